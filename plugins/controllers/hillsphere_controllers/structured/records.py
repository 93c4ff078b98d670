"""Records of structured synthesis: the problem, where a search of it begins, and its result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_controllers.structured.polish import Active
from hillsphere_controllers.structured.requirements import DesignPlant, PoleRegion
from hillsphere_controllers.structured.route_names import STARTS
from hillsphere_controllers.structured.structure import Structure
from hillsphere_controllers.structured.verification import FullOrder

__all__ = ["KEPT", "Problem", "SearchResult", "Start"]

KEPT = 1e-6
"""A constraint counts as kept when it is not exceeded by more than this, relative."""
_SETTLED = 1e-5
"""Residual of the certificate below which a minimum needs no narrow second search."""


@dataclass(frozen=True)
class Problem:
    """A synthesis problem: all that a search depends on besides its start.

    Parameters
    ----------
    plants : tuple of DesignPlant
        Plants, and what is asked of each.
    structure : Structure
        Of the controller.
    region : PoleRegion or None
        Where the poles of all closed loops are to be.
    largest_gain : float or None
        Limit of the Frobenius norm of K.
    controller_stable : bool
        Whether the controller itself is to be stable.
    bandwidth_rad_s : float or None
        About that of the loops: gives the scale of the search; None: the plants' poles do.
    near : bool
        Whether parameters that are given are near a minimum, so that polishing will do.
    target : float
        A search ends once γ is below this.
    full : FullOrder or None
        A controller of full order, for the route from it.
    """

    plants: tuple[DesignPlant, ...]
    structure: Structure
    region: PoleRegion | None = None
    largest_gain: float | None = None
    controller_stable: bool = False
    bandwidth_rad_s: float | None = None
    near: bool = False
    target: float = 0.0
    full: FullOrder | None = None


@dataclass(frozen=True)
class Start:
    """Where a search begins.

    Parameters
    ----------
    number : int
        Its number among all.
    seed : int
        Of what is random in the search.
    theta : ndarray, shape (size,), or None
        Parameters; None: random ones.
    perturbation : float
        By so much, relative, they are changed at random.
    route : str
        One of `route_names.ROUTES`.
    variant : int
        Tells the searches of one route apart.
    rescaled : bool
        Whether the search goes on from the parameters in their own scale, see `Search.rescaled`.
    """

    number: int
    seed: int
    theta: Array | None = None
    perturbation: float = 0.0
    route: str = STARTS
    variant: int = 0
    rescaled: bool = False


@dataclass(frozen=True)
class SearchResult:
    """Result of a search.

    Parameters
    ----------
    start : Start
        Where it began.
    theta : ndarray, shape (size,)
        Parameters.
    gamma : float
        Largest weighted norm; infinite if no stable closed loop was found.
    abscissa : float
        Largest real part of the poles of all closed loops, each relative to its plant's rate.
    excess : float
        Largest of the constraints, relative; below zero: all are kept; −inf: there is none.
    converged : bool
        Whether polishing ended by itself, where the residual is below 1e-2.
    residual : float
        |Σ λ g| max(1, |x|) of the multipliers λ and gradients g of the logarithms of the peaks, in
        scaled parameters x: zero at a local minimum.
    active : tuple of Active
        Peaks and constraints that hold it.
    evaluations : int
        How often a set of closed loops was made.
    interrupted : bool
        Whether the user stopped it: this is the best until then.
    note : str
        Why its route led nowhere; may be empty.
    """

    start: Start
    theta: Array
    gamma: float
    abscissa: float
    excess: float = -np.inf
    converged: bool = False
    residual: float = np.inf
    active: tuple[Active, ...] = ()
    evaluations: int = 0
    interrupted: bool = False
    note: str = ""

    @property
    def settled(self) -> bool:
        """Whether it has converged so well that no search near it would lower it."""
        return self.converged and self.residual < _SETTLED

    @property
    def allowed(self) -> bool:
        """Whether it is stable and keeps all constraints."""
        return bool(np.isfinite(self.gamma) and self.excess <= KEPT)
