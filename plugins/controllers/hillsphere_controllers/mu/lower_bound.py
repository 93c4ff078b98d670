r"""Lower bound of µ: a perturbation that makes I − M Δ singular.

µ(M) is the largest positive real eigenvalue of Q M over Q of the structure whose real scalars are
in [−1, 1], whose complex ones are on the unit circle and whose full blocks are dyads of unit
norm [1]_. Good starts are the singular direction of the upper bound's F, and the power iteration of
[1]_, which ends at a local maximum where it converges at all; where real scalars stay inside their
range it often does not. From the best iterates the eigenvalue is raised further in all parameters
at once, and in frequency where M is that of a system, under the condition that it is real. Where
this ends below what one block does by itself (`single_blocks`), that is taken and raised instead.
What is returned is checked by the smallest singular value of I − M Δ.

References
----------
.. [1] P. M. Young, J. C. Doyle (1990), Computation of µ with real and complex uncertainties, Proc.
   29th IEEE Conference on Decision and Control, 1230-1235.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.ascent import Ascent
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.power_iteration import power_iterations, singular_direction
from hillsphere_controllers.mu.scalings import Scalings
from hillsphere_controllers.mu.single_blocks import single_block, single_blocks

__all__ = [
    "LowerBound",
    "lower_bound",
    "lower_bound_near",
    "lower_bound_of_block",
    "moving_response",
    "verify_perturbation",
]  # fmt: skip

Complex = NDArray[np.complex128]

_SINGULAR = 1e-8
"""Smallest singular value of I − M Δ, relative to the size of M Δ, at which Δ proves a lower bound:
half of the digits of double precision."""
_RAISED = 3
"""So many of the best iterates are raised."""


@dataclass(frozen=True, eq=False)
class LowerBound:
    """A lower bound of µ and the perturbation that proves it.

    Parameters
    ----------
    value : float
        µ is no smaller; the inverse of the largest singular value of Δ. Zero if none was found.
    delta : ndarray, shape (m, p)
        Δ, with which I − M Δ is singular; entries of real blocks are exactly real. Zeros if none
        was found.
    singular : float
        The smallest singular value of I − M Δ.
    frequency_rad_s : float
        Frequency of the response M; NaN if M is a matrix and no response.
    """

    value: float
    delta: Complex
    singular: float
    frequency_rad_s: float = np.nan


def lower_bound(
    matrix: Complex | Array,
    structure: BlockStructure,
    *,
    scalings: Scalings | None = None,
    starts: int = 8,
    seed: int = 0,
) -> LowerBound:
    """Return a lower bound of µ of a matrix, no smaller than that of any block alone.

    Parameters
    ----------
    matrix : ndarray, shape (p, m)
        M, complex.
    structure : BlockStructure
        Of Δ.
    scalings : Scalings, optional
        Of the upper bound, which give a good start.
    starts : int
        Random starts of the power iteration, besides.
    seed : int
        Of the starts.

    Returns
    -------
    LowerBound
        The bound and the Δ that proves it.

    Raises
    ------
    InputError
        If the matrix does not fit the structure.
    """
    squared = structure.pad_to_square(matrix)

    def constant(_: float) -> tuple[Complex, Complex]:
        return squared, np.zeros_like(squared)

    return _best_start(constant, structure, scalings, starts, seed, None)


def lower_bound_near(
    system: LtiSystem,
    structure: BlockStructure,
    omega_rad_s: float,
    *,
    scalings: Scalings | None = None,
    starts: int = 8,
    seed: int = 0,
) -> LowerBound:
    """Return a lower bound of µ of a system, at a frequency near the one given.

    Frequency is raised together with Δ: purely real ones are singular at few frequencies only.

    Parameters
    ----------
    system : LtiSystem
        M, in continuous time, without poles on the imaginary axis.
    structure : BlockStructure
        Of Δ.
    omega_rad_s : float
        Begun at; zero and infinity stay where they are.
    scalings : Scalings, optional
        Of the upper bound there.
    starts, seed : int
        As of `lower_bound`.

    Returns
    -------
    LowerBound
        The bound, the Δ that proves it, and its frequency.

    Raises
    ------
    InputError
        If the system does not fit the structure.
    """
    at = moving_response(system, structure, omega_rad_s)
    fixed = omega_rad_s == 0.0 or not np.isfinite(omega_rad_s)
    return _best_start(at, structure, scalings, starts, seed, None if fixed else omega_rad_s)


def lower_bound_of_block(
    system: LtiSystem, structure: BlockStructure, block: int, omega_rad_s: float
) -> LowerBound | None:
    """Return the lower bound that one block alone gives a system at a frequency.

    Parameters
    ----------
    system : LtiSystem
        M, in continuous time, without poles on the imaginary axis.
    structure : BlockStructure
        Of Δ.
    block : int
        Its number.
    omega_rad_s : float
        The frequency, which may be infinite; at zero and there a full block is real.

    Returns
    -------
    LowerBound or None
        The bound, None if the block gives none.

    Raises
    ------
    InputError
        If the system does not fit the structure.
    """
    m, _ = moving_response(system, structure, omega_rad_s)(0.0)
    delta = single_block(m, structure, block)
    return None if delta is None else verify_perturbation(m, delta, structure, omega_rad_s)


def moving_response(
    system: LtiSystem, structure: BlockStructure, omega_rad_s: float
) -> Callable[[float], tuple[Complex, Complex]]:
    """Return the function of z that gives the squared M at ω exp(z), and its derivative.

    Parameters
    ----------
    system : LtiSystem
        M.
    structure : BlockStructure
        Of Δ, by which M is made square.
    omega_rad_s : float
        ω, rad/s.

    Returns
    -------
    callable
        z → M (n, n) at ω exp(z), and its derivative by z.
    """
    one = np.eye(system.order)

    def at(z: float) -> tuple[Complex, Complex]:
        omega = omega_rad_s * np.exp(z)
        if not np.isfinite(omega):
            m = structure.pad_to_square(system.d + 0j)
            return m, np.zeros_like(m)
        # M = C (jω − A)⁻¹ B + D, dM/dz = −jω C (jω − A)⁻² B with ω = ω₀ exp z
        x = np.linalg.solve(1j * omega * one - system.a, system.b + 0j)
        more = np.linalg.solve(1j * omega * one - system.a, x)
        m = structure.pad_to_square(system.c @ x + system.d)
        return m, structure.pad_to_square(-1j * omega * (system.c @ more))

    return at


def _best_start(
    at: Callable[[float], tuple[Complex, Complex]],
    structure: BlockStructure,
    scalings: Scalings | None,
    starts: int,
    seed: int,
    omega: float | None,
) -> LowerBound:
    m, _ = at(0.0)
    none = LowerBound(0.0, structure.remove_padding(np.zeros_like(m)), 1.0)
    size = float(np.linalg.norm(m, 2))
    if size == 0.0:
        return none
    ascent = Ascent(at, structure, moving=omega is not None)
    random = np.random.default_rng(seed)
    # starts in the order of their expected merit: the upper bound's direction, power iterations,
    # random ones
    likely = [] if scalings is None else singular_direction(m, structure, scalings)
    starting = power_iterations(m, structure, random, starts)
    starting.sort(key=lambda q: -ascent.merit(q))
    likely += starting[:_RAISED]
    if structure.purely_real or not likely:  # no phase makes an eigenvalue real: more are tried
        count = len(structure.blocks)
        likely += [
            structure.perturbation(list(random.uniform(-1.0, 1.0, count))) for _ in range(starts)
        ]
    best = none

    def raise_from(q: Complex) -> None:
        nonlocal best
        raised = ascent.climb(q)
        if raised is None:
            return
        delta, z = raised
        made = verify_perturbation(at(z)[0], delta, structure)
        if made is not None and made.value > best.value:
            frequency = np.nan if omega is None else float(omega * np.exp(z))
            best = LowerBound(made.value, made.delta, made.singular, frequency)

    for q in likely:
        raise_from(q)
    # no smaller than the bound of any single block, which is known exactly
    for delta in single_blocks(m, structure):
        if 1.0 / float(np.linalg.norm(delta, 2)) <= best.value:
            break
        made = verify_perturbation(m, delta, structure)
        if made is not None and made.value > best.value:
            best = made if omega is None else replace(made, frequency_rad_s=omega)
            raise_from(delta * made.value)
    return best


def verify_perturbation(
    m: Complex, delta: Complex, structure: BlockStructure, frequency_rad_s: float = np.nan
) -> LowerBound | None:
    """Return the lower bound that a squared Δ proves, None if I − M Δ is not singular.

    Parameters
    ----------
    m : ndarray, shape (n, n)
        Squared.
    delta : ndarray, shape (n, n)
        Squared.
    structure : BlockStructure
        Of Δ.
    frequency_rad_s : float
        Frequency of the response M, if it is one.

    Returns
    -------
    LowerBound or None
        The bound, with Δ in the form of the structure.
    """
    product = m @ delta
    singular = float(np.linalg.svd(np.eye(len(m)) - product, compute_uv=False)[-1])
    if not singular <= _SINGULAR * max(1.0, float(np.linalg.norm(product, 2))):
        return None
    made = structure.remove_padding(delta)
    size = max(float(np.linalg.norm(made[rows, columns], 2)) for rows, columns in structure.parts())
    return LowerBound(1.0 / size, made, singular, frequency_rad_s)
