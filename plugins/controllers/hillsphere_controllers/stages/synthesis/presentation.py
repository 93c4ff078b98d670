"""Presentation of a synthesis: tables of norms and margins, figures, verdict."""

from __future__ import annotations

from functools import partial

import numpy as np

from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_controllers.stages.synthesis.figures import (
    draw_gains,
    draw_iterations,
    draw_starts,
    draw_steps,
)
from hillsphere_controllers.stages.synthesis.products import Iterations, Synthesis
from hillsphere_controllers.stages.synthesis.search_tables import (
    search_metrics,
    search_tables,
    start_sentences,
    worst_sentence,
)
from hillsphere_controllers.stages.synthesis.step_panels import size_of_steps_in

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
_NORMS = (
    Column("model", "", "model"),
    Column("designed", "", "made for it"),
    Column("stable", "", "stable"),
    Column("hinf", "-", "H∞ norm", 6),
    Column("hinf_upper", "-", "its bound from above", 6),
    Column("peak_rad_s", "rad/s", "reached at", 4),
    Column("hinf_error", "-", "rounding of the norm, relative", 2),
    Column("sampled", "-", "largest gain sampled", 6),
    Column("h2", "-", "H2 norm", 6),
    Column("abscissa_1_s", "1/s", "largest real part of the poles", 4),
    Column("damping", "-", "least damping", 3),
    Column("disk", "-", "disk margin α, both ends", 4),
)
_MARGINS = (
    Column("model", "", "model"),
    Column("place", "", "loop broken at"),
    Column("gain_lower_db", "dB", "gain may fall by", 4),
    Column("gain_upper_db", "dB", "gain may rise by", 4),
    Column("phase_deg", "deg", "phase margin", 4),
    Column("delay_s", "s", "delay margin", 4),
)


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
        "synthesis_gamma": Metric(product.gamma),
        "synthesis_order": Metric(product.controller.order),
        "synthesis_models_stable": Metric(int(np.count_nonzero(stable))),
    }
    if product.lower_bound > 0.0:
        metrics["synthesis_lower_bound"] = Metric(product.lower_bound)
    tables = {
        "synthesis_loops": Table("Closed loops", _NORMS, _norm_rows(product), _notes(product)),
        "synthesis_margins": Table(
            "Margins of single loops",
            _MARGINS,
            _margin_rows(product),
            ("One loop changes at a time, the others stay as they are. A blank cell means an "
             "unbounded margin.",),
        ),
        "synthesis_controller": _controller(product),
    }  # fmt: skip
    figures = {}
    if stable.any():
        figures["synthesis_gains"] = Figure(
            "Closed loops against the inverse weights",
            partial(draw_gains, product=product),
            "Largest singular value from all disturbances to each weighted signal before its "
            "weight, and what the weight allows for the γ reached (dashed) and for γ = 1 (dotted).",
            size_in=(7.0, 0.6 + 2.7 * _panels(product)),
        )
        figures["synthesis_steps"] = Figure(
            "Step responses",
            partial(draw_steps, product=product, duration_s=duration_s),
            "Responses of the plant's outputs to a step of each command in turn, in the units of "
            "the measurements; where these are many, the outputs not commanded are grey.",
            size_in=size_of_steps_in(product.measurements),
        )
    if product.search is not None:
        figures["synthesis_starts"] = Figure(
            "Results of the searches",
            partial(draw_starts, product=product),
            "γ of every search, sorted; the line is the lower bound for any controller.",
        )
        metrics["synthesis_residual"] = Metric(product.search.residual)
        metrics |= search_metrics(product.search)
        tables |= search_tables(product.search, _names(product))
    if product.iterations is not None:
        tables["synthesis_iterations"] = _iterations(product.iterations)
        figures["synthesis_iterations"] = Figure(
            "µ over the steps",
            partial(draw_iterations, found=product.iterations),
            "Certified bound of every step's controller; filled: accepted.",
        )
    return Presentation(metrics, tables, figures, _verdict(product))


def _names(product: Synthesis) -> tuple[str, ...]:
    """Return the names of the plants that the controller was made for."""
    robust = None if product.search is None else product.search.robust
    if robust is not None:
        return robust.labels
    return tuple(label for label, own in zip(product.labels, product.designed, strict=True) if own)


def _panels(product: Synthesis) -> int:
    weighted = {name for weight in product.weights for name in weight.outputs}
    outputs = product.plants[0].outputs[: product.plants[0].shape[0] - product.measurements]
    return len(product.weights) + int(not outputs or not set(outputs) <= weighted)


def _frequency(value: float) -> float | None:
    return None if np.isnan(value) else float(value)  # a peak may lie at infinite frequency


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _norm_rows(product: Synthesis) -> list[dict[str, Cell]]:
    judged = product.judged
    return [
        {
            "model": label,
            "designed": bool(product.designed[k]),
            "stable": bool(np.isfinite(judged.hinf[k])),
            "hinf": _finite(judged.hinf[k]),
            "hinf_upper": _finite(judged.hinf_upper[k]),
            "peak_rad_s": _frequency(judged.peak_rad_s[k]),
            "hinf_error": _finite(judged.hinf_error[k]),
            "sampled": _finite(judged.sampled[k]),
            "h2": _finite(judged.h2[k]),
            "abscissa_1_s": _finite(judged.abscissa_1_s[k]),
            "damping": _finite(judged.damping[k]),
            "disk": _finite(judged.disk[k]),
        }
        for k, label in enumerate(product.labels[:_LISTED])
    ]


def _margin_rows(product: Synthesis) -> list[dict[str, Cell]]:
    judged, plant = product.judged, product.plants[0]
    p, m = plant.shape
    own_inputs = plant.inputs[m - product.controls :] or tuple(
        f"control {i}" for i in range(product.controls)
    )
    own_outputs = plant.outputs[p - product.measurements :] or tuple(
        f"measurement {i}" for i in range(product.measurements)
    )
    rows: list[dict[str, Cell]] = []
    for k, label in enumerate(product.labels[:_LISTED]):
        for place, name in enumerate((*own_inputs, *own_outputs)):
            lower, upper = judged.gain_lower[place, k], judged.gain_upper[place, k]
            phase, delay = judged.phase_rad[place, k], judged.delay_s[place, k]
            rows.append(
                {
                    "model": label,
                    "place": name,
                    "gain_lower_db": 20.0 * float(np.log10(lower)) if lower > 0.0 else None,
                    "gain_upper_db": 20.0 * float(np.log10(upper)) if upper < np.inf else None,
                    "phase_deg": float(np.degrees(phase)) if phase < np.pi else None,
                    "delay_s": _finite(delay),
                }
            )
    return rows


def _controller(product: Synthesis) -> Table:
    poles = sorted(product.controller.poles.tolist(), key=abs)
    rows: list[dict[str, Cell]] = [
        {"pole_re_1_s": pole.real, "pole_im_rad_s": pole.imag, "size_rad_s": abs(pole)}
        for pole in poles[:_LISTED]
    ]
    columns = (
        Column("pole_re_1_s", "1/s", "real part", 6),
        Column("pole_im_rad_s", "rad/s", "imaginary part", 6),
        Column("size_rad_s", "rad/s", "size", 6),
    )
    note = "The matrices of the controller are in the stage's product."
    return Table(f"Poles of the controller, order {len(poles)}", columns, rows, (note,))


def _iterations(found: Iterations) -> Table:
    rows: list[dict[str, Cell]] = [
        {
            "step": k,
            "kind": kind,
            "upper": _finite(found.upper[k]),
            "gamma": _finite(found.gamma[k]),
            "peak_rad_s": _frequency(found.peak_rad_s[k]),
            "scaling_order": int(found.scaling_order[k]),
            "controller_order": int(found.controller_order[k]),
            "accepted": bool(found.accepted[k]),
            "refusal": found.refusals[k],
        }
        for k, kind in enumerate(found.kinds)
    ]
    columns = (
        Column("step", "-", "step"),
        Column("kind", "", "what was done"),
        Column("upper", "-", "µ, certified", 6),
        Column("gamma", "-", "norm of the scaled loop", 6),
        Column("peak_rad_s", "rad/s", "largest at", 4),
        Column("scaling_order", "-", "order of the scalings"),
        Column("controller_order", "-", "order of the controller"),
        Column("accepted", "", "accepted"),
        Column("refusal", "", "why not"),
    )
    return Table("Steps of the µ synthesis", columns, rows, (f"It ended: {found.reason}.",))


def _notes(product: Synthesis) -> list[str]:
    notes = ["The norms are of the whole transfer from all disturbances to all weighted signals."]
    if product.search is not None:
        notes.append(
            "γ is the largest weighted norm of the design's channels, which may be parts of it."
        )
    if len(product.labels) > _LISTED:
        notes.append(f"The first {_LISTED} of {len(product.labels)} models.")
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
    if (over := judged.sampled > judged.hinf_upper * (1.0 + _CHECK)).any():
        said.append(
            f"For {int(over.sum())} models a sampled gain exceeds the bound of the H∞ norm: these "
            "norms are wrong; scale the models."
        )
    if (unsure := np.isfinite(judged.hinf) & ~(judged.hinf_error <= _UNSURE)).any():
        said.append(
            f"Rounding may change the H∞ norm of {int(unsure.sum())} closed loops by more than "
            f"{100.0 * _UNSURE:g} %: scale the models' states, or remove very slow and fast modes."
        )
    if product.search is not None:
        search = product.search
        said += worst_sentence(search)
        said += start_sentences(search)
        found = np.concatenate([search.starts, search.shaken])
        same = int(np.count_nonzero(found <= found.min() * (1.0 + _SAME)))
        among = (
            f"{same} of {found.size} searches, {search.starts.size} from starts and "
            f"{search.shaken.size} from near the best, end within 0.1 % of the best γ (the best "
            "included)."
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
