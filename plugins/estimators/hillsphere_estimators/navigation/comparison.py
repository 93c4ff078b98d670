"""The stage ``navigation_comparison``: which sensors give which errors."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.presentation import Presentation
from hillsphere.products import CaseTable
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.comparison_presentation import present_comparison
from hillsphere_estimators.navigation.comparison_products import NavigationComparison
from hillsphere_estimators.navigation.metrics import moment, ratio_to_bound
from hillsphere_estimators.navigation.products import NavigationFlight
from hillsphere_estimators.navigation.specs import NavigationComparisonSpec

__all__ = ["NavigationComparisonStage", "paired_rms_ratio"]

_RESAMPLES = 2000
_COLUMNS = ("case", "spacecraft", "position_error_m", "velocity_error_mm_s")
_STATES = 6
"""Of each spacecraft."""


class NavigationComparisonStage:
    """Navigation stages and campaigns of them, side by side.

    Parameters
    ----------
    spec : NavigationComparisonSpec
        With its references bound.
    """

    def __init__(self, spec: NavigationComparisonSpec) -> None:
        self.spec = spec

    def run(
        self,
        ctx: Context,
        flights: tuple[NavigationFlight, ...] = (),
        campaigns: tuple[CaseTable, ...] = (),
    ) -> NavigationComparison:
        """Compare.

        Parameters
        ----------
        ctx : Context
            Not used: it takes no time.
        flights : tuple of NavigationFlight
            Shown in one figure.
        campaigns : tuple of CaseTable
            Of navigation stages, on the same draws.

        Returns
        -------
        NavigationComparison
            Side by side.

        Raises
        ------
        InputError
            If a campaign is not one of a navigation stage, or they do not fit together.
        """
        spec, needs = self.spec, self.spec.needs
        named = tuple(ref.name for ref in (needs.campaigns or needs.flights))
        labels = spec.labels or named
        points = _points(campaigns[0]) if campaigns else ()
        crafts = _spacecraft(flights, campaigns)
        shape = (len(labels), len(points), len(crafts))
        found = _Tables(shape)
        errors: list[list[Array]] = []
        for c, (table, name) in enumerate(zip(campaigns, named, strict=False)):
            if _points(table) != points:
                raise InputError(f"campaigns: {name!r} has other points than {named[0]!r}")
            errors.append(found.fill(c, table, name, len(crafts)))
        low, high = chi_square_band(_STATES * len(crafts), np.maximum(found.cases - found.lost, 1))
        ratio, answers = np.zeros((3, 0, shape[1])), []
        if spec.ordered and len(campaigns) > 1:
            ratio = np.zeros((3, len(campaigns) - 1, shape[1]))
            for c in range(len(campaigns) - 1):
                for p in range(shape[1]):
                    ratio[:, c, p] = paired_rms_ratio(
                        errors[c + 1][p], errors[c][p], spec.confidence
                    )
                    least, _, most = ratio[:, c, p]
                    if found.lost[c : c + 2, p].any() or np.isnan(least):
                        answers.append("undecided")  # survivors prove nothing
                        continue
                    answers.append(
                        "confirmed" if most < 1.0 else "refuted" if least > 1.0 else "undecided"
                    )
        paper = _published(spec, shape[0], len(crafts))
        return NavigationComparison(
            labels=labels,
            spacecraft=crafts,
            points=points,
            cases=found.cases,
            lost=found.lost,
            position_m=found.position,
            velocity_m_s=found.velocity,
            rms_m=found.rms,
            bound_m=found.bound,
            bound_ratio=found.bound_ratio,
            nees=found.nees,
            nees_low=np.asarray(low, dtype=float).reshape(shape[:2]),
            nees_high=np.asarray(high, dtype=float).reshape(shape[:2]),
            paper_position_m=paper[0],
            paper_velocity_m_s=paper[1],
            ratio=ratio,
            answers=tuple(answers),
            lightest=self._lightest(labels, found.rms, found.lost),
            **_courses(flights, len(labels), len(crafts)),
        )

    def present(
        self,
        product: NavigationComparison,
        flights: tuple[NavigationFlight, ...] = (),
        campaigns: tuple[CaseTable, ...] = (),
    ) -> Presentation:
        """Show them."""
        return present_comparison(product, self.spec)

    def _lightest(self, labels: tuple[str, ...], rms: Array, lost: Array) -> str:
        """Return the lightest set whose rms position errors are as required at every point.

        A flight that is lost violates any requirement.
        """
        masses, most = self.spec.masses_kg, self.spec.required_position_m
        if most is None:
            return ""
        meets = [bool((one <= most).all()) and not gone.any()
                 for one, gone in zip(rms, lost, strict=True)]  # fmt: skip
        fitting = [(mass, label) for mass, label, ok in zip(masses, labels, meets, strict=True)
                   if ok]  # fmt: skip
        return "{1}, {0:g} kg".format(*min(fitting)) if fitting else "none"


class _Tables:
    """What is filled campaign by campaign, (C, P, …)."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.cases, self.lost = np.zeros((2, *shape[:2]))
        self.position = np.full((3, *shape), np.nan)
        self.velocity, self.rms, self.bound = np.full((3, *shape), np.nan)
        self.bound_ratio = np.full((2, *shape), np.nan)
        self.nees = np.full(shape[:2], np.nan)

    def fill(self, c: int, table: CaseTable, name: str, crafts: int) -> list[Array]:
        """Take a campaign; return the position errors (S, N) at each point, in order of draws."""
        found = []
        for p in range(self.cases.shape[1]):
            at = np.flatnonzero((table.point == p) & ~table.failed)
            at = at[np.argsort(table.draw[at], kind="stable")]
            error = np.array([_column(table, name, f"position_error_{s + 1}")[at]
                              for s in range(crafts)])  # fmt: skip
            found.append(np.vstack([error, table.draw[at]]))
            self.cases[c, p] = np.sum(table.point == p)
            self.lost[c, p] = self.cases[c, p] - len(at)
            if not len(at):
                continue
            self.position[:, c, p] = np.quantile(error, [0.05, 0.5, 0.95], axis=1)
            self.rms[c, p] = np.sqrt(np.mean(error**2, axis=1))
            for s in range(crafts):
                speed = _column(table, name, f"velocity_error_{s + 1}")[at]
                self.velocity[c, p, s] = np.median(speed)
                bound = _column(table, name, f"position_bound_{s + 1}")[at]
                self.bound[c, p, s] = np.sqrt(np.mean(bound**2))
                self.bound_ratio[:, c, p, s] = ratio_to_bound(error[s], bound)
            self.nees[c, p] = np.mean(_column(table, name, "nees")[at])
        return found


def paired_rms_ratio(first: Array, second: Array, confidence: float) -> Array:
    """Return the ratio of two rms position errors with its interval, by a paired bootstrap.

    Parameters
    ----------
    first, second : ndarray, shape (S + 1, N)
        Errors of S spacecraft and, in the last row, the draws; only draws that both have count.
    confidence : float
        Of the interval.

    Returns
    -------
    ndarray, shape (3,)
        Lower limit, value, upper limit; NaN without any pair.
    """
    _, here, there = np.intersect1d(first[-1], second[-1], return_indices=True)
    squares = np.array([np.sum(e[:-1, rows] ** 2, axis=0)
                        for e, rows in ((first, here), (second, there))])  # fmt: skip
    count = squares.shape[1]
    if not count:
        return np.full(3, np.nan)
    # the same resamples for any two of as many cases: an answer must not depend on the run
    lots = np.random.default_rng(count).integers(0, count, (_RESAMPLES, count))
    sums = squares[:, lots].sum(axis=2)
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(np.sqrt(sums[0] / sums[1]), [tail, 1.0 - tail])
    total = squares.sum(axis=1)
    return np.array([low, np.sqrt(total[0] / total[1]), high])


def _points(table: CaseTable) -> tuple[str, ...]:
    """Return names of the points of a sweep, without that of its stage; one empty one of none."""
    if not table.swept or table.points is None:
        return ("",)
    names = [name.rpartition(".")[2] for name in table.swept]
    found = []
    for column in table.points.T:
        said = [
            moment(value) if unit == "s" else f"{name} {value:g}"
            for name, unit, value in zip(names, table.swept_units, column.tolist(), strict=True)
        ]
        found.append(", ".join(said))
    return tuple(found)


def _column(table: CaseTable, name: str, metric: str) -> Array:
    if metric not in table.metrics:
        raise InputError(
            f"campaigns: {name!r} has no metric {metric!r}; campaigns that repeat a stage "
            "'navigation' of as many spacecraft are compared"
        )
    return np.asarray(table.values[table.metrics.index(metric)])


def _spacecraft(
    flights: Sequence[NavigationFlight], campaigns: Sequence[CaseTable]
) -> tuple[str, ...]:
    if flights:
        crafts = flights[0].spacecraft
        for flight in flights:
            if flight.spacecraft != crafts:
                raise InputError(
                    f"flights: spacecraft {', '.join(flight.spacecraft)} beside "
                    f"{', '.join(crafts)}; only flights of the same ones are compared"
                )
        return crafts
    count = sum(m.startswith("position_bound_") for m in campaigns[0].metrics)
    return tuple(f"spacecraft {i + 1}" for i in range(max(count, 1)))


def _published(spec: NavigationComparisonSpec, sets: int, crafts: int) -> Array:
    """Return published position and velocity errors (2, C, S), SI; NaN where there are none."""
    found = np.full((2, sets, crafts), np.nan)
    if spec.reference is None:
        return found
    path = Path(spec.reference)
    with path.open(encoding="utf-8", newline="") as file:
        lines = [line for line in file if not line.startswith("#")]
    reader = csv.DictReader(lines)
    if tuple(reader.fieldnames or ()) != _COLUMNS:
        raise InputError(
            f"reference: {path.name} must have the columns {', '.join(_COLUMNS)}; it has "
            f"{', '.join(reader.fieldnames or ()) or 'none'}"
        )
    for number, row in enumerate(reader, start=1):
        try:
            case, craft = int(row["case"]) - 1, int(row["spacecraft"]) - 1
            values = float(row["position_error_m"]), 1e-3 * float(row["velocity_error_mm_s"])
        except (TypeError, ValueError) as error:
            raise InputError(f"reference: {path.name}, row {number}: {error}") from error
        if not (0 <= case < sets and 0 <= craft < crafts):
            raise InputError(
                f"reference: {path.name}, row {number}: case {case + 1}, spacecraft {craft + 1}; "
                f"there are {sets} sets and {crafts} spacecraft, counted from 1"
            )
        found[:, case, craft] = values
    return found


def _courses(flights: Sequence[NavigationFlight], sets: int, crafts: int) -> dict[str, Array]:
    """Return the flights over time, padded with NaN to the longest."""
    longest = max((len(flight.time_s) for flight in flights), default=0)
    time, mean = np.full((2, sets, longest), np.nan)
    error, sigma = np.full((2, sets, crafts, longest), np.nan)
    states, runs, lost = np.zeros((3, sets))
    rms = np.full((sets, crafts), np.nan)
    for c, flight in enumerate(flights):
        k = len(flight.time_s)
        time[c, :k] = flight.time_s
        error[c, :, :k] = flight.position_error_m[:, :, 0]
        sigma[c, :, :k] = flight.position_sigma_m[:, :, 0]
        states[c], runs[c], lost[c] = len(flight.states), flight.nees.shape[1], flight.lost
        there = np.isfinite(flight.nees[-1])
        if there.any():
            mean[c, :k] = np.mean(flight.nees[:, there], axis=1)
            rms[c] = np.sqrt(np.mean(flight.position_error_m[:, -1, there] ** 2, axis=1))
    return {
        "time_s": time, "error_m": error, "sigma_m": sigma, "mean_nees": mean,
        "flight_rms_m": rms, "flight_states": states, "flight_runs": runs, "flight_lost": lost,
    }  # fmt: skip
