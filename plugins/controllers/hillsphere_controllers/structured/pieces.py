"""Pieces of the objective: singular values at peaks and constraints, with their gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array

__all__ = [
    "ALIKE", "NEAR", "Piece", "distinct_peaks", "nearest_frequency", "piece_key",
    "without_duplicates",
]  # fmt: skip

NEAR = 0.6
"""Peaks of at least this share of the largest are looked at."""
ALIKE = 10
"""Decimals to which levels are compared; what is the same for many plants counts once."""


@dataclass(frozen=True)
class Piece:
    """One of the functions whose largest is minimised, or of the constraints, at a θ.

    Parameters
    ----------
    level : float
        Logarithm of a weighted gain or norm; or the excess of a constraint.
    slope : ndarray, shape (size,)
        Its gradient.
    plant, channel : int
        Where; channel −1: poles, of plant −1: gains, of −2: the controller's poles.
    omega_rad_s : float
        Peak; NaN where there is none.
    number : int
        Of the singular value, or of the condition on the poles.
    hard : bool
        Whether it is a constraint.
    """

    level: float
    slope: Array
    plant: int
    channel: int
    omega_rad_s: float
    number: int
    hard: bool


def without_duplicates(pieces: Sequence[Piece]) -> list[Piece]:
    """Return the pieces without duplicates, which several plants have in a common direct term."""
    distinct: list[Piece] = []
    known: dict[tuple[int, int, float, float], list[Array]] = {}
    for p in pieces:
        same = known.setdefault((p.channel, p.number, p.omega_rad_s, round(p.level, ALIKE)), [])
        if not same or (np.abs(p.slope - same) > 1e-6 * np.abs(same)).any(axis=1).all():
            same.append(p.slope)
            distinct.append(p)
    return distinct


def piece_key(piece: Piece) -> tuple[int, int, int, float]:
    """Return what tells a piece from others: plant, channel, number and frequency."""
    at = piece.omega_rad_s
    return piece.plant, piece.channel, piece.number, round(at, 12) if np.isfinite(at) else at


def distinct_peaks(omega: Array, high: Array) -> list[int]:
    """Return the indices of peaks near the largest, each once."""
    distinct: list[int] = []
    for i in np.argsort(-high, kind="stable"):
        if high[i] < NEAR * high.max():
            break
        other = [omega[k] for k in distinct if np.isfinite(omega[k])]
        if np.isinf(omega[i]) or all(abs(omega[i] - f) > 1e-6 * max(omega[i], f) for f in other):
            distinct.append(int(i))
    return distinct


def nearest_frequency(omega: Array, wanted: float) -> float:
    """Return the frequency, rad/s, of the peak that a wanted one moved to; else itself."""
    if np.isinf(wanted) or wanted == 0.0:
        return wanted
    there = omega[np.isfinite(omega) & (omega > 0.0)]
    if not there.size:
        return wanted
    best = float(there[int(np.argmin(np.abs(np.log(there / wanted))))])
    return best if abs(np.log(best / wanted)) < 0.2 else wanted
