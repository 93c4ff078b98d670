"""An orbit interpolated through the states of a numerical flight (Hermite interpolation)."""

from __future__ import annotations

from typing import cast, get_args

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import InertialFrame
from hillsphere.products import Trajectories
from hillsphere.time import Epoch

__all__ = ["TOLERANCE", "FlownOrbit", "estimate_interpolation_error"]

TOLERANCE = 1e-9
"""Largest error of interpolated positions, relative to the distance from the Earth's centre: 7 mm
in a low orbit, below the error of any force model. A smaller value needs shorter steps."""

_END_S = 1e-6
"""Time (s) by which a flight is evaluated beyond its ends: differences of epochs are rounded."""
_NODES = 4
"""States through which a polynomial runs: degree 7, error proportional to the eighth power of the
step. Two (a cubic) would need steps about ten times as short for the same error; more would let
rounding grow, and reach across a manoeuvre from farther away."""
_LEAST = _NODES + 1
"""States that a flight needs: its error is estimated by leaving one out of five."""
_GAIN = 18.0
"""Leaving out a node of five makes the error at least this much larger than it is between them: by
Π(t − t_i)², 16 h⁸ instead of 0.88 h⁸ in the outermost step and 0.32 h⁸ in the others."""


class FlownOrbit:
    """Orbit of a numerical flight, by Hermite interpolation of its states.

    Polynomials of degree seven run through the positions and velocities at the four nearest times.
    The error is proportional to the eighth power of the step.

    Parameters
    ----------
    name : str
        Name of the satellite.
    epoch : Epoch
        Origin of the times.
    frame : {"teme", "gcrs"}
        Inertial frame of the states.
    t_s : ndarray, shape (K,)
        Times of the states, s, in increasing order, at least five.
    x : ndarray, shape (6, K)
        Positions, m, and velocities, m/s, of a motion without manoeuvres.
    tolerance : float
        Largest error of the interpolated positions, relative to the distance from the centre.
    ending : str
        Reason why the flight ends at the last time, as the end of a sentence; by default the
        flight simply lasts no longer.

    Attributes
    ----------
    error_m : float
        Estimated largest error of interpolated positions, see `estimate_interpolation_error`.

    Raises
    ------
    InputError
        If the shapes do not match, times do not increase, a value is not finite, or the error of
        interpolation exceeds the tolerance: the steps are too long, or the states contain a jump.
    """

    def __init__(
        self,
        name: str,
        epoch: Epoch,
        frame: InertialFrame,
        t_s: Array,
        x: Array,
        tolerance: float = TOLERANCE,
        ending: str = "",
    ) -> None:
        t, x = np.asarray(t_s, dtype=float), np.asarray(x, dtype=float)
        if t.ndim != 1 or x.shape != (6, t.size) or t.size < _LEAST:
            raise InputError(
                f"flight {name!r}: needs at least {_LEAST} times (K,) and states (6, K), got "
                f"{t.shape} and {x.shape}"
            )
        if not (np.isfinite(t).all() and np.isfinite(x).all()) or not (np.diff(t) > 0.0).all():
            raise InputError(f"flight {name!r}: times must rise, and all must be finite")
        self.name, self.epoch, self.frame = name, epoch, frame
        self._t, self._ending = t, ending
        first = np.arange(t.size - _NODES + 1)
        self._nodes = t[first + np.arange(_NODES)[:, None]]
        self._coefficients = _divided_differences(t, x, first + np.arange(_NODES)[:, None])
        middle, off, allowed = estimate_interpolation_error(t, x, tolerance)
        self.error_m = float(off.max())
        if (off > allowed).any():
            worst = int(np.argmax(off - allowed))
            raise InputError(
                f"flight {name!r}: the interpolated positions have an error of {off[worst]:.3g} m "
                f"near {t[middle[worst]]:.6g} s, at most {allowed[worst]:.3g} m are allowed; give "
                "states at shorter steps, and split the flight at manoeuvres"
            )

    @classmethod
    def of_coast(cls, flights: Trajectories, coast: int, epoch: Epoch) -> FlownOrbit:
        """Return the orbit of one coast of a product.

        Parameters
        ----------
        flights : Trajectories
            Flights in the frame ``"teme"`` or ``"gcrs"``.
        coast : int
            Index of the coast.
        epoch : Epoch
            Origin of its times.

        Returns
        -------
        FlownOrbit
            Orbit with the name of the coast.

        Raises
        ------
        InputError
            If the frame is not inertial, or the states are too far apart.
        """
        if flights.frame not in get_args(InertialFrame):
            raise InputError(
                f"an orbit about the Earth needs states in {' or '.join(get_args(InertialFrame))}, "
                f"got a flight in {flights.frame!r}"
            )
        there = np.isfinite(flights.t_s[:, coast])
        return cls(
            flights.labels[coast], epoch, cast(InertialFrame, flights.frame),
            flights.t_s[there, coast], flights.x[:6, there, coast],
        )  # fmt: skip

    def states(self, t_s: Array) -> Array:
        """Return states at times after the epoch.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            SI seconds after the epoch, within the flight, in any order.

        Returns
        -------
        ndarray, shape (6, N)
            Positions, m, and velocities, m/s.

        Raises
        ------
        PropagationError
            If a time lies outside the flight.
        """
        t = np.atleast_1d(np.asarray(t_s, dtype=float))
        there = self.exists(t)
        if not there.all():
            outside = float(t[np.argmin(there)])
            raise PropagationError(
                f"satellite {self.name!r} {self.end_reason(outside)}; ask for times within, or "
                "fly it longer"
            )
        last = self._t.size - _NODES
        at = np.clip(np.searchsorted(self._t, t, side="right") - 2, 0, last)
        return _evaluate_polynomials(self._nodes[:, at], self._coefficients[:, :, at], t)

    def exists(self, t_s: Array) -> NDArray[np.bool_]:
        """Return whether each of the times (N,), s after the epoch, lies within the flight."""
        t = np.asarray(t_s, dtype=float)
        return np.asarray((t >= self._t[0] - _END_S) & (t <= self._t[-1] + _END_S))

    def end_reason(self, t_s: float) -> str:
        """Return why the flight has no state at a time, as the end of a sentence."""
        if self._ending and t_s > self._t[-1]:
            return self._ending
        return (
            f"has no state at {t_s:.6g} s: its flight lasts from {self._t[0]:.6g} to "
            f"{self._t[-1]:.6g} s after its epoch"
        )


def estimate_interpolation_error(
    t: Array, x: Array, tolerance: float = TOLERANCE
) -> tuple[NDArray[np.intp], Array, Array]:
    """Estimate the error of interpolation by leaving out one state at a time.

    Each inner state is predicted by the polynomial through its four neighbours. The difference,
    divided by `_GAIN`, bounds the error of the polynomials between the states.

    Parameters
    ----------
    t : ndarray, shape (K,)
        Times, s, in increasing order, K ≥ 5.
    x : ndarray, shape (6, K)
        Positions, m, and velocities, m/s.
    tolerance : float
        Allowed error relative to the distance from the centre.

    Returns
    -------
    middle : ndarray of int, shape (K − 4,)
        Indices of the states that are left out: all but two at each end.
    error_m, allowed_m : ndarray, shape (K − 4,)
        Estimated errors of positions near these states, and the tolerance plus the effect of
        rounding.
    """
    middle = np.arange(2, t.size - 2)
    around = middle + np.array([-2, -1, 1, 2])[:, None]
    guess = _evaluate_polynomials(t[around], _divided_differences(t, x, around), t[middle])[:3]
    place = x[:3, middle]
    # Rounding of states and times limits the comparison; shorter steps would not reduce it.
    rounding = 1e-13 * float(np.abs(x[:3]).max())
    allowed = tolerance * np.linalg.norm(place, axis=0) + rounding
    return middle, np.linalg.norm(guess - place, axis=0) / _GAIN, allowed


def _divided_differences(t: Array, x: Array, nodes: NDArray[np.int64]) -> Array:
    """Return the Newton coefficients (8, 3, M) of Hermite polynomials through nodes (4, M).

    Each node counts twice; the divided difference of a double node is the velocity there.
    """
    # z: each node twice. First column of the scheme: velocities at double nodes, else slopes.
    z = np.repeat(t[nodes], 2, axis=0)
    place = np.repeat(x[:3][:, nodes].swapaxes(0, 1), 2, axis=0)
    speed = x[3:][:, nodes].swapaxes(0, 1)
    table = place.copy()
    steps = z[1:] - z[:-1]
    first = np.empty_like(table[1:])
    first[0::2] = speed
    first[1::2] = (table[2::2] - table[1:-1:2]) / steps[1::2, None]
    out = [table[0], first[0]]
    level = first
    for order in range(2, 2 * _NODES):
        level = (level[1:] - level[:-1]) / (z[order:] - z[:-order])[:, None]
        out.append(level[0])
    return np.array(out)


def _evaluate_polynomials(nodes: Array, coefficients: Array, t: Array) -> Array:
    """Evaluate Newton polynomials and their derivatives by Horner's scheme: states (6, M)."""
    z = np.repeat(nodes, 2, axis=0)
    place = coefficients[-1]
    speed = np.zeros_like(place)
    # p ← p (t − z_k) + c_k, and its derivative by the product rule
    for k in range(2 * _NODES - 2, -1, -1):
        off = t - z[k]
        speed = speed * off + place
        place = place * off + coefficients[k]
    return np.concatenate([place, speed])
