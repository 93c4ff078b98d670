"""Motion and sensors linearised about one path, however far the estimate is from it.

A filter that linearises each measurement about its current estimate combines derivatives that
belong to different distances, while the distance is hardly known. Directions in the state space
that no sensor observes then seem observed, and the covariance becomes too small [1]_. Linearised
about one path all derivatives are consistent. If this is repeated along the path of the result
until it converges, the last belief of the filter is the Gauss-Newton solution for all measurements
with the random accelerations among the unknowns: an iterated smoother [2]_.

References
----------
.. [1] Huang, Mourikis, Roumeliotis (2010), Observability-based rules for designing consistent EKF
   SLAM estimators, International Journal of Robotics Research 29(5).
.. [2] Bell (1994), The iterated Kalman smoother as a Gauss-Newton method, SIAM Journal on
   Optimization 4(3).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Channel, Integers
from hillsphere_estimators.differences import layout_of
from hillsphere_estimators.innovations import require_independent, usable
from hillsphere_estimators.orbit_refinement.motion import BodiesModel

__all__ = ["LinearPath", "path_to"]


class LinearPath(BodiesModel):
    """A `BodiesModel` replaced by its tangents along a path: linear motion and linear sensors.

    It is made by `about`, for the times of the path. Its measurements are the differences from
    those on the path, as plain numbers: angles do not wrap, however large the difference.
    """

    _shown: Array
    _slopes: Array
    _path: Array
    _at: dict[float, int]
    _base: BodiesModel
    _phi: dict[tuple[int, int], Array]

    @classmethod
    def about(cls, model: BodiesModel, path: Array, present: NDArray[np.bool_]) -> Self:
        """Linearise a model about a path.

        Parameters
        ----------
        model : BodiesModel
            Motion and sensors.
        path : ndarray, shape (n, K, N)
            States at the times of its scenes, each moved from the one before.
        present : ndarray of bool, shape (m, K, N)
            Rows that are evaluated; the others hold zeros.

        Returns
        -------
        LinearPath
            The linear model.
        """
        made = cls.__new__(cls)
        made.__dict__.update(model.__dict__)
        times = np.array(model.times_s)
        made._path = path
        made._shown, slopes = model.along(path, times, present)
        rows, n, count, cases = slopes.shape
        flat = layout_of(model.suite.blocks).tangent(
            slopes.reshape(rows, n, -1).transpose(2, 0, 1), made._shown.reshape(rows, -1)
        )
        made._slopes = flat.reshape(count, cases, rows, n)
        made._at = {float(t): k for k, t in enumerate(times)}
        made._base, made._phi = model, {}
        return made

    def beyond(self, measured: MeasurementSet) -> MeasurementSet:
        """Return measurements of one time as differences from those on the path."""
        require_independent([measured], "a linearised path")
        layout, used = usable(measured)
        shown = self._shown[:, self._at[float(measured.t_s[0])]]
        off = layout.difference(np.where(used, measured.values, shown), shown)
        return replace(measured, values=off, blocks=_plain(measured.blocks), present=used)

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states (n, K) later, by the transition matrix about the path."""
        before, after = (self._at[float(t[0])] for t in (t0_s, t1_s))
        off = (x - self._path[:, before, case]).T[:, :, None]
        phi = self._across(before, after)[case]
        return np.ascontiguousarray(self._path[:, after, case] + (phi @ off)[:, :, 0].T)

    def transition(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return the transition matrices (N, n, n) along the path."""
        return self._across(*(self._at[float(t[0])] for t in (t0_s, t1_s)))

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots (N, n, r) of the covariance of the process noise along the path."""
        there = np.ascontiguousarray(self._path[:, self._at[float(t0_s[0])]])
        return self._base.process_noise(there, t0_s, t1_s, control)

    def _across(self, before: int, after: int) -> Array:
        """Return the transition matrices between two times, computed once."""
        if (before, after) not in self._phi:
            there = np.ascontiguousarray(self._path[:, before])
            cases = there.shape[1]
            t0, t1 = (np.full(cases, self.times_s[k]) for k in (before, after))
            none = np.zeros((0, cases))
            self._phi[before, after] = self._base.transition(there, t0, t1, none)
        return self._phi[before, after]

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return the linear measurements (m, N), all at one time."""
        k = self._at[float(t_s[0])]
        off = (x - self._path[:, k, case]).T[:, :, None]
        return np.ascontiguousarray((self._slopes[k, case] @ off)[:, :, 0].T)

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        """Return their derivatives (N, m, n)."""
        return np.asarray(self._slopes[self._at[float(t_s[0])]])


def path_to(model: BodiesModel, last: Belief) -> Array:
    """Return the path (n, K, N) without accelerations that leads to a belief's last means.

    Random accelerations bend the true path by far less than the distances over which the sensors
    are curved, so that the derivatives along both agree.
    """
    cases = last.x.shape[1]
    none, case = np.zeros((0, cases)), np.arange(cases)
    times = model.times_s
    states = [last.x]
    for later, earlier in zip(times[::-1], times[-2::-1], strict=False):
        t0, t1 = np.full(cases, later), np.full(cases, earlier)
        states.append(model.advance(states[-1], t0, t1, none, case))
    return np.stack(states[::-1], axis=1)


def _plain(blocks: tuple[tuple[Channel, ...], ...]) -> tuple[tuple[Channel, ...], ...]:
    """Return channels of as many rows, all of plain numbers."""
    return tuple(
        tuple(
            Channel(f"{channel.name} {row}", channel.unit)
            for channel in block
            for row in range(channel.rows)
        )
        for block in blocks
    )
