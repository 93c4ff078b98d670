r"""Exact analysis of sampled-data loops: a plant in continuous time, a controller at samples.

Between samples plant, filters and controller move by matrix exponentials; over one period the whole
is a linear map, the monodromy, and the loop is stable if and only if its eigenvalues lie inside the
unit circle [1]_. Nothing stands in for the hold: not a Padé delay, not a discrete plant for a
controller that acts between samples.

References
----------
.. [1] T. Chen, B. A. Francis (1995), Optimal Sampled-Data Control Systems, Springer, chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm

__all__ = ["SampledLoop", "SampledMargins", "first_unstable_period", "sampled_margins"]

_STEPS = 160
"""Factors of the gain that are looked at on either side of one, evenly in their logarithm."""
_FAR = 100.0
"""A gain margin is looked for up to this factor, and down to its inverse."""


@dataclass(frozen=True)
class SampledLoop:
    r"""A sampled-data loop: a plant G and a controller K of its sampled outputs, u = K y.

    K is closed without a change of sign, as a synthesis makes it. In continuous time it runs
    between the samples, on outputs that are held; in discrete time its u is held.

    Parameters
    ----------
    plant : LtiSystem
        G in continuous time, from p controls to the q values that are seen, without a direct term.
    controller : LtiSystem
        K, filters included.
    period_s : float
        Time between samples.
    delay_s : float
        Time from a sample until it acts, at most a period.

    Raises
    ------
    InputError
        If the two do not fit, or a time does not.
    """

    plant: LtiSystem
    controller: LtiSystem
    period_s: float
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        plant, k, h = self.plant, self.controller, self.period_s
        if plant.dt_s is not None or plant.d.any():
            raise InputError("a sampled loop needs a plant in continuous time without direct term")
        if k.shape != plant.shape[::-1]:
            raise InputError(
                f"the controller is {k.shape[0]} × {k.shape[1]}, the plant {plant.shape[0]} × "
                f"{plant.shape[1]}: their signals do not fit"
            )
        if not (np.isfinite(h) and h > 0.0) or not 0.0 <= self.delay_s <= h:
            raise InputError(
                f"a period must be > 0 s and a delay at most as long, got {h} s and "
                f"{self.delay_s} s"
            )
        if k.dt_s is not None and abs(k.dt_s - h) > 1e-9 * h:
            raise InputError(f"the controller was made for a period of {k.dt_s:.12g} s, not {h} s")

    @property
    def controls(self) -> int:
        """Number of the plant's controls."""
        return self.plant.shape[1]

    def monodromy(self, factors: Array | None = None) -> Array:
        """Return the monodromy: the map of plant, controller and held values over one period.

        Parameters
        ----------
        factors : ndarray, shape (..., p), optional
            Factors on the plant's controls; ones if absent.

        Returns
        -------
        ndarray, shape (..., s, s)
            s is n + m + q for a controller in continuous time, else n + m + p.
        """
        if factors is None:
            factors = np.ones(self.controls)
        return self._over_a_period(factors)[..., : self._size, : self._size]

    def spectral_radius(self, factors: Array | None = None) -> Array:
        """Return the largest size of the eigenvalues (...,) of the monodromy."""
        return np.asarray(np.abs(np.linalg.eigvals(self.monodromy(factors))).max(axis=-1))

    @property
    def is_stable(self) -> bool:
        """Whether the loop is stable."""
        return bool(self.spectral_radius() < 1.0)

    def sensitivity(self) -> LtiSystem:
        """Return S at the plant's controls, in discrete time.

        From disturbances of the controls that are held over each period to the mean over it of what
        then enters the plant: for a controller whose u is held (I − K G)⁻¹ with the plant as it is
        seen through the hold; for one that acts between samples the same of the whole hybrid loop.
        """
        whole = self._over_a_period(np.ones(self.controls))
        n, p, h = self._size, self.controls, self.period_s
        d, total = slice(n, n + p), slice(n + p, n + 2 * p)
        return LtiSystem(whole[:n, :n], whole[:n, d], whole[total, :n] / h, whole[total, d] / h, h)

    @property
    def _held_size(self) -> int:
        return self.controller.shape[1 if self.controller.dt_s is None else 0]

    @property
    def _size(self) -> int:
        return self.plant.order + self.controller.order + self._held_size

    def _over_a_period(self, factors: Array) -> Array:
        """Return the map (..., s + 2p, s + 2p) of states, disturbance and ∫ of the total."""
        before = self._flow(factors, self.delay_s)
        after = self._flow(factors, self.period_s - self.delay_s)
        sampled = self._sample_map()
        if self.delay_s == 0.0:
            return np.asarray(after @ sampled)
        # The old values act first; the new ones are those of the sample all the same, and travel
        # as further rows until the delay is over.
        s, held = len(sampled), self._held_size
        rows = slice(self._size - held, self._size)
        # flow until the delay is over with the old values, the new ones stored as extra rows
        widened = np.zeros((*factors.shape[:-1], s + held, s))
        widened[..., :s, :] = before @ self._only_controller()
        widened[..., s:, :] = sampled[rows]
        swap = np.eye(s, s + held)
        swap[rows, rows] = 0.0
        swap[rows, s:] = np.eye(held)
        return np.asarray(after @ swap @ widened)

    def _flow(self, factors: Array, time_s: float) -> Array:
        """Return the transition matrix of the loop between changes of the held signals."""
        plant, k, p = self.plant, self.controller, self.controls
        n, m, held = plant.order, k.order, self._held_size
        x, xk, y = slice(0, n), slice(n, n + m), slice(n + m, n + m + held)
        d, total = slice(y.stop, y.stop + p), slice(y.stop + p, y.stop + 2 * p)
        rate = np.zeros((*factors.shape[:-1], total.stop, total.stop))
        into = plant.b * factors[..., None, :]
        # generator of the states (plant, controller, held values, disturbance, ∫ of the total
        # command)
        rate[..., x, x] = plant.a
        rate[..., x, d] = into
        rate[..., total, d] = np.eye(p)
        if k.dt_s is None:
            rate[..., xk, xk], rate[..., xk, y] = k.a, k.b
            rate[..., x, xk], rate[..., x, y] = into @ k.c, into @ k.d
            rate[..., total, xk], rate[..., total, y] = k.c, k.d
        else:
            rate[..., x, y], rate[..., total, y] = into, np.eye(p)
        return np.asarray(expm(rate * time_s))

    def _sample_map(self) -> Array:
        """Return the jump at a sample: new values are held, a controller in discrete time steps."""
        plant, k, n, m = self.plant, self.controller, self.plant.order, self.controller.order
        made = self._only_controller()
        y = slice(n + m, n + m + self._held_size)
        made[y] = 0.0
        if k.dt_s is None:
            made[y, :n] = plant.c
        else:
            made[y, :n], made[y, n : n + m] = k.d @ plant.c, k.c
        return made

    def _only_controller(self) -> Array:
        """Return the jump at a sample of the controller alone; the held values stay."""
        plant, k, n, m = self.plant, self.controller, self.plant.order, self.controller.order
        made = np.eye(self._size + 2 * self.controls)
        if k.dt_s is not None:
            made[n : n + m, : n + m] = np.hstack([k.b @ plant.c, k.a])
        return made


@dataclass(frozen=True)
class SampledMargins:
    """Stability and margins of a sampled loop at the plant's p controls.

    Parameters
    ----------
    spectral_radius : float
        Of the monodromy; the loop is stable below one.
    peak : float
        Ms, the H∞ norm of `SampledLoop.sensitivity`, all controls at once; infinite of an unstable
        loop.
    peak_rad_s : float
        Where it is.
    peaks : ndarray, shape (p,)
        The same of each control by itself, the other loops closed.
    gain_lower, gain_upper : ndarray, shape (p + 1,)
        The loop stays stable for all factors on the gain of one control between them, the others as
        they are, and last for a common factor on all; 0 and infinite where none up to 100 and down
        to its inverse ends it; ones of an unstable loop.
    """

    spectral_radius: float
    peak: float
    peak_rad_s: float
    peaks: Array
    gain_lower: Array
    gain_upper: Array


def sampled_margins(loop: SampledLoop) -> SampledMargins:
    """Return the margins of a sampled loop.

    Gain margins are exact for the hybrid loop: the factors at which an eigenvalue of its monodromy
    meets the unit circle.

    Parameters
    ----------
    loop : SampledLoop
        The loop.

    Returns
    -------
    SampledMargins
        Gain, phase and delay margins.
    """
    p, radius = loop.controls, float(loop.spectral_radius())
    if not radius < 1.0:
        one = np.ones(p + 1)
        return SampledMargins(radius, np.inf, np.nan, np.full(p, np.inf), one, one.copy())
    s = loop.sensitivity()
    norm = hinf_norm(s)
    peaks = [
        hinf_norm(LtiSystem(s.a, s.b[:, [i]], s.c[[i]], s.d[[i]][:, [i]], s.dt_s)).value
        for i in range(p)
    ]
    directions = np.vstack([np.eye(p), np.ones(p)])
    lower, upper = (
        np.array([_gain_margin(loop, which, sign) for which in directions]) for sign in (-1, 1)
    )
    return SampledMargins(radius, norm.value, norm.frequency_rad_s, np.array(peaks), lower, upper)


def _gain_margin(loop: SampledLoop, which: Array, sign: Literal[-1, 1]) -> float:
    """Return the factor on some controls, below or above one, at which stability ends."""

    def radius(log_gain: Array | float) -> Array:
        return loop.spectral_radius(np.exp(np.multiply.outer(log_gain, which))) - 1.0

    # the first factor at which the spectral radius reaches one, bracketed on a grid
    logs = np.linspace(0.0, sign * np.log(_FAR), _STEPS + 1)
    unstable = np.flatnonzero(radius(logs[1:]) >= 0.0)
    if not unstable.size:
        return 0.0 if sign < 0 else np.inf
    k = int(unstable[0])
    return float(np.exp(brentq(lambda g: float(radius(g)), logs[k], logs[k + 1], xtol=1e-13)))


def first_unstable_period(
    plants: Sequence[LtiSystem],
    controller: Callable[[float], LtiSystem],
    shortest_s: float,
    longest_s: float,
    *,
    delay_s: float = 0.0,
    steps: int = 200,
) -> float:
    """Return the shortest period at which a controller loses one of several plants.

    Parameters
    ----------
    plants : sequence of LtiSystem
        As for `SampledLoop`.
    controller : callable
        What flies at a period: the same in continuous time, or what samples make of it.
    shortest_s, longest_s : float
        Where it is looked for.
    delay_s : float
        Time from a sample until it acts; of a shorter period all of it.
    steps : int
        Periods looked at, evenly in their logarithm, before the first change is located.

    Returns
    -------
    float
        The shortest period if the loop is not stable there; infinite if it always is.

    Raises
    ------
    InputError
        If the periods are not positive and rising.
    """

    def radius(log_period: float) -> float:
        period = float(np.exp(log_period))
        flown = controller(period)
        loops = (SampledLoop(one, flown, period, min(delay_s, period)) for one in plants)
        return max(float(loop.spectral_radius()) for loop in loops) - 1.0

    if not 0.0 < shortest_s < longest_s:
        raise InputError(f"periods must rise from above zero, got {shortest_s} and {longest_s} s")
    logs = np.linspace(np.log(shortest_s), np.log(longest_s), steps + 1).tolist()
    if radius(logs[0]) >= 0.0:
        return shortest_s
    for low, high in pairwise(logs):
        if radius(high) >= 0.0:
            return float(np.exp(brentq(radius, low, high, xtol=1e-12)))
    return np.inf
