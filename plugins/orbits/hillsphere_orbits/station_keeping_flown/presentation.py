"""Tables, figures and sentences about station-keeping that was flown."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.constants import DAY_S, HOUR_S
from hillsphere.interfaces import Integers
from hillsphere.presentation import Metric, Presentation
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.qso.presentation import format_count, label_identifier
from hillsphere_orbits.station_keeping_flown.figures import (
    UNCORRECTED,
    cost_chart,
    survival_chart,
)
from hillsphere_orbits.station_keeping_flown.products import StationKeepingFlown
from hillsphere_orbits.station_keeping_flown.references import FLOWN
from hillsphere_orbits.station_keeping_flown.tuning import REGULATORS

__all__ = ["present_flown"]

_SEVERAL = 3
"""Tuned laws that must fail on the same flights before an orbit counts as not to be held: one of
each kind there is (unstable component, target points, regulator)."""


def present_flown(product: StationKeepingFlown, label: str) -> Presentation:
    """Show survival and cost of every combination, and the longest intervals.

    Parameters
    ----------
    product : StationKeepingFlown
        What is shown.
    label : str
        Appended to names.

    Returns
    -------
    Presentation
        Tables ``station_keeping_flown`` and ``station_keeping_longest``, figures
        ``station_keeping_survival`` and ``station_keeping_cost``.
    """
    days = f"{product.duration_s / DAY_S:g} days"
    own = label_identifier("station_keeping_flown", label)
    names = {
        "station_keeping_flown": tabulate(
            f"Station-keeping flown for {days}", _grid(product), _notes(product)
        ),
        "station_keeping_longest": tabulate(
            "Longest interval between corrections that holds the orbit",
            _longest(product),
            _longest_notes(product),
        ),
    }
    held = np.isfinite(product.longest()).any(axis=1)
    metrics = {
        "station_keeping_references": Metric(len(product.labels)),
        "station_keeping_held": Metric(int(np.count_nonzero(held))),
    }
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={label_identifier(name, label): table for name, table in names.items()},
        figures={
            label_identifier("station_keeping_survival", label): survival_chart(product),
            label_identifier("station_keeping_cost", label): cost_chart(product, own),
        },
        verdict=_verdict(product),
    )


def _grid(product: StationKeepingFlown) -> list[FilledColumn]:
    """Return the flights without any correction (M rows), then every combination (M·S·I)."""
    of = FieldColumns(product, "orbits", "strategies", "intervals")
    flown, free = product.flown, product.uncorrected_survival
    tuned = flown & (product.tuning_survivors >= 0)
    regulator = np.array([name in REGULATORS for name in product.strategies])[:, None]
    ends, other = _ends(product.counts, product)
    free_ends, free_other = _ends(product.uncorrected_counts, product)

    def both(values: Any, there: Any = flown, uncorrected: Any = None) -> list[Any]:
        """Return cells of all rows: blank where not flown or not applicable."""
        first = _where(np.isfinite(free), uncorrected) if uncorrected is not None else free * np.nan
        return [*first, *_where(there, values).ravel()]

    part, required = product.survival, product.survival_required
    words = np.where(part >= required, "held", np.where(product.lost, "lost", "partly lost"))
    free_words = np.where(
        free >= required, "survives", np.where(free == 0.0, "lost", "partly lost")
    )
    outcomes = [
        *np.where(np.isfinite(free), free_words, np.array(product.status)),
        *(
            words[i, s, j] if flown[i, s, j] else _why_not(product, i, j)
            for i, s, j in np.ndindex(*flown.shape)
        ),
    ]
    times = of.spread(product.interval_s, "orbits", "intervals")
    strategies = of.spread(product.strategies, "strategies")
    tuning = product.tuning_survivors / max(product.tuning_cases, 1)
    low, high = product.uncorrected_low, product.uncorrected_high
    return [
        text_column("orbit", [*product.labels, *of.spread(product.labels, "orbits")], "orbit"),
        text_column("strategy", [*[UNCORRECTED] * free.size, *strategies], "strategy"),
        column("interval_h", [*free * np.nan, *times], "interval", 6),
        text_column("outcome", outcomes, "outcome"),
        column("survival", both(part, flown, free), "survival probability", 4,
               interval=("survival_low", "survival_high"), confidence=product.confidence),
        column("survival_low", both(product.low, flown, low), "at least", 3),
        column("survival_high", both(product.high, flown, high), "at most", 3),
        column("cost_m_s", both(product.cost_m_s), "mean Δv", 4),
        column("cost_95_m_s", both(product.cost_95_m_s), "95 % of Δv", 4),
        column("deviation_km", both(product.deviation_m), "rms deviation", 4),
        column("tuned_impulse_m_s", both(product.tuned_impulse_m_s, tuned),
               "tuned: tolerable impulse", 3),
        column("tuned_velocity_m_s", both(product.tuned_velocity_m_s, tuned & regulator),
               "tuned: tolerable velocity", 3),
        column("tuned_targets", both(product.tuned_targets, tuned & ~regulator), "tuned: targets"),
        column("tuning_survival", both(tuning, tuned), "survival in tuning", 4),
        column("impact", both(ends["impact"], flown, free_ends["impact"]), "impact"),
        column("escape", both(ends["escape"], flown, free_ends["escape"]), "escape"),
        column("other_loss", both(other, flown, free_other), "other loss"),
    ]  # fmt: skip


def _where(there: NDArray[np.bool_], values: NDArray[Any]) -> NDArray[np.object_]:
    """Return values, None where absent; an object array keeps counts integers."""
    cells = np.full(np.shape(values), None, dtype=object)
    cells[there] = values[there]
    return cells


def _ends(counts: Integers, product: StationKeepingFlown) -> tuple[dict[str, Integers], Integers]:
    """Return the counts by name, and the counts of losses without a column."""
    ends = dict(zip(product.statuses, counts, strict=True))
    return ends, counts.sum(axis=0) - ends["completed"] - ends["impact"] - ends["escape"]


def _longest(product: StationKeepingFlown) -> list[FilledColumn]:
    of = FieldColumns(product, "orbits", "strategies")
    longest, survival = product.longest(), product.survival
    held, tried = np.isfinite(longest), np.asarray(product.flown.any(axis=2))
    # The first of the intervals that are the longest with the survival required.
    enough = (survival >= product.survival_required) & (
        product.interval_s[:, None] == longest[..., None]
    )
    place = np.argmax(enough, axis=2)[..., None]
    costs = (
        np.where(held, np.take_along_axis(values, place, axis=2)[..., 0], np.nan).ravel()
        for values in (product.cost_m_s, product.cost_95_m_s)
    )
    outcomes = [
        ("held" if held[i, s] else "no interval holds it")
        if tried[i, s]
        else _why_not(product, i, 0)
        for i, s in np.ndindex(*longest.shape)
    ]
    folding = np.where(np.isinf(product.unstable_time_s), np.nan, product.unstable_time_s)
    most = np.argmax(np.nan_to_num(survival, nan=-1.0), axis=2)[..., None]
    best, best_low, best_high = (
        np.where(tried, np.take_along_axis(values, most, axis=2)[..., 0], np.nan).ravel()
        for values in (survival, product.low, product.high)
    )
    return [
        of("labels", "orbit"),
        of("strategies", "strategy"),
        of("period_s"),
        column("e_folding_h", of.spread(folding, "orbits"), "e-folding time", 4),
        text_column("outcome", outcomes, "outcome"),
        column("longest_h", longest.ravel(), "longest interval held", 6),
        column("cost_m_s", next(costs), "mean Δv there", 4),
        column("cost_95_m_s", next(costs), "95 % of Δv there", 4),
        column("best_survival", best, "best survival", 4,
               interval=("best_survival_low", "best_survival_high"), confidence=product.confidence),
        column("best_survival_low", best_low, "at least", 3),
        column("best_survival_high", best_high, "at most", 3),
        column("uncorrected_survival", of.spread(product.uncorrected_survival, "orbits"),
               "survival without correction", 4,
               interval=("uncorrected_survival_low", "uncorrected_survival_high"),
               confidence=product.confidence),
        column("uncorrected_survival_low", of.spread(product.uncorrected_low, "orbits"),
               "at least", 3),
        column("uncorrected_survival_high", of.spread(product.uncorrected_high, "orbits"),
               "at most", 3),
        of("index_m_s"),
    ]  # fmt: skip


def _why_not(product: StationKeepingFlown, i: int, j: int) -> str:
    if product.status[i] != FLOWN:
        return product.status[i]
    if not np.isfinite(product.interval_s[i, j]):
        return "not flown: no period"
    return "stable: nothing to correct"


def _notes(product: StationKeepingFlown) -> list[str]:
    limit = f"{product.limit_factor:g} times the orbit's largest |x|, |y| or |z|"
    if product.distance_max_m is not None:
        limit += f", or {product.distance_max_m / 1e3:g} km from its reference at the time"
    sure = (0.5 * (1.0 - product.confidence)) ** (1.0 / product.cases)
    return [
        f"{product.cases} flights of each combination. One standard deviation per axis: at the "
        f"start {product.injection_m:g} m and {100 * product.injection_m_s:g} cm/s; of the "
        f"navigation at each correction {product.navigation_m:g} m and "
        f"{100 * product.navigation_m_s:g} cm/s, independent each time. Impulses err by "
        f"{100 * product.execution_magnitude:g} % in size and "
        f"{np.degrees(product.execution_pointing_rad):.3g}° in direction; below "
        f"{1e3 * product.minimum_impulse_m_s:g} mm/s no impulse is made.",
        f"A flight is lost beyond {limit}, or when it meets the body.",
        f"Strategy {UNCORRECTED}: the same cases without any correction. Where they survive and "
        "corrected ones do not, the errors of navigation and execution do the harm.",
        "Δv and deviation are of the flights that survived; blank where none did. "
        "The deviation is the distance at the corrections: for the Floquet mode and the phase-free "
        "strategies from the nearest point of the reference, else from its point at that time.",
        _tuning_note(product),
        f"The interval contains the probability with {100 * product.confidence:g} % confidence "
        f"(Clopper and Pearson): if all {product.cases} survive, its lower end is {sure:.3f}.",
    ]


def _tuning_note(product: StationKeepingFlown) -> str:
    paired = f"All strategies meet the same errors, case by case (seed {product.seed}, stream "
    paired += "station_keeping_flown)."
    if not product.tuning_cases:
        return f"{paired} The weights are as written, not tuned."
    return (
        f"{paired} The weights of each strategy, orbit and interval were chosen on "
        f"{product.tuning_cases} other flights (the same seed, stream station_keeping_tuning): the "
        "most survivors, and of these the least sum of the squares of deviation and mean impulse, "
        "each over its tolerable size as written."
    )


def _longest_notes(product: StationKeepingFlown) -> list[str]:
    notes = [
        f"Held: at least {100 * product.survival_required:g} % of {product.cases} flights survive; "
        "longer intervals, of those tried, do not.",
        "The best survival is the largest of all intervals tried, with the confidence interval of "
        "that one by itself.",
    ]
    if np.isfinite(product.index_m_s).any():
        notes.append(
            "v_cm is an analytic index, not a simulated cost: it assumes perfect navigation and "
            "one correction per period. Compare it with the rows of one correction per period."
        )
    return notes


def _verdict(product: StationKeepingFlown) -> list[str]:
    total, longest = len(product.labels), product.longest()
    refused = sum(status != FLOWN for status in product.status)
    days = f"{product.duration_s / DAY_S:g} days"
    said = []
    free = product.uncorrected_survival
    survive = np.asarray(free >= product.survival_required)
    if np.isfinite(free).any():
        surviving = int(np.count_nonzero(survive))
        said.append(
            "Without any correction "
            f"{format_count(surviving, 'orbit', of=int(np.count_nonzero(np.isfinite(free))))} "
            f"{'survives' if surviving == 1 else 'survive'} {days} with "
            f"{100 * product.survival_required:g} % probability."
        )
    said += _not_held(product, survive)
    for s, name in enumerate(product.strategies):
        tried = product.flown[:, s].any(axis=1)
        if not tried.any():
            continue  # all stable, or none could be flown: said below
        held = np.isfinite(longest[:, s])
        whole = format_count(int(np.count_nonzero(held)), "orbit", of=int(np.count_nonzero(tried)))
        sentence = f"Strategy {name} holds {whole} flown for {days} with "
        sentence += f"{100 * product.survival_required:g} % survival"
        if held.any():
            hours = longest[held, s] / HOUR_S
            span = f"{hours.min():.4g}"
            if hours.max() > hours.min():
                span += f" to {hours.max():.4g}"
            sentence += f", corrected every {span} h at the longest"
        said.append(sentence + ".")
    stable = int(np.count_nonzero(product.stable))
    if stable:
        said.append(
            f"{format_count(stable, 'orbit', of=total)} {'is' if stable == 1 else 'are'} stable: "
            "without an unstable component, the Floquet mode has nothing to correct and no cost."
        )
    if refused:
        said.append(f"{refused} of {total} references could not be flown; the table says why.")
    once = [j for j, name in enumerate(product.intervals) if name == "period"]
    if once:
        flown = product.flown[:, :, once[0]].any(axis=1) & ~product.stable
        best = np.where(product.flown, product.survival, 0.0)[:, :, once[0]].max(axis=1)
        lost = int(np.count_nonzero(flown & (best < product.survival_required)))
        if lost:
            said.append(
                f"One correction per period, which the analytic index supposes, does not hold "
                f"{lost} of {np.count_nonzero(flown)} unstable orbits with any strategy tried "
                f"({', '.join(product.strategies)}; "
                f"{'weights tuned' if product.tuning_cases else 'weights not tuned'})."
            )
    return said


def _not_held(product: StationKeepingFlown, survive: NDArray[np.bool_]) -> list[str]:
    """Return sentences about orbits that no strategy holds at any interval.

    That an orbit cannot be held is said only where several tuned laws failed on the same flights.
    """
    orbits: dict[str, list[str]] = {}
    lost = product.flown.any(axis=(1, 2)) & ~np.isfinite(product.longest()).any(axis=1)
    tuned = np.asarray(product.tuned.any(axis=2))
    flown = np.asarray(product.flown.any(axis=2))
    for i in np.flatnonzero(lost).tolist():
        names = [n for s, n in enumerate(product.strategies) if tuned[i, s]]
        text = "without any correction the flights survive, and " if survive[i] else ""
        if len(names) >= _SEVERAL:
            text += (
                f"none of {len(names)} laws holds the orbit at any interval tried; all were tuned "
                f"on {product.tuning_cases} flights and judged on the same {product.cases} others "
                f"({', '.join(names)})."
            )
        else:
            tried = ", ".join(n for s, n in enumerate(product.strategies) if flown[i, s])
            text += (
                f"not held by what was tried ({tried}); fewer than {_SEVERAL} tuned laws were, "
                "which says nothing about others."
            )
        orbits.setdefault(text, []).append(product.labels[i])
    return [f"{'; '.join(labels)}: {text}" for text, labels in orbits.items()]
