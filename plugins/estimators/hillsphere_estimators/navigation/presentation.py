"""Tables, figures and sentences of the stage ``navigation``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.divergence import (
    DIVERGED_WITH_ALARM,
    DIVERGED_WITHOUT_ALARM,
    detect_divergence,
)
from hillsphere_estimators.navigation.figures import draw_control, draw_errors, draw_nees
from hillsphere_estimators.navigation.metrics import ratio_to_bound
from hillsphere_estimators.navigation.products import NavigationFlight
from hillsphere_estimators.navigation.specs import NavigationSpec

__all__ = ["judge_consistency", "present_navigation"]

MOST_OVER_BOUND = 1.2
"""Of an rms error: what is worse is said at the head of the report."""
_COLUMNS = [
    Column("spacecraft", "", "spacecraft"),
    Column("median_m", "m", "median error", 4),
    Column("low_m", "m", "5 %", 4),
    Column("high_m", "m", "95 %", 4),
    Column("rms_m", "m", "rms", 4),
    Column("believed_m", "m", "rms believed", 4),
    Column("bound_m", "m", "bound", 4),
    Column("ratio", "-", "rms over bound", 4),
    Column("ratio_se", "-", "its standard error", 2),
    Column("velocity_mm_s", "mm/s", "median velocity error", 4),
    Column("control_m", "m", "median distance from the reference", 4),
]
_SENSORS = [
    Column("sensor", "", "sensor"),
    Column("seen", "-", "share of the times at which it measures", 4),
    Column("blind", "-", "flights in which it never does"),
]


def judge_consistency(
    mean: float, states: int, flights: int, lost: int
) -> tuple[str, float, float]:
    """Return what a mean NEES says of a filter, and its band.

    Parameters
    ----------
    mean : float
        Over the flights that came to their end.
    states, flights, lost : int
        Numbers of states, of all flights, and of those that were lost.

    Returns
    -------
    answer : str
        ``consistent``, ``overconfident``, ``cautious``, or ``lost`` if any flight was: then the
        mean is one of survivors and proves nothing.
    low, high : float
        Where 99.9 % of such means lie for as many flights as are left.
    """
    low, high = map(float, chi_square_band(states, max(flights - lost, 1)))
    if lost:
        return "lost", low, high
    answer = "overconfident" if mean > high else "cautious" if mean < low else "consistent"
    return answer, low, high


def present_navigation(product: NavigationFlight, spec: NavigationSpec) -> Presentation:
    """Show the flights.

    Parameters
    ----------
    product : NavigationFlight
        What is shown.
    spec : NavigationSpec
        What was asked for.

    Returns
    -------
    Presentation
        Tables ``navigation`` and ``navigation_sensors``, figures ``navigation_errors``,
        ``navigation_control``, ``navigation_nees``.
    """

    def named(name: str) -> str:
        return f"{name}_{spec.label}" if spec.label else name

    n, count = len(product.states), product.nees.shape[1]
    diverged = (
        product.endings.count(DIVERGED_WITH_ALARM),
        product.endings.count(DIVERGED_WITHOUT_ALARM),
    )
    alarms = detect_divergence(product.nis, product.used, product.sent, spec.diverged_beyond)
    mean = float(np.nanmean(product.nees[-1])) if product.lost < count else np.nan
    answer, low, high = judge_consistency(mean, n, count, product.lost)
    ratios = [
        ratio_to_bound(product.position_error_m[i, -1], product.bounds_m[i, -1])
        for i in range(len(product.spacecraft))
    ]
    hours = product.time_s[-1] / 3600.0
    called = f" ({spec.label.replace('_', ' ')})" if spec.label else ""
    dv = _median(product.values[product.metrics.index("dv")])
    unknown = _unknown_to_the_bound(product, spec)
    notes = [
        f"{count} flights of different draws, after {hours:g} h and {len(product.time_s)} sets of "
        "measurements; errors are lengths of vectors.",
        "The bound is the posterior Cramér-Rao bound, each flight's own along its planned path, "
        "and the root of their mean square" + (f"; it does not know of {unknown}." if unknown
                                               else "."),
    ]  # fmt: skip
    if spec.law is not None:
        notes.append(
            f"The law spends a median of {dv:.4g} m/s, {dv / hours * 24.0:.4g} m/s a day, all "
            "spacecraft together; random accelerations are not counted."
        )
    sensors = _sensors(product)
    return Presentation(
        metrics={
            named("navigation_nees"): Metric(mean),
            named("navigation_consistent"): Metric(answer == "consistent" and not sum(diverged)),
            named("navigation_lost"): Metric(product.lost),
            named("navigation_diverged"): Metric(sum(diverged)),
            named("navigation_alarms"): Metric(int(alarms.sum())),
            named("navigation_bound_ratio"): Metric(float(max(r for r, _ in ratios))),
            named("navigation_dv"): Metric(dv, "m/s"),
        },
        tables={
            named("navigation"): Table(
                f"Errors of the estimates{called}", _COLUMNS, _rows(product, ratios), notes
            ),
            named("navigation_sensors"): Table(f"What the sensors see{called}", _SENSORS, sensors),
        },
        figures={
            named("navigation_errors"): Figure(
                f"Errors of the estimated positions{called}",
                lambda figure: draw_errors(figure, product),
                "Thick: the first flight; dashed: three standard deviations as its filter believes "
                "them; band: 5 to 95 % of all flights; thin: their rms; dotted: its Cramér-Rao "
                "bound.",
                (7.5, 2.4 + 2.0 * len(product.spacecraft)),
            ),
            named("navigation_control"): Figure(
                f"Distance from the reference{called}",
                lambda figure: draw_control(figure, product),
                "Of the first flight, at its measurements: as it is, and as the filter believes.",
            ),
            named("navigation_nees"): Figure(
                f"Normalised errors squared{called}",
                lambda figure: draw_nees(figure, product),
                f"Mean over {count} flights; grey: where 99.9 % of such means of a consistent "
                "filter lie.",
            ),
        },
        verdict=[
            *_verdict(product, called, (answer, mean, low, high), ratios, sensors, unknown),
            *_describe_divergence(diverged, int(alarms.sum()), count, called),
        ],
    )


def _rows(product: NavigationFlight, ratios: list[tuple[float, float]]) -> list[Mapping[str, Cell]]:
    rows: list[Mapping[str, Cell]] = []
    for i, name in enumerate(product.spacecraft):
        error = product.position_error_m[i, -1]
        alive = bool(np.isfinite(error).any())
        shares = np.nanquantile(error, [0.05, 0.5, 0.95]) if alive else [np.nan] * 3
        rows.append(
            {
                "spacecraft": name,
                "median_m": float(shares[1]),
                "low_m": float(shares[0]),
                "high_m": float(shares[2]),
                "rms_m": _rms(error),
                "believed_m": _rms(product.position_sigma_m[i, -1]),
                "bound_m": float(product.bound_m[i, -1]),
                "ratio": ratios[i][0],
                "ratio_se": ratios[i][1],
                "velocity_mm_s": 1e3 * _median(product.velocity_error_m_s[i, -1]),
                "control_m": _median(product.control_error_m[i, -1]),
            }
        )
    return rows


def _sensors(product: NavigationFlight) -> list[Mapping[str, Cell]]:
    return [
        {
            "sensor": name,
            "seen": float(np.nanmean(seen)) if np.isfinite(seen).any() else float("nan"),
            "blind": int(np.sum(seen == 0.0)),
        }
        for name, seen in zip(product.sensors, product.seen, strict=True)
    ]


def _unknown_to_the_bound(product: NavigationFlight, spec: NavigationSpec) -> str:
    """Return what the bound leaves out, "" if nothing: there it is no bound of this filter."""
    left = {
        "a true world that is another": not product.matched,
        "dropouts": spec.dropouts > 0.0,
        "outliers": spec.outliers > 0.0,
        "biases": bool(spec.biases),
        "a law on estimates that nothing corrects, while all sensors are silent": any(
            not out.sensors or set(out.sensors) >= set(product.sensors) for out in spec.outages
        ),
        "what covariance intersection gives away": bool(spec.members),
    }
    return ", ".join(name for name, there in left.items() if there)


def _verdict(
    product: NavigationFlight, called: str, judgement: tuple[str, float, float, float],
    ratios: list[tuple[float, float]], sensors: list[Mapping[str, Cell]], unknown: str,
) -> list[str]:  # fmt: skip
    """Return what is wrong; nothing of a filter that is as it should be."""
    answer, mean, low, high = judgement
    n, count = len(product.states), product.nees.shape[1]
    said = []
    if product.lost:
        said.append(
            f"Navigation{called}: {product.lost} of {count} flights did not come to their end: "
            f"{_causes(product)}."
        )
    if answer in ("overconfident", "cautious"):
        meaning = "greater" if answer == "overconfident" else "smaller"
        said.append(
            f"Navigation{called}: the filter is {answer}, its errors are {meaning} than it says; "
            f"its mean NEES over {count} flights is {mean:.4g}, the 99.9 % band for {n} states "
            f"{low:.3g} to {high:.3g}."
        )
    blind = [f"{row['sensor']} in {row['blind']}" for row in sensors if row["blind"]]
    if blind:
        said.append(
            f"Navigation{called}: sensors never measure anything in some of {count} flights: "
            f"{', '.join(blind)}."
        )
    for name, (ratio, error) in zip(product.spacecraft, ratios, strict=True):
        if not unknown and ratio > MOST_OVER_BOUND:
            said.append(
                f"Navigation{called}: the rms position error of {name} is {ratio:.3g} ± "
                f"{error:.2g} times its bound, more than {MOST_OVER_BOUND:g}."
            )
    return said


def _describe_divergence(
    diverged: tuple[int, int], alarms: int, count: int, called: str
) -> list[str]:
    """Return how many filters went on but nowhere, and how many cried for nothing."""
    said = []
    seen, silent = diverged
    if seen + silent:
        said.append(
            f"Navigation{called}: the filters of {seen + silent} of {count} flights have diverged; "
            f"the innovations of {seen} of them give the alarm."
        )
    if alarms > seen:
        said.append(
            f"Navigation{called}: the innovations of {alarms - seen} of {count} flights give the "
            "alarm although their filters have not diverged: the sensors are not as believed."
        )
    return said


def _causes(product: NavigationFlight) -> str:
    """Return how many flights ended how, those that came to their end left out."""
    others = ("completed", DIVERGED_WITH_ALARM, DIVERGED_WITHOUT_ALARM)
    causes = Counter(ending for ending in product.endings if ending not in others)
    return ", ".join(f"{count} {cause}" for cause, count in causes.most_common())


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else float("nan")


def _median(values: np.ndarray) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")
