r"""Gain, phase and delay margins of loops closed by negative feedback, S = (I + L)⁻¹.

Crossings are found exactly: the gain of a scalar L(jω) is one at the imaginary zeros of
:math:`1 - L(-s) L(s)`, and L(jω) is real at those of :math:`L(s) - L(-s)`; both are eigenvalues of
a pencil made of the matrices of L. A sample rate changes nothing of this: the bilinear map brings
the unit circle to the axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eig
from scipy.optimize import brentq

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response
from hillsphere_controllers.systems.algebra import close_with_gain, feedback, gain
from hillsphere_controllers.systems.balancing import balance_states
from hillsphere_controllers.systems.bilinear import continuous

__all__ = ["LoopMargins", "loop_margins"]

Complex = NDArray[np.complex128]
Curve = Callable[[Complex], Array]

_GRID = 200
"""Frequencies that are looked at besides the eigenvalues, should one of these be missed."""
_BESIDE = 1e-7
"""Relative distance to both sides of a candidate at which L is evaluated, so that its change of
sign there is seen."""
_REAL, _SAME = 1e-6, 1e-5
"""The first is the deviation of L from the real axis or the unit circle up to which a candidate
counts as a crossing, the second the relative distance of frequencies up to which two are one."""
_NEAR = 1e-2
"""Zeros this near to the imaginary axis, relative to their size, are candidates. A double crossing
is displaced by the root of rounding; a larger value only costs evaluations."""
_NOISY = 100.0
"""A real crossing is believed where L is so many times what rounding may change in it: at a pole on
the axis, or far beyond all poles, its sign is no news."""
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class LoopMargins:
    """Margins of one loop while all others stay as they are.

    Parameters
    ----------
    stable : bool
        Whether the closed loop is stable. If not, it bears nothing: the other numbers are those of
        no margin at all.
    gain_lower, gain_upper : float
        The loop stays stable for all factors on its gain between them; 0 and infinite where nothing
        bounds them.
    gain_lower_rad_s, gain_upper_rad_s : float
        Frequencies of the oscillation at these factors; NaN where there is none.
    phase_rad : float
        It stays stable for all changes of phase up to this, both ways; π where nothing bounds it.
    phase_rad_s : float
        Frequency at which the phase is that near; NaN where the gain is one nowhere.
    delay_s : float
        It stays stable for all additional delays below this; infinite where nothing bounds it. Zero
        if the gain does not fall below one at infinite frequency. In discrete time that holds for
        delays of whole periods: a part of one changes the gain between the samples too, of which L
        knows nothing, and a loop may bear less of it (it may even where this is infinite). Such a
        delay is judged by `hillsphere_controllers.systems.sampling.sampled_loop`. Zero there if L
        at z = −1, half the sampling rate, or its direct term is one or more in size.
    delay_rad_s : float
        Frequency of the oscillation at that delay; NaN where there is none.
    """

    stable: bool
    gain_lower: float
    gain_upper: float
    gain_lower_rad_s: float
    gain_upper_rad_s: float
    phase_rad: float
    phase_rad_s: float
    delay_s: float
    delay_rad_s: float


_NONE = LoopMargins(False, 1.0, 1.0, np.nan, np.nan, 0.0, np.nan, 0.0, np.nan)


def loop_margins(loop: LtiSystem) -> tuple[LoopMargins, ...]:
    """Return the margins of each loop, the others closed.

    Parameters
    ----------
    loop : LtiSystem
        L, as many outputs as inputs, closed by negative feedback: ``series(plant, controller)``
        for margins at the controls, ``series(controller, plant)`` at the measurements. In discrete
        time, a plant as the computer sees it is given by `hillsphere_controllers.systems.holding`,
        and the delay margin is one of whole periods.

    Returns
    -------
    tuple of LoopMargins
        One per channel.

    Raises
    ------
    InputError
        If L is not square, or has a pole at z = −1.
    """
    p, m = loop.shape
    if p != m or p == 0:
        raise InputError(f"a loop has as many outputs as inputs, got {p} and {m}")
    if not feedback(gain(np.eye(p)), loop).is_stable:
        return (_NONE,) * p
    return tuple(_channel_margins(_single_loop(loop, i)) for i in range(p))


def _single_loop(loop: LtiSystem, channel: int) -> LtiSystem:
    """Return the loop of one channel, the others closed."""
    others = -np.eye(loop.shape[0])
    others[channel, channel] = 0.0
    closed = close_with_gain(replace(loop, inputs=(), outputs=()), others)
    at = slice(channel, channel + 1)
    return LtiSystem(closed.a, closed.b[:, at], closed.c[at], closed.d[at, at], loop.dt_s)


def _channel_margins(loop: LtiSystem) -> LoopMargins:
    image, _ = balance_states(loop if loop.dt_s is None else continuous(loop))
    curve = _Curve(image)
    gains, phases = curve.real_crossings(), curve.unit_crossings()
    direct = float(image.d[0, 0])

    def rate(omega: float) -> float:
        if loop.dt_s is None:
            return omega
        return float(2.0 / loop.dt_s * np.arctan(0.5 * loop.dt_s * omega))

    lower, upper = (0.0, np.nan), (np.inf, np.nan)
    for omega, value in gains:
        # the factor that brings the crossing to −1
        factor = -1.0 / value.real
        if factor > 1.0:
            upper = min(upper, (factor, omega), key=lambda pair: pair[0])
        else:
            lower = max(lower, (factor, omega), key=lambda pair: pair[0])
    phase, delay = (np.pi, np.nan), (np.inf, np.nan)
    for omega, value in phases:
        # phase between L and −1, and the delay that uses it up at this frequency
        lag = float(np.angle(-value)) % (2.0 * np.pi)
        phase = min(phase, (min(lag, 2.0 * np.pi - lag), omega), key=lambda pair: pair[0])
        delay = min(delay, (lag / rate(omega), omega), key=lambda pair: pair[0])
    # In discrete time that is L(−1): z⁻ᵏ turns it by half a turn for each period, all at once at
    # the end of the curve, so that a gain of one or more there is an encirclement without a
    # crossing. A direct term comes a period later however short the delay.
    if max(abs(direct), abs(float(loop.d[0, 0]))) >= 1.0:
        delay = (0.0, np.inf)
    return LoopMargins(
        True, lower[0], upper[0], rate(lower[1]), rate(upper[1]), phase[0], rate(phase[1]),
        delay[0], rate(delay[1]),
    )  # fmt: skip


class _Curve:
    """L(jω) of a scalar loop in continuous time."""

    def __init__(self, loop: LtiSystem) -> None:
        self.loop = loop
        self._response = Response(loop.a, loop.b, loop.c, loop.d)
        self._poles = self._response.poles
        size = np.abs(self._poles)
        size = size[size > 0.0]
        low, high = (size.min(), size.max()) if size.size else (1.0, 1.0)
        self._grid = np.concatenate(
            [size, np.logspace(np.log10(low) - 3.0, np.log10(high) + 3.0, _GRID)]
        )

    def __call__(self, omega: Array) -> Complex:
        return np.asarray(self._response(np.asarray(1j * omega, dtype=complex))[:, 0, 0])

    def real_crossings(self) -> list[tuple[float, complex]]:
        """Return the frequencies at which L is real and negative, and L there."""
        frequencies = [
            (omega, value)
            for omega, value in self._crossings(
                self._real_at(), lambda value: value.imag / np.abs(value)
            )
            if value.real < 0.0 and abs(value.imag) <= _REAL * abs(value)
        ]
        # the ends of the axis, where L is real in any case
        loop = self.loop
        if loop.d[0, 0] < 0.0:
            frequencies.append((np.inf, complex(loop.d[0, 0])))
        size = np.abs(self._poles)
        if size.min(initial=np.inf) > 4.0 * len(size) * _EPS * size.max(initial=0.0):
            at_rest = complex(self(np.zeros(1))[0])
            if at_rest.real < 0.0:
                frequencies.append((0.0, at_rest))
        return [pair for pair in frequencies if abs(pair[1]) > _NOISY * self._noise(pair[0])]

    def _noise(self, omega: float) -> float:
        """Return the change of L by rounding of the entries of A, to first order.

        Entry by entry: the norms of A and of what stands beside it would let fast poles hide all
        that happens at low frequencies.
        """
        loop = self.loop
        if np.isinf(omega):
            return 0.0
        shifted = 1j * omega * np.eye(loop.order) - loop.a
        try:
            into = np.linalg.solve(shifted, loop.b)
            out = np.linalg.solve(shifted.T, loop.c.T)
        except np.linalg.LinAlgError:  # at a pole
            return np.inf
        return float(_EPS * (np.abs(out).T @ np.abs(loop.a) @ np.abs(into))[0, 0])

    def unit_crossings(self) -> list[tuple[float, complex]]:
        """Return the frequencies at which the gain is one, and L there."""
        return [
            (omega, value)
            for omega, value in self._crossings(
                self._unit_at(), lambda value: np.log(np.abs(value))
            )
            if abs(abs(value) - 1.0) <= _REAL
        ]

    def _crossings(self, candidates: Array, side: Curve) -> list[tuple[float, complex]]:
        """Return where a function of L changes its sign, or vanishes at a candidate."""
        points = np.concatenate(
            [self._grid, candidates * (1.0 - _BESIDE), candidates * (1.0 + _BESIDE)]
        )
        points = np.unique(points[np.isfinite(points) & (points > 0.0)])
        with np.errstate(all="ignore"):
            sides = side(self(points))
        keep = np.isfinite(sides)
        points, sides = points[keep], sides[keep]

        def at(log_omega: float) -> float:
            return float(side(self(np.exp([log_omega])))[0])

        frequencies = []
        for k in np.flatnonzero(sides[1:] * sides[:-1] < 0.0):
            ends = np.log(points[k : k + 2])
            if at(ends[0]) * at(ends[1]) < 0.0:
                frequencies.append(float(np.exp(brentq(at, *ends, xtol=1e-15, rtol=1e-15))))
        # a curve that touches and does not cross has a candidate all the same
        known = np.array(frequencies)
        frequencies += [
            x for x in candidates if x > 0.0 and not (np.abs(known - x) <= _SAME * x).any()
        ]
        if not frequencies:
            return []
        with np.errstate(all="ignore"):
            values = self(np.array(frequencies))
        return [
            (float(omega), complex(value))
            for omega, value in zip(frequencies, values, strict=True)
            if np.isfinite(value)
        ]

    def _unit_at(self) -> Array:
        """Return candidates for a gain of one: zeros of 1 − L(−s) L(s)."""
        a, b, c, d = self.loop.a, self.loop.b, self.loop.c, self.loop.d
        # realisation of 1 − L(−s) L(s)
        both = np.block([[a, np.zeros_like(a)], [c.T @ c, -a.T]])
        into, out = np.vstack([b, c.T @ d]), np.hstack([-d.T @ c, b.T])
        return _axis_zeros(both, into, out, np.eye(1) - d.T @ d)

    def _real_at(self) -> Array:
        """Return candidates for a real L: zeros of L(s) − L(−s)."""
        a, b, c = self.loop.a, self.loop.b, self.loop.c
        return _axis_zeros(
            block_diag(a, -a.T), np.vstack([b, c.T]), np.hstack([c, b.T]), np.zeros((1, 1))
        )


def _axis_zeros(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the sizes of the zeros of C (s I − A)⁻¹ B + D that lie near the imaginary axis."""
    n = len(a)
    left = np.block([[a, b], [c, d]])
    right = block_diag(np.eye(n), np.zeros((1, 1)))
    alpha, beta = eig(left, right, right=False, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-300
    with np.errstate(all="ignore"):
        zeros = alpha[finite] / beta[finite]
    zeros = zeros[np.isfinite(zeros)]
    near = np.abs(zeros.real) <= _NEAR * np.abs(zeros)
    return np.unique(np.abs(zeros[near].imag))
