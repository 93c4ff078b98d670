"""Tables, figures and sentences about the offsets that orbits bear."""

from __future__ import annotations

import numpy as np

from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_orbits.nonlinear_stability.figures import draw_edges, draw_probabilities
from hillsphere_orbits.nonlinear_stability.products import NonlinearStability
from hillsphere_orbits.nonlinear_stability.survival import Fate
from hillsphere_orbits.qso.presentation import named

__all__ = ["present_stability"]

_ORBIT = Column("orbit", "", "orbit")
_SUMMARY = (
    _ORBIT,
    Column("x_max_km", "km", "largest |x|", 6),
    Column("y_max_km", "km", "largest |y|", 6),
    Column("z_max_km", "km", "largest |z|", 6),
    Column("radius_position_m", "m", "stability radius, position", 4),
    Column("radius_position_direction", "", "in direction"),
    Column("radius_position_fate", "", "then"),
    Column("radius_velocity_cm_s", "cm/s", "stability radius, velocity", 4),
    Column("radius_velocity_direction", "", "in direction"),
    Column("radius_velocity_fate", "", "then"),
    Column("survival", "-", "survival probability, least of the phases", 4),
    Column("survival_low", "-", "from", 4),
    Column("survival_high", "-", "to", 4),
    Column("median_loss_h", "h", "median time of loss", 4),
    Column("nearest_resonance", "", "nearest resonance"),
    Column("resonance_distance_km", "km", "its distance", 4),
)
_PROBABILITIES = (
    _ORBIT,
    Column("phase", "-", "phase of injection", 4),
    Column("draws", "-"),
    *(Column(fate.plural, "-", fate.plural) for fate in Fate),
    Column("survival", "-", "survival probability", 4),
    Column("survival_low", "-", "from", 4),
    Column("survival_high", "-", "to", 4),
    Column("median_loss_h", "h", "median time of loss", 4),
)
_EDGES = (
    _ORBIT,
    Column("direction", "", "direction"),
    *(Column(f"u{axis}", "-", f"along {axis}", 3) for axis in "xyz"),
    Column("survives_m", "m", "survives to", 4),
    Column("lost_m", "m", "lost at", 4),
    Column("survives_cm_s", "cm/s", "survives to", 4),
    Column("lost_cm_s", "cm/s", "lost at", 4),
    Column("fate", "", "then"),
    Column("time_h", "h", "after", 4),
)
_OFFSETS = (
    _ORBIT,
    *(Column(f"d{axis}_m", "m", f"Δ{axis}", 5) for axis in "xyz"),
    *(Column(f"dv{axis}_cm_s", "cm/s", f"Δv{axis}", 5) for axis in "xyz"),
    Column("fate", "", "fate"),
    Column("time_h", "h", "lost after", 5),
)
_NEARBY = (
    _ORBIT,
    Column("plane", "", "plane"),
    Column("resonance", "", "d:n"),
    Column("x0_km", "km", "x of the resonant orbit", 7),
    Column("distance_km", "km", "distance", 4),
    Column("vy_offset_cm_s", "cm/s", "Δẏ that reaches its Jacobi constant", 4),
)
_HOUR = 3600.0


def present_stability(product: NonlinearStability, label: str) -> Presentation:
    """Show what was flown.

    Parameters
    ----------
    product : NonlinearStability
        What is shown.
    label : str
        Appended to all identifiers.

    Returns
    -------
    Presentation
        Tables ``nonlinear_stability``, ``survival_probability``, ``survival_edges``,
        ``nearby_resonances`` and, if any were asked for, ``offset_fates``; figures
        ``survival_edges`` and ``survival_probability``.
    """
    rule, errors = rule_of(product), _errors(product)
    days = product.duration_s / 86400.0
    tables = {
        "nonlinear_stability": Table(
            f"Nonlinear stability over {days:g} days", _SUMMARY, _summary(product),
            [rule, _search(product), errors, _REACH_NOTE],
        ),
        "survival_probability": Table(
            "Survival of injection errors", _PROBABILITIES, _probabilities(product), [rule, errors]
        ),
        "survival_edges": Table(
            "First losses by direction", _EDGES, _edges(product), [rule, _search(product)]
        ),
        "nearby_resonances": Table(
            "Resonances near the orbits", _NEARBY, _nearby(product), [_REACH_NOTE]
        ),
    }  # fmt: skip
    if product.offset.shape[1]:
        tables["offset_fates"] = Table(
            "Fates of given offsets", _OFFSETS, _offsets(product), [rule]
        )
    figures = {
        "survival_edges": Figure(
            "Offsets that the orbits bear",
            lambda figure: draw_edges(figure, product),
            f"First losses by direction within {days:g} days; an arrow: not lost at the largest "
            "offset tried. Dashed: one standard deviation of the injection error.",
            size_in=(9.0, 1.8 + 0.32 * max(4, len(product.labels))),
        ),
        "survival_probability": Figure(
            f"Survival over {days:g} days",
            lambda figure: draw_probabilities(figure, product),
            f"Share of {product.draws} draws that survive, with {100 * product.confidence:g} % "
            "intervals.",
            size_in=(8.0, 1.8 + 0.32 * max(4, len(product.labels))),
        ),
    }
    metrics = {"survival_flights": Metric(product.flights)}
    if np.isfinite(product.drift):
        metrics["survival_integral_drift"] = Metric(product.drift)
    return Presentation(
        metrics={named(name, label): metric for name, metric in metrics.items()},
        tables={named(name, label): table for name, table in tables.items()},
        figures={named(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


_REACH_NOTE = (
    "A resonance d:n is met where the stability index of its plane is 2 cos(2π d/n). The change "
    "of ẏ is the one at the start that gives the orbit the Jacobi constant of the resonant one: "
    "the size of offset at which the resonance begins to act, not an edge."
)


def rule_of(product: NonlinearStability) -> str:
    """Say when a flight counts as lost."""
    planar = np.isinf(product.limit_m[2])
    axes = "|x| or |y|" if planar.all() else "|x|, |y| or |z|"
    if planar.any() and not planar.all():
        axes += " (planar orbits, to a twentieth of their extent: |x| or |y|)"
    surface = ", or meets the surface of the body" if product.has_surface else ""
    return (
        f"An orbit is lost if within {product.duration_s / 86400.0:g} days it goes beyond "
        f"{product.limit:g} times its own largest {axes}{surface}. Another rule changes the "
        "hours rather than the verdicts."
    )


def _search(product: NonlinearStability) -> str:
    return (
        "The radius is the least over the directions tried of the offset before the first loss, "
        f"which is searched with the largest offset halved {product.doublings} times and upwards, "
        f"then with {product.scan} equal parts of what lies below, then to a sixteenth of the gap. "
        "Edges are fractal: losses in tongues thinner than that may lie below, and survivors "
        "beyond."
    )


def _errors(product: NonlinearStability) -> str:
    return (
        f"Injection errors are Gaussian, σ = {product.sigma_position_m:g} m and "
        f"{100.0 * product.sigma_velocity_m_s:g} cm/s per axis, {product.draws} draws per orbit "
        f"and phase; intervals are those of Clopper and Pearson, {100 * product.confidence:g} %."
    )


def _number(value: float, factor: float = 1.0) -> float | None:
    return float(value * factor) if np.isfinite(value) else None


def _fate(product: NonlinearStability, member: int, direction: int) -> str:
    if np.isinf(product.lost[member, direction]):
        return "not lost"
    return Fate(int(product.lost_fate[member, direction])).text


def _summary(product: NonlinearStability) -> list[dict[str, Cell]]:
    place, speed = product.weakest(velocity=False), product.weakest(velocity=True)
    share = product.counts[Fate.SURVIVES] / product.draws
    rows: list[dict[str, Cell]] = []
    for i, name in enumerate(product.labels):
        worst = int(np.argmin(share[i]))
        p, v = int(place[i]), int(speed[i])
        row: dict[str, Cell] = {"orbit": name}
        for axis, amplitude in zip("xyz", product.amplitude_m[:, i], strict=True):
            row[f"{axis}_max_km"] = float(amplitude / 1e3)
        row |= {
            "radius_position_m": float(product.survived[i, p]),
            "radius_position_direction": product.directions[p],
            "radius_position_fate": _fate(product, i, p),
            "radius_velocity_cm_s": float(100.0 * product.survived[i, v]),
            "radius_velocity_direction": product.directions[v],
            "radius_velocity_fate": _fate(product, i, v),
            "survival": float(share[i, worst]),
            "survival_low": float(product.low[i, worst]),
            "survival_high": float(product.high[i, worst]),
            "median_loss_h": _number(product.median_loss_s[i, worst], 1.0 / _HOUR),
        }
        near = np.flatnonzero(product.near_member == i)
        if near.size:
            k = int(near[0])
            row["nearest_resonance"] = (
                f"{product.near_plane[k]} {product.near_d[k]}:{product.near_n[k]}"
            )
            row["resonance_distance_km"] = float(product.near_distance_m[k] / 1e3)
        rows.append(row)
    return rows


def _probabilities(product: NonlinearStability) -> list[dict[str, Cell]]:
    return [
        {
            "orbit": name,
            "phase": float(phase),
            "draws": product.draws,
            **{fate.plural: int(product.counts[fate, i, k]) for fate in Fate},
            "survival": float(product.counts[Fate.SURVIVES, i, k] / product.draws),
            "survival_low": float(product.low[i, k]),
            "survival_high": float(product.high[i, k]),
            "median_loss_h": _number(product.median_loss_s[i, k], 1.0 / _HOUR),
        }
        for i, name in enumerate(product.labels)
        for k, phase in enumerate(product.phases)
    ]


def _edges(product: NonlinearStability) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for i, name in enumerate(product.labels):
        for k, direction in enumerate(product.directions):
            vector = product.direction[:, k]
            is_velocity = bool(vector[3:].any())
            unit, factor = ("cm_s", 100.0) if is_velocity else ("m", 1.0)
            part = vector[3:] if is_velocity else vector[:3]
            rows.append(
                {
                    "orbit": name,
                    "direction": direction,
                    **{f"u{axis}": float(u) for axis, u in zip("xyz", part, strict=True)},
                    f"survives_{unit}": float(product.survived[i, k] * factor),
                    f"lost_{unit}": _number(product.lost[i, k], factor),
                    "fate": _fate(product, i, k),
                    "time_h": _number(product.lost_time_s[i, k], 1.0 / _HOUR),
                }
            )
    return rows


def _offsets(product: NonlinearStability) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for i, name in enumerate(product.labels):
        for k, offset in enumerate(product.offset.T):
            fate = Fate(int(product.offset_fate[i, k]))
            row: dict[str, Cell] = {"orbit": name, "fate": fate.text}
            for j, axis in enumerate("xyz"):
                row[f"d{axis}_m"] = float(offset[j])
                row[f"dv{axis}_cm_s"] = float(100.0 * offset[3 + j])
            if fate is not Fate.SURVIVES:
                row["time_h"] = float(product.offset_time_s[i, k] / _HOUR)
            rows.append(row)
    return rows


def _nearby(product: NonlinearStability) -> list[dict[str, Cell]]:
    return [
        {
            "orbit": product.labels[int(i)],
            "plane": product.near_plane[k],
            "resonance": f"{product.near_d[k]}:{product.near_n[k]}",
            "x0_km": float(product.near_x_m[k] / 1e3),
            "distance_km": float(product.near_distance_m[k] / 1e3),
            "vy_offset_cm_s": _number(product.near_vy_offset_m_s[k], 100.0),
        }
        for k, i in enumerate(product.near_member)
    ]


def _verdict(product: NonlinearStability) -> list[str]:
    days, sentences = product.duration_s / 86400.0, []
    share = np.min(product.counts[Fate.SURVIVES], axis=1) / product.draws
    risky = [
        f"{name} ({100 * p:.3g} %)"
        for name, p in zip(product.labels, share, strict=True)
        if p < 1.0
    ]
    if risky:
        sentences.append(f"Injection errors lose within {days:g} days, survivors in brackets: "
                         f"{', '.join(risky)}.")  # fmt: skip
    else:
        sentences.append(f"No drawn injection error loses any of these orbits in {days:g} days.")
    unheld = [
        name
        for name, fate in zip(product.labels, product.reference_fate, strict=True)
        if fate != Fate.SURVIVES
    ]
    if unheld:
        sentences.append(
            f"Lost without any offset but rounding, so that their radius is zero: "
            f"{', '.join(unheld)}."
        )
    return sentences
