"""Figures of a controller: gains against the inverse weights, step responses, searches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.step_responses import step_responses
from hillsphere_controllers.stages.synthesis.evaluation import inner_plant
from hillsphere_controllers.stages.synthesis.products import Iterations, Synthesis
from hillsphere_controllers.stages.synthesis.step_panels import (
    LARGEST_GRID,
    draw_each_response,
    draw_each_step,
)
from hillsphere_controllers.systems.algebra import feedback, gain, lower_lft, series

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_gains", "draw_iterations", "draw_starts", "draw_steps"]

Complex = NDArray[np.complex128]

_DRAWN = 12
"""Plants drawn at most, evenly spaced among the stable loops."""
_NAMED = 6
"""Curves with a colour and a legend entry each at most; more curves could not be told apart."""
_ALLOWED = "#555555"


def draw_gains(figure: Figure, product: Synthesis) -> None:
    """Draw the gain from all disturbances to each weighted signal, and its inverse weight."""
    chosen = _select_plants(product)
    loops = [lower_lft(product.plants[k], product.controller) for k in chosen]
    omega = frequencies([*loops, *product.weights])
    responses = [loop.response(omega) for loop in loops]
    outputs = loops[0].outputs
    weighted = {name for weight in product.weights for name in weight.outputs}
    rest = [i for i, name in enumerate(outputs) if name not in weighted] if outputs else []
    if not outputs:
        rest = list(range(loops[0].shape[0]))
    panels = len(product.weights) + bool(rest)
    grid = figure.subplots(panels, 1, squeeze=False, sharex=True)[:, 0]
    for axes, weight in zip(grid, product.weights, strict=False):
        rows = [outputs.index(name) for name in weight.outputs]
        across = weight.response(omega)
        before = [_gains_before_weight(across, response[:, rows]) for response in responses]
        _draw_lines(axes, omega, before, product, chosen)
        least = np.linalg.svd(across, compute_uv=False)[:, -1]
        allowed = 1.0 / np.where(least > 0.0, least, np.nan)
        axes.loglog(omega, product.gamma * allowed, color=_ALLOWED, ls="--", label="allowed for γ")
        axes.loglog(omega, allowed, color=_ALLOWED, ls=":", label="allowed for γ = 1")
        axes.set_ylabel(f"gain to {_shorten(weight.inputs)}")
    if rest:
        gains = [largest_gains(response[:, rest]) for response in responses]
        _draw_lines(grid[-1], omega, gains, product, chosen)
        grid[-1].axhline(product.gamma, color=_ALLOWED, ls="--", label="allowed for γ")
        grid[-1].set_ylabel(f"gain to {_shorten(tuple(outputs[i] for i in rest)) or 'all outputs'}")
    grid[-1].set_xlabel("frequency (rad/s)")
    grid[0].legend(fontsize=8)


def draw_steps(figure: Figure, product: Synthesis, duration_s: float | None) -> None:
    """Draw the responses of all measured outputs to steps of their commands."""
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
        (response, _colour(place, len(chosen)), product.labels[index] if several else "")
        for place, (index, response) in enumerate(zip(chosen, responses, strict=True))
    ]
    draw = draw_each_response if q <= LARGEST_GRID else draw_each_step
    draw(figure, times, lines, names)


def draw_starts(figure: Figure, product: Synthesis) -> None:
    """Draw γ of all searches in rising order."""
    from matplotlib.ticker import MaxNLocator

    assert product.search is not None
    axes = figure.add_subplot()
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    for gammas, label, marker, colour in (
        (product.search.starts, "from different starts", ".", PALETTE["blue"]),
        (product.search.shaken, "from near the best", "s", PALETTE["vermillion"]),
    ):
        rising = np.sort(gammas[np.isfinite(gammas)])
        if rising.size:
            place = np.arange(1, rising.size + 1)
            axes.plot(place, rising, marker, color=colour, mfc="none", ms=9, label=label)
    lost = int(np.count_nonzero(~np.isfinite(product.search.starts)))
    if product.lower_bound > 0.0:
        axes.axhline(product.lower_bound, color=_ALLOWED, ls="--", label="bound for any controller")
    axes.set_yscale("log")
    axes.set_xlabel("search, by what it found" + (f" ({lost} found nothing)" if lost else ""))
    axes.set_ylabel("γ")
    axes.legend()


def draw_iterations(figure: Figure, iterations: Iterations) -> None:
    """Draw the certified bound over the steps."""
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_subplot()
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    step = np.arange(iterations.upper.size)
    seen = np.isfinite(iterations.upper)
    axes.plot(
        step[iterations.accepted], iterations.upper[iterations.accepted], "-", color=PALETTE["blue"]
    )
    for chosen, face, label in (
        (seen & iterations.accepted, PALETTE["blue"], "accepted"),
        (seen & ~iterations.accepted, "none", "refused"),
    ):
        if chosen.any():
            axes.plot(step[chosen], iterations.upper[chosen], "o", mec=PALETTE["blue"], mfc=face,
                      label=label)  # fmt: skip
    axes.axhline(1.0, color=_ALLOWED, ls=":", lw=1.2)
    axes.set_xlabel("step")
    axes.set_ylabel("certified bound of µ")
    axes.legend()


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


def _draw_lines(
    axes: Axes, omega: Array, gains: list[Array], product: Synthesis, chosen: list[int]
) -> None:
    for place, (index, one) in enumerate(zip(chosen, gains, strict=True)):
        label = product.labels[index] if len(chosen) <= _NAMED else None
        axes.loglog(omega, one, color=_colour(place, len(chosen)), lw=1.4, label=label)


def _colour(place: int, count: int) -> str:
    colours = [c for name, c in PALETTE.items() if name != "yellow"]
    return colours[place % len(colours)] if count <= _NAMED else PALETTE["blue"]


def _shorten(names: tuple[str, ...]) -> str:
    stems = list(dict.fromkeys(name.partition("[")[0].partition("(")[0] for name in names))
    return ", ".join(stems)
