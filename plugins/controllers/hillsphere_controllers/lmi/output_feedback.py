r"""Output feedback of full order by linear matrix inequalities, for several requirements at once.

The change of variables of [1]_ makes norms of channels and pole regions linear in X, Y and
:math:`\hat A, \hat B, \hat C, \hat D`, if one Lyapunov matrix serves them all. First the least
bound is found; then, for a bound a little larger, X and Y of a limited size that keep I − X Y far
from singular, since the controller is made by inverting it.

References
----------
.. [1] C. Scherer, P. Gahinet, M. Chilali (1997), Multiobjective output-feedback control via LMI
   optimization, IEEE Transactions on Automatic Control 42(7), 896-911.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import null_space

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.errors import InfeasibleError, SynthesisFailedError
from hillsphere_controllers.full_order.modes import check_modes
from hillsphere_controllers.full_order.scaling import Units
from hillsphere_controllers.lmi.coordinates import output_feedback_coordinates
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
from hillsphere_controllers.systems.algebra import close_with_gain, lower_lft
from hillsphere_controllers.systems.balancing import balance_states
from hillsphere_controllers.systems.bilinear import continuous, discrete

__all__ = ["OutputFeedback", "output_feedback"]

_BACK_OFFS = (1.01, 1.03, 1.1, 1.3)
"""Factors on the least bound, tried in this order. At the least bound itself I − X Y is singular
and the controller's gains infinite; a larger factor gives smaller gains, at the cost of the
norm."""
_ROOM = 10.0
"""Upper limit of X and Y in the second optimisation, relative to their sizes at the least bound. It
keeps the search for the best conditioned I − X Y bounded."""
_LARGEST = (1e5, 1e7, 1e4, 1e3)
"""Sizes of X and Y, in coordinates in which those of a linear-quadratic design are one."""
_SLOWEST = 1e-6
"""Decay that is asked for at least, relative to the size of A."""


@dataclass(frozen=True, eq=False)
class OutputFeedback:
    """An output feedback controller and the verified norms of its channels.

    Parameters
    ----------
    controller : LtiSystem
        From y to u, of the order of the plant.
    closed_loop : LtiSystem
        From w to z.
    channels : tuple of VerifiedNorm
        Norms, computed from the closed loop.
    least : float
        The least bound that the inequalities allow, with X and Y of limited size, for the largest
        norm to be minimised; zero if none is. The controller is that of a bound a little larger. It
        is no lower bound for other methods: where the optimum needs X and Y without limit, as it
        does for modes that are hardly controlled, it may lie some percent above.
    """

    controller: LtiSystem
    closed_loop: LtiSystem
    channels: tuple[VerifiedNorm, ...]
    least: float


def output_feedback(
    plant: LtiSystem,
    controls: int,
    measurements: int,
    channels: Sequence[Channel] = (Channel(),),
    region: PoleRegion | None = None,
) -> OutputFeedback:
    """Return a controller that minimises the largest norm that has no limit.

    Parameters
    ----------
    plant : LtiSystem
        Of at most 20 states, the last inputs the controls u, the last outputs the measurements y.
        In discrete time its bilinear image is used, which keeps H∞ norms alone.
    controls, measurements : int
        Numbers of u and y.
    channels : sequence of Channel
        What is to be small or to stay below a limit.
    region : PoleRegion, optional
        Where the closed loop's poles are to be.

    Returns
    -------
    OutputFeedback
        The controller, checked by the norms and poles of its closed loop.

    Raises
    ------
    InputError
        If sizes or channels do not fit, the plant is too large, or in discrete time with an H2
        channel or a region.
    NotStabilisableError
        If u cannot stabilise the plant, or y does not show an unstable mode.
    SingularProblemError
        If an H2 channel has a direct term.
    InfeasibleError
        If the inequalities have no solution.
    SynthesisFailedError
        If the solver finds none to rely on, or the closed loop does not do what they promise.
    """
    (p, m), k, q = plant.shape, controls, measurements
    if not (0 < k < m and 0 < q < p):
        raise InputError(
            f"{k} controls and {q} measurements do not fit a plant of {p} × {m}, which needs a "
            "disturbance and an output to be weighted besides"
        )
    check_order(plant.order)
    wanted = PoleRegion() if region is None else region
    if plant.dt_s is not None:
        if region is not None or any(channel.norm != "hinf" for channel in channels):
            raise InputError("in discrete time only H∞ norms can be asked for, and no pole region")
        made = output_feedback(continuous(plant), k, q, channels)
        controller = discrete(made.controller, plant.dt_s)
        loop = lower_lft(plant, controller)
        bounds = [channel.bound for channel in made.channels]
        return OutputFeedback(
            controller, loop, verify_norms([loop], channels, bounds, wanted), made.least
        )
    units = Units.of(plant, k, q)
    even, _ = balance_states(units.scale(plant))
    check_modes(even.a, even.b[:, m - k :], even.c[p - q :])
    coordinates = output_feedback_coordinates(even, k, q)
    asked = tuple(scale_limit(channel, coordinates.unit) for channel in channels)
    problem, least = _build_problem(coordinates.of(even, q), k, q, asked, wanted)
    least *= coordinates.unit
    reason: SynthesisFailedError | None = None
    for factor in _BACK_OFFS:
        try:
            controller = units.restore(problem.controller(factor))
            # the design is for D22 = 0: y − D22 u
            controller = close_with_gain(controller, -plant.d[p - q :, m - k :])
            loop = lower_lft(plant, controller)
            bounds = [factor * least if c.limit is None else c.limit for c in channels]
            norms = verify_norms([loop], channels, bounds, wanted)
        except (SynthesisFailedError, InputError) as error:
            reason = SynthesisFailedError(str(error))
            continue
        return OutputFeedback(controller, loop, norms, least)
    assert reason is not None
    raise reason


def _build_problem(
    plant: LtiSystem,
    controls: int,
    measurements: int,
    channels: Sequence[Channel],
    region: PoleRegion,
) -> tuple[_Problem, float]:
    """Return the inequalities with a size of X and Y that the solver copes with, and the least."""
    reason: SynthesisFailedError | None = None
    for largest in _LARGEST:
        problem = _Problem(plant, controls, measurements, channels, region, largest)
        try:
            return problem, problem.least()
        except SynthesisFailedError as error:
            reason = error
            if isinstance(error, InfeasibleError) and largest == max(_LARGEST):
                break
    assert reason is not None
    raise reason


class _Problem:
    """Variables X, Y, Â, B̂, Ĉ, D̂ and the inequalities in them."""

    def __init__(
        self,
        plant: LtiSystem,
        controls: int,
        measurements: int,
        channels: Sequence[Channel],
        region: PoleRegion,
        largest: float,
    ) -> None:
        n, (p, m), k, q = plant.order, plant.shape, controls, measurements
        p1, m1 = p - q, m - k
        self._plant, self._channels = plant, channels
        self._a, self._b2, self._c2 = plant.a, plant.b[:, m1:], plant.c[p1:]
        self._x = cp.Variable((n, n), symmetric=True)
        self._y = cp.Variable((n, n), symmetric=True)
        self._ah, self._bh, self._ch = (
            cp.Variable((n, n)), cp.Variable((n, q)), cp.Variable((k, n)),
        )  # fmt: skip
        self._square = cp.Variable(nonneg=True)
        # X and Y grow without limit towards the least bound, which they hardly lower then
        limit = largest * np.eye(n)
        self._dh = self._direct(channels, k, q)
        a, b2, c2, one = self._a, self._b2, self._c2, np.eye(n)
        # closed-loop A under the congruence of Scherer, Gahinet and Chilali (1997), linear in the
        # new variables
        moved = cp.bmat(
            [
                [a @ self._x + b2 @ self._ch, a + b2 @ self._dh @ c2],
                [self._ah, self._y @ a + self._bh @ c2],
            ]
        )
        self._lyapunov = cp.bmat([[self._x, one], [one, self._y]])
        slow = _SLOWEST * float(np.linalg.norm(a, 2))
        self._inequalities: list[Any] = [
            moved + moved.T + 2.0 * slow * self._lyapunov << 0,
            self._x << limit,
            self._y << limit,
        ]
        self._inequalities += region_inequalities(region, moved, self._lyapunov)
        for channel in channels:
            rows, columns = indices(channel, p1, m1)
            b1, c1 = plant.b[:, columns], plant.c[rows]
            d12, d21 = plant.d[rows, m1:], plant.d[p1:, columns]
            b = cp.vstack([b1 + b2 @ self._dh @ d21, self._y @ b1 + self._bh @ d21])
            c = cp.hstack([c1 @ self._x + d12 @ self._ch, c1 + d12 @ self._dh @ c2])
            direct = plant.d[np.ix_(rows, columns)] + d12 @ self._dh @ d21
            square = self._square if channel.limit is None else channel.limit**2
            self._inequalities += norm_inequalities(
                channel, square, moved, b, c, direct, self._lyapunov
            )
        self._least = 0.0

    def _direct(self, channels: Sequence[Channel], k: int, q: int) -> Any:
        """Return D̂, free but for D12 D̂ D21 = 0 in the H2 channels."""
        (p, m), kept = self._plant.shape, np.eye(k * q)
        for channel in channels:
            rows, columns = indices(channel, p - q, m - k)
            check_direct(self._plant.d[np.ix_(rows, columns)], channel)
            if channel.norm == "h2":
                d12, d21 = self._plant.d[rows, m - k :], self._plant.d[p - q :, columns]
                # column by column, vec(D12 D̂ D21) = (D21ᵀ ⊗ D12) vec D̂
                kept = kept @ null_space(np.kron(d21.T, d12) @ kept)
        count = kept.shape[1]
        if count == 0:
            return cp.Constant(np.zeros((k, q)))
        return cp.reshape(kept @ cp.Variable(count), (k, q), order="F")

    def least(self) -> float:
        """Find the least bound."""
        self._least = minimise(
            self._square, [*self._inequalities, self._lyapunov >> 0], "output feedback"
        )
        self._sizes = [float(np.linalg.norm(v.value, 2)) for v in (self._x, self._y)]
        return float(np.sqrt(max(self._least, 0.0)))

    def controller(self, factor: float) -> LtiSystem:
        """Return a controller, for D22 = 0, for so much more than the least bound."""
        n = len(self._a)
        apart = cp.Variable()
        one = np.eye(n)
        minimise(
            -apart,
            [
                *self._inequalities,
                self._square <= factor**2 * self._least,
                cp.bmat([[self._x, apart * one], [apart * one, self._y]]) >> 0,
                apart >= 1.0,
                self._x << _ROOM * max(self._sizes[0], 1.0) * one,
                self._y << _ROOM * max(self._sizes[1], 1.0) * one,
            ],
            "output feedback",
            checked=True,
        )
        x, y = self._x.value, self._y.value
        dk = self._dh.value
        # back to K: M Nᵀ = I − X Y, then D, C, B and A in turn
        u, values, vt = np.linalg.svd(one - x @ y)
        if not values[-1] > 1e-10 * values[0]:
            raise SynthesisFailedError("output feedback: I − X Y is singular")
        # M Nᵀ = I − X Y
        root = np.sqrt(values)
        m, left = u * root, (vt.T * root)
        ck = np.linalg.solve(m, (self._ch.value - dk @ self._c2 @ x).T).T
        bk = np.linalg.solve(left, self._bh.value - y @ self._b2 @ dk)
        inside = (
            self._ah.value - left @ bk @ self._c2 @ x - y @ self._b2 @ ck @ m.T
            - y @ (self._a + self._b2 @ dk @ self._c2) @ x
        )  # fmt: skip
        ak = np.linalg.solve(m, np.linalg.solve(left, inside).T).T
        return LtiSystem(ak, bk, ck, dk)
