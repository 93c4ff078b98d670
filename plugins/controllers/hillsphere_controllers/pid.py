"""Sampled PID control with derivative filter and anti-windup."""

from __future__ import annotations

from typing import Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.specs import PidSpec

__all__ = ["Pid"]


class Pid:
    r"""PID on each axis, sampled every h and held.

    With the error e of the position (seen − reference) and v of the velocity,

    .. math::

        u_k &= \mathrm{sat}(w_k), \qquad w_k = -(K_p e_k + I_k + D_k), \\
        I_{k+1} &= I_k + h K_i e_k - \frac{h}{T_t} (u_k - w_k), \\
        D_k &= \frac{T_f}{T_f + h} D_{k-1} + \frac{h K_d}{T_f + h} v_k,

    with v taken from the velocities seen, or as (e_k − e_{k−1})/h; D and I begin with zero, and
    without an earlier e the first v is zero. This is the implementation of [1]_ (section 10.5,
    which writes the error with the other sign): backward difference for the derivative filter,
    forward for the integral, back-calculation against windup.

    Parameters
    ----------
    spec : PidSpec
        Gains and limits.

    References
    ----------
    .. [1] K. J. Åström, R. M. Murray (2008), Feedback Systems, Princeton University Press.
    """

    actuation: Literal["hold", "impulse"] = "hold"

    def __init__(self, spec: PidSpec) -> None:
        self.spec = spec
        self.period_s = spec.period_s
        self.axes = len(spec.proportional)
        h, tf = spec.period_s, spec.derivative_filter_s
        self._kp = _column(spec.proportional, self.axes)
        self._hki = h * _column(spec.integral, self.axes)
        self._kept = tf / (tf + h)
        self._kd = h / (tf + h) * _column(spec.derivative, self.axes)
        self._back = h / (spec.tracking_time_s or h)

    def initial(self, n_cases: int) -> Array:
        """Return the states I, D and the last e, (3 axes, N), zero."""
        return np.zeros((3 * self.axes, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return the acceleration (axes, N), m/s², and the states."""
        axes, spec = self.axes, self.spec
        seen = axes if spec.rate == "position" else 2 * axes
        if len(y) < seen:
            raise InputError(f"the law needs {seen} rows of positions and velocities, got {len(y)}")
        integral, derivative, last = xc[:axes], xc[axes : 2 * axes], xc[2 * axes :]
        e = y[:axes] - ref[:axes]
        if spec.rate == "velocity":
            v = y[axes : 2 * axes] - ref[axes : 2 * axes]
        else:
            v = (e - last) / spec.period_s if k else np.zeros_like(e)
        derivative = self._kept * derivative + self._kd * v
        wanted = -(self._kp * e + integral + derivative)
        u = wanted
        integral = integral + self._hki * e
        if spec.maximum_m_s2 is not None:
            u = np.clip(wanted, -spec.maximum_m_s2, spec.maximum_m_s2)
            if spec.integral:
                # back-calculation: the integral runs back by the part of the command that was cut
                integral = integral - self._back * (u - wanted)
        return u, np.concatenate([integral, derivative, e])


def _column(gains: tuple[float, ...], axes: int) -> Array:
    return np.array(gains or (0.0,) * axes)[:, None]
