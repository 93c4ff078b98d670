"""Robust stability and robust performance of a loop in M-Δ form, by bounds of µ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.bilinear_images import (
    continuous_image,
    discrete_frequency,
    finite_frequency,
    image_frequency,
)
from hillsphere_controllers.mu.blocks import Block, BlockStructure, full, repeated_complex
from hillsphere_controllers.mu.certified import CertifiedPeak, certified_peak
from hillsphere_controllers.mu.gain_bound import bound_by_gain
from hillsphere_controllers.mu.lower_bound import (
    LowerBound,
    lower_bound,
    lower_bound_near,
    lower_bound_of_block,
)
from hillsphere_controllers.mu.restrictions import improve_by_restrictions
from hillsphere_controllers.mu.upper_bound import upper_bounds
from hillsphere_controllers.mu.worst_case import WorstCase, worst_case

__all__ = [
    "Complexified", "Robustness", "complexify", "mu_bounds_on_grid", "performance_structure",
    "robust_performance", "robust_stability",
]  # fmt: skip

Complex = NDArray[np.complex128]

_PEAKS = 4
"""Frequencies of the largest upper bounds at which a lower bound is searched. The highest peak of µ
can lie at another frequency than that of its upper bound, where the two differ."""
_COARSE = 0.05
"""Gap of the bounds of a restriction, which only say where its lower bound is to be searched."""
_SEARCHED = (0.05,)
"""Complex share with which the places of purely real restrictions are found."""


@dataclass(frozen=True)
class Complexified:
    """Bounds of µ when each real scalar may have a small complex part.

    Parameters
    ----------
    share : float
        Size of that part relative to the real one's.
    upper, lower : float
        Bounds over all frequencies.
    """

    share: float
    upper: float
    lower: float


@dataclass(frozen=True, eq=False)
class Robustness:
    """Bounds of the largest µ over all frequencies.

    Parameters
    ----------
    upper : float
        Certified: the loop is stable, or keeps its performance, for all Δ smaller than its inverse.
    lower : float
        For some Δ of that inverse it does not.
    frequency_rad_s : float
        Where the lower bound is.
    certified : CertifiedPeak
        What proves the upper bound.
    worst : WorstCase or None
        What proves the lower bound; None if that is zero.
    complexified : tuple of Complexified
        For purely real Δ, whose µ may jump with the data: what it becomes when their values are
        not quite real.
    """

    upper: float
    lower: float
    frequency_rad_s: float
    certified: CertifiedPeak
    worst: WorstCase | None
    complexified: tuple[Complexified, ...] = ()

    @property
    def undecided_gap(self) -> float:
        """Of the certificate, see `CertifiedPeak.undecided_gap`."""
        return self.certified.undecided_gap

    @property
    def margin(self) -> tuple[float, float]:
        """Size of Δ that is surely allowed, and size of one that is not."""
        sure, broken = (1.0 / b if b > 0.0 else np.inf for b in (self.upper, self.lower))
        return sure, broken


def performance_structure(system: LtiSystem, uncertainty: BlockStructure) -> BlockStructure:
    """Return the blocks of Δ with a full one for the outputs and inputs that are left.

    Parameters
    ----------
    system : LtiSystem
        M; its first outputs and inputs belong to Δ.
    uncertainty : BlockStructure
        Blocks of Δ.

    Returns
    -------
    BlockStructure
        The blocks of Δ and the full block.

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


def robust_stability(
    system: LtiSystem,
    uncertainty: BlockStructure,
    *,
    gap: float = 0.01,
    complex_shares: Sequence[float] = (0.01, 0.05),
    seed: int = 0,
) -> Robustness:
    """Return bounds of µ for robust stability: below one, every Δ up to size one is tolerated.

    Parameters
    ----------
    system : LtiSystem
        M, stable; its first outputs and inputs belong to Δ, others are not looked at.
    uncertainty : BlockStructure
        Of Δ.
    gap : float
        As of `certified_peak`.
    complex_shares : sequence of float
        Complex parts with which purely real Δ are analysed besides.
    seed : int
        Of the lower bound's random starts.

    Returns
    -------
    Robustness
        Bounds that hold at all frequencies, and the worst Δ that was found.

    Raises
    ------
    InputError
        If the system is not stable or does not fit the structure.
    ConvergenceError
        If the upper bound needs too many intervals of frequency, or a Δ(s) built of the lower
        bound's Δ does not make I − M Δ singular.
    """
    p, m = uncertainty.shape
    if system.shape[0] < p or system.shape[1] < m:
        raise InputError(
            f"these blocks need {p} outputs and {m} inputs, got {system.shape[0]} and "
            f"{system.shape[1]}"
        )
    own = LtiSystem(system.a, system.b[:, :m], system.c[:p], system.d[:p, :m], system.dt_s)
    certified, low, beside = _bounds(own, uncertainty, gap, complex_shares, seed)

    def search(part: LtiSystem, structure: BlockStructure) -> LowerBound:
        return _bounds(part, structure, max(gap, _COARSE), _SEARCHED, seed)[1]

    low = improve_by_restrictions(own, uncertainty, low, certified.upper, gap, search)
    return _robustness(own, uncertainty, certified, low, beside)


def robust_performance(
    system: LtiSystem,
    uncertainty: BlockStructure,
    *,
    gap: float = 0.01,
    seed: int = 0,
    starts: Sequence[Mapping[str, float]] = (),
) -> Robustness:
    """Return bounds of µ for robust performance, with a full block that closes performance.

    Below one, the gain from the inputs to the outputs that Δ leaves is below one for all Δ up to
    size one.

    Parameters
    ----------
    system : LtiSystem
        M, stable; its first outputs and inputs belong to Δ, the others are performance.
    uncertainty : BlockStructure
        Of Δ.
    gap : float
        As of `certified_peak`.
    seed : int
        Of the lower bound's random starts.
    starts : sequence of mapping of str to float
        Normalised values of real blocks, by name, from which the lower bound is raised besides:
        perturbations that are known to be bad.

    Returns
    -------
    Robustness
        Bounds that hold at all frequencies, and the worst Δ that was found.

    Raises
    ------
    InputError
        If the system is not stable or does not fit, or nothing is left for performance.
    ConvergenceError
        As of `robust_stability`.
    """
    whole = performance_structure(system, uncertainty)
    certified, low, _ = _bounds(system, whole, gap, (), seed)

    def search(part: LtiSystem, structure: BlockStructure) -> LowerBound:
        at_gap = max(gap, _COARSE)
        bound, below, _ = _bounds(part, structure, at_gap, (), seed)
        return _raise_by_gain(part, structure, bound, below, seed)

    low = _raise_by_gain(system, whole, certified, low, seed, starts)
    low = improve_by_restrictions(
        system, whole, low, certified.upper, gap, search, kept=len(whole.blocks) - 1
    )
    return _robustness(system, whole, certified, low)


def mu_bounds_on_grid(
    system: LtiSystem, structure: BlockStructure, omega_rad_s: Array, *, seed: int = 0
) -> tuple[Array, Array]:
    """Return lower and upper bounds (K,) of µ at given frequencies (K,), for plots.

    Between them µ may be larger: `robust_stability` misses nothing.

    Parameters
    ----------
    system : LtiSystem
        M, stable.
    structure : BlockStructure
        Of Δ.
    omega_rad_s : ndarray, shape (K,)
        Frequencies, rad/s.
    seed : int
        Of the lower bound's random starts.

    Returns
    -------
    tuple of ndarray, shape (K,)
        Lower bounds and upper bounds.

    Raises
    ------
    InputError
        If the system does not fit the structure.
    """
    responses = system.response(omega_rad_s)
    upper = upper_bounds(responses, structure)
    lower = [
        lower_bound(m, structure, scalings=u.scalings, starts=3, seed=seed).value
        for m, u in zip(responses, upper, strict=True)
    ]
    return np.array(lower), np.array([u.value for u in upper])


def complexify(
    system: LtiSystem, structure: BlockStructure, share: float
) -> tuple[LtiSystem, BlockStructure]:
    """Return M and structure in which each real scalar δ is δ + share·δᶜ with |δᶜ| ≤ the size too.

    Parameters
    ----------
    system : LtiSystem
        M.
    structure : BlockStructure
        Of real blocks only.
    share : float
        Between 0 and 1.

    Returns
    -------
    system : LtiSystem
        With twice as many outputs and inputs.
    structure : BlockStructure
        The real blocks, then the complex ones.

    Raises
    ------
    InputError
        If not all blocks are real, the system has other outputs or inputs than theirs, or the
        share is out of range.
    """
    if not structure.purely_real:
        raise InputError("only purely real Δ are made complex")
    if system.shape != structure.shape:
        raise InputError(
            f"these blocks close {structure.shape[0]} outputs and {structure.shape[1]} inputs, the "
            f"system has {system.shape[0]} and {system.shape[1]}: leave those of performance out"
        )
    if not 0.0 < share < 1.0:
        raise InputError(f"the complex share must be between 0 and 1, got {share}")
    root = np.sqrt(share)
    # δ + share·δᶜ = [I, √share I] diag(δ, δᶜ) [I; √share I]
    into = np.vstack([np.eye(structure.size), root * np.eye(structure.size)])
    made = LtiSystem(
        system.a, system.b @ into.T, into @ system.c, into @ system.d @ into.T, system.dt_s
    )
    parts: list[Block] = [repeated_complex(b.rows, b.name) for b in structure.blocks]
    return made, BlockStructure([*structure.blocks, *parts])


def _bounds(
    system: LtiSystem,
    structure: BlockStructure,
    gap: float,
    shares: Sequence[float],
    seed: int,
) -> tuple[CertifiedPeak, LowerBound, tuple[Complexified, ...]]:
    """Return the certified bound, a lower one, and the bounds of purely real Δ made complex."""
    certified = certified_peak(system, structure, gap=gap)
    beside = []
    more: list[float] = []
    if structure.purely_real:
        # µ of purely real Δ can be discontinuous in frequency: the complex parts show how large it
        # becomes nearby
        for share in shares:
            wider, blocks = complexify(system, structure, share)
            bound = certified_peak(wider, blocks, gap=gap)
            below = _best_lower_bound(wider, blocks, bound, [], seed)
            beside.append(Complexified(share, bound.upper, below.value))
            more += [bound.frequency_rad_s, below.frequency_rad_s]
    low = _best_lower_bound(system, structure, certified, more, seed)
    return certified, low, tuple(beside)


def _raise_by_gain(
    system: LtiSystem,
    structure: BlockStructure,
    certified: CertifiedPeak,
    low: LowerBound,
    seed: int,
    starts: Sequence[Mapping[str, float]] = (),
) -> LowerBound:
    """Return the lower bound of robust performance, raised by the gain under bounded Δ."""
    image = continuous_image(system, structure)
    order = np.argsort(-certified.bounds)[:_PEAKS]
    places = [*certified.looked_at_rad_s[order].tolist(), low.frequency_rad_s]
    places = [image_frequency(w, system.dt_s) for w in places if not np.isnan(w)]
    known = None
    if low.value > 0.0:
        known = replace(low, frequency_rad_s=image_frequency(low.frequency_rad_s, system.dt_s))
    more = bound_by_gain(
        image, structure, [0.0, *places, np.inf], known, certified.upper, starts=starts, seed=seed
    )
    if more is None:
        return low
    return replace(more, frequency_rad_s=discrete_frequency(more.frequency_rad_s, system.dt_s))


def _robustness(
    system: LtiSystem,
    structure: BlockStructure,
    certified: CertifiedPeak,
    low: LowerBound,
    beside: tuple[Complexified, ...] = (),
) -> Robustness:
    """Return both bounds, with the perturbation of the lower one as a system."""
    if low.value == 0.0:
        return Robustness(certified.upper, 0.0, certified.frequency_rad_s, certified, None, beside)
    worst = worst_case(system, structure, low.delta, low.frequency_rad_s)
    return Robustness(certified.upper, low.value, low.frequency_rad_s, certified, worst, beside)


def _best_lower_bound(
    system: LtiSystem,
    structure: BlockStructure,
    certified: CertifiedPeak,
    more: Sequence[float],
    seed: int,
) -> LowerBound:
    """Return the best lower bound near the largest upper ones, with its frequency.

    It is no smaller than the H∞ norm of what any full block closes by itself: with one for
    performance, no smaller than nominal performance.
    """
    image = continuous_image(system, structure)
    order = np.argsort(-certified.bounds)[:_PEAKS]
    tried = [*certified.looked_at_rad_s[order].tolist(), *more]
    tried = [w for w in dict.fromkeys(tried) if not np.isnan(w)]
    best: LowerBound | None = None
    for k, given in enumerate(tried):
        omega = image_frequency(given, system.dt_s)
        scalings = certified.scalings if k == 0 else None
        places = [omega]
        if not 0.0 < omega < np.inf:
            # there a system has real values only, which complex blocks come near nearby
            places.append(finite_frequency(image, omega))
        for place in places:
            bound = lower_bound_near(image, structure, place, scalings=scalings, seed=seed)
            if not 0.0 < place < np.inf and not _is_real(bound):
                continue
            at = place if np.isnan(bound.frequency_rad_s) else bound.frequency_rad_s
            at = discrete_frequency(at, system.dt_s)
            if best is None or bound.value > best.value:
                best = LowerBound(bound.value, bound.delta, bound.singular, at)
    for k, (rows, columns) in enumerate(structure.parts()):
        if structure.blocks[k].kind != "full":
            continue
        # a full block alone: µ is no smaller than the H∞ norm of the part of M that it closes
        closed = LtiSystem(image.a, image.b[:, rows], image.c[columns], image.d[columns, rows])
        peak = hinf_norm(closed)
        if peak.value <= (0.0 if best is None else best.value) or not np.isfinite(peak.value):
            continue
        alone = lower_bound_of_block(image, structure, k, peak.frequency_rad_s)
        if alone is not None and (best is None or alone.value > best.value):
            best = replace(
                alone, frequency_rad_s=discrete_frequency(alone.frequency_rad_s, system.dt_s)
            )
    if best is None:
        p, m = structure.shape
        return LowerBound(0.0, np.zeros((m, p), dtype=complex), 1.0)
    return best


def _is_real(bound: LowerBound) -> bool:
    return float(np.abs(bound.delta.imag).max()) <= 1e-10 * float(np.abs(bound.delta).max())
