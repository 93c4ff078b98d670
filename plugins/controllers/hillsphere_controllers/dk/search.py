"""The search for a controller of low µ: D-steps, K-steps and joint steps from the best known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from hillsphere.errors import HillsphereError, InputError, Interrupted
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere.products.product_codec import canonical
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.analysis.stability import spectral_abscissa
from hillsphere_controllers.dk.absorption import absorb_scalings, factors
from hillsphere_controllers.dk.fitting import (
    FittedMultipliers,
    Goal,
    fit_multipliers,
    lift_multiplier,
    negative_frequencies,
    relative_levels,
)
from hillsphere_controllers.dk.goals import mu_upper_bounds
from hillsphere_controllers.dk.initial_scalings import constant_multipliers, constant_scalings
from hillsphere_controllers.dk.joint import descend_jointly
from hillsphere_controllers.dk.multipliers import Multiplier
from hillsphere_controllers.dk.results import DkIteration, Kind
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.full_order.hinf import hinf_synthesis, least_gamma
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.certified import CertifiedPeak, certified_peak
from hillsphere_controllers.systems.algebra import lower_lft

__all__ = ["KStep", "Point", "Search", "State"]

KStep = Callable[[LtiSystem], LtiSystem]
"""A synthesis: takes the scaled plant, its last inputs and outputs being controls and measurements,
returns a controller that makes the gain of the others small; `HillsphereError` if there is none."""

_FLOORS = (0.5, 0.9, 1.0)
"""Shares of µ's peak below which no bound is asked for, tried in turn where the fit misses."""
_SLOW = 0.01
"""An alternation that gains less is followed by a joint step."""
_ENDED = 1e-3
"""Relative gain of a step below which the search has converged."""
_REFITTED = 4
"""Fits of one step at most, each with the frequencies at which the last one fell short."""
_MISSED = 1.01
"""A fit whose proved level is within 1 % of the bounds of µ, or a norm within 1 % of the level, is
good enough: the next H∞ synthesis moves µ by more."""
_FITTED = 1.004
"""A fit within 0.4 % of the goal needs no further pole; each pole adds states to the plant."""
_ABOVE = 1.005
"""G is taken in for a level that the K-step should stay below: above it a large G proves little."""
_ROUGH = 1e-2
"""Relative accuracy of γ while constant scalings are compared."""
_SMOOTH = 1e-6
"""Relative accuracy of γ in the joint descent. Its difference quotients have steps of 0.3 %, so
that a rougher γ would hide the slope."""


@dataclass(frozen=True, eq=False)
class Point:
    """A controller, the scalings that it was made with, and its certified bound."""

    controller: LtiSystem
    loop: LtiSystem
    multipliers: tuple[Multiplier, ...]
    peak: CertifiedPeak


@dataclass(frozen=True, eq=False)
class State:
    """State of a search between two steps, complete for its continuation.

    Parameters
    ----------
    key : str
        Of the problem and its options.
    done : int
        Steps after the first.
    joint, raised : bool
        Whether the next one is a joint step, and one with scalings of higher order.
    reason : str
        Why there is no next one; empty if there is.
    controller, multipliers, peak
        Of the best `Point`.
    omega_rad_s : ndarray, shape (K,)
        Frequencies of the last D-step.
    steps : tuple of DkIteration
        All steps.
    """

    key: str
    done: int
    joint: bool
    raised: bool
    reason: str
    controller: LtiSystem
    multipliers: tuple[Multiplier, ...]
    peak: CertifiedPeak
    omega_rad_s: Array
    steps: tuple[DkIteration, ...]


class Search:
    """The best controller so far, and the steps towards it.

    `progress` is called with each step, `keep` with the state after it.
    """

    def __init__(
        self,
        plant: LtiSystem,
        structure: BlockStructure,
        channels: tuple[int, int],
        k_step: KStep | None,
        back_off: float,
        gap: float,
        progress: Callable[[DkIteration], None] | None,
        keep: Callable[[State], None] | None = None,
        key: str = "",
        regularisation: float = 0.0,
    ) -> None:
        self.plant, self.structure, self.channels = plant, structure, channels
        self._given, self._back_off, self._gap, self._progress = k_step, back_off, gap, progress
        self.best: Point | None = None
        self.steps: list[DkIteration] = []
        self._omega: Array = np.zeros(0)
        self._clock = perf_counter()
        self._keep, self._key, self._regularisation = keep, key, regularisation
        self._done, self._is_joint, self._is_raised, self._reason = 0, False, False, ""

    def restore(self, state: State) -> None:
        """Go on from a state that was kept, as if the search had never ended."""
        self._go_on_from(state)
        self._done, self._is_joint, self._is_raised = state.done, state.joint, state.raised
        self._reason = state.reason
        for step in state.steps:
            self.steps.append(step)
            if self._progress is not None:
                self._progress(step)

    def _go_on_from(self, state: State) -> None:
        loop = lower_lft(self.plant, state.controller)
        self.best = Point(state.controller, loop, state.multipliers, state.peak)
        self._omega = state.omega_rad_s

    def begin(self, controller: LtiSystem | None) -> None:
        """Take a first controller, or make it with the best constant scalings."""
        if controller is not None:
            loop = lower_lft(self.plant, controller)
            if not loop.is_stable:
                raise InputError(
                    "the first controller does not stabilise the plant: the closed loop has a pole "
                    f"with real part {spectral_abscissa(loop):.3g} 1/s; leave it out, or check its "
                    "sign (u = K y, without a change of sign)"
                )
            peak = certified_peak(loop, self.structure, gap=self._gap)
            goal = mu_upper_bounds(loop, self.structure, peak.looked_at_rad_s).goal(_FLOORS[0])
            self._judge(
                "start", controller, constant_multipliers(self.structure, goal.sizes), np.nan
            )
            self._store_step()
            return
        scalings = constant_scalings(self.structure, lambda x: self._gamma(x, 1.0))
        first, gamma = self._synthesise(scalings, 1.0)
        self._judge("start", first, scalings, gamma)
        self._store_step()

    def run(self, iterations: int, highest: int, joint_steps: int, target: float) -> str:
        """Go on until nothing is gained; return why it ended."""
        if len(self.structure.blocks) == 1 and self.structure.blocks[0].kind == "full":
            return "one full block: there is nothing to scale"
        while self._done < iterations:
            assert self.best is not None
            if self._reason:
                return self._reason
            before, joint, raised = self.best, self._is_joint, self._is_raised
            if before.peak.upper <= target:
                return f"the target {target:.6g} is met"
            if joint:
                start = self._add_poles(before, highest) if raised else before.multipliers
                self._joint(start, before.peak.upper, joint_steps)
            else:
                self._step("alternate", *self._fit_scalings(before, highest))
            # an alternation that gains little is followed by a joint step, that by one of higher
            # order
            gained = 1.0 - self.best.peak.upper / before.peak.upper
            if joint:
                if gained < _ENDED and (
                    raised or all(o.fixed or o.order >= highest for o in before.multipliers)
                ):
                    self._reason = f"neither alternation nor a joint step gains {_ENDED:.0e}"
                raised, joint = gained < _ENDED, gained < _ENDED
            elif gained < _SLOW:
                if not joint_steps and gained < _ENDED:
                    self._reason = f"alternation gains less than {_ENDED:.0e}"
                joint = joint_steps > 0
            self._done, self._is_joint, self._is_raised = self._done + 1, joint, raised
            self._store_step()
        assert self.best is not None
        if self._reason:
            return self._reason
        if self.best.peak.upper <= target:
            return f"the target {target:.6g} is met"
        return f"{iterations} iterations are done"

    def _store_step(self) -> None:
        """Store the state after a step, and report the step."""
        best = self.best
        if self._keep is not None and best is not None:
            state = canonical(
                State(
                    self._key, self._done, self._is_joint, self._is_raised, self._reason,
                    best.controller, best.multipliers, best.peak, self._omega, tuple(self.steps),
                )
            )  # fmt: skip
            self._keep(state)
            self._go_on_from(state)
        if self._progress is not None:
            self._progress(self.steps[-1])

    def _joint(self, start: Sequence[Multiplier], beta: float, steps: int) -> None:
        """Move scalings and controller together."""
        near: tuple[float, float] | None = None

        def gamma(multipliers: Sequence[Multiplier]) -> float:
            nonlocal near
            if self._given is not None:
                return self._gamma(multipliers, beta)
            near = least_gamma(
                self._absorb(multipliers, beta), *self.channels, tolerance=_SMOOTH,
                regularisation=self._regularisation, near=near,
            )  # fmt: skip
            return near[0]

        self._step("joint", tuple(descend_jointly(gamma, start, self._omega, steps)), beta)

    def _add_poles(self, point: Point, highest: int) -> tuple[Multiplier, ...]:
        omega = self._omega[(self._omega > 0.0) & np.isfinite(self._omega)]
        place = float(np.clip(point.peak.frequency_rad_s, omega.min(), omega.max()))
        return tuple(
            one if one.fixed or one.order >= highest else one.add_pole(place)
            for one in point.multipliers
        )

    def _fit_scalings(self, point: Point, highest: int) -> tuple[tuple[Multiplier, ...], float]:
        """Return scalings that prove nearly µ's bound of a loop, and a level above it."""
        more = point.peak.looked_at_rad_s
        start, beta = point.multipliers, np.inf
        for _ in range(_REFITTED):
            bounds = mu_upper_bounds(point.loop, self.structure, more)
            self._omega = bounds.omega_rad_s
            # fit the whole curve first; if it misses, only the frequencies near the peak
            for floor in _FLOORS:
                goal = bounds.goal(floor)
                if not np.isfinite(relative_levels(goal, start)).all():
                    start = constant_multipliers(self.structure, goal.sizes)
                fit = _fit_by_rising_order(goal, start, highest)
                beta = float(np.sqrt((fit.ratios * goal.levels).max()))
                if beta <= _MISSED * bounds.values.max():
                    break
            start = fit.multipliers
            # between the frequencies D may be negative, or the scaled norm exceed the level: such a
            # frequency joins the set
            missed = negative_frequencies(start, bounds.omega_rad_s)
            if not missed.size:
                try:
                    scaled = self._absorb(start, beta)
                except SynthesisFailedError:
                    break
                norm = hinf_norm(lower_lft(scaled, point.controller), 1e-6)
                if norm.value <= _MISSED * beta:
                    break
                missed = np.array([norm.frequency_rad_s])
            more = np.append(more, missed)
        return tuple(lift_multiplier(one, self._omega) for one in start), _ABOVE * beta

    def _absorb(self, multipliers: Sequence[Multiplier], beta: float) -> LtiSystem:
        return absorb_scalings(self.plant, [factors(one, beta) for one in multipliers], beta)

    def _gamma(self, multipliers: Sequence[Multiplier], beta: float) -> float:
        """Return the γ that the K-step reaches with scalings, accurate enough to compare them."""
        scaled = self._absorb(multipliers, beta)
        if self._given is not None:
            return hinf_norm(lower_lft(scaled, self._given(scaled)), 1e-6).value
        return hinf_synthesis(
            scaled, *self.channels, tolerance=_ROUGH, back_off=self._back_off,
            regularisation=self._regularisation,
        ).solvable  # fmt: skip

    def _synthesise(
        self, multipliers: Sequence[Multiplier], beta: float
    ) -> tuple[LtiSystem, float]:
        scaled = self._absorb(multipliers, beta)
        if self._given is not None:
            controller = self._given(scaled)
            return controller, hinf_norm(lower_lft(scaled, controller), 1e-6).value
        design = hinf_synthesis(
            scaled, *self.channels, back_off=self._back_off, regularisation=self._regularisation
        )
        return design.controller, design.gamma

    def _step(self, kind: Kind, multipliers: tuple[Multiplier, ...], beta: float) -> None:
        try:
            controller, gamma = self._synthesise(multipliers, beta)
        except Interrupted:
            raise
        except HillsphereError as error:
            self._record(
                DkIteration(
                    kind,
                    np.inf,
                    np.nan,
                    np.inf,
                    _orders(multipliers),
                    0,
                    accepted=False,
                    seconds=0.0,
                    refusal=str(error),
                )
            )
            return
        self._judge(kind, controller, multipliers, gamma)

    def _judge(
        self,
        kind: Kind,
        controller: LtiSystem,
        multipliers: tuple[Multiplier, ...],
        gamma: float,
    ) -> None:
        """Certify µ with a controller, and keep it if that is lower."""
        upper, frequency, refusal = np.inf, np.nan, ""
        try:
            loop = lower_lft(self.plant, controller)
            peak = certified_peak(loop, self.structure, gap=self._gap)
        except HillsphereError as error:  # not stable, say
            if self.best is None:
                raise
            refusal = str(error)
        else:
            upper, frequency = peak.upper, peak.frequency_rad_s
            if self.best is None or upper < self.best.peak.upper:
                self.best = Point(controller, loop, multipliers, peak)
            else:
                refusal = "µ is not lower"
        self._record(
            DkIteration(
                kind, upper, frequency, gamma, _orders(multipliers), controller.order,
                accepted=not refusal, seconds=0.0, refusal=refusal,
            )
        )  # fmt: skip

    def _record(self, step: DkIteration) -> None:
        now = perf_counter()
        step = replace(step, seconds=now - self._clock)
        self._clock = now
        self.steps.append(step)


def _orders(multipliers: Sequence[Multiplier]) -> tuple[int, ...]:
    return tuple(one.order for one in multipliers)


def _fit_by_rising_order(
    goal: Goal, start: Sequence[Multiplier], highest: int
) -> FittedMultipliers:
    """Return the fit of the least order that meets the goal nearly, or of the highest one."""
    best = fit_multipliers(goal, start)
    while best.ratios.max() > _FITTED**2:
        worst = goal.omega_rad_s[int(np.argmax(best.ratios))]
        place = float(np.clip(worst, *np.exp(goal.range)))
        raised = [
            one if one.fixed or one.order >= highest else one.add_pole(place)
            for one in best.multipliers
        ]
        if all(a is b for a, b in zip(raised, best.multipliers, strict=True)):
            break
        best = fit_multipliers(goal, raised)
    return best
