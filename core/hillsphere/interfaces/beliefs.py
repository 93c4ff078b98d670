"""Data of estimators: beliefs, sets of measurements, and innovations.

Each holds N independent cases. A belief stores a square root of its covariance, so that the
covariance stays positive definite in spite of rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.interfaces.sensing import Channel

__all__ = ["Belief", "Innovation", "MeasurementSet"]

_SKEW = 1e-8
"""Largest relative asymmetry of a covariance that is accepted as rounding."""


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
            Covariances, positive definite.
        t_s : ndarray, shape (N,)
            Times, s.

        Returns
        -------
        Belief
            With the Cholesky factors of the covariances.

        Raises
        ------
        InputError
            If a mean is not finite, a covariance is not finite, symmetric and positive definite, or
            the shapes do not match.
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
        try:
            root = np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            least = np.linalg.eigvalsh(covariance)[..., 0]
            raise InputError(
                f"covariances of cases {np.flatnonzero(least <= 0.0)[:10].tolist()} are not "
                f"positive definite: the least eigenvalue is {least.min():.3g}"
            ) from None
        return cls(
            np.ascontiguousarray(x, dtype=float), np.asarray(root), np.asarray(t_s, dtype=float)
        )

    @property
    def covariance(self) -> Array:
        """Covariances (N, n, n)."""
        return np.asarray(self.root @ np.swapaxes(self.root, 1, 2))

    @property
    def sigma(self) -> Array:
        """Standard deviations (n, N)."""
        return np.asarray(np.linalg.norm(self.root, axis=2).T)


@dataclass(frozen=True)
class MeasurementSet:
    """Measurements of all sensors for N cases, at one time per case; some may be missing.

    Parameters
    ----------
    t_s : ndarray, shape (N,)
        Times, s.
    values : ndarray, shape (m, N)
        Measured values, SI; arbitrary in rows that are not present.
    sigma : ndarray, shape (m, N)
        Standard deviations of the independent errors; positive where a row is present. All rows of
        a direction hold the same value, in rad perpendicular to it.
    blocks : tuple of tuple of Channel
        The channels of each block, in the order of the rows. A block is one sensor's measurement
        at a time; a gate accepts or rejects it as a whole.
    present : ndarray of bool, shape (m, N)
        Which rows were measured; of a direction all or none.

    Raises
    ------
    InputError
        If the shapes do not fit together, a value that is present is not finite or its standard
        deviation is not positive.
    """

    t_s: Array
    values: Array
    sigma: Array
    blocks: tuple[tuple[Channel, ...], ...]
    present: NDArray[np.bool_]

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
        sigma : ndarray, shape (m, N) or (m, 1)
            Standard deviations.
        blocks : tuple of tuple of Channel
            The channels of each block.

        Returns
        -------
        MeasurementSet
            The set; `present` is False where a value is NaN.
        """
        values = np.asarray(values, dtype=float)
        spread = np.broadcast_to(np.asarray(sigma, dtype=float), values.shape)
        return cls(np.asarray(t_s, dtype=float), values, spread, blocks, ~np.isnan(values))


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
        variance, or 1.
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
