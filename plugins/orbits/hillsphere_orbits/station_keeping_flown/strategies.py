r"""Strategies of station-keeping: impulses in proportion to the deviation from a reference.

They differ in the gains, made from the linear flow along the reference, and in what the deviation
is from. With :math:`A_k = \Phi(t_{k+1}, t_k)` a deviation goes as
:math:`\delta_{k+1} = A_k(\delta_k + B\,\Delta v_k)`, where B puts velocities into the state.

`GainSchedule` holds the reference in time, :math:`\Delta v_k = -G_k\,(\hat x(t_k) - x_{ref}(t_k))`,
with the gains of `target_point` or `periodic_lqr`. The others hold the orbit and leave the phase
free: their deviation is from the nearest point of the orbit, not from where the reference would be.
`FloquetMode` nulls the unstable component only; `phase_free_target_point` and `phase_free_lqr`
weigh what lies across the orbit, see `hillsphere_orbits.station_keeping_flown.phase_free`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Compensator
from hillsphere_orbits.station_keeping_flown.phase_free import (
    phase_free_lqr_gains,
    phase_free_target_point_gains,
)
from hillsphere_orbits.station_keeping_flown.reference_path import ReferencePath
from hillsphere_orbits.station_keeping_flown.sampling import Sampling, Weights

__all__ = [
    "STRATEGIES",
    "FloquetMode",
    "GainSchedule",
    "NearestPointLaw",
    "Uncorrected",
    "floquet_mode",
    "periodic_lqr",
    "periodic_lqr_gains",
    "phase_free_lqr",
    "phase_free_target_point",
    "target_point",
    "target_point_gains",
]

_SWEEPS = 500
"""Most rounds of the periodic Riccati recursion, one period each; the last one stands."""
_CONVERGED = 1e-10
"""Relative change of the cost matrix in one round: the gains follow to about as many digits."""


class GainSchedule:
    """Impulses −G_k (estimate − reference), with a gain per number of the correction.

    Parameters
    ----------
    period_s : float
        Time between corrections.
    gains : ndarray, shape (K, p, q)
        One per correction, from the estimated deviation (q rows, SI) to the Δv (p, m/s).

    Raises
    ------
    InputError
        If the gains are no such array of finite numbers.
    """

    actuation: Literal["hold", "impulse"] = "impulse"

    def __init__(self, period_s: float, gains: Array) -> None:
        if gains.ndim != 3 or not np.isfinite(gains).all():
            raise InputError(f"gains must be (K, p, q) finite numbers, got {gains.shape}")
        self.period_s, self.gains = period_s, gains

    def initial(self, n_cases: int) -> Array:
        """Return no states, (0, N)."""
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return Δv (p, N), m/s, and no states."""
        if k >= len(self.gains) or len(y) != self.gains.shape[2]:
            raise InputError(
                f"the schedule has {len(self.gains)} gains on {self.gains.shape[2]} values; "
                f"correction {k} on {len(y)} was asked for"
            )
        return self.gains[k] @ (ref - y), xc


class NearestPointLaw:
    r"""Impulses −G(τ) δ from the deviation δ from the nearest point of an orbit, of phase τ.

    Its own state is the slip: the phase of that point less the time, s.

    Parameters
    ----------
    period_s : float
        Time between corrections.
    path : ReferencePath
        The orbit.
    gains : callable
        Phases (K,) → gains (3, 6, K) or, of all states, (3, n, K); normalised.
    """

    actuation: Literal["hold", "impulse"] = "impulse"

    def __init__(
        self, period_s: float, path: ReferencePath, gains: Callable[[Array], Array]
    ) -> None:
        self.period_s, self.path, self.gains = period_s, path, gains

    def initial(self, n_cases: int) -> Array:
        """Return no slip, (1, N)."""
        return np.zeros((1, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return Δv (3, N), m/s, and the slip; what the loop gives as reference is not used."""
        system = self.path.flow.system
        phase, delta = self.deviation(t_s, y, xc[0])
        gains = self.gains(phase)
        # further states are the clock of a plant, which nothing corrects
        dv = -np.einsum("ijk,jk->ik", gains[:, :6], delta[:6])
        slip = phase - t_s / system.time_unit_s
        return dv * system.unit[3:6, None], slip[None] * system.time_unit_s

    def deviation(self, t_s: Array, y: Array, slip_s: Array) -> tuple[Array, Array]:
        """Return the phase (N,) of the nearest point and the deviation (n, N) from it, normalised.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            Time, s.
        y : ndarray, shape (n, N)
            States, SI.
        slip_s : ndarray, shape (N,)
            Slip from which the nearest point is looked for, s.
        """
        system = self.path.flow.system
        seen = y / system.unit[:, None]
        phase = self.path.nearest(seen, (t_s + slip_s) / system.time_unit_s)
        return phase, seen - self.path.interpolate(phase)[0]


class FloquetMode(NearestPointLaw):
    r"""The smallest impulse that nulls the unstable component of the deviation from an orbit.

    With the left unstable directions as rows of :math:`W = (W_r, W_v)` at the phase of the nearest
    point, :math:`\Delta v = -W_v^{+} W\,\delta` [1]_, [2]_.

    Parameters
    ----------
    period_s : float
        Time between corrections.
    path : ReferencePath
        The orbit.

    References
    ----------
    .. [1] C. Simó, G. Gómez, J. Llibre, R. Martínez, J. Rodríguez (1987), On the optimal station
       keeping control of halo orbits, Acta Astronautica 15, p. 391.
    .. [2] The Phobos QSO bifurcation paper (document provided by JAXA: bifurcated families of
       quasi-satellite orbits around Phobos for MMX), section 4.1.1.
    """

    def __init__(self, period_s: float, path: ReferencePath) -> None:
        super().__init__(period_s, path, path.floquet_gains)


class Uncorrected:
    """No impulse at all: the baseline for comparison.

    Parameters
    ----------
    period_s : float
        Time between the samples at which nothing is done.
    """

    actuation: Literal["hold", "impulse"] = "impulse"

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s

    def initial(self, n_cases: int) -> Array:
        """Return no states, (0, N)."""
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return a Δv of zero (3, N), m/s, and no states."""
        return np.zeros((3, y.shape[1])), xc


def target_point_gains(sampling: Sampling, weights: Weights) -> Array:
    r"""Return gains (K, 3, 6) that make a weighted sum of deviations at later times least.

    The sum is :math:`|\Delta v|^2/\rho^2 + \sum_i |r_i|^2/q^2` over the target times, whole numbers
    of intervals later, where :math:`r_i = \Phi_{rr}\delta_r + \Phi_{rv}(\delta_v + \Delta v)` [1]_.

    References
    ----------
    .. [1] K. C. Howell, H. J. Pernicka (1993), Station-keeping method for libration point
       trajectories, Journal of Guidance, Control, and Dynamics 16, p. 151.
    """
    count = sampling.count
    steps = sampling.steps(count + max(weights.targets) - 1)
    rows = [np.zeros((count, 3, 6))]
    total = np.eye(6)[None]
    for i in range(1, max(weights.targets) + 1):
        total = steps[i - 1 : i - 1 + count] @ total
        if i in weights.targets:
            rows.append(total[:, :3] / weights.position)
    seen = np.concatenate(rows, axis=1)
    # least squares by singular values: the squares of the rows would lose the impulse's weight
    by_impulse = seen[:, :, 3:].copy()
    by_impulse[:, :3] = np.eye(3) / weights.impulse
    return np.asarray(np.linalg.pinv(by_impulse) @ seen)


def periodic_lqr_gains(sampling: Sampling, weights: Weights) -> Array:
    r"""Return gains (K, 3, 6) of the linear-quadratic regulator along the reference.

    It minimises :math:`\sum_k |r_k|^2/q_r^2 + |v_k|^2/q_v^2 + |\Delta v_k|^2/\rho^2` by the Riccati
    recursion backwards in time [1]_: swept round and round until it repeats itself where a whole
    number of intervals makes a period, else once from the last correction.

    References
    ----------
    .. [1] S. Bittanti, P. Colaneri (2009), Periodic Systems: Filtering and Control, Springer.
    """
    cycle = sampling.cycle
    q = np.diag(np.repeat([weights.position, weights.velocity], 3) ** -2.0)
    r = np.eye(3) / weights.impulse**2
    rounds = 1 if cycle is None else _SWEEPS
    steps = sampling.steps(sampling.count if cycle is None else cycle)
    p = q.copy()
    gains = np.empty((len(steps), 3, 6))
    for _ in range(rounds):
        # backwards in time through one cycle of corrections
        before = p
        for k in range(len(steps) - 1, -1, -1):
            cost = steps[k].T @ p @ steps[k]  # of the state after the impulse
            gains[k] = np.linalg.solve(r + cost[3:, 3:], cost[3:])
            # Joseph's form: a sum of squares, which stays positive
            kept = np.eye(6)
            kept[3:] -= gains[k]
            p = q + gains[k].T @ r @ gains[k] + kept.T @ cost @ kept
            p = 0.5 * (p + p.T)
        if np.max(np.abs(p - before)) <= _CONVERGED * np.max(np.abs(p)):
            break
    return gains[np.arange(sampling.count) % len(steps)]


def floquet_mode(sampling: Sampling, weights: Weights) -> Compensator:
    """Return the law `FloquetMode`; it takes no weights."""
    return FloquetMode(sampling.interval_s, sampling.path)


def target_point(sampling: Sampling, weights: Weights) -> Compensator:
    """Return the schedule of `target_point_gains`."""
    return _gain_schedule(sampling, target_point_gains(sampling, weights))


def periodic_lqr(sampling: Sampling, weights: Weights) -> Compensator:
    """Return the schedule of `periodic_lqr_gains`."""
    return _gain_schedule(sampling, periodic_lqr_gains(sampling, weights))


def phase_free_target_point(sampling: Sampling, weights: Weights) -> Compensator:
    """Return the law of `phase_free_target_point_gains` on the nearest point."""
    gains = phase_free_target_point_gains(sampling, weights)
    return NearestPointLaw(sampling.interval_s, sampling.path, gains)


def phase_free_lqr(sampling: Sampling, weights: Weights) -> Compensator:
    """Return the law of `phase_free_lqr_gains` on the nearest point."""
    gains = phase_free_lqr_gains(sampling, weights)
    return NearestPointLaw(sampling.interval_s, sampling.path, gains)


STRATEGIES: Mapping[str, Callable[[Sampling, Weights], Compensator]] = {
    "floquet_mode": floquet_mode,
    "target_point": target_point,
    "periodic_lqr": periodic_lqr,
    "phase_free_target_point": phase_free_target_point,
    "phase_free_lqr": phase_free_lqr,
}
"""By the name that a mission writes."""


def _gain_schedule(sampling: Sampling, gains: Array) -> GainSchedule:
    unit = sampling.path.flow.system.unit
    wide = np.zeros((len(gains), 3, len(unit)))
    wide[:, :, :6] = gains * (unit[3:6, None] / unit[:6])
    return GainSchedule(sampling.interval_s, wide)
