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

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Innovation, MeasurementSet
from hillsphere.interfaces import Array
from hillsphere_estimators.chi_square_tests import (
    Check,
    expected_check,
    inapplicable_check,
    most_extreme_check,
    one_sided_check,
    two_sided_check,
)
from hillsphere_estimators.differences import layout_of

__all__ = [
    "OF_FILTER",
    "OF_FIT",
    "OF_SIGMA",
    "innovation_checks",
    "measured_rows",
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
_MOSTLY_REJECTED = 0.5
"""Share of rejected rows above which a filter that rejects has no measurements to follow, as in the
detection of divergence of the stage ``navigation``."""


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
        made.append(two_sided_check(name, says, squares, dof, share / len(lengths)))
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
