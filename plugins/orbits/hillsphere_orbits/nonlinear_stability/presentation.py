"""Tables, figures and sentences about nonlinear stability."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.constants import DAY_S
from hillsphere.presentation import Metric, Presentation
from hillsphere.show.tables import (
    FieldColumns,
    FilledColumn,
    column,
    tabulate,
    take_or_blank,
    text_column,
)
from hillsphere_orbits.nonlinear_stability.figures import edge_chart, probability_chart
from hillsphere_orbits.nonlinear_stability.products import NonlinearStability
from hillsphere_orbits.nonlinear_stability.survival import Fate
from hillsphere_orbits.qso.presentation import label_identifier

__all__ = ["present_stability"]


def present_stability(product: NonlinearStability, label: str) -> Presentation:
    """Show stability radii, survival probabilities and nearby resonances.

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
        ``nearby_resonances`` and, if offsets were given, ``offset_fates``; figures
        ``survival_edges`` and ``survival_probability``.
    """
    rule, errors = rule_of(product), _errors(product)
    days = product.duration_s / DAY_S
    tables = {
        "nonlinear_stability": tabulate(
            f"Nonlinear stability over {days:g} days", _summary(product),
            [rule, _search(product), errors, _REACH_NOTE],
        ),
        "survival_probability": tabulate(
            "Survival of injection errors", _probabilities(product), [rule, errors]
        ),
        "survival_edges": tabulate(
            "First losses by direction", _edges(product), [rule, _search(product)]
        ),
        "nearby_resonances": tabulate(
            "Resonances near the orbits", _nearby(product), [_REACH_NOTE]
        ),
    }  # fmt: skip
    if product.offset.shape[1]:
        tables["offset_fates"] = tabulate("Fates of given offsets", _offsets(product), [rule])
    figures = {
        "survival_edges": edge_chart(product, label_identifier("survival_edges", label)),
        "survival_probability": probability_chart(
            product, label_identifier("survival_probability", label)
        ),
    }
    metrics = {"survival_flights": Metric(product.flights)}
    if np.isfinite(product.drift):
        metrics["survival_integral_drift"] = Metric(product.drift)
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={label_identifier(name, label): table for name, table in tables.items()},
        figures={label_identifier(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


_REACH_NOTE = (
    "A resonance d:n is met where the stability index of its plane is 2 cos(2π d/n). The change "
    "of ẏ is the one at the start that gives the orbit the Jacobi constant of the resonant one: "
    "the size of offset at which the resonance begins to act, not an edge."
)


def rule_of(product: NonlinearStability) -> str:
    """Return the sentence on when a flight counts as lost."""
    planar = np.isinf(product.limit_m[2])
    axes = "|x| or |y|" if planar.all() else "|x|, |y| or |z|"
    if planar.any() and not planar.all():
        axes += " (planar orbits, to a twentieth of their extent: |x| or |y|)"
    surface = ", or meets the surface of the body" if product.has_surface else ""
    return (
        f"An orbit is lost if within {product.duration_s / DAY_S:g} days it goes beyond "
        f"{product.limit:g} times its own largest {axes}{surface}. Another rule changes the "
        "hours rather than the verdicts."
    )


def _search(product: NonlinearStability) -> str:
    return (
        "The stability radius is the largest offset before the first loss, the least of all tried "
        f"directions. The search begins with the largest offset halved {product.doublings} times, "
        f"then in {product.scan} equal parts below it, then to a sixteenth of the gap. "
        "The edge is fractal: tongues of losses thinner than that may lie below it, and survivors "
        "beyond it."
    )


def _errors(product: NonlinearStability) -> str:
    return (
        f"Injection errors are Gaussian, σ = {product.sigma_position_m:g} m and "
        f"{100.0 * product.sigma_velocity_m_s:g} cm/s per axis, {product.draws} draws per orbit "
        f"and phase; {100 * product.confidence:g} % intervals by Clopper and Pearson."
    )


def _fates(product: NonlinearStability) -> NDArray[np.str_]:
    """Return the fate of the first lost flight of each orbit in each direction (M, D)."""
    words = np.array([fate.text for fate in Fate])[product.lost_fate]
    return np.where(np.isinf(product.lost), "not lost", words)


def _summary(product: NonlinearStability) -> list[FilledColumn]:
    of, orbit = FieldColumns(product, "orbits"), np.arange(len(product.labels))
    place, speed = product.weakest(velocity=False), product.weakest(velocity=True)
    share, fates = product.counts[Fate.SURVIVES] / product.draws, _fates(product)
    directions, worst = np.array(product.directions), np.argmin(share, axis=1)
    nearest = [next(iter(np.flatnonzero(product.near_member == i).tolist()), -1) for i in orbit]
    names = [
        None if k < 0 else f"{product.near_plane[k]} {_resonance(product, k)}" for k in nearest
    ]
    return [
        of("labels", "orbit"),
        *(
            column(f"{axis}_max_km", largest, f"largest |{axis}|", 6)
            for axis, largest in zip("xyz", product.amplitude_m, strict=True)
        ),
        column(
            "radius_position_m", product.survived[orbit, place], "stability radius, position", 4
        ),
        text_column("radius_position_direction", directions[place], "in direction"),
        text_column("radius_position_fate", fates[orbit, place], "then"),
        column(
            "radius_velocity_cm_s", product.survived[orbit, speed], "stability radius, velocity", 4
        ),
        text_column("radius_velocity_direction", directions[speed], "in direction"),
        text_column("radius_velocity_fate", fates[orbit, speed], "then"),
        column("survival", share[orbit, worst], "survival probability, least of the phases", 4,
               interval=("survival_low", "survival_high"), confidence=product.confidence),
        column("survival_low", product.low[orbit, worst], "from", 4),
        column("survival_high", product.high[orbit, worst], "to", 4),
        column("median_loss_h", product.median_loss_s[orbit, worst], "median time of loss", 4),
        text_column("nearest_resonance", names, "nearest resonance"),
        column(
            "resonance_distance_km",
            take_or_blank(product.near_distance_m, nearest),
            "its distance", 4,
        ),
    ]  # fmt: skip


def _resonance(product: NonlinearStability, k: int) -> str:
    return f"{product.near_d[k]}:{product.near_n[k]}"


def _probabilities(product: NonlinearStability) -> list[FilledColumn]:
    of = FieldColumns(product, "orbits", "phases")
    share = (product.counts[Fate.SURVIVES] / product.draws).ravel()
    return [
        of("labels", "orbit"),
        of("phases", "phase"),
        of("draws"),
        *(column(fate.plural, product.counts[fate].ravel(), fate.plural) for fate in Fate),
        column("survival", share, "survival probability", 4,
               interval=("survival_low", "survival_high"), confidence=product.confidence),
        of("low", "survival_low"),
        of("high", "survival_high"),
        of("median_loss_s"),
    ]  # fmt: skip


def _edges(product: NonlinearStability) -> list[FilledColumn]:
    of = FieldColumns(product, "orbits", "directions")
    is_velocity = product.direction[3:].any(axis=0)
    unit = np.where(is_velocity, product.direction[3:], product.direction[:3])
    # An offset is a position or a velocity: one pair of columns is blank.
    kinds = {"m": ~is_velocity, "cm_s": is_velocity}
    lost = np.where(np.isinf(product.lost), np.nan, product.lost)
    pairs = (("survives", product.survived, "survives to"), ("lost", lost, "lost at"))
    return [
        of("labels", "orbit"),
        of("directions", "direction"),
        *(
            column(f"u{axis}", of.spread(part, "directions"), f"along {axis}", 3)
            for axis, part in zip("xyz", unit, strict=True)
        ),
        *(
            column(f"{stem}_{suffix}", np.where(own, values, np.nan).ravel(), label, 4)
            for suffix, own in kinds.items()
            for stem, values, label in pairs
        ),
        text_column("fate", _fates(product).ravel(), "then"),
        of("lost_time_s", "time_h", "after"),
    ]


def _offsets(product: NonlinearStability) -> list[FilledColumn]:
    of, units = FieldColumns(product, "orbits", "offsets"), ("m", "m", "m", "cm_s", "cm_s", "cm_s")
    names = ("x", "y", "z", "vx", "vy", "vz")
    survives = product.offset_fate == Fate.SURVIVES
    return [
        of("labels", "orbit"),
        *(
            column(f"d{name}_{unit}", of.spread(part, "offsets"), f"Δ{name}", 5)
            for name, unit, part in zip(names, units, product.offset, strict=True)
        ),
        text_column(
            "fate", [Fate(fate).text for fate in product.offset_fate.ravel().tolist()], "fate"
        ),
        column(
            "time_h", np.where(survives, np.nan, product.offset_time_s).ravel(), "lost after", 5
        ),
    ]


def _nearby(product: NonlinearStability) -> list[FilledColumn]:
    of = FieldColumns(product, "resonances")
    return [
        text_column("orbit", [product.labels[i] for i in product.near_member], "orbit"),
        of("near_plane", "plane"),
        text_column(
            "resonance", [_resonance(product, k) for k in range(len(product.near_plane))], "d:n"
        ),
        of("near_x_m", "x0_km"),
        of("near_distance_m", "distance_km"),
        of("near_vy_offset_m_s", "vy_offset_cm_s"),
    ]


def _verdict(product: NonlinearStability) -> list[str]:
    days, sentences = product.duration_s / DAY_S, []
    share = np.min(product.counts[Fate.SURVIVES], axis=1) / product.draws
    risky = [
        f"{name} ({100 * p:.3g} %)"
        for name, p in zip(product.labels, share, strict=True)
        if p < 1.0
    ]
    if risky:
        sentences.append(f"Orbits that drawn injection errors lose within {days:g} days "
                         f"(survival in brackets): {', '.join(risky)}.")  # fmt: skip
    else:
        sentences.append(f"No drawn injection error loses any of these orbits in {days:g} days.")
    unheld = [
        name
        for name, fate in zip(product.labels, product.reference_fate, strict=True)
        if fate != Fate.SURVIVES
    ]
    if unheld:
        sentences.append(
            f"Lost even without an offset (stability radius zero): {', '.join(unheld)}."
        )
    return sentences
