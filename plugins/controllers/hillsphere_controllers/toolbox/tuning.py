"""Controllers of a fixed structure for one or many plants, under their usual names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, Literal

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem, indices_of
from hillsphere_controllers.structured.effort import Effort
from hillsphere_controllers.structured.requirements import Channel, DesignPlant, PoleRegion
from hillsphere_controllers.structured.sampled_plants import sampled_norms, synthesise_sampled
from hillsphere_controllers.structured.search import STATIONARY
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import Structure, free_state_space, static
from hillsphere_controllers.structured.synthesis import StructuredDesign, synthesise
from hillsphere_controllers.structured.verdict import Verdict
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.conversion import as_lti, like
from hillsphere_controllers.toolbox.results import Readable, System

__all__ = [
    "FixedStructure", "GainGoal", "Goal", "GoalValue", "PidGains", "PolesGoal", "Tuned",
    "VarianceGoal", "hinfstruct", "systune", "tunableGain", "tunablePID", "tunableSS", "tunableTF",
]  # fmt: skip

Signals = Sequence[str] | Sequence[int] | None


def tunableGain(outputs: int, inputs: int) -> Structure:  # noqa: N802 - MATLAB's name
    """Return a matrix of free gains.

    Parameters
    ----------
    outputs, inputs : int
        Size of the matrix.

    Returns
    -------
    Structure
        Its free entries.
    """
    return static(outputs, inputs)


def tunableSS(  # noqa: N802 - MATLAB's name
    order: int, outputs: int, inputs: int, *, strictly_proper: bool = False
) -> Structure:
    """Return a state-space controller of an order, all of whose entries are free.

    Parameters
    ----------
    order : int
        Number of states.
    outputs, inputs : int
        Numbers of controls and measurements.
    strictly_proper : bool
        Whether D is zero.

    Returns
    -------
    Structure
        Its free entries.
    """
    return free_state_space(order, outputs, inputs, strictly_proper=strictly_proper)


def tunablePID(  # noqa: N802 - MATLAB's name
    kind: Literal["p", "pi", "pd", "pid"] = "pid",
) -> Structure:
    """Return a PID controller; in discrete time with the trapezoidal formulas of both actions.

    Parameters
    ----------
    kind : {'p', 'pi', 'pd', 'pid'}
        The actions that it has.

    Returns
    -------
    Structure
        Its free gains and the time constant of the derivative.

    Raises
    ------
    InputError
        If there is no such kind.
    """
    if kind not in ("p", "pi", "pd", "pid"):
        raise InputError(f"a kind is 'p', 'pi', 'pd' or 'pid', got {kind!r}")
    return Pid(integral="i" in kind, derivative="d" in kind)


def tunableTF(zeros: int, poles: int) -> Structure:  # noqa: N802 - MATLAB's name
    """Return a transfer function of free coefficients, with numbers of zeros and poles.

    Parameters
    ----------
    zeros, poles : int
        Degrees of numerator and denominator; no more zeros than poles.

    Returns
    -------
    Structure
        Its free coefficients.
    """
    return TransferFunction(poles, poles - zeros)


@dataclass(frozen=True)
class GainGoal:
    """The H∞ norm of a part of the closed loop is to be at most a value.

    Parameters
    ----------
    outputs, inputs : sequence of str or int, optional
        Names or indices among z and w; all if left out.
    value : float
        > 0.
    """

    outputs: Signals = None
    inputs: Signals = None
    value: float = 1.0


@dataclass(frozen=True)
class VarianceGoal:
    """The H2 norm of a part of the closed loop is to be at most a value.

    Parameters
    ----------
    outputs, inputs, value
        As of `GainGoal`.
    """

    outputs: Signals = None
    inputs: Signals = None
    value: float = 1.0


@dataclass(frozen=True)
class PolesGoal:
    """The poles of the closed loop are to lie in a region; a hard goal.

    Of a pole z of a loop in discrete time with the period T, λ is ln z/T, as MATLAB's systune and
    damp define it: |z| ≤ exp(−decay T), and a damping is that of the sampled mode. A pole on the
    negative real axis has |Im λ| = π/T, and so hardly any damping; one at zero has no frequency
    below any limit.

    Parameters
    ----------
    min_decay_1_s, min_damping, max_frequency_rad_s : float
        Re λ ≤ −decay, Re λ ≤ −damping |λ|, |λ| ≤ the largest frequency.
    """

    min_decay_1_s: float = 0.0
    min_damping: float = 0.0
    max_frequency_rad_s: float = np.inf


Goal = GainGoal | VarianceGoal | PolesGoal


@dataclass(frozen=True)
class PidGains:
    """Gains of a tuned PID controller, K(s) = Kp + Ki/s + Kd s/(1 + Tf s), u = K y.

    They have the sign of K: of a loop closed by u = K y without a change of sign, negative gains
    are negative feedback.

    Parameters
    ----------
    Kp, Ki, Kd : float
        Proportional, integral (1/s) and derivative (s) gain; 0 for an action that it has not.
    Tf : float
        Time constant of the derivative's filter, s; 0 without derivative.
    note : str
        A remark on a gain that ended at about zero; may be empty.
    """

    Kp: float
    Ki: float
    Kd: float
    Tf: float
    note: str = ""

    def __repr__(self) -> str:
        """Return the gains in one line, with the remark below."""
        gains = f"Kp = {self.Kp:.5g}, Ki = {self.Ki:.5g}, Kd = {self.Kd:.5g}, Tf = {self.Tf:.5g} s"
        return f"{gains}\n{self.note}" if self.note else gains


@dataclass(frozen=True)
class GoalValue:
    """What a goal asked for and what the controller reaches.

    Parameters
    ----------
    text : str
        The goal in words.
    is_hard : bool
        Whether it had to be met.
    asked : float
        The largest allowed norm; for a region of poles 0, the largest allowed violation.
    value : float
        The norm that is reached, the largest of all plants; for a region of poles by how much the
        worst pole violates it, relative to its size.
    is_met : bool
        Whether the value is at most what was asked, but for rounding.
    """

    text: str
    is_hard: bool
    asked: float
    value: float
    is_met: bool

    def __repr__(self) -> str:
        """Return the goal, its value, what was asked and whether that is met, in one line."""
        kind, state = "hard" if self.is_hard else "soft", "met" if self.is_met else "not met"
        if self.asked == 0.0:
            by = "" if self.is_met else f"violated by {self.value:.3g} of a pole's size: "
            return f"{kind}: {self.text}: {by}{state}"
        return f"{kind}: {self.text}: {self.value:.5g}, asked ≤ {self.asked:.5g}: {state}"


@dataclass(frozen=True, eq=False, repr=False)
class FixedStructure(Readable, Generic[System]):
    """A controller of a fixed structure.

    Parameters
    ----------
    K : System
        u = K y.
    CL : tuple of System
        Closed loop of each plant.
    gamma : float
        Largest H∞ norm of these, computed from them.
    lower_bound : float
        No controller of any structure reaches a γ below this; 0 if nothing is known.
    converged : bool
        Whether the search ended at a local minimum by its own test.
    reason : str
        Why it did not; empty if it did.
    pid : PidGains or None
        Gains, if the structure is that of `tunablePID`.
    verdict : Verdict or None
        Which routes of the search arrived at this γ, and its gap to controllers of full order: in
        words when printed, and see `hillsphere_controllers.structured.verdict.Verdict`.
    """

    K: System
    CL: tuple[System, ...]
    gamma: float
    lower_bound: float
    converged: bool
    reason: str = ""
    pid: PidGains | None = None
    verdict: Verdict | None = None


def hinfstruct(
    P: System | Sequence[System],
    K: Structure,
    *,
    starts: int = 10,
    seed: int = 1,
    effort: Effort = "normal",
) -> FixedStructure[System]:
    """Return the controller of a structure with the least H∞ norm found from several starts.

    Parameters
    ----------
    P : LtiSystem or system of python-control, or several
        Generalised plants, all closed by the same controller, in continuous or discrete time.
    K : Structure
        From `tunableSS`, `tunablePID`, `tunableTF`, `tunableGain`, or any of
        `hillsphere_controllers.structured.structure`.
    starts, seed : int
        Number of starts, and seed of the random ones.
    effort : {'quick', 'normal', 'thorough'} or float
        How many searches follow by other routes, in units of the starts: 0, 1, 5 or any number.

    Returns
    -------
    FixedStructure[System]
        The controller, the closed loops, γ and a lower bound of it.

    Raises
    ------
    InputError, NotStabilisableError, SynthesisFailedError
        As `hillsphere_controllers.structured.synthesis.synthesise`.
    """
    given, plants = _plants(P)
    design = _design([DesignPlant(plant) for plant in plants], K, starts, seed, effort, None)
    return FixedStructure(
        like(design.controller, *given),
        tuple(like(lower_lft(plant, design.controller), *given) for plant in plants),
        design.gamma, design.lower_bound, design.converged, _reason(design),
        _pid_gains(K, design, plants), design.verdict,
    )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(Readable, Generic[System]):
    """A controller of a fixed structure for several goals.

    Parameters
    ----------
    K : System
        u = K y.
    CL : tuple of System
        Closed loop of each plant.
    soft, hard : tuple of float
        Norm of each gain and variance goal relative to its value, the largest of all plants.
    converged : bool
        Whether the search ended at a local minimum by its own test.
    reason : str
        Why it did not; empty if it did.
    goals : tuple of GoalValue
        Each goal with what was asked and what is reached, the soft ones first.
    pid : PidGains or None
        Gains, if the structure is that of `tunablePID`.
    verdict : Verdict or None
        Which routes of the search arrived at this γ, and its gap to controllers of full order: in
        words when printed, and see `hillsphere_controllers.structured.verdict.Verdict`.
    """

    K: System
    CL: tuple[System, ...]
    soft: tuple[float, ...]
    hard: tuple[float, ...]
    converged: bool
    reason: str = ""
    goals: tuple[GoalValue, ...] = ()
    pid: PidGains | None = None
    verdict: Verdict | None = None

    def __repr__(self) -> str:
        """Return the fields, one in a line, and each goal in a line of its own."""
        head = super().__repr__().split("\n")
        own = [line for line in head if not line.startswith(("  soft ", "  hard ", "  goals "))]
        return "\n".join([*own, "  goals", *(f"    {goal}" for goal in self.goals)])


def systune(
    P: System | Sequence[System],
    K: Structure,
    soft: Sequence[GainGoal | VarianceGoal],
    hard: Sequence[Goal] = (),
    *,
    starts: int = 10,
    seed: int = 1,
    effort: Effort = "normal",
) -> Tuned[System]:
    """Return the controller that lowers the largest soft goal while all hard goals are met.

    Parameters
    ----------
    P, K, starts, seed, effort
        As of `hinfstruct`.
    soft : sequence of GainGoal or VarianceGoal
        Their norms, each relative to its value: the largest is minimised.
    hard : sequence of GainGoal, VarianceGoal or PolesGoal
        Are to be met; at most one is a `PolesGoal`.

    Returns
    -------
    Tuned[System]
        The controller and the value of each goal.

    Raises
    ------
    InputError, NotStabilisableError, SynthesisFailedError
        As `hillsphere_controllers.structured.synthesis.synthesise`; `SynthesisFailedError` if no
        controller found meets the hard goals.
    """
    given, plants = _plants(P)
    if not soft or any(isinstance(goal, PolesGoal) for goal in soft):
        raise InputError("systune needs a soft goal; a region of poles is a hard one")
    regions = [goal for goal in hard if isinstance(goal, PolesGoal)]
    limits = [goal for goal in hard if not isinstance(goal, PolesGoal)]
    if len(regions) > 1:
        raise InputError("give one PolesGoal with all its conditions")
    region = None
    if regions:
        one = regions[0]
        region = PoleRegion(one.min_decay_1_s, one.min_damping, one.max_frequency_rad_s)
    designs = [
        DesignPlant(
            plant,
            tuple(_channel(goal, plant, K, False) for goal in soft)
            + tuple(_channel(goal, plant, K, True) for goal in limits),
        )
        for plant in plants
    ]
    design = _design(designs, K, starts, seed, effort, region)
    if plants[0].dt_s is None:
        weights = [channel.weight for channel in designs[0].channels]
        norms = np.array(design.verified.norms) * weights
    else:
        norms = np.array([sampled_norms(one, design.controller) for one in designs])
    worst = [float(value) for value in norms.max(axis=0)]
    return Tuned(
        like(design.controller, *given),
        tuple(like(lower_lft(plant, design.controller), *given) for plant in plants),
        tuple(worst[: len(soft)]), tuple(worst[len(soft) :]), design.converged, _reason(design),
        (
            *(
                _goal_value(goal, norm, is_hard=k >= len(soft))
                for k, (goal, norm) in enumerate(zip([*soft, *limits], worst, strict=True))
            ),
            *(_region_value(one, plants, design.controller) for one in regions),
        ),
        _pid_gains(K, design, plants), design.verdict,
    )  # fmt: skip


_ROUNDING = 1e-6
"""Relative excess of a goal that counts as met: hard goals are held at their limit to that."""
_VANISHED = 1e-4
"""Share of the integral action in the gain at the loop's middle pole below which it has ended at
about zero: it then acts ten thousand times more slowly than the loop."""


def _goal_value(goal: GainGoal | VarianceGoal, relative: float, *, is_hard: bool) -> GoalValue:
    norm = "H∞" if isinstance(goal, GainGoal) else "H2"
    to, of = (_signal_names(one) for one in (goal.outputs, goal.inputs))
    value = relative * goal.value
    met = value <= goal.value * (1.0 + _ROUNDING)
    return GoalValue(f"{norm} norm of {to} from {of}", is_hard, goal.value, value, met)


def _signal_names(chosen: Signals) -> str:
    return "all" if chosen is None else ", ".join(map(str, chosen))


def _region_value(goal: PolesGoal, plants: Sequence[LtiSystem], K: LtiSystem) -> GoalValue:
    poles = np.concatenate([lower_lft(plant, K).poles for plant in plants])
    size = np.maximum(np.abs(poles), 1e-300)
    excess = [
        (poles.real + goal.min_decay_1_s) / size,
        poles.real / size + goal.min_damping,
        (size - goal.max_frequency_rad_s) / size,
    ]
    worst = max(0.0, float(np.max(excess, initial=0.0)))
    conditions = (
        ("decay", goal.min_decay_1_s, 0.0, "≥", "1/s"),
        ("damping", goal.min_damping, 0.0, "≥", ""),
        ("frequency", goal.max_frequency_rad_s, np.inf, "≤", "rad/s"),
    )
    asked = ", ".join(
        f"{word} {sign} {value:g} {unit}".rstrip()
        for word, value, none, sign, unit in conditions
        if value != none
    )
    violation = worst if worst > _ROUNDING else 0.0
    return GoalValue(
        f"poles with {asked or 'no condition'}", True, 0.0, violation, violation == 0.0
    )


def _reason(design: StructuredDesign) -> str:
    """Return why a search did not end at a local minimum by its own test."""
    if design.converged:
        return ""
    if design.interrupted:
        return "it was stopped before its end"
    if not design.residual < STATIONARY:
        return (
            f"residual {design.residual:.2g}, not below {STATIONARY:g}: it got stuck, or the gain "
            "is the same over a range of frequencies, which no few peaks hold; compare gamma with "
            "lower_bound of hinfstruct, or give more starts"
        )
    return "the last step still promised a lower γ; give more starts"


def _pid_gains(
    K: Structure, design: StructuredDesign, plants: Sequence[LtiSystem]
) -> PidGains | None:
    """Return the gains of a PID controller, and say whether its integral action vanished."""
    if not isinstance(K, Pid):
        return None
    theta = design.theta
    integral = float(theta[1]) if K.integral else 0.0
    derivative, filter_s = (
        (float(theta[-2]), float(np.exp(-theta[-1]))) if K.derivative else (0.0, 0.0)
    )
    gains = PidGains(float(theta[0]), integral, derivative, filter_s)
    if not K.integral:
        return gains
    poles = np.concatenate([_rates(lower_lft(plant, design.controller)) for plant in plants])
    omega = float(np.median(np.abs(poles))) if poles.size else 1.0
    others = max(abs(gains.Kp), abs(gains.Kd) * omega)
    if abs(integral) <= _VANISHED * others * omega:
        return replace(
            gains,
            note="Ki ended at about zero: these goals ask for no integral action; one on the "
            "error at low frequencies does",
        )
    return gains


def _rates(loop: LtiSystem) -> NDArray[np.complex128]:
    """Return the poles as rates in continuous time, rad/s."""
    poles = np.asarray(loop.poles, dtype=complex)
    if loop.dt_s is None:
        return poles
    return np.asarray(np.log(poles[np.abs(poles) > 0.0]) / loop.dt_s)


def _plants(P: System | Sequence[System]) -> tuple[list[object], list[LtiSystem]]:
    given: list[object] = list(P) if isinstance(P, list | tuple) else [P]
    return given, [as_lti(one, f"plant {k}") for k, one in enumerate(given)]


def _design(
    plants: list[DesignPlant],
    K: Structure,
    starts: int,
    seed: int,
    effort: Effort,
    region: PoleRegion | None,
) -> StructuredDesign:
    if all(plant.system.dt_s is None for plant in plants):
        return synthesise(plants, K, starts=starts, seed=seed, effort=effort, region=region)
    return synthesise_sampled(plants, K, starts=starts, seed=seed, effort=effort, region=region)


def _channel(
    goal: GainGoal | VarianceGoal, plant: LtiSystem, K: Structure, is_hard: bool
) -> Channel:
    if not 0.0 < goal.value < np.inf:
        raise InputError(f"the value of a goal must be > 0 and finite, got {goal.value}")
    return Channel(
        _indices(goal.outputs, plant.outputs, "output"),
        _indices(goal.inputs, plant.inputs, "input"),
        "hinf" if isinstance(goal, GainGoal) else "h2",
        1.0 / goal.value,
        1.0 if is_hard else None,
    )


def _indices(chosen: Signals, names: tuple[str, ...], what: str) -> tuple[int, ...] | None:
    if chosen is None:
        return None
    if isinstance(chosen, str):
        raise InputError(f"{what}s of a goal are a sequence of names or indices, got {chosen!r}")
    return tuple(
        indices_of(names, [one], what)[0] if isinstance(one, str) else int(one) for one in chosen
    )
