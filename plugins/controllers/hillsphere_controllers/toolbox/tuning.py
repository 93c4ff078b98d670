"""Controllers of a fixed structure for one or many plants, under their usual names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem, indices_of
from hillsphere_controllers.structured.requirements import Channel, DesignPlant, PoleRegion
from hillsphere_controllers.structured.sampled_plants import sampled_norms, synthesise_sampled
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import Structure, free_state_space, static
from hillsphere_controllers.structured.synthesis import StructuredDesign, synthesise
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.conversion import as_lti, like
from hillsphere_controllers.toolbox.results import Readable, System

__all__ = [
    "FixedStructure", "GainGoal", "Goal", "PolesGoal", "Tuned", "VarianceGoal", "hinfstruct",
    "systune", "tunableGain", "tunablePID", "tunableSS", "tunableTF",
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
    if kind == "p":
        return static(1, 1)
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
    """

    K: System
    CL: tuple[System, ...]
    gamma: float
    lower_bound: float
    converged: bool


def hinfstruct(
    P: System | Sequence[System], K: Structure, *, starts: int = 10, seed: int = 1
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
    design = _design([DesignPlant(plant) for plant in plants], K, starts, seed, None)
    return FixedStructure(
        like(design.controller, *given),
        tuple(like(lower_lft(plant, design.controller), *given) for plant in plants),
        design.gamma, design.lower_bound, design.converged,
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
    """

    K: System
    CL: tuple[System, ...]
    soft: tuple[float, ...]
    hard: tuple[float, ...]
    converged: bool


def systune(
    P: System | Sequence[System],
    K: Structure,
    soft: Sequence[GainGoal | VarianceGoal],
    hard: Sequence[Goal] = (),
    *,
    starts: int = 10,
    seed: int = 1,
) -> Tuned[System]:
    """Return the controller that lowers the largest soft goal while all hard goals are met.

    Parameters
    ----------
    P, K, starts, seed
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
    design = _design(designs, K, starts, seed, region)
    if plants[0].dt_s is None:
        weights = [channel.weight for channel in designs[0].channels]
        norms = np.array(design.verified.norms) * weights
    else:
        norms = np.array([sampled_norms(one, design.controller) for one in designs])
    worst = [float(value) for value in norms.max(axis=0)]
    return Tuned(
        like(design.controller, *given),
        tuple(like(lower_lft(plant, design.controller), *given) for plant in plants),
        tuple(worst[: len(soft)]), tuple(worst[len(soft) :]), design.converged,
    )  # fmt: skip


def _plants(P: System | Sequence[System]) -> tuple[list[object], list[LtiSystem]]:
    given: list[object] = list(P) if isinstance(P, list | tuple) else [P]
    return given, [as_lti(one, f"plant {k}") for k, one in enumerate(given)]


def _design(
    plants: list[DesignPlant], K: Structure, starts: int, seed: int, region: PoleRegion | None
) -> StructuredDesign:
    if all(plant.system.dt_s is None for plant in plants):
        return synthesise(plants, K, starts=starts, seed=seed, region=region)
    return synthesise_sampled(plants, K, starts=starts, seed=seed, region=region)


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
