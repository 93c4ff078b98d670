"""Verification of legs by Taylor series, in pieces for the workers of a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.endtoend import Leg as Flight
from hillsphere_orbits.transfers.endtoend import verify

__all__ = ["Coasts", "LegFlights", "VerifiedFlights", "Waits", "coasts_of", "waits_of"]

_LANES = 16
"""Lanes of a piece: whole batches of the integrators, as a lane's last bits depend on those in its
batch."""
_STEPS_PER_UNIT = 120  # sub-steps of the matrix per revolution of the primary's motion
_CORRECTIONS = 3
"""Most corrections of a first state. Its rounding limits the miss: further ones only change the
last digit."""
_ENOUGH = 1e-7  # normalised: a leg that misses by no more is not corrected


@dataclass(frozen=True, eq=False)
class Coasts:
    """K legs to be corrected and verified, normalised, in the direction of flight.

    Parameters
    ----------
    start, end : ndarray, shape (6, K)
        First and last states.
    tof : ndarray, shape (K,)
        Times of flight.
    steps : int
        Sub-steps of their matrices.
    """

    start: Array
    end: Array
    tof: Array
    steps: int


@dataclass(frozen=True, eq=False)
class Waits:
    """A planar orbit to be propagated from its first state to K meetings.

    Parameters
    ----------
    arrives : bool
        Whether it is the orbit of arrival.
    target : ndarray, shape (6, K)
        Its states there, normalised.
    """

    arrives: bool
    target: Array


@dataclass(frozen=True, eq=False)
class VerifiedFlights:
    """Verified states, misses and altitudes of K coasts or waits.

    Parameters
    ----------
    start : ndarray, shape (6, K)
        First states, corrected, normalised.
    closure_km, closure_m_s : ndarray, shape (K,)
        Misses.
    impact : ndarray of bool, shape (K,)
        Whether they met the surface.
    places_m : ndarray, shape (3, P)
        Where on the ways the body may be nearest.
    place_lane : ndarray of int, shape (P,)
        Of which of them.
    """

    start: Array
    closure_km: Array
    closure_m_s: Array
    impact: NDArray[np.bool_]
    places_m: Array
    place_lane: NDArray[np.intp]

    @classmethod
    def join(cls, parts: Sequence[VerifiedFlights]) -> VerifiedFlights:
        """Return the lanes of all parts, concatenated."""
        first = np.cumsum([0, *(part.impact.size for part in parts)])
        return cls(
            np.concatenate([part.start for part in parts], axis=1),
            np.concatenate([part.closure_km for part in parts]),
            np.concatenate([part.closure_m_s for part in parts]),
            np.concatenate([part.impact for part in parts]),
            np.concatenate([part.places_m for part in parts], axis=1),
            np.concatenate([p.place_lane + k for p, k in zip(parts, first, strict=False)]),
        )


def coasts_of(start: Array, end: Array, tof: Array) -> list[Coasts]:
    """Return legs in pieces; the arguments are those of `Coasts`."""
    if not tof.size:
        return []
    steps = int(np.max(tof) / (2.0 * np.pi) * _STEPS_PER_UNIT) + 1
    return [Coasts(start[:, s], end[:, s], tof[s], steps) for s in _parts(tof.size)]


def waits_of(target: Array, *, arrives: bool) -> list[Waits]:
    """Return meetings with a planar orbit in pieces; the arguments are those of `Waits`."""
    return [Waits(arrives, target[:, s]) for s in _parts(target.shape[1])]


def _parts(lanes: int) -> Iterator[slice]:
    # one lane that is left over joins the piece before it: alone it would go without a batch
    starts = list(range(0, max(1, lanes - 1), _LANES)) if lanes else []
    return (slice(a, b) for a, b in pairwise([*starts, lanes]))


class LegFlights:
    """Verifies pieces of legs with one compiled propagator.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    flow : Flow
        The same, compiled.
    curves : (PolarOrbit, PolarOrbit)
        Planar orbits of departure and arrival.
    """

    def __init__(self, plant: Plant, flow: Flow, curves: tuple[PolarOrbit, PolarOrbit]) -> None:
        self._plant, self._flow, self._curves = plant, flow, curves

    def __call__(self, piece: Coasts | Waits) -> VerifiedFlights:
        """Fly a piece; coasts are corrected before."""
        if isinstance(piece, Coasts):
            start = self.correct_starts(piece)
            return self._verify("leg", start, piece.tof, piece.end)
        curve, target = self._curves[piece.arrives], piece.target
        start = np.repeat(curve.x0[:, None], target.shape[1], axis=1)
        return self._verify("planar", start, curve.time(np.arctan2(target[1], target[0])), target)

    def _verify(self, name: str, start: Array, duration: Array, end: Array) -> VerifiedFlights:
        unit, clock = self._flow.system.unit[:, None], self._flow.system.time_unit_s
        flight = Flight(name, duration * clock, np.zeros((3, duration.size)), end * unit)
        flown = verify(self._plant, start * unit, [flight])
        return VerifiedFlights(
            start, flown.closure_km, flown.closure_m_s, flown.impact, flown.places_m,
            flown.place_lane,
        )  # fmt: skip

    def correct_starts(self, piece: Coasts) -> Array:
        """Return first states from which the Taylor propagator reaches planned ends.

        Passing near the body and the unstable orbit, a leg magnifies the last digits of its first
        state. The matrix of the flight tells which change of the first state, of the order of
        those digits, takes the miss away; a step that does not make it smaller is not taken.

        Parameters
        ----------
        piece : Coasts
            Legs, K of them.

        Returns
        -------
        ndarray, shape (6, K)
            Corrected first states, normalised. None is moved by more than its miss.
        """
        end, tof, taylor = piece.end, piece.tof, self._flow.taylor
        best = piece.start
        miss = taylor.propagate(best, tof) - end
        matrix: Array | None = None
        for _ in range(_CORRECTIONS):
            size = np.linalg.norm(miss, axis=0)
            if not (size > _ENOUGH).any():
                break
            if matrix is None:
                _, matrix = self._flow.with_matrix(np.ascontiguousarray(best), tof, piece.steps)
            tried = best - _cause(matrix, miss)
            other = taylor.propagate(tried, tof) - end
            better = (size > _ENOUGH) & (np.linalg.norm(other, axis=0) < size)
            if not better.any():
                break
            best, miss = np.where(better, tried, best), np.where(better, other, miss)
        return best


def _cause(matrix: Array, miss: Array) -> Array:
    """Return the first states' errors (6, K) that the flight magnifies to misses (6, K).

    The matrix of a Hamiltonian flight shrinks as many directions as it stretches, by the same
    factors. Along a stretched one the error is smaller than the miss by that factor; along a shrunk
    one it would be larger by it, so that a miss of the size of rounding would move the first state
    away from where the search put it. That part of the miss is not caused by the first state, and
    is left: singular values below one count as zero.
    """
    flown = np.isfinite(matrix).all(axis=(0, 1))
    # a flight that met a singularity keeps its miss, and does not stop the others
    known = np.where(flown, matrix, np.eye(len(matrix))[:, :, None])
    left, size, right = np.linalg.svd(np.moveaxis(known, 2, 0))
    part = np.einsum("kij,ik->kj", left, miss)
    part = np.where(size >= 1.0, part / np.maximum(size, 1.0), 0.0)
    return np.where(flown, np.einsum("kji,kj->ik", right, part), np.nan)
