r"""State feedback u = K x by linear matrix inequalities, for one plant or a polytope of plants.

With X ≻ 0 and W = K X all requirements are linear in X and W: norms of channels through the bounded
real lemma and its H2 counterpart, poles in a region [1]_. One X serves all requirements and plants.
The result therefore holds for every plant in their convex hull, even one that changes with time; it
is somewhat conservative.

References
----------
.. [1] M. Chilali, P. Gahinet (1996), H∞ design with pole placement constraints: an LMI approach,
   IEEE Transactions on Automatic Control 41(3), 358-367.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.full_order.modes import check_modes
from hillsphere_controllers.full_order.scaling import Units
from hillsphere_controllers.lmi.coordinates import state_feedback_coordinates
from hillsphere_controllers.lmi.requirements import (
    VerifiedNorm,
    check_direct,
    indices,
    norm_inequalities,
    region_inequalities,
    scale_limit,
    verify_norms,
)
from hillsphere_controllers.lmi.solving import check_order, cp, minimise
from hillsphere_controllers.structured.requirements import Channel, PoleRegion
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["StateFeedback", "state_feedback"]

_BACK_OFFS = (1.01, 1.03, 1.1, 1.3)
"""Factors on the least bound, tried in this order. At the least bound itself X is singular and K
infinite; a larger factor gives smaller gains and more accurate inequalities, at the cost of the
norm."""
_ROOM = 10.0
"""Upper limit of X in the second kind of solution, relative to the X of the least bound. Without a
limit the largest smallest eigenvalue of X would be unbounded."""
_SMALLEST = 1e-4
"""Eigenvalue of X that is asked for at least, relative to the largest of the least bound."""
_SLOWEST = 1e-6
"""Decay that is asked for at least, relative to the size of A."""


@dataclass(frozen=True, eq=False)
class StateFeedback:
    """A state feedback gain and the verified norms of its channels.

    Parameters
    ----------
    gain : ndarray, shape (k, n)
        K of u = K x.
    closed_loops : tuple of LtiSystem
        From w to z, one for each plant.
    channels : tuple of VerifiedNorm
        Norms, computed from the closed loops.
    least : float
        The least bound that the inequalities allow for the largest norm to be minimised; zero if
        none is. The gain is that of a bound a little larger.
    """

    gain: Array
    closed_loops: tuple[LtiSystem, ...]
    channels: tuple[VerifiedNorm, ...]
    least: float


def state_feedback(
    plants: LtiSystem | Sequence[LtiSystem],
    controls: int,
    channels: Sequence[Channel] = (Channel(),),
    region: PoleRegion | None = None,
) -> StateFeedback:
    """Return a gain that minimises the largest norm that has no limit.

    Parameters
    ----------
    plants : LtiSystem or sequence of LtiSystem
        In continuous time, of at most 20 states, the last inputs the controls u, all outputs z; or
        the corners of a polytope of such.
    controls : int
        Number of u.
    channels : sequence of Channel
        What is to be small or to stay below a limit.
    region : PoleRegion, optional
        Where the closed loop's poles are to be.

    Returns
    -------
    StateFeedback
        The gain, checked by the norms and poles of its closed loops.

    Raises
    ------
    InputError
        If sizes or channels do not fit, or a plant is in discrete time or too large.
    NotStabilisableError
        If u cannot stabilise a plant.
    SingularProblemError
        If an H2 channel has a direct term.
    InfeasibleError
        If the inequalities have no solution.
    SynthesisFailedError
        If the solver finds none to rely on, or the closed loop does not do what they promise.
    """
    given = (plants,) if isinstance(plants, LtiSystem) else tuple(plants)
    wanted = PoleRegion() if region is None else region
    _check(given, controls)
    units = Units.of(given[0], controls, 0)
    balanced_one, scale = balance_states(units.scale(given[0]))
    even = state_feedback_coordinates(balanced_one, controls)
    even = replace(even, t=scale[:, None] * even.t)
    asked = tuple(scale_limit(channel, even.unit) for channel in channels)
    problem = _Problem([even.of(units.scale(plant)) for plant in given], controls, asked, wanted)
    least = problem.least() * even.unit
    reason: SynthesisFailedError | None = None
    for factor, small in product(_BACK_OFFS, (True, False)):
        try:
            recovered = problem.gain(factor, small=small)
            gain: Array = np.asarray(np.linalg.solve(even.t.T, recovered.T).T, float)
            gain = gain / units.controls[:, None]
            loops = tuple(_close_loop(plant, gain) for plant in given)
            bounds = [factor * least if c.limit is None else c.limit for c in channels]
            norms = verify_norms(loops, channels, bounds, wanted)
        except SynthesisFailedError as error:
            reason = error
            continue
        return StateFeedback(gain, loops, norms, least)
    assert reason is not None
    raise reason


class _Problem:
    """Variables and inequalities of X and W."""

    def __init__(
        self,
        plants: Sequence[LtiSystem],
        controls: int,
        channels: tuple[Channel, ...],
        region: PoleRegion,
    ) -> None:
        n, k = plants[0].order, controls
        self._x = cp.Variable((n, n), symmetric=True)
        self._w = cp.Variable((k, n))
        self._square = cp.Variable(nonneg=True)
        self._channels = channels
        self._inequalities: list[Any] = []
        for plant in plants:
            m = plant.shape[1] - k
            # (A + B K) X = A X + B W with W = K X
            a = plant.a @ self._x + plant.b[:, m:] @ self._w
            for channel in channels:
                rows, columns = indices(channel, plant.shape[0], m)
                d = plant.d[np.ix_(rows, columns)]
                check_direct(d, channel)
                c = plant.c[rows] @ self._x + plant.d[rows, m:] @ self._w
                square = self._square if channel.limit is None else channel.limit**2
                self._inequalities += norm_inequalities(
                    channel, square, a, plant.b[:, columns], c, d, self._x
                )
            self._inequalities += region_inequalities(region, a, self._x)
            # also without channels the loop is to be stable
            slow = _SLOWEST * float(np.linalg.norm(plant.a, 2))
            self._inequalities.append(a + a.T + 2.0 * slow * self._x << 0)
        self._least = 0.0
        self._size = 1.0

    def least(self) -> float:
        """Find the least bound."""
        self._least = minimise(self._square, [*self._inequalities, self._x >> 0], "state feedback")
        if self._channels:  # else any multiple of X does
            self._size = float(np.linalg.norm(self._x.value, 2))
        return float(np.sqrt(max(self._least, 0.0)))

    def gain(self, factor: float, *, small: bool) -> Array:
        """Return a gain for so much more than the least bound, near which gains run away.

        Of those there are, one for which K X Kᵀ is small, or the X of best condition.
        """
        n, k = self._x.shape[0], self._w.shape[0]
        kept = [*self._inequalities, self._square <= factor**2 * self._least]
        if small:
            power = cp.Variable()
            kept += [
                self._x >> _SMALLEST * self._size * np.eye(n),
                cp.bmat([[power * np.eye(k), self._w], [self._w.T, self._x]]) >> 0,
            ]
            minimise(power, kept, "state feedback", checked=True)
        else:
            smallest = cp.Variable()
            kept += [
                self._x >> smallest * self._size * np.eye(n),
                self._x << _ROOM * self._size * np.eye(n),
            ]
            minimise(-smallest, kept, "state feedback", checked=True)
            if not smallest.value > 0.0:
                raise SynthesisFailedError("state feedback: the Lyapunov matrix is singular")
        return np.asarray(np.linalg.solve(self._x.value, self._w.value.T).T, dtype=float)


def _check(plants: Sequence[LtiSystem], controls: int) -> None:
    if not plants:
        raise InputError("state feedback needs at least one plant")
    if len({(p.shape, p.order) for p in plants}) > 1:
        raise InputError(
            "the plants of a polytope must have the same numbers of states and signals"
        )
    for plant in plants:
        if plant.dt_s is not None:
            raise InputError(
                "state feedback by matrix inequalities is for continuous time; use lqr"
            )
        if not 0 < controls < plant.shape[1]:
            raise InputError(
                f"{controls} controls do not fit a plant of {plant.shape[1]} inputs, of which at "
                "least one must be a disturbance"
            )
        check_order(plant.order)
        even, _ = balance_states(Units.of(plant, controls, 0).scale(plant))
        b2 = even.b[:, plant.shape[1] - controls :]
        check_modes(even.a, b2, np.zeros((0, plant.order)))


def _close_loop(plant: LtiSystem, gain: Array) -> LtiSystem:
    m = plant.shape[1] - len(gain)
    return LtiSystem(
        plant.a + plant.b[:, m:] @ gain, plant.b[:, :m],
        plant.c + plant.d[:, m:] @ gain, plant.d[:, :m],
    )  # fmt: skip
