"""Uncertain elements and systems, under their usual names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any, overload

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.delays.algebra import append as append_late
from hillsphere_controllers.delays.algebra import feedback as late_feedback
from hillsphere_controllers.delays.system import DelaySystem, as_delay_system
from hillsphere_controllers.linear_fractional.algebra import (
    diagonal,
    dynamics,
    join_inputs,
    parameter,
    stack_outputs,
    state_space,
)
from hillsphere_controllers.linear_fractional.algebra import feedback as uncertain_feedback
from hillsphere_controllers.linear_fractional.algebra import star as uncertain_star
from hillsphere_controllers.linear_fractional.cover import Kind, cover_plants
from hillsphere_controllers.linear_fractional.transformation import Lft, constant
from hillsphere_controllers.linear_fractional.uncertainties import real_parameter
from hillsphere_controllers.systems.algebra import append as append_systems
from hillsphere_controllers.systems.algebra import feedback as certain_feedback
from hillsphere_controllers.systems.algebra import gain, star
from hillsphere_controllers.systems.conversion import as_lti, like
from hillsphere_controllers.toolbox.results import Readable

__all__ = [
    "PlantCover", "append", "feedback", "lft", "parallel", "series", "ucover", "ultidyn", "ureal",
    "uss",
]  # fmt: skip


def ureal(
    name: str,
    nominal: float,
    *,
    range: tuple[float, float] | None = None,  # noqa: A002 - MATLAB's name
    plusminus: float | tuple[float, float] | None = None,
    percentage: float | tuple[float, float] | None = None,
) -> Lft:
    """Return an uncertain real parameter, as a 1 × 1 matrix for further algebra.

    Parameters
    ----------
    name : str
        Of the parameter; two of one name are one.
    nominal : float
        Its nominal value.
    range : tuple of float, optional
        Its bounds.
    plusminus, percentage : float or tuple of float, optional
        Its bounds relative to the nominal value, ± 1 if nothing is given; two numbers are the
        changes to the lower and to the upper bound.

    Returns
    -------
    Lft
        The parameter, 1 × 1.

    Raises
    ------
    InputError
        If more than one of the three is given, one is no number or pair of numbers, or the nominal
        value is not between the bounds.
    """
    if sum(one is not None for one in (range, plusminus, percentage)) > 1:
        raise InputError(f"{name}: give range, plusminus or percentage, not several of them")
    if range is not None:
        low, high = _pair(name, "range", range)
        if not low < nominal < high:
            raise InputError(
                f"{name}: range=(lower, upper) must contain the nominal value {nominal} between "
                f"its ends, got {range!r}"
            )
        return parameter(real_parameter(name, low, high, nominal))
    what = "plusminus" if percentage is None else "percentage"
    given = percentage if percentage is not None else 1.0 if plusminus is None else plusminus
    down, up = _pair(name, what, given)
    if not down < 0.0 < up:
        raise InputError(
            f"{name}: {what} must be a number > 0, or a change below and one above zero, (-5, 10), "
            f"got {given!r}"
        )
    if percentage is not None and nominal == 0.0:
        raise InputError(f"{name}: a percentage of the nominal value 0 is 0; give plusminus")
    scale = 1.0 if percentage is None else abs(nominal) / 100.0
    return parameter(real_parameter(name, nominal + scale * down, nominal + scale * up, nominal))


def _pair(name: str, what: str, given: float | Sequence[float]) -> tuple[float, float]:
    """Return two finite numbers, of one number those of both signs."""
    made = np.asarray(given)
    is_number = made.dtype.kind in "iuf" and bool(np.isfinite(made).all())
    if not is_number or made.shape not in ((), (2,)) or (what == "range" and made.ndim == 0):
        number = "" if what == "range" else "a number or "
        raise InputError(f"{name}: {what} must be {number}two finite numbers, got {given!r}")
    return (-float(made), float(made)) if made.ndim == 0 else (float(made[0]), float(made[1]))


def ultidyn(name: str, iosize: tuple[int, int] = (1, 1), *, bound: float = 1.0) -> Lft:
    """Return an unknown stable system whose H∞ norm is at most a bound.

    Parameters
    ----------
    name : str
        Of the uncertainty.
    iosize : tuple of int
        Its numbers of outputs and inputs.
    bound : float
        Largest H∞ norm.

    Returns
    -------
    Lft
        The uncertain system, without a nominal part.

    Raises
    ------
    InputError
        If the bound is not positive.
    """
    if not 0.0 < bound < np.inf:
        raise InputError(f"{name}: a bound must be > 0 and finite, got {bound}")
    return dynamics(name, *iosize) * bound


def uss(
    A: Lft | Array, B: Lft | Array, C: Lft | Array, D: Lft | Array, dt_s: float | None = None
) -> Lft:
    """Return an uncertain system of matrices of which some are uncertain.

    Parameters
    ----------
    A, B, C, D : Lft or ndarray
        Matrices (n, n), (n, m), (p, n), (p, m).
    dt_s : float, optional
        Sampling period, s, of a system in discrete time.

    Returns
    -------
    Lft
        The uncertain system.

    Raises
    ------
    InputError
        If the matrices do not fit.
    """
    whole = stack_outputs(join_inputs(A, B), join_inputs(C, D))
    return state_space(whole, constant(A).shape[0], dt_s)


@overload
def lft(A: Lft, B: Lft | LtiSystem, nu: int | None = None, ny: int | None = None) -> Lft: ...
@overload
def lft(A: LtiSystem, B: Lft, nu: int | None = None, ny: int | None = None) -> Lft: ...
@overload
def lft(A: LtiSystem, B: LtiSystem, nu: int | None = None, ny: int | None = None) -> LtiSystem: ...
def lft(A: Any, B: Any = None, nu: int | None = None, ny: int | None = None) -> Any:
    """Return the linear fractional transformation of two systems, certain or uncertain.

    Parameters
    ----------
    A, B : LtiSystem, system of python-control or Lft
        ``lft(P, K)`` closes the last inputs and outputs of P by K, ``lft(Delta, M)`` the first ones
        of M by Δ: the smaller system closes the larger one.
    nu, ny : int, optional
        The last `ny` outputs of A go into the first inputs of B, whose first `nu` outputs go into
        the last inputs of A: Redheffer's star product.

    Returns
    -------
    Lft, LtiSystem or control.StateSpace
        Uncertain if one of them is, else of python-control if one of them is.

    Raises
    ------
    InputError
        If there is one system only, neither fits into the other, only one of the numbers is given,
        or the loop is not well posed.
    """
    if B is None:
        raise InputError("lft takes two systems: lft(P, K), or lft(Delta, M)")
    if (nu is None) != (ny is None):
        raise InputError("give both nu and ny, or none of them")
    a, b = (s if isinstance(s, Lft) else as_lti(s) for s in (A, B))
    (p1, m1), (p2, m2) = a.shape, b.shape
    if nu is not None and ny is not None:
        made = _star(a, b, nu, ny)
    elif m1 >= p2 and p1 >= m2:
        made = _star(a, b, p2, m2)
    elif p2 >= m1 and m2 >= p1:
        made = _star(a, b, m1, p1)
    else:
        raise InputError(f"none of the systems, {p1} × {m1} and {p2} × {m2}, closes the other one")
    return made if isinstance(made, Lft) else like(made, A, B)


@overload
def feedback(G: Lft, H: Lft | LtiSystem | Array | float | None = None, sign: int = -1) -> Lft: ...
@overload
def feedback(G: LtiSystem | Array | float, H: Lft, sign: int = -1) -> Lft: ...
@overload
def feedback(
    G: DelaySystem, H: DelaySystem | LtiSystem | Array | float | None = None, sign: int = -1
) -> DelaySystem: ...
@overload
def feedback(G: LtiSystem | Array | float, H: DelaySystem, sign: int = -1) -> DelaySystem: ...
@overload
def feedback(
    G: LtiSystem | Array | float, H: LtiSystem | Array | float | None = None, sign: int = -1
) -> LtiSystem: ...
def feedback(G: Any, H: Any = None, sign: int = -1) -> Any:
    """Return the closed loop (I − sign G H)⁻¹ G of two systems, certain, uncertain or with delays.

    Parameters
    ----------
    G, H : LtiSystem, DelaySystem, system of python-control, ndarray, float or Lft
        Forward system and system in the feedback; H is the unit matrix if left out.
    sign : {-1, 1}
        Negative or positive feedback.

    Returns
    -------
    Lft, DelaySystem, LtiSystem or control.StateSpace
        Uncertain or with delays if one of them is, else of python-control if one of them is.

    Raises
    ------
    InputError
        If the two do not fit, the loop is not well posed, or one is uncertain and one has delays.
    """
    if _have_delays(G, H):
        back = gain(np.eye(G.shape[1], G.shape[0])) if H is None else H
        return late_feedback(G, back, sign)
    g = G if isinstance(G, Lft) else as_lti(G, "the system G")
    if H is None:
        h: Lft | LtiSystem = gain(np.eye(g.shape[1], g.shape[0]))
    else:
        h = H if isinstance(H, Lft) else as_lti(H, "the system H")
    if isinstance(g, LtiSystem) and isinstance(h, LtiSystem):
        return like(certain_feedback(g, h, sign), G, H)
    return uncertain_feedback(constant(g), h, sign)


@overload
def append(first: Lft, /, *more: Lft | LtiSystem | Array | float) -> Lft: ...
@overload
def append(
    first: LtiSystem | Array | float, second: Lft, /, *more: Lft | LtiSystem | Array | float
) -> Lft: ...
@overload
def append(
    first: DelaySystem, /, *more: DelaySystem | LtiSystem | Array | float
) -> DelaySystem: ...
@overload
def append(
    first: LtiSystem | Array | float,
    second: DelaySystem,
    /,
    *more: DelaySystem | LtiSystem | Array | float,
) -> DelaySystem: ...
@overload
def append(*systems: LtiSystem | Array | float) -> LtiSystem: ...
def append(*systems: Any) -> Any:
    """Return the block-diagonal system of several, certain, uncertain or with delays.

    Parameters
    ----------
    *systems : LtiSystem, DelaySystem, system of python-control, ndarray, float or Lft
        The blocks.

    Returns
    -------
    Lft, DelaySystem, LtiSystem or control.StateSpace
        Uncertain or with delays if one of them is, else of python-control if one of them is.

    Raises
    ------
    InputError
        If there is none, the sampling periods differ, or one is uncertain and one has delays.
    """
    if _have_delays(*systems):
        return append_late(*systems)
    parts = [s if isinstance(s, Lft) else as_lti(s) for s in systems]
    certain = [part for part in parts if isinstance(part, LtiSystem)]
    if len(certain) < len(parts):
        return diagonal(*parts)
    return like(append_systems(*certain), *systems)


@overload
def series(first: Lft, /, *more: Lft | LtiSystem | Array | float) -> Lft: ...
@overload
def series(
    first: LtiSystem | Array | float, second: Lft, /, *more: Lft | LtiSystem | Array | float
) -> Lft: ...
@overload
def series(
    first: DelaySystem, /, *more: DelaySystem | LtiSystem | Array | float
) -> DelaySystem: ...
@overload
def series(
    first: LtiSystem | Array | float,
    second: DelaySystem,
    /,
    *more: DelaySystem | LtiSystem | Array | float,
) -> DelaySystem: ...
@overload
def series(*systems: LtiSystem | Array | float) -> LtiSystem: ...
def series(*systems: Any) -> Any:
    """Return systems one after the other, the first one first.

    Gₖ … G₂ G₁ of certain or uncertain systems, or of systems with delays.

    Parameters
    ----------
    *systems : LtiSystem, DelaySystem, system of python-control, ndarray, float or Lft
        One or more, the first one first.

    Returns
    -------
    Lft, DelaySystem, LtiSystem or control.StateSpace
        As of `append`.

    Raises
    ------
    InputError
        If there is none, they do not fit, or one is uncertain and one has delays.
    """
    return _combine(systems, lambda before, after: after @ before)


@overload
def parallel(first: Lft, /, *more: Lft | LtiSystem | Array | float) -> Lft: ...
@overload
def parallel(
    first: LtiSystem | Array | float, second: Lft, /, *more: Lft | LtiSystem | Array | float
) -> Lft: ...
@overload
def parallel(
    first: DelaySystem, /, *more: DelaySystem | LtiSystem | Array | float
) -> DelaySystem: ...
@overload
def parallel(
    first: LtiSystem | Array | float,
    second: DelaySystem,
    /,
    *more: DelaySystem | LtiSystem | Array | float,
) -> DelaySystem: ...
@overload
def parallel(*systems: LtiSystem | Array | float) -> LtiSystem: ...
def parallel(*systems: Any) -> Any:
    """Return the sum of systems, certain, uncertain or with delays.

    Parameters
    ----------
    *systems : LtiSystem, DelaySystem, system of python-control, ndarray, float or Lft
        One or more, of the same inputs and outputs.

    Returns
    -------
    Lft, DelaySystem, LtiSystem or control.StateSpace
        As of `append`.

    Raises
    ------
    InputError
        If there is none, they do not fit, or one is uncertain and one has delays.
    """
    return _combine(systems, add)


def _combine(
    systems: Sequence[Any], operation: Callable[[Any, Any], Any]
) -> Lft | LtiSystem | DelaySystem:
    """Return systems of whatever kind combined by an operation, from the first one on."""
    if not systems:
        raise InputError("at least one system is needed")
    late, are_uncertain = _have_delays(*systems), any(isinstance(one, Lft) for one in systems)
    turn = as_delay_system if late else constant if are_uncertain else as_lti
    made = reduce(operation, [turn(one) for one in systems])
    return like(made, *systems) if isinstance(made, LtiSystem) else made


def _have_delays(*systems: object) -> bool:
    """Say whether a system has delays; `InputError` if another one is uncertain."""
    late = any(isinstance(one, DelaySystem) for one in systems)
    if late and any(isinstance(one, Lft) for one in systems):
        raise InputError(
            "a system with delays does not connect to an uncertain one; padecover(G, order) makes "
            "it uncertain itself"
        )
    return late


def _star(a: Lft | LtiSystem, b: Lft | LtiSystem, nu: int, ny: int) -> Lft | LtiSystem:
    if isinstance(a, LtiSystem) and isinstance(b, LtiSystem):
        return star(a, b, nu, ny)
    return uncertain_star(constant(a), b, nu, ny)


@dataclass(frozen=True, eq=False, repr=False)
class PlantCover(Readable):
    """An uncertain plant that covers a set of plants.

    Parameters
    ----------
    usys : Lft
        P₀ (I + w Δ), (I + w Δ) P₀ or P₀ + w Δ.
    W : LtiSystem
        The weight w, 1 × 1, stable; one that was fitted has a stable inverse.
    omega_rad_s, radius : ndarray, shape (K,)
        Frequencies, and the largest deviation of the plants there, which w covers.
    excess : float
        Largest ratio of the weight's gain to the radius.
    """

    usys: Lft
    W: LtiSystem
    omega_rad_s: Array
    radius: Array
    excess: float


def ucover(
    Parray: Sequence[LtiSystem | Array | float],
    Pnom: LtiSystem | Array | float,
    order: int | None = None,
    *,
    W: LtiSystem | Array | float | None = None,
    kind: Kind = "input",
    omega_rad_s: Array | None = None,
    name: str = "Delta",
) -> PlantCover:
    """Return an uncertain plant, one scalar weight times one full Δ, that covers some plants.

    Parameters
    ----------
    Parray : sequence of LtiSystem, systems of python-control, matrices or numbers
        The plants.
    Pnom : LtiSystem, system of python-control, matrix or number
        The nominal plant P₀.
    order : int, optional
        Of the weight, which is fitted to the plants.
    W : LtiSystem, system of python-control or float, optional
        The weight itself instead of its order, stable and 1 × 1. It is checked that it covers.
    kind : {"input", "output", "additive"}
        MATLAB's 'InputMult', which is P₀ (I + w Δ), 'OutputMult' or 'Additive'.
    omega_rad_s : ndarray, shape (K,), optional
        Frequencies at which the plants are covered; by default a decade beyond all poles.
    name : str
        Of the uncertainty.

    Returns
    -------
    PlantCover
        The uncertain plant and its weight.

    Raises
    ------
    InputError, SynthesisFailedError
        As `hillsphere_controllers.linear_fractional.cover.cover_plants`; if not exactly one of
        `order` and `W` is given.
    """
    if (order is None) == (W is None):
        raise InputError("give the order of a weight that is fitted, or a weight W, not both")
    plants = [as_lti(one, f"plant {k}") for k, one in enumerate(Parray)]
    cover = cover_plants(
        plants, as_lti(Pnom, "the plant Pnom"), order or 0,
        weight=None if W is None else as_lti(W, "the weight W"),
        kind=kind, omega_rad_s=omega_rad_s, name=name,
    )  # fmt: skip
    return PlantCover(
        cover.uncertain, like(cover.weight, Pnom, W), cover.omega_rad_s, cover.radius, cover.excess
    )
