"""Presentation of a synthesis: tables of norms and margins, figures, verdict."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Metric, Presentation, Table
from hillsphere.show.tables import (
    FieldColumns,
    FilledColumn,
    column,
    finite_or_blank,
    tabulate,
    text_column,
)
from hillsphere_controllers.stages.synthesis.figures import (
    gain_chart,
    iteration_chart,
    loop_step_chart,
    start_chart,
)
from hillsphere_controllers.stages.synthesis.products import Iterations, Synthesis
from hillsphere_controllers.stages.synthesis.search_tables import (
    search_metrics,
    search_tables,
    start_sentences,
    worst_sentence,
)
from hillsphere_controllers.stages.table_cells import finite_fields

__all__ = ["present_synthesis"]

_LISTED = 60
"""Rows of a table at most; all values are in the product."""
_CHECK = 1e-6
"""Relative excess of a sampled gain over the proved bound of the H∞ norm that is rounding of the
response."""
_SAME = 1e-3
"""Searches whose γ differ by less than 0.1 % count as ending at the same value."""
_UNSURE = 0.01
"""Relative error by rounding from which on the H∞ norm is reported as uncertain."""


def present_synthesis(product: Synthesis, duration_s: float | None) -> Presentation:
    """Return tables, figures and sentences of a controller.

    Parameters
    ----------
    product : Synthesis
        The controller and its closed loops.
    duration_s : float or None
        Length of the step responses.
    """
    judged = product.judged
    stable = np.isfinite(judged.hinf)
    metrics = {
        # of a µ synthesis a certified upper bound: above a limit, it refutes nothing
        "synthesis_gamma": Metric(product.gamma, "-", (0.0, product.gamma), 1.0)
        if product.norm == "mu"
        else Metric(product.gamma),
        "synthesis_order": Metric(product.controller.order),
        "synthesis_models_stable": Metric(int(np.count_nonzero(stable))),
    }
    if product.lower_bound > 0.0:
        metrics["synthesis_lower_bound"] = Metric(product.lower_bound)
    tables = {
        "synthesis_loops": _norms(product),
        "synthesis_margins": _margins(product),
        "synthesis_controller": _controller(product),
    }
    figures = {}
    if stable.any():
        figures["synthesis_gains"] = gain_chart(product, "synthesis_loops")
        figures["synthesis_steps"] = loop_step_chart(product, duration_s, "synthesis_loops")
    if product.search is not None:
        figures["synthesis_starts"] = start_chart(product, "synthesis_searches")
        metrics["synthesis_residual"] = Metric(product.search.residual)
        metrics |= search_metrics(product.search)
        tables |= search_tables(product.search, _names(product))
    if product.iterations is not None:
        tables["synthesis_iterations"] = _iterations(product.iterations)
        figures["synthesis_iterations"] = iteration_chart(
            product.iterations, "synthesis_iterations"
        )
    return Presentation(metrics, tables, figures, _verdict(product))


def _names(product: Synthesis) -> tuple[str, ...]:
    """Return the names of the plants that the controller was made for."""
    robust = None if product.search is None else product.search.robust
    if robust is not None:
        return robust.labels
    return tuple(label for label, own in zip(product.labels, product.designed, strict=True) if own)


def _norms(product: Synthesis) -> Table:
    of = FieldColumns(
        finite_fields(
            product.judged,
            "hinf", "hinf_upper", "hinf_error", "sampled", "h2", "abscissa_1_s", "damping", "disk",
        ),
        "models",
    )  # fmt: skip
    columns = [
        text_column("model", product.labels, "model"),
        text_column("designed", product.designed, "made for it"),
        text_column("stable", np.isfinite(product.judged.hinf), "stable"),
        *map(of, ("hinf", "hinf_upper", "peak_rad_s", "hinf_error", "sampled", "h2")),
        *map(of, ("abscissa_1_s", "damping", "disk")),
    ]
    return tabulate("Closed loops", columns, _notes(product)).first(_LISTED, "models")


def _margins(product: Synthesis) -> Table:
    judged, plant = product.judged, product.plants[0]
    p, m = plant.shape
    own_inputs = plant.inputs[m - product.controls :] or tuple(
        f"control {i}" for i in range(product.controls)
    )
    own_outputs = plant.outputs[p - product.measurements :] or tuple(
        f"measurement {i}" for i in range(product.measurements)
    )
    places = (*own_inputs, *own_outputs)
    of = FieldColumns(judged, "models", "loops")
    lower = np.where(judged.gain_lower > 0.0, judged.gain_lower, np.nan)
    phase = np.where(judged.phase_rad < np.pi, judged.phase_rad, np.nan)

    def margin(name: str, values: Array, label: str, unit: str | None = None) -> FilledColumn:
        return column(name, of.spread(values, "loops", "models"), label, 4, unit=unit)

    def decibels(gains: Array) -> Array:
        return 20.0 * np.log10(gains)

    columns = [
        text_column("model", of.spread(product.labels, "models"), "model"),
        text_column("place", of.spread(places, "loops"), "loop broken at"),
        margin("gain_lower_db", decibels(lower), "gain may fall by", "dB"),
        margin(
            "gain_upper_db", decibels(finite_or_blank(judged.gain_upper)), "gain may rise by", "dB"
        ),
        margin("phase_deg", phase, "phase margin"),
        margin("delay_s", finite_or_blank(judged.delay_s), "delay margin"),
    ]
    note = (
        "One loop changes at a time, the others stay as they are. A blank cell means an unbounded "
        "margin."
    )
    table = tabulate("Margins of single loops", columns, (note,))
    return table.first(_LISTED * len(places))


def _controller(product: Synthesis) -> Table:
    poles = np.array(sorted(product.controller.poles.tolist(), key=abs), dtype=complex)
    columns = [
        column("pole_re_1_s", poles.real, "real part", 6),
        column("pole_im_rad_s", poles.imag, "imaginary part", 6),
        column("size_rad_s", [abs(pole) for pole in poles.tolist()], "size", 6),
    ]
    note = "The matrices of the controller are in the stage's product."
    title = f"Poles of the controller, order {poles.size}"
    return tabulate(title, columns, (note,)).first(_LISTED)


def _iterations(found: Iterations) -> Table:
    of = FieldColumns(finite_fields(found, "upper", "gamma"), "steps")
    columns = [
        column("step", range(len(found.kinds)), "step"),
        of("kinds", "kind"),
        *map(of, ("upper", "gamma", "peak_rad_s", "scaling_order", "controller_order")),
        of("accepted"),
        of("refusals", "refusal"),
    ]
    return tabulate("Steps of the µ synthesis", columns, (f"It ended: {found.reason}.",))


def _notes(product: Synthesis) -> list[str]:
    notes = ["The norms are of the whole transfer from all disturbances to all weighted signals."]
    if product.search is not None:
        notes.append(
            "γ is the largest weighted norm of the design's channels, which may be parts of it."
        )
    return notes


def _verdict(product: Synthesis) -> list[str]:
    judged, count = product.judged, len(product.labels)
    stable = int(np.count_nonzero(np.isfinite(judged.hinf)))
    order = product.controller.order
    norm = {"h2": "H2 norm", "mu": "certified µ"}.get(product.norm, "γ")
    bound = (
        f" (lower bound for any order: {product.lower_bound:.6g})"
        if product.lower_bound > 0.0
        else ""
    )
    said = [
        f"The controller ({product.method}, order {order}) reaches {norm} = {product.gamma:.6g}"
        f"{bound}, computed from the closed loops. It stabilises {stable} of {count} "
        f"model{'' if count == 1 else 's'}."
    ]
    if product.added:
        said.append(
            f"For the synthesis alone the problem was regularised ({product.added}); γ is that of "
            "the models without."
        )
    if (over := judged.sampled > judged.hinf_upper * (1.0 + _CHECK)).any():
        said.append(
            f"For {int(over.sum())} models a sampled gain exceeds the bound of the H∞ norm: these "
            "norms are wrong; scale the models."
        )
    if (unsure := np.isfinite(judged.hinf) & ~(judged.hinf_error <= _UNSURE)).any():
        said.append(
            f"Rounding may change the H∞ norm of {int(unsure.sum())} closed loops by more than "
            f"{100.0 * _UNSURE:g} %: scale the models' states, or remove very slow and fast modes. "
            "Of a synthesis of full order γ is then the upper bound."
        )
    if product.search is not None:
        search = product.search
        said += worst_sentence(search)
        said += start_sentences(search)
        found = np.concatenate([search.starts, search.shaken])
        best = min(product.gamma, float(found.min(initial=np.inf)))
        same = int(np.count_nonzero(found <= best * (1.0 + _SAME)))
        among = (
            f"{same} of {found.size} searches, {search.starts.size} from starts and "
            f"{search.shaken.size} from near the best, end within 0.1 % of the best γ."
            if found.size > 1
            else "There was one search only."
        )
        said.append(
            f"{among} By its gradients the result is "
            f"{'' if search.converged else 'not shown to be '}a local minimum (residual "
            f"{search.residual:.2g}, {search.active} active peaks and constraints)."
        )
        if not search.converged:
            said.append(
                "The residual stays large if the gain is constant over a range of frequencies, or "
                "if gains grow without bound: compare γ with its bound, or use more starts."
            )
    return said
