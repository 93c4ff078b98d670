"""Product of the stage ``synthesis``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere.products import ControlDesign
from hillsphere.products.fields import Label, Shape
from hillsphere_controllers.structured.verdict import Verdict

__all__ = ["Iterations", "Judged", "RobustResult", "SearchResult", "Synthesis"]


@dataclass(frozen=True)
class Judged:
    """Norms, poles and margins of a controller's closed loops with N plants."""

    hinf: Annotated[Array, Shape("models"), Label("H∞ norm", 6)]
    """H∞ norm of the closed loop; infinite if the loop is not stable."""
    hinf_upper: Annotated[Array, Shape("models"), Label("its bound from above", 6)]
    """A level that its gain exceeds at no frequency."""
    peak_rad_s: Annotated[Array, Shape("models"), Label("reached at", 4)]
    """Frequency at which the norm is reached."""
    hinf_error: Annotated[Array, Shape("models"), Label("rounding of the norm, relative", 2)]
    """Bound of what rounding can have changed in the norm, relative to it."""
    sampled: Annotated[Array, Shape("models"), Label("largest gain sampled", 6)]
    """The largest gain at many frequencies, for a check of these."""
    h2: Annotated[Array, Shape("models"), Label("H2 norm", 6)]
    """H2 norm; infinite if the loop is not stable or passes noise directly."""
    poles: Annotated[NDArray[np.complex128], Shape("poles", "models")]
    """Of the closed loops, 1/s, or in the z-plane."""
    abscissa_1_s: Annotated[Array, Shape("models"), Label("largest real part of the poles", 4)]
    """Largest real part of the poles; in discrete time of the logarithm of the poles over the
    period."""
    damping: Annotated[Array, Shape("models"), Label("least damping", 3)]
    """Least damping of the poles, likewise."""
    gain_lower: Annotated[Array, Shape("loops", "models")]
    """Gain margin of each loop, the others closed: at the controls, then at the measurements. This
    is the smallest stabilising factor."""
    gain_upper: Annotated[Array, Shape("loops", "models")]
    """The largest stabilising factor likewise."""
    phase_rad: Annotated[Array, Shape("loops", "models")]
    """Phase margin likewise."""
    delay_s: Annotated[Array, Shape("loops", "models")]
    """Delay margin likewise."""
    disk: Annotated[Array, Shape("models"), Label("disk margin α, both ends", 4)]
    """α of the disk margin of all controls and measurements at once."""


@dataclass(frozen=True)
class RobustResult:
    """Worst cases and scenarios of a design for uncertain plants."""

    labels: Annotated[tuple[str, ...], Shape("models"), Label("model")]
    """Names of the N uncertain models."""
    worst: Annotated[Array, Shape("models"), Label("γ of the worst case found", 6)]
    """γ of the worst case found for each: gains that are reached, with no guarantee that nothing is
    worse; infinite if a loop is not stable."""
    plants: Annotated[Integers, Shape("scenarios")]
    """Which model each scenario is of. They are those that the controller was made for, and as the
    last one the worst case of all."""
    gammas: Annotated[Array, Shape("scenarios"), Label("γ", 6)]
    """γ there."""
    names: Annotated[tuple[tuple[str, ...], ...], Shape("scenarios")]
    """Parameters of each scenario, which its model has."""
    values: Annotated[tuple[Array, ...], Shape("scenarios")]
    """Their values, in their units."""
    rounds: int
    """Designs that were made."""
    converged: bool
    """Whether the worst case is no more than 0.5 % above the γ of the scenarios."""


@dataclass(frozen=True)
class SearchResult:
    """Outcome of the searches for a controller of fixed structure."""

    theta: Annotated[Array, Shape("size")]
    """Parameters of the structure."""
    starts: Annotated[Array, Shape("starts")]
    """γ from every start; infinite without an allowed controller."""
    shaken: Annotated[Array, Shape("restarts")]
    """γ from near the best of them, likewise."""
    residual: float
    """Zero at a local minimum: length of the multipliers' sum of gradients of the logarithms. Not
    small where the gain is the same over a range of frequencies."""
    active: int
    """Number of peaks and constraints that hold the minimum."""
    converged: bool
    """Whether the last step promised next to nothing, and the residual is small."""
    evaluations: int
    """How often a set of closed loops was made."""
    per_plant: Annotated[Array, Shape("plants"), Label("γ of a controller of its own", 6)]
    """γ that the same structure reaches for each plant by itself, its uncertainty aside; none if
    that was not asked for."""
    joint: Annotated[Array, Shape("plants"), Label("γ of the controller of all", 6)]
    """γ of the controller of all at each of them, likewise."""
    scatter: float
    """How far from the first controller the searches began, relative; 0: at random ones."""
    given: bool
    """Whether the first began at a controller of another synthesis."""
    target: float
    """Searches ended once γ was below this."""
    equals: Annotated[Array, Shape("equal", 2)]
    """γ of the designs that were equal, and of their worst cases for the wider uncertainty, that of
    the one that was taken first; none without such."""
    robust: RobustResult | None
    """With uncertain plants: their worst cases."""
    verdict: Verdict
    """Which routes arrived at γ, and its gap to controllers of full order; with uncertain plants
    for the scenarios."""


@dataclass(frozen=True)
class Iterations:
    """Steps of a µ synthesis."""

    kinds: Annotated[tuple[str, ...], Shape("steps"), Label("what was done")]
    """Kind of each step."""
    upper: Annotated[Array, Shape("steps"), Label("µ, certified", 6)]
    """Certified bound of µ over all frequencies; infinite if no controller was found."""
    gamma: Annotated[Array, Shape("steps"), Label("norm of the scaled loop", 6)]
    """H∞ norm of the scaled loop."""
    peak_rad_s: Annotated[Array, Shape("steps"), Label("largest at", 4)]
    """Frequency of the largest bound at one frequency."""
    scaling_order: Annotated[Integers, Shape("steps"), Label("order of the scalings")]
    """Number of states of all scalings."""
    controller_order: Annotated[Integers, Shape("steps"), Label("order of the controller")]
    """Number of states of the controller."""
    accepted: Annotated[NDArray[np.bool_], Shape("steps"), Label("accepted")]
    """Whether the bound was the lowest until then."""
    refusals: Annotated[tuple[str, ...], Shape("steps"), Label("why not")]
    """Why a step was not accepted; empty if it was."""
    upper_mu: float
    """Upper bound of µ of the controller that was taken."""
    lower_mu: float
    """Lower bound of µ of that controller."""
    full_order: int
    """States of the controller before its reduction."""
    reason: str
    """Why the iteration ended."""


@dataclass(frozen=True)
class Synthesis(ControlDesign):
    """A controller u = K(s) y, without a change of sign, and its closed loops.

    Parameters
    ----------
    method : str
        How it was made.
    norm : {"hinf", "h2", "mu"}
        Meaning of γ: a norm, or the certified bound of µ.
    gamma : float
        Minimised value, recomputed from the closed loops.
    lower_bound : float
        No controller of any order or structure reaches less; 0 if nothing is known.
    plants : tuple of LtiSystem
        All N generalised plants, weights and all, with what was asked to be small.
    labels : tuple of str
        Their names.
    designed : ndarray of bool, shape (N,)
        Whether it was made for them.
    controls, measurements : int
        Their last inputs and outputs.
    weights : tuple of LtiSystem
        Square systems at the plants' ends, see
        `hillsphere_controllers.linear_products.LinearModels`.
    judged : Judged
        Norms, poles and margins of the closed loops.
    search : SearchResult or None
        Of a fixed structure.
    iterations : Iterations or None
        Of a µ synthesis.
    added : str
        Weights and noise that a full-order synthesis added for itself alone, in words; empty if
        there are none.
    """

    method: str
    norm: str
    gamma: float
    lower_bound: float
    plants: tuple[LtiSystem, ...]
    labels: tuple[str, ...]
    designed: NDArray[np.bool_]
    controls: int
    measurements: int
    weights: tuple[LtiSystem, ...]
    judged: Judged
    search: SearchResult | None
    iterations: Iterations | None
    added: str = ""
