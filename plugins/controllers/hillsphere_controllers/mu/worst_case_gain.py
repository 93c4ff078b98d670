r"""The largest gain that a loop can have under perturbations of bounded size.

With a full block between the performance outputs and inputs that closes the loop, the gain of
F_u(M, Δ) is below γ for all Δ with σ̄(Δ) ≤ 1 if the skewed µ of M, whose performance block alone has
the level γ, is [1]_. From below, the gain is raised in the parameters of Δ and in frequency.

References
----------
.. [1] G. Ferreres (1999), A Practical Approach to Robustness Analysis with Aeronautical
   Applications, Kluwer, chapter 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.ascent import FARTHEST
from hillsphere_controllers.mu.blocks import BlockStructure, full
from hillsphere_controllers.mu.certified import CertifiedPeak, certified_peak
from hillsphere_controllers.mu.images import beside_poles, from_image, in_continuous_time, to_image
from hillsphere_controllers.mu.lower_bound import lower_bound, moving_response
from hillsphere_controllers.mu.parameters import UnitPerturbation
from hillsphere_controllers.mu.worst_case import interpolated
from hillsphere_controllers.systems.algebra import upper_lft
from hillsphere_controllers.systems.bilinear import discrete

__all__ = ["WorstCaseGain", "performance_structure", "worst_case_gain"]

Complex = NDArray[np.complex128]

_STARTS = 6
_MOST = 200
_INSIDE = 1e-9
"""Relative room that Δ leaves to its bound, so that the system built of it stays within."""


@dataclass(frozen=True, eq=False)
class WorstCaseGain:
    """Bounds of the gain, and a perturbation that reaches the lower.

    Parameters
    ----------
    upper : float
        The gain is no larger for any Δ(s) of the size allowed; infinite if some may be unstable.
    lower : float
        The H∞ norm of the loop closed with `delta`; infinite if that is unstable.
    frequency_rad_s : float
        Where Δ(s) was chosen.
    delta : LtiSystem
        Δ(s), stable and of the size allowed, or a matrix if all blocks are real.
    values : dict of str to float
        Of its real blocks, by their name, or their number without one.
    certified : CertifiedPeak
        What proves the upper bound.
    """

    upper: float
    lower: float
    frequency_rad_s: float
    delta: LtiSystem
    values: dict[str, float]
    certified: CertifiedPeak


def performance_structure(system: LtiSystem, uncertainty: BlockStructure) -> BlockStructure:
    """Return the blocks of Δ with a full one for the outputs and inputs that are left.

    Raises
    ------
    InputError
        If none are left.
    """
    outputs = system.shape[0] - uncertainty.shape[0]
    inputs = system.shape[1] - uncertainty.shape[1]
    if outputs < 1 or inputs < 1:
        raise InputError(
            f"the uncertainty takes {uncertainty.shape[0]} outputs and {uncertainty.shape[1]} "
            f"inputs of {system.shape[0]} and {system.shape[1]}: none is left for performance"
        )
    return BlockStructure([*uncertainty.blocks, full(inputs, outputs, "performance")])


def worst_case_gain(
    system: LtiSystem,
    uncertainty: BlockStructure,
    *,
    size: float = 1.0,
    gap: float = 0.01,
    seed: int = 0,
) -> WorstCaseGain:
    """Return bounds of the largest gain under perturbations of a given size.

    Parameters
    ----------
    system : LtiSystem
        M, stable; its first outputs and inputs belong to Δ, the others are performance.
    uncertainty : BlockStructure
        Of Δ.
    size : float
        Largest singular value that Δ may have.
    gap : float
        As of `certified_peak`.
    seed : int
        Of random starts of the lower bound.

    Raises
    ------
    InputError
        If the system is not stable or does not fit, the size is not positive, or no outputs and
        inputs are left for performance.
    """
    if not (np.isfinite(size) and size > 0.0):
        raise InputError(f"the size of Δ must be positive, got {size}")
    structure = performance_structure(system, uncertainty)
    p = uncertainty.shape[0]
    grown = np.ones(system.shape[0])
    grown[:p] = size
    scaled = LtiSystem(
        system.a, system.b, grown[:, None] * system.c, grown[:, None] * system.d, system.dt_s
    )
    skewed = [len(uncertainty.blocks)]
    proof = certified_peak(scaled, structure, skewed=skewed, gap=gap)
    image = in_continuous_time(scaled, structure)
    omega = to_image(proof.frequency_rad_s, system.dt_s)
    if not 0.0 < omega < np.inf:
        omega = beside_poles(image, omega)
    delta, omega = _raised(image, structure, uncertainty, omega, proof, seed)
    delta = (1.0 - _INSIDE) * size * delta
    block = interpolated(delta, uncertainty, omega)
    if system.dt_s is not None:
        block = discrete(block, system.dt_s)
    reached = hinf_norm(upper_lft(system, block)).value
    return WorstCaseGain(
        proof.upper, reached, from_image(omega, system.dt_s), block,
        uncertainty.real_values(delta), proof,
    )  # fmt: skip


def _raised(
    system: LtiSystem,
    structure: BlockStructure,
    uncertainty: BlockStructure,
    omega: float,
    proof: CertifiedPeak,
    seed: int,
) -> tuple[Complex, float]:
    """Return a Δ of unit size of the largest gain found, and the frequency."""
    at = moving_response(system, structure, omega)
    unit = UnitPerturbation(uncertainty)
    random = np.random.default_rng(seed)
    n = uncertainty.size

    def cost(x: Array) -> tuple[float, Array]:
        m, slope = at(float(x[-1]))
        q = unit.q(x[:-1])
        inner = np.eye(n) - m[:n, :n] @ q
        try:
            right = np.linalg.solve(inner, m[:n, n:])
        except np.linalg.LinAlgError:
            return -700.0, np.zeros(x.size)
        left = np.linalg.solve(inner.T, (m[n:, :n] @ q).T).T  # M₂₁ Q (I − M₁₁ Q)⁻¹
        t = m[n:, n:] + m[n:, :n] @ q @ right
        u, s, vh = np.linalg.svd(t)
        if not s[0] > 0.0:
            return 700.0, np.zeros(x.size)
        v, uh = vh[0].conj(), u[:, 0].conj()
        row = uh @ (m[n:, :n] + left @ m[:n, :n])
        made = unit.derivative(x[:-1], row, right @ v)
        # T changes with M by [M₂₁ side, I] dM [Q right; I]
        outer, into = np.concatenate([uh @ left, uh]), np.concatenate([q @ right @ v, v])
        gradient = np.append(made, outer @ slope @ into).real / s[0]
        return -float(np.log(s[0])), -gradient

    starts = []
    if np.isfinite(proof.upper):
        weight = np.ones(structure.size)
        weight[n:] = 1.0 / proof.upper
        whole = BlockStructure([b.squared() for b in structure.blocks])
        found = lower_bound(weight[:, None] * at(0.0)[0], whole, seed=seed)
        if found.value > 0.0:
            starts.append(unit.parameters(found.delta[:n, :n] * found.value))
    else:
        inner = BlockStructure([b.squared() for b in uncertainty.blocks])
        found = lower_bound(at(0.0)[0][:n, :n], inner, seed=seed)
        if found.value > 0.0:
            starts.append(unit.parameters(found.delta * found.value))
    for _ in range(_STARTS):
        x = random.normal(size=len(unit.bounds)) * np.pi
        real = [b[0] is not None for b in unit.bounds]
        x[real] = random.uniform(-1.0, 1.0, sum(real))
        starts.append(x)
    best = min(
        (
            minimize(
                cost, np.append(x, 0.0), jac=True, method="L-BFGS-B",
                bounds=[*unit.bounds, (-FARTHEST, FARTHEST)], options={"maxiter": _MOST},
            )
            for x in starts
        ),
        key=lambda found: float(found.fun),
    )  # fmt: skip
    delta = uncertainty.unsquared(unit.q(best.x[:-1]))
    return delta, float(omega * np.exp(best.x[-1]))
