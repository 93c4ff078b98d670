"""The stage ``navigation_comparison``: errors of sets of sensors, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Integers
from hillsphere.presentation import Presentation, Printed
from hillsphere.products import CaseTable
from hillsphere.show.reference import ReferenceTable
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.metrics import moment, ratio_to_bound
from hillsphere_estimators.navigation.products import NavigationFlight
from hillsphere_estimators.navigation_comparison.presentation import present_comparison
from hillsphere_estimators.navigation_comparison.products import NavigationComparison
from hillsphere_estimators.navigation_comparison.specs import NavigationComparisonSpec

__all__ = ["NavigationComparisonStage", "paired_rms_ratio", "read_published_errors"]

_RESAMPLES = 2000
"""Resamples of the bootstrap. 50 of them lie beyond each limit of a 95 % interval, so that the
probability beyond it is uncertain by 0.35 percentage points (binomial); ten times more would add
one digit to it for ten times the time."""
_COLUMNS = ("case", "spacecraft", "position_error_m", "velocity_error_mm_s")
_STATES = 6
"""States of each spacecraft: degrees of freedom of the NEES."""


class NavigationComparisonStage:
    """Comparison of navigation stages, and of the sets of sensors of a campaign.

    Parameters
    ----------
    spec : NavigationComparisonSpec
        With its references bound.
    """

    def __init__(self, spec: NavigationComparisonSpec) -> None:
        self.spec = spec
        if spec.reference is not None:
            # checked now; read again in `run`, when the number of spacecraft is known
            read_published_errors(Path(spec.reference), len(spec.labels))

    def run(
        self,
        ctx: Context,
        flights: tuple[NavigationFlight, ...] = (),
        campaign: CaseTable | None = None,
    ) -> NavigationComparison:
        """Compare.

        Parameters
        ----------
        ctx : Context
            Not used.
        flights : tuple of NavigationFlight
            Shown in one figure.
        campaign : CaseTable or None
            Campaign of a navigation stage, swept over sets of sensors and P points of other keys.

        Returns
        -------
        NavigationComparison
            Side by side.

        Raises
        ------
        InputError
            If the campaign is not one of a navigation stage over as many sets as there are labels,
            each at the same points, or the flights are not those of the same spacecraft.
        """
        spec = self.spec
        labels = spec.labels or tuple(ref.name for ref in spec.needs.flights)
        crafts = _spacecraft(flights, campaign)
        places = np.zeros((len(labels), 0), dtype=np.int64)
        points: tuple[str, ...] = ()
        if campaign is not None:
            places, points = _places(campaign, spec)
        shape = (*places.shape, len(crafts))
        statistics = _Tables(shape)
        errors = [] if campaign is None else statistics.fill(places, campaign, len(crafts))
        low, high = chi_square_band(
            _STATES * len(crafts), np.maximum(statistics.cases - statistics.lost, 1)
        )
        ratio = np.zeros((3, shape[0] - 1 if spec.paired else 0, shape[1]))
        for c, p in np.ndindex(*ratio.shape[1:]):
            ratio[:, c, p] = paired_rms_ratio(errors[c + 1][p], errors[c][p], spec.confidence)
            if statistics.lost[c : c + 2, p].any():
                ratio[::2, c, p] = np.nan  # statistics over survivors prove nothing
        paper = np.full((2, shape[0], len(crafts)), np.nan)
        if spec.reference is not None:
            paper = read_published_errors(Path(spec.reference), shape[0], len(crafts))
        return NavigationComparison(
            labels=labels,
            spacecraft=crafts,
            points=points,
            cases=statistics.cases,
            lost=statistics.lost,
            position_m=statistics.position,
            velocity_m_s=statistics.velocity,
            rms_m=statistics.rms,
            bound_m=statistics.bound,
            bound_ratio=statistics.bound_ratio,
            nees=statistics.nees,
            nees_low=np.asarray(low, dtype=float).reshape(shape[:2]),
            nees_high=np.asarray(high, dtype=float).reshape(shape[:2]),
            paper_position_m=paper[0],
            paper_velocity_m_s=paper[1],
            ratio=ratio,
            lightest=self._lightest(labels, statistics.rms, statistics.lost),
            **_histories(flights, len(labels), len(crafts)),
        )

    def present(
        self,
        product: NavigationComparison,
        flights: tuple[NavigationFlight, ...] = (),
        campaign: CaseTable | None = None,
    ) -> Presentation:
        """Show the comparison."""
        return present_comparison(product, self.spec)

    def _lightest(self, labels: tuple[str, ...], rms: Array, lost: Array) -> str:
        """Return the lightest set that meets the requirement at every point, with its mass.

        A lost flight violates any requirement.
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
    """Statistics over a campaign, arrays (C, P, …)."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.cases, self.lost = np.zeros((2, *shape[:2]))
        self.position = np.full((3, *shape), np.nan)
        self.velocity, self.rms, self.bound = np.full((3, *shape), np.nan)
        self.bound_ratio = np.full((2, *shape), np.nan)
        self.nees = np.full(shape[:2], np.nan)

    def fill(self, places: Integers, table: CaseTable, crafts: int) -> list[list[Array]]:
        """Compute the statistics of a campaign.

        Parameters
        ----------
        places : ndarray of int, shape (C, P)
            Points of the campaign for each set and point.
        table : CaseTable
            The campaign.
        crafts : int
            Number of spacecraft, S.

        Returns
        -------
        list of list of ndarray, shape (S + 1, N)
            Position errors and, in the last row, the draws, of each set at each point.
        """
        errors: list[list[Array]] = [[] for _ in places]
        for (c, p), place in np.ndenumerate(places):
            here = table.point == place
            at = np.flatnonzero(here & ~table.failed)
            at = at[np.argsort(table.draw[at], kind="stable")]
            error = np.array([_column(table, f"position_error_{s + 1}")[at]
                              for s in range(crafts)])  # fmt: skip
            errors[c].append(np.vstack([error, table.draw[at]]))
            self.cases[c, p] = np.sum(here)
            self.lost[c, p] = self.cases[c, p] - len(at)
            if not len(at):
                continue
            self.position[:, c, p] = np.quantile(error, [0.05, 0.5, 0.95], axis=1)
            self.rms[c, p] = np.sqrt(np.mean(error**2, axis=1))
            for s in range(crafts):
                speed = _column(table, f"velocity_error_{s + 1}")[at]
                self.velocity[c, p, s] = np.median(speed)
                bound = _column(table, f"position_bound_{s + 1}")[at]
                self.bound[c, p, s] = np.sqrt(np.mean(bound**2))
                self.bound_ratio[:, c, p, s] = ratio_to_bound(error[s], bound)
            self.nees[c, p] = np.mean(_column(table, "nees")[at])
        return errors


def paired_rms_ratio(first: Array, second: Array, confidence: float) -> Array:
    """Return the ratio of two rms position errors with its interval, by a paired bootstrap.

    Parameters
    ----------
    first, second : ndarray, shape (S + 1, N)
        Errors of S spacecraft and, in the last row, the draws. Only draws in both count.
    confidence : float
        Probability with which the interval holds the value.

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
    # seeded by the number of pairs: the same data must give the same answer in every run
    lots = np.random.default_rng(count).integers(0, count, (_RESAMPLES, count))
    sums = squares[:, lots].sum(axis=2)
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(np.sqrt(sums[0] / sums[1]), [tail, 1.0 - tail])
    total = squares.sum(axis=1)
    return np.array([low, np.sqrt(total[0] / total[1]), high])


def _places(table: CaseTable, spec: NavigationComparisonSpec) -> tuple[Integers, tuple[str, ...]]:
    """Return the points of a sweep (C, P) by set, and the names of the P points of the other keys.

    A sweep over sets alone has one point, with an empty name.
    """
    keys = [name.rpartition(".")[2] for name in table.swept]
    if table.points is None or keys.count(spec.sets) != 1:
        raise InputError(f"needs.campaign: {spec.no_sets(table.swept)}")
    of_sets = keys.index(spec.sets)
    values = table.points[of_sets]
    _, first = np.unique(values, return_index=True)
    if first.size != len(spec.labels):
        raise InputError(f"labels: {spec.miscounted(first.size)}")
    places = [np.flatnonzero(values == values[one]) for one in np.sort(first)]
    rest = np.delete(table.points, of_sets, axis=0)
    if any(not np.array_equal(rest[:, at], rest[:, places[0]]) for at in places):
        raise InputError(
            f"needs.campaign: expected every value of {spec.sets!r} at the same points, in the "
            "same order, as in a grid; some stand at others"
        )
    others = [pair for row, pair in enumerate(zip(keys, table.swept_units, strict=True))
              if row != of_sets]  # fmt: skip
    names = tuple(
        ", ".join(
            moment(value) if unit == "s" else f"{key} {value:g}"
            for (key, unit), value in zip(others, column, strict=True)
        )
        for column in rest[:, places[0]].T.tolist()
    )
    return np.array(places), names


def _column(table: CaseTable, metric: str) -> Array:
    """Return the values of a metric of a campaign, or raise `InputError` if it has none."""
    if metric not in table.metrics:
        raise InputError(
            f"needs.campaign: expected one that repeats a stage 'navigation' of as many "
            f"spacecraft; that of {table.stage!r} has no metric {metric!r}"
        )
    return np.asarray(table.values[table.metrics.index(metric)])


def _spacecraft(flights: Sequence[NavigationFlight], campaign: CaseTable | None) -> tuple[str, ...]:
    """Return the names of the spacecraft of flights, or numbers for those of a campaign."""
    if flights:
        crafts = flights[0].spacecraft
        for flight in flights:
            if flight.spacecraft != crafts:
                raise InputError(
                    f"flights: spacecraft {', '.join(flight.spacecraft)} beside "
                    f"{', '.join(crafts)}; only flights of the same ones are compared"
                )
        return crafts
    names = () if campaign is None else campaign.metrics
    count = sum(name.startswith("position_bound_") for name in names)
    return tuple(f"spacecraft {i + 1}" for i in range(max(count, 1)))


def read_published_errors(path: Path, sets: int, crafts: int | None = None) -> Array:
    """Read published errors of navigation.

    Parameters
    ----------
    path : Path
        A reference table with the columns case, spacecraft (both counted from 1),
        position_error_m and velocity_error_mm_s.
    sets, crafts : int
        Numbers S of sets that are compared and C of spacecraft; C left out: what the file says.

    Returns
    -------
    ndarray, shape (2, S, C)
        Errors of position and velocity, SI; NaN where none are published.

    Raises
    ------
    InputError
        If the file is no reference table of these columns, or a row belongs to no set or craft.
    """
    table = ReferenceTable.read(path)
    rows: list[tuple[int, int, float, float]] = []
    if table.columns != _COLUMNS:
        raise InputError(
            f"{path.name}: must have the columns {', '.join(_COLUMNS)}; it has "
            f"{', '.join(table.columns)}"
        )
    for number, row in enumerate(table.rows, start=1):
        values = []
        for name in _COLUMNS:
            cell = row[name]
            if not isinstance(cell, Printed):
                raise InputError(f"{path.name}, row {number}: {name} must be a number, got {cell}")
            values.append(float(cell))
        case, craft, position_m, velocity_mm_s = values
        most = len(table.rows) if crafts is None else crafts
        if not (case in range(1, sets + 1) and craft in range(1, most + 1)):
            there = "" if crafts is None else f" and {crafts} spacecraft"
            raise InputError(
                f"{path.name}, row {number}: case {case:g}, spacecraft {craft:g}; "
                f"there are {sets} sets{there}, counted from 1"
            )
        rows.append((int(case) - 1, int(craft) - 1, position_m, 1e-3 * velocity_mm_s))
    count = max((row[1] + 1 for row in rows), default=0) if crafts is None else crafts
    errors = np.full((2, sets, count), np.nan)
    for place, one, position, velocity in rows:
        errors[:, place, one] = position, velocity
    return errors


def _histories(flights: Sequence[NavigationFlight], sets: int, crafts: int) -> dict[str, Array]:
    """Return the histories of the flights, padded with NaN to the longest."""
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
