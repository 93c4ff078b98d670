"""Tests of innovations with their limits, of all cases together and of each.

Innovations in units of the roots of their covariances are white noise of unit variance for a
consistent filter of a linear problem [1]_. Their squares, their sums over windows of sets, their
means and their correlations in time are then χ² distributed.

References
----------
.. [1] Bar-Shalom, Li, Kirubarajan (2001), Estimation with applications to tracking and navigation,
   section 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import t as student

from hillsphere.estimation import Innovation, MeasurementSet
from hillsphere.interfaces import Array, Integers
from hillsphere_estimators.differences import layout_of

__all__ = [
    "OF_FILTER",
    "OF_FIT",
    "OF_SIGMA",
    "Check",
    "expected_check",
    "inapplicable_check",
    "innovation_checks",
    "measured_rows",
    "most_extreme_check",
    "one_sided_check",
    "rejected_check",
]

OF_FILTER = ("nis", "late_nis", "slow_nis", "mean", "whiteness")
OF_FIT = ("fit_nis", "fit_late_nis", "fit_slow_nis", "fit_bias", "fit_whiteness")
OF_SIGMA = tuple(f"sigma_{name}" for name in OF_FILTER)
"""Names of the tests of innovations: of the filter, about the fit, and of a sigma-point filter."""
_LAGS = 5
"""Lags of the test of whiteness. A wrong process noise shows at the first few, an unmodelled force
at all; each further lag spends power on nothing."""
_LEAST_SETS = 3
"""Sets of measurements of a case below which a run is too short for whiteness."""
_LEAST_MIXED = 20
"""Cases of mixtures below which the mean of squares is not tested: the mean of fewer skew numbers
is not near to Student's distribution."""
_MOSTLY_REJECTED = 0.5
"""Share of rejected rows above which a filter that rejects has no measurements to follow, as in the
detection of divergence of the stage ``navigation``."""


@dataclass(frozen=True)
class Check:
    """Result of one test, of all cases together and of each of N cases.

    Parameters
    ----------
    name : str
        Its name.
    says : str
        What its statistic is.
    value, low, high : float
        Statistic of all cases, and the limits between which it passes.
    each, each_low, each_high : ndarray, shape (N,)
        The same of each case; NaN where it does not apply.
    reason : str
        Why the test does not apply, "" if it does.
    """

    name: str
    says: str
    value: float
    low: float
    high: float
    each: Array
    each_low: Array
    each_high: Array
    reason: str = ""

    @property
    def above(self) -> bool:
        """Whether the statistic of all cases is above its limit."""
        return bool(self.value > self.high)

    @property
    def below(self) -> bool:
        """Whether it is below its limit."""
        return bool(self.value < self.low)

    @property
    def each_above(self) -> NDArray[np.bool_]:
        """Whether that of a case is above its limit, (N,)."""
        return np.asarray(self.each > self.each_high)

    @property
    def each_below(self) -> NDArray[np.bool_]:
        """Whether that of a case is below its limit, (N,)."""
        return np.asarray(self.each < self.each_low)

    def __str__(self) -> str:
        if self.reason:
            return f"{self.name}: not applicable, {self.reason}"
        band = (
            f"at most {self.high:.3g}" if self.low <= 0.0 else f"{self.low:.3g} to {self.high:.3g}"
        )
        return f"{self.name}: {self.says} {self.value:.3g} (limit {band})"


def innovation_checks(
    innovations: Sequence[Innovation], share: float, whole: NDArray[np.bool_], optimal: bool,
    states: int, names: tuple[str, ...], mixed: NDArray[np.bool_] | None = None,
) -> list[Check]:  # fmt: skip
    """Test innovations: NIS over all sets, the later half and windows, mean and whiteness.

    Parameters
    ----------
    innovations : sequence of Innovation
        At K times, of N cases.
    share : float
        Probability with which a consistent filter fails each limit.
    whole : ndarray of bool, shape (N,)
        Cases that count.
    optimal : bool
        Whether the innovations of a consistent filter would be white, so that correlations in time
        are tested.
    states : int
        Number of states: the sets that bring the first so many rows do not count in the mean.
    names : tuple of str
        Names of the five tests.
    mixed : ndarray of bool, shape (N,), optional
        Cases whose beliefs are mixtures, none by default: their innovations are not normal, so that
        only the mean NIS is tested.

    Returns
    -------
    list of Check
        In the order of the names.
    """
    white, used = _whiten_all(innovations, whole)
    half = len(innovations) // 2
    # the first sets meet the prior: where it is wide their innovations are not normal, and for a
    # fit their mean is not zero, as the point of its linearisation depends on the measurements
    rows = np.cumsum(used.sum(axis=1).max(axis=1))
    met = min(int(np.searchsorted(rows, states)) + 1, half)
    nis = np.sum(white**2, axis=1)
    dof = used.sum(axis=1)
    if mixed is None:
        mixed = np.zeros(len(whole), dtype=bool)
    made = [
        expected_check(
            names[0], "mean NIS per row", nis.sum(axis=0), dof.sum(axis=0), share, mixed
        ),
        expected_check(
            names[1], "mean NIS per row, later half", nis[half:].sum(axis=0),
            dof[half:].sum(axis=0), share, mixed,
        ),
    ]  # fmt: skip
    if mixed.any():
        why = "the innovations of mixtures are not normal"
        return made + [inapplicable_check(name, "", len(whole), why) for name in names[2:]]
    return [
        *made,
        _slow_check(names[2], white, used, share, optimal),
        _mean_check(names[3], white[met:], used[met:], share),
        _whiteness_check(names[4], white, used, share, optimal),
    ]


def expected_check(
    name: str, says: str, squares: Array, dof: Array, share: float, mixed: NDArray[np.bool_]
) -> Check:
    """Test squares of errors, or of innovations, whose mean is their degrees of freedom.

    Those of normal distributions are χ² distributed. Of mixtures only the mean is known: the mean
    over the cases is then compared with its spread among them by Student's distribution, and no
    case is judged by itself.

    Parameters
    ----------
    name, says : str
        Its name, and what its statistic is.
    squares, dof : ndarray, shape (N,)
        Squares and their degrees of freedom, 0 in cases that do not count.
    share : float
        Probability with which a consistent filter fails each limit.
    mixed : ndarray of bool, shape (N,)
        Cases whose beliefs are mixtures.

    Returns
    -------
    Check
        Numbers and limits per degree of freedom.
    """
    check = _chi_check(name, says, squares, dof, share)
    counted = dof > 0.0
    if check.reason:
        return check
    if not (mixed & counted).any():
        return check
    many = int(counted.sum())
    if many < _LEAST_MIXED:
        return inapplicable_check(
            name, says, len(dof), f"{many} cases of mixtures are too few for a mean"
        )
    each = squares[counted] / dof[counted].mean()
    width = float(student.isf(share, many - 1)) * float(np.std(each, ddof=1)) / np.sqrt(many)
    # one that is judged by the spread is called so; the mean of the cases is that of the sums
    nothing = np.where(mixed, np.nan, 1.0)
    return Check(
        name, f"{says} (mixtures: by its spread),", float(each.mean()), max(1.0 - width, 0.0),
        1.0 + width, check.each * nothing, check.each_low, check.each_high,
    )  # fmt: skip


def rejected_check(
    measurements: Sequence[MeasurementSet], innovations: Sequence[Innovation]
) -> Check:
    """Test the share of the rows of the later half that a gate has rejected.

    Parameters
    ----------
    measurements : sequence of MeasurementSet
        K sets.
    innovations : sequence of Innovation
        K: their rows `used` were not rejected.

    Returns
    -------
    Check
        Above its limit if most rows were rejected.
    """
    half = len(measurements) // 2
    sent = np.sum([np.sum(m.present, axis=0) for m in measurements[half:]], axis=0).astype(float)
    # of a direction the third row is never used: it counts as sent only where nothing was rejected
    taken = np.sum([
        np.sum(i.used | (m.present & ~measured_rows(m)[:, None]), axis=0)
        for m, i in zip(measurements[half:], innovations[half:], strict=True)
    ], axis=0)  # fmt: skip
    each = np.where(sent > 0.0, 1.0 - taken / np.maximum(sent, 1.0), np.nan)
    value = 1.0 - float(taken.sum()) / max(float(sent.sum()), 1.0)
    many = len(each)
    return Check(
        "rejected", "share of rows rejected in the later half", value, 0.0, _MOSTLY_REJECTED, each,
        np.zeros(many), np.full(many, _MOSTLY_REJECTED),
    )  # fmt: skip


def one_sided_check(
    name: str, says: str, value: float, degrees: float, each: Array, dof: Array, share: float
) -> Check:
    """Return a test of χ² numbers that only large values fail.

    Parameters
    ----------
    name, says : str
        Its name, and what its statistic is.
    value, degrees : float
        The number of all cases, and its degrees of freedom.
    each, dof : ndarray, shape (N,)
        The same of each case.
    share : float
        Probability with which a consistent filter fails.

    Returns
    -------
    Check
        Numbers and limits per degree of freedom.
    """
    if not degrees:
        return inapplicable_check(name, says, len(each), "too few rows follow one another")
    some = np.maximum(dof, 1)
    there = dof > 0
    return Check(
        name, says, value / degrees, 0.0, float(chi2.isf(share, degrees)) / degrees,
        np.where(there, each / some, np.nan), np.zeros(len(each)),
        np.where(there, chi2.isf(share, some) / some, np.nan),
    )  # fmt: skip


def most_extreme_check(checks: list[Check]) -> Check:
    """Return one test of several: of all cases and of each the one farthest beyond its limit.

    Parameters
    ----------
    checks : list of Check
        At least one, of the same name.

    Returns
    -------
    Check
        Values with their own limits. One above its limit comes before one below.
    """

    def choose(value: Array, low: Array, high: Array) -> Integers:
        over = np.where(np.isfinite(value), value / np.maximum(high, 1e-300), -np.inf)
        under = np.where(np.isfinite(value), low / np.maximum(value, 1e-300), -np.inf)
        top = np.argmax(over, axis=0)
        above = np.take_along_axis(over, top[None], axis=0)[0] > 1.0
        return np.asarray(np.where(above, top, np.argmax(np.maximum(over, under), axis=0)))

    pooled = choose(
        *(np.array([[getattr(c, k)] for c in checks]) for k in ("value", "low", "high"))
    )
    fields = [np.array([getattr(c, k) for c in checks]) for k in ("each", "each_low", "each_high")]
    own = choose(*fields)
    case = np.arange(len(own))
    return replace(
        checks[int(pooled[0])], each=fields[0][own, case], each_low=fields[1][own, case],
        each_high=fields[2][own, case],
    )  # fmt: skip


def inapplicable_check(name: str, says: str, cases: int, reason: str) -> Check:
    """Return a test that does not apply.

    Parameters
    ----------
    name, says : str
        Its name, and what its statistic is.
    cases : int
        Number of cases.
    reason : str
        Why it does not apply.

    Returns
    -------
    Check
        Its numbers are NaN.
    """
    none = np.full(cases, np.nan)
    return Check(name, says, np.nan, np.nan, np.nan, none, none, none, reason)


def measured_rows(measured: MeasurementSet) -> NDArray[np.bool_]:
    """Return which rows of measurements can be used.

    Parameters
    ----------
    measured : MeasurementSet
        Of m rows.

    Returns
    -------
    ndarray of bool, shape (m,)
        True for all but the third of a direction.
    """
    return layout_of(measured.blocks).real


def _whiten_all(
    innovations: Sequence[Innovation], whole: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """Return innovations in units of their roots (K, m, N), and used rows; none of lost cases."""
    white, used = [], []
    for innovation in innovations:
        there = innovation.used & whole
        residual = np.where(there, innovation.residual, 0.0).T
        covariance = np.where(
            whole[:, None, None], innovation.covariance, np.eye(residual.shape[1])
        )
        # symmetric roots keep the rows apart as far as they can be
        value, vector = np.linalg.eigh(covariance)
        scaled = np.einsum("Nji,Nj->Ni", vector, residual) / np.sqrt(np.maximum(value, 1e-300))
        white.append(np.where(there, np.einsum("Nij,Nj->Ni", vector, scaled).T, 0.0))
        used.append(there)
    return np.array(white), np.array(used)


def _chi_check(name: str, says: str, squares: Array, dof: Array, share: float) -> Check:
    """Return the test of χ² numbers (N,) and of their sum, two-sided."""
    total, degrees = float(squares.sum()), float(dof.sum())
    some = np.maximum(dof, 1.0)
    low, high = chi2.ppf(share, some) / some, chi2.isf(share, some) / some
    blank = dof > 0.0
    if not degrees:
        return inapplicable_check(name, says, len(dof), "there is nothing to test")
    return Check(
        name, says, total / degrees, float(chi2.ppf(share, degrees)) / degrees,
        float(chi2.isf(share, degrees)) / degrees, np.where(blank, squares / some, np.nan),
        np.where(blank, low, np.nan), np.where(blank, high, np.nan),
    )  # fmt: skip


def _slow_check(
    name: str, white: Array, used: NDArray[np.bool_], share: float, optimal: bool
) -> Check:
    """Return the test of sums over windows: the innovations' power at low frequencies.

    Innovations that are not white belong to an overconfident filter if their power exceeds that of
    white noise at some frequency, to a cautious one if it is less. Windows are of 2, 4, 8 … sets,
    at least two in a run; the largest power counts, at a share of the level for each length.
    """
    says = "NIS per row of sums over windows"
    count, cases = len(white), white.shape[2]
    if not optimal:
        return inapplicable_check(
            name, says, cases, "a filter with considered states has coloured innovations"
        )
    lengths = [2**k for k in range(1, 12) if 2 ** (k + 1) <= count]
    if not lengths:
        return inapplicable_check(name, says, cases, f"a run of {count} sets is too short")
    made = []
    for length in lengths:
        whole = count - count % length
        shape = (-1, length, *white.shape[1:])
        # the end of a run is what counts: windows are laid from there
        sums = white[count - whole :].reshape(shape).sum(axis=1)
        many = used[count - whole :].reshape(shape).sum(axis=1)
        squares = np.sum(sums**2 / np.maximum(many, 1), axis=(0, 1))
        dof = np.sum(many > 0, axis=(0, 1))
        made.append(_chi_check(name, says, squares, dof, share / len(lengths)))
    return most_extreme_check(made)


def _mean_check(name: str, white: Array, used: NDArray[np.bool_], share: float) -> Check:
    """Return the test of the mean innovation of each row, whose normalised sum is χ²."""
    says = "mean innovations, squared, per row"

    def squares(total: Array, many: Array) -> tuple[Array, Array]:
        return np.sum(total**2 / np.maximum(many, 1.0), axis=0), np.sum(many > 0, axis=0)

    total, many = white.sum(axis=0), used.sum(axis=0)
    each, rows = squares(total, many)
    value, all_rows = squares(total.sum(axis=1), many.sum(axis=1))
    return one_sided_check(name, says, float(value), float(all_rows), each, rows, share)


def _whiteness_check(
    name: str, white: Array, used: NDArray[np.bool_], share: float, optimal: bool
) -> Check:
    """Return the test of Ljung and Box's kind: squared correlations at the first lags, per row."""
    says = "squared autocorrelations of the innovations, per lag and row"
    count, cases = len(white), white.shape[2]
    if not optimal:
        return inapplicable_check(
            name, says, cases, "a filter with considered states has coloured innovations"
        )
    if count < _LEAST_SETS:
        return inapplicable_check(name, says, cases, f"a run of {count} sets is too short")
    each, lags = np.zeros(cases), np.zeros(cases)
    value = degrees = 0.0
    for lag in range(1, min(_LAGS, count - 1) + 1):
        one, other = white[:-lag], white[lag:]
        both = used[:-lag] & used[lag:]
        product = np.sum(one * other, axis=0)
        many = both.sum(axis=0)
        own = (
            np.sum(np.where(both, one, 0.0) ** 2, axis=0),
            np.sum(np.where(both, other, 0.0) ** 2, axis=0),
        )
        # normalised by the sample's own variances (eq. 5.4.2-14 of the reference), times the count
        enough = many >= _LEAST_SETS - 1
        scale = np.maximum(own[0] * own[1], 1e-300)
        each += np.sum(np.where(enough, many * product**2 / scale, 0.0), axis=0)
        lags += enough.sum(axis=0)
        pooled = np.maximum(own[0].sum(axis=1) * own[1].sum(axis=1), 1e-300)
        there = many.sum(axis=1) >= _LEAST_SETS - 1
        value += float(
            np.sum(np.where(there, many.sum(axis=1) * product.sum(axis=1) ** 2 / pooled, 0.0))
        )
        degrees += float(there.sum())
    return one_sided_check(name, says, value, degrees, each, lags, share)
