"""Data of estimators: beliefs, sets of measurements, and innovations.

Each holds N independent cases. A belief stores a square root of its covariance, so that the
covariance stays positive definite in spite of rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.interfaces.sensing import Channel

__all__ = ["Belief", "Innovation", "MeasurementSet"]

_SKEW = 1e-8
"""Largest relative asymmetry of a covariance that is accepted as rounding."""
_LEAST_CORRELATION = 1e-14
"""Least eigenvalue of a correlation that is accepted as positive: rounding leaves about 1e-16 times
the number of rows of an eigenvalue that is zero."""


@dataclass(frozen=True)
class Belief:
    """Normal distributions of the states of N cases at their times.

    Parameters
    ----------
    x : ndarray, shape (n, N)
        Means, SI.
    root : ndarray, shape (N, n, n)
        Lower triangular square roots S of the covariances S Sᵀ.
    t_s : ndarray, shape (N,)
        Times, s.

    Raises
    ------
    InputError
        If the shapes do not fit together.
    """

    x: Array
    root: Array
    t_s: Array

    def __post_init__(self) -> None:
        n, cases = np.shape(self.x) if np.ndim(self.x) == 2 else (0, -1)
        if np.shape(self.root) != (cases, n, n) or np.shape(self.t_s) != (cases,):
            raise InputError(
                f"a belief needs x (n, N), root (N, n, n) and t_s (N,), got {np.shape(self.x)}, "
                f"{np.shape(self.root)} and {np.shape(self.t_s)}"
            )

    @classmethod
    def of(cls, x: Array, covariance: Array, t_s: Array) -> Self:
        """Make a belief of means and covariances.

        Parameters
        ----------
        x : ndarray, shape (n, N)
            Means, SI.
        covariance : ndarray, shape (N, n, n)
            Covariances, positive definite; rows and columns of states that are known exactly hold
            zeros.
        t_s : ndarray, shape (N,)
            Times, s.

        Returns
        -------
        Belief
            With the Cholesky factors of the covariances; rows of zeros for states that are known
            exactly.

        Raises
        ------
        InputError
            If a mean is not finite, a covariance is not finite, symmetric and (but for states of
            zero variance) positive definite, or the shapes do not match.
        """
        if not np.isfinite(x).all():
            case = np.argwhere(~np.isfinite(x))[0, -1]
            raise InputError(f"the mean of case {case} is not finite")
        covariance = np.asarray(covariance, dtype=np.float64)
        if covariance.ndim != 3 or covariance.shape[1] != covariance.shape[2]:
            raise InputError(f"covariances must be (N, n, n), got {covariance.shape}")
        if not np.isfinite(covariance).all():
            case = np.argwhere(~np.isfinite(covariance))[0, 0]
            raise InputError(f"the covariance of case {case} is not finite")
        variance = np.abs(np.diagonal(covariance, axis1=1, axis2=2))
        size = np.sqrt(variance[:, :, None] * variance[:, None])
        skew = np.abs(covariance - np.swapaxes(covariance, 1, 2)) > _SKEW * size
        if skew.any():
            case, i, j = np.argwhere(skew)[0]
            raise InputError(
                f"the covariance of case {case} is not symmetric: its entry ({i}, {j}) is "
                f"{covariance[case, i, j]:.6g}, that of ({j}, {i}) {covariance[case, j, i]:.6g}"
            )
        known = variance == 0.0
        tied = known[:, :, None] & (covariance != 0.0)
        if tied.any():
            case, i, j = np.argwhere(tied)[0]
            raise InputError(
                f"covariances of cases [{case}] are not positive definite: state {i} has no "
                f"variance, but a covariance of {covariance[case, i, j]:.6g} with state {j}"
            )
        # a state without variance has the pivot 1 beside zeros, and a row of zeros in the root
        regular = covariance + known[:, :, None] * np.eye(covariance.shape[1])
        try:
            root = np.linalg.cholesky(regular)
        except np.linalg.LinAlgError:
            least = np.linalg.eigvalsh(regular)[..., 0]
            raise InputError(
                f"covariances of cases {np.flatnonzero(least <= 0.0)[:10].tolist()} are not "
                f"positive definite: the least eigenvalue is {least.min():.3g}"
            ) from None
        root = np.where(known[:, :, None], 0.0, root)
        return cls(
            np.ascontiguousarray(x, dtype=float), np.asarray(root), np.asarray(t_s, dtype=float)
        )

    def of_cases(self, cases: Integers) -> Belief:
        """Return the beliefs of some cases, by their indices, which may occur repeatedly."""
        return Belief(self.x.take(cases, axis=1), self.root[cases], self.t_s[cases])

    @property
    def covariance(self) -> Array:
        """Covariances (N, n, n)."""
        return np.asarray(self.root @ np.swapaxes(self.root, 1, 2))

    @property
    def sigma(self) -> Array:
        """Standard deviations (n, N)."""
        return np.asarray(np.linalg.norm(self.root, axis=2).T)

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Whether mean and covariance of a case are numbers (N,).

        False for a case whose computation failed, a failure of the class ``numerics``.
        """
        x, root = np.isfinite(self.x), np.isfinite(self.root)
        # the common case at half the cost: a filter asks several times at each step
        if x.all() and root.all():
            return np.ones(len(self.t_s), dtype=bool)
        return np.asarray(x.all(axis=0) & root.all(axis=(1, 2)))


@dataclass(frozen=True)
class MeasurementSet:
    """Measurements of all sensors for N cases, at one time per case; some may be missing.

    Errors are independent unless a correlation is given; `of` takes it from full covariances.

    Parameters
    ----------
    t_s : ndarray, shape (N,)
        Times, s.
    values : ndarray, shape (m, N)
        Measured values, SI; arbitrary in rows that are not present.
    sigma : ndarray, shape (m, N)
        Standard deviations of the errors; positive where a row is present. All rows of a direction
        hold the same value, in rad perpendicular to it.
    blocks : tuple of tuple of Channel
        The channels of each block, in the order of the rows. A block is one sensor's measurement
        at a time; a gate accepts or rejects it as a whole.
    present : ndarray of bool, shape (m, N)
        Which rows were measured; of a direction all or none.
    correlation : ndarray, shape (N, m, m), optional
        The covariance of the errors over the products of their standard deviations; None for
        independent errors. Rows and columns that are not present are arbitrary. Of a direction it
        is the covariance of the three components of the unit vector, of which the part along the
        vector has no effect.

    Raises
    ------
    InputError
        If the shapes do not fit together, a value that is present is not finite or its standard
        deviation is not positive, or the correlation of the rows that are present is not finite,
        symmetric and positive definite.
    """

    t_s: Array
    values: Array
    sigma: Array
    blocks: tuple[tuple[Channel, ...], ...]
    present: NDArray[np.bool_]
    correlation: Array | None = None

    def __post_init__(self) -> None:
        rows = sum(channel.rows for block in self.blocks for channel in block)
        shape = (rows, np.size(self.t_s))
        shapes = [np.shape(a) for a in (self.values, self.sigma, self.present)]
        if shapes != [shape] * 3 or np.ndim(self.t_s) != 1:
            raise InputError(
                f"measurements of {rows} rows at times {np.shape(self.t_s)}: values, sigma and "
                f"present must be {shape}, got {shapes[0]}, {shapes[1]} and {shapes[2]}"
            )
        good = np.isfinite(self.values) & (self.sigma > 0.0) & (self.sigma < np.inf)
        if not (good | ~self.present).all():
            row, case = np.argwhere(self.present & ~good)[0]
            raise InputError(
                f"row {row} of case {case} is present with the value {self.values[row, case]} and "
                f"the standard deviation {self.sigma[row, case]}; both must be finite, the latter "
                "positive"
            )
        if self.correlation is not None:
            _check_correlation(self.correlation, self.values, self.present, self.blocks)

    @classmethod
    def of(
        cls, t_s: Array, values: Array, sigma: Array, blocks: tuple[tuple[Channel, ...], ...]
    ) -> Self:
        """Make a set of measurements in which rows that are NaN count as not measured.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            Times, s.
        values : ndarray, shape (m, N)
            Measured values as `hillsphere.interfaces.Sensor.measure` gives them.
        sigma : ndarray, shape (m, N) or (m, 1); or (N, m, m) or (1, m, m)
            Standard deviations of independent errors; or covariances of errors, three-dimensional
            even for one case. Those of a direction are of the components of its unit vector.
        blocks : tuple of tuple of Channel
            The channels of each block.

        Returns
        -------
        MeasurementSet
            The set; `present` is False where a value is NaN.

        Raises
        ------
        InputError
            If shapes do not fit, or a standard deviation or covariance cannot be used.
        """
        values, t_s = np.asarray(values, dtype=float), np.asarray(t_s, dtype=float)
        given, present = np.asarray(sigma, dtype=float), ~np.isnan(values)
        if given.ndim == 3 and values.ndim == 2:
            spread, correlation = _split_covariance(given, values, blocks)
            return cls(t_s, values, spread, blocks, present, correlation)
        try:
            spread = np.broadcast_to(given, values.shape)
        except ValueError:
            raise InputError(
                f"sigma must be standard deviations of the shape {values.shape} or "
                f"({len(values)}, 1), or covariances with three dimensions, got {given.shape}"
            ) from None
        return cls(t_s, values, spread, blocks, present)

    def of_cases(self, cases: Integers) -> MeasurementSet:
        """Return the measurements of some cases, by their indices, which may occur repeatedly."""
        correlation = None if self.correlation is None else self.correlation[cases]
        return MeasurementSet(
            self.t_s[cases], self.values[:, cases], self.sigma[:, cases], self.blocks,
            self.present[:, cases], correlation,
        )  # fmt: skip

    @property
    def covariance(self) -> Array:
        """Covariances of the errors (N, m, m); arbitrary in rows that are not present."""
        sigma = self.sigma.T
        if self.correlation is None:
            return np.asarray(sigma[:, :, None] ** 2 * np.eye(sigma.shape[1]))
        return np.asarray(sigma[:, :, None] * self.correlation * sigma[:, None])


@dataclass(frozen=True)
class Innovation:
    """Innovation of a set of measurements: measured minus predicted, before the update.

    Of the three rows of a direction, two are angles perpendicular to the predicted direction, rad;
    the third is unused.

    Parameters
    ----------
    residual : ndarray, shape (m, N)
        Measured minus predicted, SI; angles in [−π, π]. Zero in rows that were not used.
    covariance : ndarray, shape (N, m, m)
        Innovation covariance S. Rows that were not used are independent, with their stated
        variance, or 1. NaN, as `nis`, in a case whose prediction is no number.
    used : ndarray of bool, shape (m, N)
        Rows that were used: present and accepted by the gate, if there is one.
    nis : ndarray, shape (N,)
        Normalised innovation squared νᵀ S⁻¹ ν of the rows used.
    """

    residual: Array
    covariance: Array
    used: NDArray[np.bool_]
    nis: Array

    @property
    def dof(self) -> NDArray[np.int64]:
        """Number of rows used (N,): the degrees of freedom of `nis`."""
        return np.asarray(self.used.sum(axis=0), dtype=np.int64)


def _first_rows(blocks: tuple[tuple[Channel, ...], ...]) -> list[int]:
    """Return the first row of each direction."""
    first, row = [], 0
    for channel in (channel for block in blocks for channel in block):
        if channel.kind == "direction":
            first.append(row)
        row += channel.rows
    return first


def _split_covariance(
    covariance: Array, values: Array, blocks: tuple[tuple[Channel, ...], ...]
) -> tuple[Array, Array]:
    """Return the standard deviations (m, N) and correlation (N, m, m) of covariances.

    The three rows of a direction share the largest of their standard deviations.
    """
    m, cases = values.shape
    if covariance.shape not in ((cases, m, m), (1, m, m)):
        raise InputError(
            f"covariances of {m} rows of {cases} cases must be ({cases}, {m}, {m}) or (1, {m}, "
            f"{m}), got {covariance.shape}"
        )
    with np.errstate(invalid="ignore"):
        # what is no standard deviation is refused with its row and case by the set itself
        sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).T.copy()
    for row in _first_rows(blocks):
        sigma[row : row + 3] = sigma[row : row + 3].max(axis=0)
    unit = np.where((sigma > 0.0) & np.isfinite(sigma), sigma, 1.0).T
    correlation = covariance / (unit[:, :, None] * unit[:, None])
    return np.broadcast_to(sigma, values.shape), np.broadcast_to(correlation, (cases, m, m))


def _check_correlation(
    correlation: Array,
    values: Array,
    present: NDArray[np.bool_],
    blocks: tuple[tuple[Channel, ...], ...],
) -> None:
    """Raise `InputError` unless the correlation of the rows present is positive definite."""
    m, cases = values.shape
    if np.shape(correlation) != (cases, m, m):
        raise InputError(
            f"the correlation of {m} rows of {cases} cases must be ({cases}, {m}, {m}), got "
            f"{np.shape(correlation)}"
        )
    both = present.T[:, :, None] & present.T[:, None]
    own = np.where(both, correlation, np.eye(m))
    wrong = ~np.isfinite(own) | ~(np.abs(own - np.swapaxes(own, 1, 2)) <= _SKEW)
    if wrong.any():
        case, i, j = np.argwhere(wrong)[0]
        raise InputError(
            f"the covariance of the measurements of case {case} is not finite and symmetric: over "
            f"the standard deviations its entry ({i}, {j}) is {own[case, i, j]:.6g}, that of "
            f"({j}, {i}) {own[case, j, i]:.6g}"
        )
    own = own.copy()
    for row in _first_rows(blocks):
        # the part along the unit vector has no effect: a variance there cannot make it definite
        along = np.where(present[row : row + 3], values[row : row + 3], 0.0).T
        own[:, row : row + 3, row : row + 3] += along[:, :, None] * along[:, None]
    least = np.linalg.eigvalsh(own)[:, 0]
    if not (least > _LEAST_CORRELATION).all():
        case = int(np.argmin(least))
        raise InputError(
            f"the covariance of the measurements of case {case} is not positive definite: over the "
            f"standard deviations its least eigenvalue is {least[case]:.3g}"
        )
