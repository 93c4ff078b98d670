r"""Worst-case gain: the largest gain of a loop under perturbations of bounded size.

With a full block between the performance outputs and inputs that closes the loop, the gain of
F_u(M, Δ) is below γ for all Δ with σ̄(Δ) ≤ 1 if the skewed µ of M, whose performance block alone has
the level γ, is [1]_. From below, the gain is raised in the parameters of Δ and in frequency.

References
----------
.. [1] G. Ferreres (1999), A Practical Approach to Robustness Analysis with Aeronautical
   Applications, Kluwer, chapter 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.bilinear_images import (
    continuous_image,
    discrete_frequency,
    finite_frequency,
    image_frequency,
)
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.certified import CertifiedPeak, certified_peak
from hillsphere_controllers.mu.gain_ascent import GainAscent
from hillsphere_controllers.mu.gain_division import divide_gain
from hillsphere_controllers.mu.lower_bound import lower_bound, moving_response
from hillsphere_controllers.mu.robustness import performance_structure, robust_stability
from hillsphere_controllers.mu.scalings import Scalings
from hillsphere_controllers.mu.worst_case import interpolate_perturbation
from hillsphere_controllers.systems.algebra import upper_lft
from hillsphere_controllers.systems.bilinear import discrete

__all__ = ["WorstCaseGain", "worst_case_gain"]

Complex = NDArray[np.complex128]

_STARTS = 6
"""Random starts of the ascent besides those from bounds of µ. More find higher local maxima of the
gain, in proportion to the time."""
_INSIDE = 1e-9
"""Relative room that Δ leaves to its bound, so that the system built of it stays within."""
_LOOSE = 1.05
"""Ratio of upper to lower bound above which ranges are divided: below it, the certified bound is as
good as what a design is known to, and parts would only take time."""
_GROWN = (1.0 + 1e-6, 1.001, 1.03, 1.3, 3.0, 1e3)
"""A Δ of a very large gain is near the border of stability: with real blocks so much larger, as far
as they may be, it is looked for beyond."""


@dataclass(frozen=True, eq=False)
class WorstCaseGain:
    """Bounds of the gain, and a perturbation that reaches the lower.

    Parameters
    ----------
    upper : float
        The gain is no larger for any Δ(s) of the size allowed; infinite if some may make the loop
        unstable.
    lower : float
        The H∞ norm of the loop closed with `delta`; infinite if that is unstable or, but for
        rounding, has a pole on the border of stability.
    frequency_rad_s : float
        Where Δ(s) was chosen.
    delta : LtiSystem
        Δ(s), stable and of the size allowed, or a matrix if all blocks are real.
    values : dict of str to float
        Of its real blocks, by their name, or their number without one; normalised:
        `hillsphere_controllers.linear_fractional.uncertainties.physical_values` has them in their
        units.
    certified : CertifiedPeak
        What proves the upper bound, or a larger one where the ranges were divided.
    parts : int
        Parts of the ranges of real parameters on each of which the upper bound is certified by
        itself; zero if they were not divided.
    """

    upper: float
    lower: float
    frequency_rad_s: float
    delta: LtiSystem
    values: dict[str, float]
    certified: CertifiedPeak
    parts: int = 0


def worst_case_gain(
    system: LtiSystem,
    uncertainty: BlockStructure,
    *,
    size: float = 1.0,
    gap: float = 0.01,
    seed: int = 0,
    divide: bool = True,
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
    divide : bool
        Whether ranges of real parameters are divided where the upper bound is more than 5 % above
        the lower one: at most 24 parts are bounded, each of which takes as long as the whole.

    Returns
    -------
    WorstCaseGain
        Lower and upper bound of the gain, and the perturbation that reaches the lower one.

    Raises
    ------
    InputError
        If the system is not stable or does not fit, the size is not positive, or no outputs and
        inputs are left for performance.

    Notes
    -----
    For modes of a damping below 1e-4 the upper bound may be far above the lower one (589 times for
    1e-6): the lower bound is then the nearer one.
    """
    if not (np.isfinite(size) and size > 0.0):
        raise InputError(f"the size of Δ must be positive, got {size}")
    structure = performance_structure(system, uncertainty)
    p = uncertainty.shape[0]
    # a Δ of the given size becomes one of unit size: its factor goes into M
    grown = np.ones(system.shape[0])
    grown[:p] = size
    scaled = LtiSystem(
        system.a, system.b, grown[:, None] * system.c, grown[:, None] * system.d, system.dt_s
    )
    units = _performance_units(scaled, uncertainty)
    # the levels of performance and of Δ then have the same size, which the skewed problem needs
    measured = _rescale_performance(scaled, uncertainty, *units)
    skewed = [len(uncertainty.blocks)]
    proof = certified_peak(measured, structure, skewed=skewed, gap=gap)
    image = continuous_image(measured, structure)
    omega = image_frequency(proof.frequency_rad_s, system.dt_s)
    if not 0.0 < omega < np.inf:
        # at zero and infinity a system has real values only: complex blocks are interpolated nearby
        omega = finite_frequency(image, omega)
    certified = _restore_units(proof, structure, *units)
    if np.isinf(proof.upper):
        broken = _infinite_gain(system, scaled, uncertainty, size, certified, gap, seed)
        if broken is not None:
            return broken
    delta, omega = _ascend(image, structure, uncertainty, omega, proof, seed)

    def closed(unit: Complex, factor: float) -> tuple[float, Complex, LtiSystem]:
        made = (1.0 - _INSIDE) * size * _enlarge_real_blocks(unit, uncertainty, factor)
        block = interpolate_perturbation(made, uncertainty, omega)
        if system.dt_s is not None:
            block = discrete(block, system.dt_s)
        return hinf_norm(upper_lft(system, block)).value, made, block

    best = closed(delta, 1.0)
    # the proof failed: a slightly larger Δ may make the loop unstable, which proves an infinite
    # gain
    for factor in _GROWN if np.isinf(proof.upper) else ():
        if np.isinf(best[0]):
            break
        best = max(best, closed(delta, factor), key=lambda made: made[0])
    upper, parts, level = certified.upper, 0, units[0] * units[1]
    near = max(_LOOSE, 1.0 + 2.0 * gap)
    real = any(block.kind == "real" for block in uncertainty.blocks)
    if divide and real and upper > near * best[0]:
        divided = divide_gain(
            measured, uncertainty, structure, proof.upper, near * best[0] / level, gap=gap
        )
        upper, parts = min(upper, level * divided.upper), divided.parts
        if level * divided.lower > best[0]:
            # the middle of a part is worse than what the ascent has found
            centre = _real_delta(uncertainty, divided.values)
            best = max(best, closed(centre, 1.0), key=lambda made: made[0])
    reached, delta, block = best
    return WorstCaseGain(
        upper, reached, discrete_frequency(omega, system.dt_s), block,
        uncertainty.real_values(delta), certified, parts,
    )  # fmt: skip


def _real_delta(uncertainty: BlockStructure, values: Array) -> Complex:
    """Return a Δ with these values (k,) of its real blocks and zero elsewhere."""
    p, m = uncertainty.shape
    made = np.zeros((m, p), dtype=complex)
    for block, value, (rows, columns) in zip(
        uncertainty.blocks, values, uncertainty.parts(), strict=True
    ):
        if block.kind == "real":
            made[rows, columns] = value * np.eye(block.rows)
    return made


def _performance_units(system: LtiSystem, uncertainty: BlockStructure) -> tuple[float, float]:
    """Return units of the performance inputs and outputs in which their gains are one at most.

    Powers of two; the gains are those without Δ and from and to it.
    """
    p, m = uncertainty.shape
    first, left = (slice(0, p), slice(0, m)), (slice(p, None), slice(m, None))

    def norm(rows: slice, columns: slice) -> float:
        part = LtiSystem(
            system.a, system.b[:, columns], system.c[rows], system.d[rows, columns], system.dt_s
        )
        return hinf_norm(part).value

    into, out, through = norm(first[0], left[1]), norm(left[0], first[1]), norm(left[0], left[1])
    if not np.isfinite([into, out, through]).all():
        return 1.0, 1.0
    # gain of performance, directly or by way of Δ
    whole = max(through, into * out)
    if not whole > 0.0:
        return 1.0, 1.0
    share = into / out if into > 0.0 and out > 0.0 else 1.0
    inputs = float(2.0 ** np.round(0.5 * np.log2(whole * share)))
    return inputs, float(2.0 ** np.round(np.log2(whole / inputs)))


def _rescale_performance(
    system: LtiSystem, uncertainty: BlockStructure, inputs: float, outputs: float
) -> LtiSystem:
    """Return the system with performance inputs and outputs in other units."""
    (p, m), (rows, columns) = uncertainty.shape, system.shape
    into, out = np.ones(columns), np.ones((rows, 1))
    into[m:], out[p:] = inputs, outputs
    return LtiSystem(system.a, system.b / into, system.c / out, system.d / out / into, system.dt_s)


def _restore_units(
    proof: CertifiedPeak, structure: BlockStructure, inputs: float, outputs: float
) -> CertifiedPeak:
    """Return the proof for the performance inputs and outputs in the units given."""
    level = inputs * outputs
    unit = np.where(structure.indices([len(structure.blocks) - 1]), outputs, 1.0)

    def scalings(one: Scalings) -> Scalings:  # of the performance G is zero
        return Scalings(one.d / unit[:, None] / unit, one.g)

    intervals = (
        replace(one, bound=level * one.bound, scalings=scalings(one.scalings))
        for one in proof.intervals
    )
    return replace(
        proof, upper=level * proof.upper, peak=level * proof.peak, bounds=level * proof.bounds,
        scalings=scalings(proof.scalings), intervals=tuple(intervals),
    )  # fmt: skip


def _infinite_gain(
    system: LtiSystem,
    scaled: LtiSystem,
    uncertainty: BlockStructure,
    size: float,
    proof: CertifiedPeak,
    gap: float,
    seed: int,
) -> WorstCaseGain | None:
    """Return the infinite gain with a Δ that makes the loop unstable, None if none is known."""
    try:
        robustness = robust_stability(scaled, uncertainty, gap=gap, complex_shares=(), seed=seed)
    except ConvergenceError:  # its Δ did not stand the check
        return None
    if robustness.worst is None or robustness.lower < 1.0:
        return None
    # beyond the border if there is room, else on it
    most = max((1.0 - _INSIDE) * robustness.lower, 1.0)
    for factor in (*(1.0 + (most - 1.0) * np.array([1e-3, 0.1, 1.0])), 1.0):
        made = robustness.worst.system
        grown = float(factor) * size
        block = LtiSystem(made.a, made.b, grown * made.c, grown * made.d, made.dt_s)
        if factor == 1.0 or not upper_lft(system, block).is_stable:
            break
    values = uncertainty.real_values(grown * robustness.worst.delta)
    return WorstCaseGain(np.inf, np.inf, robustness.frequency_rad_s, block, values, proof)


def _enlarge_real_blocks(delta: Complex, uncertainty: BlockStructure, factor: float) -> Complex:
    """Return a Δ of unit size with larger real blocks."""
    made = delta.copy()
    for block, part in zip(uncertainty.blocks, uncertainty.parts(), strict=True):
        if block.kind == "real":
            made[part] = np.clip(factor * made[part].real, -1.0, 1.0)
    return made


def _ascend(
    system: LtiSystem,
    structure: BlockStructure,
    uncertainty: BlockStructure,
    omega: float,
    proof: CertifiedPeak,
    seed: int,
) -> tuple[Complex, float]:
    """Return a Δ of unit size of the largest gain found, and the frequency."""
    at = moving_response(system, structure, omega)
    ascent = GainAscent(at, uncertainty)
    unit = ascent.unit
    random = np.random.default_rng(seed)
    n = uncertainty.size
    starts = []
    if 0.0 < proof.upper < np.inf:
        weight = np.ones(structure.size)
        # starts from a lower bound of µ whose performance block has the level found
        weight[n:] = 1.0 / proof.upper
        whole = BlockStructure([b.enclosing_square() for b in structure.blocks])
        bound = lower_bound(weight[:, None] * at(0.0)[0], whole, seed=seed)
        if bound.value > 0.0:
            starts.append(unit.parameters(bound.delta[:n, :n] * bound.value))
    elif proof.upper > 0.0:
        inner = BlockStructure([b.enclosing_square() for b in uncertainty.blocks])
        bound = lower_bound(at(0.0)[0][:n, :n], inner, seed=seed)
        if bound.value > 0.0:
            starts.append(unit.parameters(bound.delta * bound.value))
    starts += [ascent.random(random) for _ in range(_STARTS)]
    best = ascent.best(starts)
    return uncertainty.remove_padding(best.q), float(omega * np.exp(best.z))
