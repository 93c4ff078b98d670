r"""Cover of a set of plants by one uncertain plant: nominal, weight, one full block.

With multiplicative uncertainty at the inputs, P = P₀ (I + w Δ) covers P_k where

.. math::

    |w(jω)| \ge r(ω) = \max_k \bar σ(P_0^{-1} (P_k - P_0)).

Among the weights of an order, stable with stable inverse, that one is found whose largest excess
over r is smallest. With cos θ = (ω₀² − ω²)/(ω₀² + ω²) the square of its magnitude is a quotient of
two polynomials of cos θ, N/D, and

.. math::

    r^2 D \le N \le t\, r^2 D, \quad N > 0, \quad D > 0

is a linear programme for each t, which is bisected [1]_. The weight is the spectral factor of N/D.

References
----------
.. [1] S. Boyd, L. Vandenberghe (2004), Convex Optimization, Cambridge University Press, section
   4.2.5 and exercise 4.58 (quasiconvex fits of rational functions).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.optimize import linprog

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.linear_fractional.algebra import dynamics
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.systems.algebra import gain
from hillsphere_controllers.systems.bilinear import continuous
from hillsphere_controllers.systems.conversion import transfer_function

__all__ = ["Cover", "Kind", "cover_plants", "fit_magnitude"]

Kind = Literal["input", "output", "additive"]
_POINTS = 120
"""Frequencies of the default grid: about thirty per decade of the plants' dynamics."""
_BEYOND = 10.0
"""Factor by which the default grid goes beyond the slowest and the fastest pole."""
_BELOW_NYQUIST = 0.99
"""End of the grid by half the sampling frequency, at which a strictly proper plant that was made
discrete by the bilinear transform is zero, so that a relative difference there is 0/0."""
_FLOOR = 1e-4
"""Share of the largest radius below which a smaller one is not fitted: rounding, and a weight that
follows it to zero would need many more states."""
_CLOSE = 1e-4
"""Width of the logarithm of t at which its bisection ends: far below what a weight is known to.
Where the order is higher than needed, N and D at the least t have nearly common roots."""
_POSITIVE = 1e-9
"""Least N and D, whose largest coefficient is one, on the grid."""
_ROOM = 1e-6
"""Relative room of the weight above the radius, for rounding of the spectral factor."""
_RESIDUAL = 1e-6
"""Relative distance of a difference from the range of the nominal plant up to which it counts as
within."""


@dataclass(frozen=True, eq=False)
class Cover:
    r"""An uncertain plant that covers a set of plants.

    Parameters
    ----------
    uncertain : Lft
        P₀ (I + w Δ), (I + w Δ) P₀ or P₀ + w Δ.
    weight : LtiSystem
        w, 1 × 1, stable, with stable inverse.
    omega_rad_s, radius : ndarray, shape (K,)
        Frequencies, and the largest deviation there.
    excess : float
        Largest ratio of \|w\| to the radius; one for a perfect fit.
    """

    uncertain: Lft
    weight: LtiSystem
    omega_rad_s: Array
    radius: Array
    excess: float


def cover_plants(
    plants: Sequence[LtiSystem],
    nominal: LtiSystem,
    order: int = 0,
    *,
    weight: LtiSystem | None = None,
    kind: Kind = "input",
    omega_rad_s: Array | None = None,
    name: str = "Delta",
) -> Cover:
    """Return an uncertain plant that covers a set of plants at a grid of frequencies.

    Parameters
    ----------
    plants : sequence of LtiSystem
        P_k, of the shape and sampling of the nominal one, each with as many unstable poles as it.
    nominal : LtiSystem
        P₀.
    order : int
        Of the weight, from 0 to about 8; of no effect with a weight given.
    weight : LtiSystem, optional
        Weight to be used instead of a fitted one, 1 × 1 and stable. It is checked that it covers.
    kind : {"input", "output", "additive"}
        P₀ (I + w Δ), (I + w Δ) P₀ or P₀ + w Δ.
    omega_rad_s : ndarray, shape (K,), optional
        Frequencies, rising and > 0; by default a decade beyond the poles of all plants.
    name : str
        Of the uncertainty.

    Returns
    -------
    Cover
        The uncertain plant and its weight.

    Raises
    ------
    InputError
        If shapes, sampling or numbers of unstable poles differ, no plant differs from the nominal
        one, or a difference is none of its inputs (outputs); if a weight that is given does not
        cover the plants.
    SynthesisFailedError
        If the linear programme has no solution that passes the check.
    """
    if kind not in get_args(Kind):
        raise InputError(f"kind must be one of {', '.join(get_args(Kind))}, got {kind!r}")
    if order < 0:
        raise InputError(f"the order of a weight must be ≥ 0, got {order}")
    unstable = _unstable_poles(nominal)
    for k, plant in enumerate(plants):
        if plant.shape != nominal.shape or plant.dt_s != nominal.dt_s:
            raise InputError(f"plant {k} must have the shape and sampling of the nominal one")
        if _unstable_poles(plant) != unstable:
            raise InputError(
                f"plant {k} has {_unstable_poles(plant)} poles that are not stable, the nominal "
                f"one {unstable}: no stable Δ makes one of the other"
            )
    omega = _default_grid([nominal, *plants]) if omega_rad_s is None else np.asarray(omega_rad_s)
    if omega.ndim != 1 or omega.size < 2 or not (np.diff(omega) > 0.0).all() or omega[0] <= 0.0:
        raise InputError("frequencies must be at least two, rising and > 0 rad/s")
    radius = _radius(plants, nominal, omega, kind)
    if not radius.max(initial=0.0) > 0.0:
        raise InputError("no plant differs from the nominal one: there is nothing to cover")
    if weight is None:
        covered = np.maximum(radius, _FLOOR * radius.max())
        weight = fit_magnitude(omega, covered, order, nominal.dt_s)
    else:
        weight = _check_weight(weight, omega, radius, nominal.dt_s)
    size = np.abs(weight.response(omega)[:, 0, 0])
    p, m = nominal.shape
    bare = replace(nominal, inputs=(), outputs=(), states=())
    if kind == "input":
        uncertain = bare @ (np.eye(m) + dynamics(name, m, m, weight))
    elif kind == "output":
        uncertain = (np.eye(p) + dynamics(name, p, p, weight)) @ bare
    else:
        uncertain = bare + dynamics(name, p, m, weight)
    excess = float((size / np.maximum(radius, _FLOOR * radius.max())).max())
    return Cover(uncertain, weight, omega, radius, excess)


def fit_magnitude(
    omega_rad_s: Array, radius: Array, order: int, dt_s: float | None = None
) -> LtiSystem:
    """Return a stable system with stable inverse whose gain is nowhere below given values.

    Parameters
    ----------
    omega_rad_s, radius : ndarray, shape (K,)
        Frequencies > 0 and the values, > 0.
    order : int
        Of the system.
    dt_s : float, optional
        Sampling period, s, of one in discrete time.

    Returns
    -------
    LtiSystem
        1 × 1; of all of this order that with the smallest largest ratio of gain to value.

    Raises
    ------
    InputError
        If frequencies or values are not positive or do not fit.
    SynthesisFailedError
        If the linear programme has no solution that passes the check.
    """
    omega, r = np.asarray(omega_rad_s, dtype=float), np.asarray(radius, dtype=float)
    if omega.shape != r.shape or not ((omega > 0.0).all() and (r > 0.0).all()):
        raise InputError("a fit needs as many values as frequencies, all positive")
    # the middle of the frequencies, where cos θ = 0
    centre = float(np.sqrt(omega.min() * omega.max()))
    period = 2.0 / centre if dt_s is None else dt_s
    if dt_s is None:
        cosine = (centre**2 - omega**2) / (centre**2 + omega**2)
    else:
        cosine = np.cos(omega * dt_s)
    squares = (r / r.max()) ** 2
    low, high = 0.0, float(np.log(squares.max() / squares.min())) + _CLOSE
    best = _quotient(cosine, squares, order, np.exp(high))
    while high - low > _CLOSE:
        middle = 0.5 * (low + high)
        made = _quotient(cosine, squares, order, np.exp(middle))
        if made is None:
            low = middle
        else:
            high, best = middle, made
    if best is None:
        raise SynthesisFailedError("no weight was found; take another order or fewer decades")
    sampled = transfer_function(
        np.atleast_1d(_spectral_factor(best[0])), np.atleast_1d(_spectral_factor(best[1])), period
    )
    weight = sampled if dt_s is not None else continuous(sampled)
    ratio = np.abs(weight.response(omega)[:, 0, 0]) / r
    weight = weight * float((1.0 + _ROOM) / ratio.min())
    if not (weight.is_stable and ratio.max() / ratio.min() <= np.exp(0.5 * high) * 1.01):
        raise SynthesisFailedError(
            "the weight lost its accuracy in the spectral factors; take a lower order or fewer "
            "decades of frequency"
        )
    return weight


def _check_weight(weight: LtiSystem, omega: Array, radius: Array, dt_s: float | None) -> LtiSystem:
    """Return a given weight in the plants' time, after a check that it covers the radius."""
    if weight.order == 0:
        weight = gain(weight.d, dt_s)
    if weight.shape != (1, 1) or weight.dt_s != dt_s or not weight.is_stable:
        raise InputError(
            f"the weight must be stable, 1 × 1 and sampled as the plants, got {weight}"
        )
    ratio = np.abs(weight.response(omega)[:, 0, 0]) / np.maximum(radius, np.finfo(float).tiny)
    worst = int(np.argmin(ratio))
    if ratio[worst] < 1.0 - _ROOM:
        raise InputError(
            f"the weight does not cover the plants: at {omega[worst]:.4g} rad/s it is "
            f"{ratio[worst]:.4g} of their largest deviation {radius[worst]:.4g}"
        )
    return weight


def _quotient(
    cosine: Array, squares: Array, order: int, ratio: float
) -> tuple[Array, Array] | None:
    """Return the coefficients (order + 1,) of N and D, or None if no quotient is that near."""
    basis = chebyshev.chebvander(cosine, order)
    # between the grid and beyond it N and D must be positive too
    all_basis = chebyshev.chebvander(np.cos(np.linspace(0.0, np.pi, 20 * order + 2)), order)
    zero = np.zeros_like(basis)
    unit = 1.0 / squares[:, None]
    rows = [
        np.hstack([-unit * basis, basis]),
        np.hstack([unit * basis, -ratio * basis]),
        np.hstack([-all_basis, np.zeros_like(all_basis)]),
        np.hstack([np.zeros_like(all_basis), -all_basis]),
        np.hstack([zero, -basis]),
    ]
    count = order + 1
    right = np.concatenate(
        [np.zeros(2 * len(basis)), np.full(2 * len(all_basis) + len(basis), -_POSITIVE)]
    )
    # the mean of D over θ is one
    equal = np.concatenate([np.zeros(count), [1.0], np.zeros(order)])[None]
    bounds = [(None, None)] * (2 * count)
    found = linprog(
        np.zeros(2 * count), np.vstack(rows), right, equal, [1.0], bounds, method="highs"
    )
    if found.status != 0:
        return None
    return np.asarray(found.x[:count]), np.asarray(found.x[count:])


def _spectral_factor(cosines: Array) -> NDArray[np.float64]:
    """Return the polynomial in z, roots in the unit disc, whose square on the circle is given.

    Parameters
    ----------
    cosines : ndarray, shape (n + 1,)
        Coefficients of Σ c_k cos kθ, positive.
    """
    # Σ c_k (zᵏ + z⁻ᵏ)/2 times zⁿ
    half = 0.5 * cosines[1:]
    roots = np.roots(np.concatenate([half[::-1], cosines[:1], half]))
    # they are pairs z and 1/z: those within the disc are the smaller half
    inner = roots[np.argsort(np.abs(roots))][: cosines.size - 1]
    factor = np.atleast_1d(np.real(np.poly(inner)))
    # c₀, the mean over the circle, is the sum of squares of the coefficients
    return np.asarray(factor * np.sqrt(cosines[0] / np.sum(factor**2)))


def _radius(plants: Sequence[LtiSystem], nominal: LtiSystem, omega: Array, kind: Kind) -> Array:
    """Return the largest deviation (K,) of the plants from the nominal one."""
    at = nominal.response(omega)
    largest = np.zeros(omega.size)
    for plant in plants:
        away = plant.response(omega) - at
        if kind == "output":
            away, inside = np.swapaxes(away, 1, 2), np.swapaxes(at, 1, 2)
        else:
            inside = at
        if kind != "additive":
            # the smallest Δ with P₀ Δ = P_k − P₀
            delta = np.linalg.pinv(inside) @ away
            rest = np.linalg.norm(inside @ delta - away, axis=(1, 2))
            if (rest > _RESIDUAL * np.linalg.norm(inside, axis=(1, 2))).any():
                raise InputError(
                    f"a plant differs from the nominal one by more than a change of its {kind}s; "
                    "take kind='additive'" + (" or 'output'" if kind == "input" else " or 'input'")
                )
            away = delta
        largest = np.maximum(largest, np.linalg.norm(away, 2, axis=(1, 2)))
    return largest


def _unstable_poles(system: LtiSystem) -> int:
    poles = system.poles
    bad = poles.real >= 0.0 if system.dt_s is None else np.abs(poles) >= 1.0
    return int(np.count_nonzero(bad))


def _default_grid(systems: Sequence[LtiSystem]) -> Array:
    poles = np.concatenate([s.poles for s in systems])
    dt_s = systems[0].dt_s
    if dt_s is not None:
        poles = np.log(poles[poles != 0.0]) / dt_s
    sizes = np.abs(poles)
    sizes = sizes[sizes > 0.0]
    low, high = (sizes.min(), sizes.max()) if sizes.size else (1.0, 1.0)
    top = _BEYOND * high if dt_s is None else _BELOW_NYQUIST * np.pi / dt_s
    return np.geomspace(min(low / _BEYOND, top / _BEYOND), top, _POINTS)
