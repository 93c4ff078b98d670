"""Zero-effort-miss/zero-effort-velocity guidance for commands that are held."""

from __future__ import annotations

from typing import Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere_guidance.law_specs import ZemZevSpec
from hillsphere_guidance.motion import motion_of
from hillsphere_guidance.replanning import Replanner
from hillsphere_guidance.sites import Ground

__all__ = ["ZemZev"]

_CONTROL_POINTS = 12
"""Control points of each axis of the path that is planned at every sample: eight of them are free.
Only the command of the next period is taken from it, and the cost of a round grows with their
square."""


class ZemZev:
    r"""Command that brings a spacecraft to a state at a given time with the least effort.

    Let :math:`Z_r` and :math:`Z_v` be the zero-effort miss in position and velocity, that at the
    arrival without any further command, and T the time to go. In a constant field the command of
    the least :math:`\int |a|^2` is :math:`6 Z_r/T^2 - 2 Z_v/T` [1]_. Here commands are held over
    periods h; the least :math:`\sum |u_j|^2` over the N periods to go is

    .. math:: u_j = \alpha + \beta c_j, \qquad c_j = (N - j - \tfrac12) h, \qquad
              h \sum_j u_j = Z_v, \quad h \sum_j c_j u_j = Z_r,

    of which the first is commanded. In the last period only one of the two can be met, and the
    velocity is.

    In the full field (prediction "field") there is no such formula, and a flight without command is
    far from the one that is flown. The problem is then solved numerically: a spline of the least
    :math:`\int |a|^2` leads from the measured state to the target. It is planned again at each
    sample, starting from the rest of the last one, and its mean command over the period is
    commanded. If the search fails (a path through the body's centre), the command is that of the
    constant field.

    Parameters
    ----------
    spec : ZemZevSpec
        With its reference bound.

    References
    ----------
    .. [1] Y. Guo, M. Hawkins, B. Wie (2013), Applications of generalized zero-effort-miss/
       zero-effort-velocity feedback guidance algorithm, Journal of Guidance, Control, and Dynamics
       36(3), 810-820.
    """

    actuation: Literal["hold", "impulse"] = "hold"

    def __init__(self, spec: ZemZevSpec) -> None:
        self.spec = spec
        self.period_s = spec.period_s
        self.samples = round(spec.duration_s / spec.period_s)
        plant: Plant = spec.plant.get()
        self._motion = motion_of(plant)
        self._goal = self._touchdown_state(plant, spec)
        self._replanner = (
            Replanner(self._motion, _CONTROL_POINTS) if spec.prediction == "field" else None
        )

    def initial(self, n_cases: int) -> Array:
        """Return the planned paths, zero before the first sample; (0, N) without planning."""
        return np.zeros((self._replanner.rows if self._replanner else 0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return the acceleration (d, N), m/s², and the planned path."""
        x = self._full(y)
        goal = self._full(ref) if self._goal is None else np.repeat(self._goal, len(t_s), axis=1)
        left = self.samples - k
        if left <= 0:
            return np.zeros((self._motion.axes, y.shape[1])), xc
        with np.errstate(all="ignore"):
            u = self._constant(left, t_s, x, goal)
            if self._replanner is not None and left > 1:
                time, h = left * self.period_s, self.period_s
                before = h if k else None
                xc = self._replanner.plan(xc, before, time, t_s, x, goal)
                planned = self._replanner.command(xc, time, h, t_s, x)
                u = np.where(np.isfinite(planned).all(axis=0), planned, u)
                # a failed plan starts from the cubic path again
                xc = np.where(np.isfinite(xc).all(axis=0), xc, 0.0)
            return self._limit(u), xc

    def _touchdown_state(self, plant: Plant, spec: ZemZevSpec) -> Array | None:
        """Return the state (n, 1) at touchdown, other states zero; None without a site."""
        if spec.site is None:
            return None
        motion = self._motion
        goal = np.zeros((len(motion.states), 1))
        place = Ground(plant, goal[:, 0]).site(spec.site.latitude_rad, spec.site.longitude_rad)
        goal[motion.positions, 0] = place.position_m
        goal[motion.velocities, 0] = -(spec.touchdown_speed_m_s or 0.0) * place.up
        return goal

    def _full(self, y: Array) -> Array:
        """Return all states of the plant (n, N), or raise `InputError` if some are not measured."""
        if len(y) == len(self._motion.states):
            return y
        raise InputError(
            f"zem_zev must see all states of its plant; give the flight sees = "
            f"{[v.name for v in self._motion.states]}"
        )

    def _constant(self, left: int, t: Array, x: Array, goal: Array) -> Array:
        """Return the command (d, N) for a field that is constant in time and space."""
        motion, time = self._motion, left * self.period_s
        here, _, _ = motion.field(x, t)
        r, v = x[motion.positions], x[motion.velocities]
        end_r, end_v = goal[motion.positions], goal[motion.velocities]
        if self.spec.towards == "reference":
            # spacecraft and reference have the same feedforward: only their difference counts
            here = here - motion.field(goal, t)[0]
            r, v, end_r, end_v = r - end_r, v - end_v, np.zeros_like(r), np.zeros_like(v)
        zero_v = end_v - v - here * time
        zero_r = end_r - r - v * time - 0.5 * here * time * time
        return self._least(left, zero_r, zero_v)

    def _least(self, left: int, zero_r: Array, zero_v: Array) -> Array:
        """Return the first of the held commands of the least effort that remove a miss."""
        h = self.period_s
        if left == 1:
            return zero_v / h
        # h Σ c_j and h Σ c_j², then the two linear equations for α and β
        one, two = 0.5 * h * left**2, h * h * (4.0 * left**3 - left) / 12.0
        size = h * (left * two - one * one)
        alpha = (two * zero_v - one * zero_r) / size
        beta = (left * zero_r - one * zero_v) / size
        return np.asarray(alpha + beta * ((left - 0.5) * h))

    def _limit(self, u: Array) -> Array:
        """Return commands cut to the maximum, their direction kept."""
        most = self.spec.maximum_m_s2
        if most is None:
            return u
        size = np.sqrt(np.add.reduce(u * u, axis=0))
        return np.asarray(u * np.minimum(1.0, most / np.maximum(size, 1e-300)))
