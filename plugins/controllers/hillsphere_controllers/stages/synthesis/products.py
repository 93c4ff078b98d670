"""Product of the stage ``synthesis``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere.products import ControlDesign

__all__ = ["Iterations", "Judged", "RobustResult", "SearchResult", "Synthesis"]


@dataclass(frozen=True)
class Judged:
    """Norms, poles and margins of a controller's closed loops with N plants.

    Parameters
    ----------
    hinf, hinf_upper, peak_rad_s : ndarray, shape (N,)
        H∞ norm of the closed loop, a level that its gain exceeds nowhere, and where it is reached;
        infinite if the loop is not stable.
    hinf_error : ndarray, shape (N,)
        Bound of what rounding can have changed in the norm, relative to it.
    sampled : ndarray, shape (N,)
        The largest gain at many frequencies, for a check of these.
    h2 : ndarray, shape (N,)
        H2 norm; infinite if the loop is not stable or passes noise directly.
    poles : ndarray, shape (n, N)
        Of the closed loops, 1/s, or in the z-plane.
    abscissa_1_s, damping : ndarray, shape (N,)
        Largest real part of the poles, and least damping; in discrete time those of the logarithm
        of the poles over the period.
    gain_lower, gain_upper, phase_rad, delay_s : ndarray, shape (c, N)
        Margins of each loop, the others closed: at the controls, then at the measurements.
    disk : ndarray, shape (N,)
        α of the disk margin of all controls and measurements at once.
    """

    hinf: Array
    hinf_upper: Array
    peak_rad_s: Array
    hinf_error: Array
    sampled: Array
    h2: Array
    poles: NDArray[np.complex128]
    abscissa_1_s: Array
    damping: Array
    gain_lower: Array
    gain_upper: Array
    phase_rad: Array
    delay_s: Array
    disk: Array


@dataclass(frozen=True)
class RobustResult:
    """Worst cases and scenarios of a design for uncertain plants.

    Parameters
    ----------
    labels : tuple of str
        Names of the N uncertain models.
    worst : ndarray, shape (N,)
        γ of the worst case found for each: gains that are reached, with no guarantee that nothing
        is worse; infinite if a loop is not stable.
    plants : ndarray of int, shape (S,)
        Which model each scenario is of. They are those that the controller was made for, and as
        the last one the worst case of all.
    gammas : ndarray, shape (S,)
        γ there.
    names : tuple of tuple of str
        Parameters of each scenario, which its model has.
    values : tuple of ndarray
        Their values, in their units.
    rounds : int
        Designs that were made.
    converged : bool
        Whether the worst case is no more than 0.5 % above the γ of the scenarios.
    """

    labels: tuple[str, ...]
    worst: Array
    plants: Integers
    gammas: Array
    names: tuple[tuple[str, ...], ...]
    values: tuple[Array, ...]
    rounds: int
    converged: bool


@dataclass(frozen=True)
class SearchResult:
    """Outcome of the searches for a controller of fixed structure.

    Parameters
    ----------
    theta : ndarray, shape (size,)
        Parameters of the structure.
    starts, shaken : ndarray, shape (S,), (K,)
        γ from every start, and from near the best of them; infinite without an allowed controller.
    residual : float
        Zero at a local minimum: length of the multipliers' sum of gradients of the logarithms.
        Not small where the gain is the same over a range of frequencies.
    active : int
        Number of peaks and constraints that hold the minimum.
    converged : bool
        Whether the last step promised next to nothing, and the residual is small.
    evaluations : int
        How often a set of closed loops was made.
    per_plant : ndarray, shape (P,)
        γ that the same structure reaches for each plant by itself, its uncertainty aside; none if
        that was not asked for.
    joint : ndarray, shape (P,)
        γ of the controller of all at each of them, likewise.
    scatter : float
        How far from the first controller the searches began, relative; 0: at random ones.
    given : bool
        Whether the first began at a controller of another synthesis.
    target : float
        Searches ended once γ was below this.
    equals : ndarray, shape (E, 2)
        γ of the designs that were equal, and of their worst cases for the wider uncertainty, that
        of the one that was taken first; none without such.
    robust : RobustResult or None
        With uncertain plants: their worst cases.
    """

    theta: Array
    starts: Array
    shaken: Array
    residual: float
    active: int
    converged: bool
    evaluations: int
    per_plant: Array
    joint: Array
    scatter: float
    given: bool
    target: float
    equals: Array
    robust: RobustResult | None


@dataclass(frozen=True)
class Iterations:
    """Steps of a µ synthesis.

    Parameters
    ----------
    kinds : tuple of str, length I
        What was done.
    upper, gamma, peak_rad_s : ndarray, shape (I,)
        Certified bound of µ over all frequencies, infinite if no controller was found; norm of the
        scaled loop; where the largest bound at one frequency is.
    scaling_order, controller_order : ndarray of int, shape (I,)
        States of all scalings, and of the controller.
    accepted : ndarray of bool, shape (I,)
        Whether the bound was the lowest until then.
    refusals : tuple of str, length I
        Why it was not.
    upper_mu, lower_mu : float
        Bounds of µ of the controller that was taken.
    full_order : int
        States of the controller before its reduction.
    reason : str
        Why the iteration ended.
    """

    kinds: tuple[str, ...]
    upper: Array
    gamma: Array
    peak_rad_s: Array
    scaling_order: Integers
    controller_order: Integers
    accepted: NDArray[np.bool_]
    refusals: tuple[str, ...]
    upper_mu: float
    lower_mu: float
    full_order: int
    reason: str


@dataclass(frozen=True)
class Synthesis(ControlDesign):
    """A controller u = K(s) y, without a change of sign, and what it does.

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
