"""Figures of a controller: gains against the inverse weights, step responses, searches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Curve,
    Mark,
    MarkerShape,
    Panel,
    Points,
    Rule,
)
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.step_responses import step_responses
from hillsphere_controllers.stages.synthesis.evaluation import inner_plant
from hillsphere_controllers.stages.synthesis.products import Iterations, Synthesis
from hillsphere_controllers.stages.synthesis.step_panels import step_chart
from hillsphere_controllers.stages.table_cells import whole_step
from hillsphere_controllers.systems.algebra import feedback, gain, lower_lft, series

__all__ = ["gain_chart", "iteration_chart", "loop_step_chart", "start_chart"]

Complex = NDArray[np.complex128]

_DRAWN = 12
"""Plants drawn at most, evenly spaced among the stable loops."""
_NAMED = 6
"""Curves with a colour and a legend entry each at most; more curves could not be told apart."""
_FREQUENCY = Axis("frequency", "rad/s", scale="log")


def gain_chart(product: Synthesis, table: str) -> Chart:
    """Return the gain from all disturbances to each weighted signal, and its inverse weight.

    The rows of `table` are the plants.
    """
    chosen = _select_plants(product)
    loops = [lower_lft(product.plants[k], product.controller) for k in chosen]
    omega = frequencies([*loops, *product.weights])
    responses = [loop.response(omega) for loop in loops]
    outputs = loops[0].outputs
    weighted = {name for weight in product.weights for name in weight.outputs}
    rest = [i for i, name in enumerate(outputs) if name not in weighted] if outputs else []
    if not outputs:
        rest = list(range(loops[0].shape[0]))

    def panel(signals: tuple[str, ...], gains: list[Array], limits: list[Mark]) -> Panel:
        curves = [
            Curve(omega, values, product.labels[k] if len(chosen) <= _NAMED else "",
                  _colour(place, len(chosen)), width=1.4, rows=k)
            for place, (k, values) in enumerate(zip(chosen, gains, strict=True))
        ]  # fmt: skip
        signal = Axis(f"gain to {_shorten(signals) or 'all outputs'}", scale="log")
        return Panel(_FREQUENCY, signal, [*curves, *limits], legend="none" if panels else "best")

    panels: list[Panel] = []
    for weight in product.weights:
        rows = [outputs.index(name) for name in weight.outputs]
        across = weight.response(omega)
        before = [_gains_before_weight(across, response[:, rows]) for response in responses]
        least = np.linalg.svd(across, compute_uv=False)[:, -1]
        allowed = 1.0 / np.where(least > 0.0, least, np.nan)
        limits: list[Mark] = [
            Curve(omega, product.gamma * allowed, "allowed for γ", "grey", "dashed"),
            Curve(omega, allowed, "allowed for γ = 1", "grey", "dotted"),
        ]
        panels.append(panel(weight.inputs, before, limits))
    if rest:
        gains = [largest_gains(response[:, rest]) for response in responses]
        signals = tuple(outputs[i] for i in rest) if outputs else ()
        limit = Rule("y", product.gamma, "allowed for γ", dash="dashed", width=1.6)
        panels.append(panel(signals, gains, [limit]))
    return Chart(
        "Closed loops against the inverse weights",
        panels,
        "Largest singular value from all disturbances to each weighted signal before its weight, "
        "and what the weight allows for the γ reached (dashed) and for γ = 1 (dotted).",
        share_x=True,
        size_in=(7.0, 0.6 + 2.7 * len(panels)),
        table=table,
    )


def loop_step_chart(product: Synthesis, duration_s: float | None, table: str) -> Chart:
    """Return the responses of all measured outputs to steps of their commands.

    The rows of `table` are the plants.
    """
    chosen = _select_plants(product)
    k = product.controller
    negative = series(k, gain(-np.eye(k.shape[0]), k.dt_s))
    loops = []
    for index in chosen:
        through = series(negative, inner_plant(product.plants[index], k))
        loops.append(feedback(through, gain(np.eye(product.measurements), k.dt_s)))
    times, responses = step_responses(loops, duration_s)
    q = product.measurements
    names = product.plants[0].outputs[-q:] or tuple(f"measurement {i}" for i in range(q))
    several = 1 < len(chosen) <= _NAMED
    lines = [
        (response, _colour(place, len(chosen)), product.labels[index] if several else "", index)
        for place, (index, response) in enumerate(zip(chosen, responses, strict=True))
    ]
    return step_chart(times, lines, names, table)


def start_chart(product: Synthesis, table: str) -> Chart:
    """Return γ of all searches in rising order; the rows of `table` are the searches."""
    search = product.search
    assert search is not None
    marks: list[Mark] = []
    kinds: tuple[tuple[Array, int, str, MarkerShape, str], ...] = (
        (search.starts, 0, "from different starts", "circle", "blue"),
        (search.shaken, search.starts.size, "from near the best", "square", "vermillion"),
    )
    for gammas, first, name, marker, colour in kinds:
        order = np.argsort(gammas)[: np.count_nonzero(np.isfinite(gammas))]
        if order.size:
            marks.append(
                Points(np.arange(1, order.size + 1), gammas[order], name, colour, marker, 8.0,
                       is_filled=False, rows=(first + order).tolist())
            )  # fmt: skip
    lost = int(np.count_nonzero(~np.isfinite(search.starts)))
    if product.lower_bound > 0.0:
        bound = Rule("y", product.lower_bound, "bound for any controller", dash="dashed", width=1.6)
        marks.append(bound)
    label = "search, by what it found" + (f" ({lost} found nothing)" if lost else "")
    most = max(search.starts.size, search.shaken.size)
    return Chart(
        "Results of the searches",
        [Panel(Axis(label, step=whole_step(most)), Axis("γ", scale="log"), marks)],
        "γ of every search, sorted; the line is the lower bound for any controller.",
        table=table,
    )


def iteration_chart(iterations: Iterations, table: str) -> Chart:
    """Return the certified bound over the steps, which are the rows of `table`."""
    upper, accepted = iterations.upper, iterations.accepted
    step, known = np.arange(upper.size), np.isfinite(upper)
    marks: list[Mark] = [
        Curve(step[accepted], upper[accepted], "", "blue", rows=step[accepted].tolist())
    ]
    for chosen, is_filled, label in (
        (known & accepted, True, "accepted"),
        (known & ~accepted, False, "refused"),
    ):
        if chosen.any():
            marks.append(
                Points(step[chosen], upper[chosen], label, "blue", is_filled=is_filled,
                       rows=step[chosen].tolist())
            )  # fmt: skip
    return Chart(
        "µ over the steps",
        [Panel(
            Axis("step", step=whole_step(upper.size)), Axis("certified bound of µ"),
            [*marks, Rule("y", 1.0)],
        )],
        "Certified bound of every step's controller; filled: accepted.",
        table=table,
    )  # fmt: skip


def _select_plants(product: Synthesis) -> list[int]:
    stable = np.flatnonzero(np.isfinite(product.judged.hinf))
    count = min(stable.size, _DRAWN)
    return [int(stable[k]) for k in np.unique(np.linspace(0, stable.size - 1, count).astype(int))]


def _gains_before_weight(weight: Complex, response: Complex) -> Array:
    """Return the largest gains (K,) of W⁻¹ T; NaN where W is singular."""
    made = np.full(len(weight), np.nan)
    good = np.linalg.svd(weight, compute_uv=False)[:, -1] > 0.0
    before: Complex = np.linalg.solve(weight[good], response[good]).astype(complex)
    made[good] = largest_gains(before)
    return made


def _colour(place: int, count: int) -> str:
    return LINE_COLOURS[place] if count <= _NAMED else "blue"


def _shorten(names: tuple[str, ...]) -> str:
    stems = list(dict.fromkeys(name.partition("[")[0].partition("(")[0] for name in names))
    return ", ".join(stems)
