"""Analysis and synthesis by the structured singular value, and disk margins, by usual names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.disk_margins import (
    DiskMargin,
    disk_margin,
    disk_margin_of_both_ends,
)
from hillsphere_controllers.dk.synthesis import dk_synthesis
from hillsphere_controllers.linear_fractional.reduction import minimal
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import physical_values
from hillsphere_controllers.mu.blocks import (
    Block,
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.mu.lower_bound import lower_bound
from hillsphere_controllers.mu.performance_margin import performance_margin
from hillsphere_controllers.mu.robustness import robust_stability
from hillsphere_controllers.mu.upper_bound import upper_bounds
from hillsphere_controllers.mu.worst_case_gain import worst_case_gain
from hillsphere_controllers.systems.algebra import close_with_gain, lower_lft
from hillsphere_controllers.systems.conversion import as_lti
from hillsphere_controllers.toolbox.results import Readable

__all__ = [
    "DiskMargins", "GainBounds", "MuBounds", "MuSynthesis", "RobustMargin", "diskmargin", "mussv",
    "musyn", "robgain", "robstab", "wcgain",
]  # fmt: skip

_EXCESS = 1.1
"""Multiple of the gap asked for up to which bounds are as near as was asked: the certificate is the
gap above the largest bound found, and the search from the other side ends a little before that."""

Blocks = BlockStructure | Sequence[Sequence[int]] | NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False, repr=False)
class MuBounds(Readable):
    """Bounds of µ of matrices.

    Parameters
    ----------
    upper, lower : ndarray, shape (K,)
        µ lies between them; (1,) for one matrix.
    omega_rad_s : ndarray, shape (K,)
        Frequencies of a system's responses; NaN for matrices.
    """

    upper: Array
    lower: Array
    omega_rad_s: Array


def mussv(
    M: LtiSystem | Array | NDArray[np.complex128],
    blk: Blocks,
    omega_rad_s: Array | None = None,
) -> MuBounds:
    """Return bounds of µ of a matrix, of several, or of a system at some frequencies.

    Parameters
    ----------
    M : ndarray, shape (p, m) or (K, p, m), or a system
        Complex matrices, or a system whose responses are analysed.
    blk : array_like of int, shape (N, 2), or BlockStructure
        MATLAB's rows: [-n, 0] is δ I of n rows with δ real, [n, 0] with δ complex, [r, c] a full
        complex block of r rows and c columns; [1, 1] is a complex number.
    omega_rad_s : ndarray, shape (K,), optional
        Frequencies of a system. `robstab` needs none: its bound holds at all of them.

    Returns
    -------
    MuBounds
        Upper and lower bounds, one of each per matrix or frequency.

    Raises
    ------
    InputError
        If the blocks do not fit M, or a system has no frequencies or a matrix has some.
    """
    structure = blk if isinstance(blk, BlockStructure) else _structure(blk)
    is_system = not isinstance(M, np.ndarray | list)
    if is_system != (omega_rad_s is not None):
        raise InputError(
            "frequencies omega_rad_s belong to a system, and a system needs them; robstab bounds µ "
            "at all frequencies"
        )
    omega = np.atleast_1d(np.nan if omega_rad_s is None else np.asarray(omega_rad_s, dtype=float))
    matrices = as_lti(M).response(omega) if is_system else np.asarray(M)
    if matrices.ndim == 2:
        matrices = matrices[None]
    upper = upper_bounds(matrices, structure)
    lower = [
        lower_bound(m, structure, scalings=u.scalings).value
        for m, u in zip(matrices, upper, strict=True)
    ]
    if not is_system:
        omega = np.full(len(matrices), np.nan)
    return MuBounds(np.array([u.value for u in upper]), np.array(lower), omega)


def _structure(rows: Sequence[Sequence[int]] | NDArray[np.integer[Any]]) -> BlockStructure:
    table = np.asarray(rows)
    if table.ndim != 2 or table.shape[1] != 2 or table.dtype.kind not in "iu":
        raise InputError(f"blocks are rows of two whole numbers, [[-1, 0], [2, 2]], got {rows!r}")
    blocks: list[Block] = []
    for r, c in table.tolist():
        if c == 0 and r != 0:
            blocks.append(repeated_real(-r) if r < 0 else repeated_complex(r))
        elif r == -1 and c == 1:
            blocks.append(repeated_real())
        else:
            blocks.append(full(r, c))
    return BlockStructure(blocks)


@dataclass(frozen=True, eq=False, repr=False)
class RobustMargin(Readable):
    """How large the uncertainty may be, relative to what the system says.

    Parameters
    ----------
    lower_bound : float
        Certified at all frequencies: all uncertainties smaller than this are tolerated.
    upper_bound : float
        One of this size is not.
    critical_frequency_rad_s : float
        Where it acts.
    worst : dict of str to float
        Values of the real parameters of that one, in their units.
    without_value : tuple of str
        Names of the complex and dynamic uncertainties: that one has values of them too, which are
        matrices at the frequency and are not listed.
    undecided_gap : float
        What is left between the bounds: `upper_bound` over `lower_bound`, less one, if that is more
        than the `gap` asked for and a tenth of it; else zero. Infinite if nothing was found that is
        not tolerated.
    """

    lower_bound: float
    upper_bound: float
    critical_frequency_rad_s: float
    worst: dict[str, float]
    without_value: tuple[str, ...] = ()
    undecided_gap: float = 0.0


def robstab(usys: Lft, *, gap: float = 0.01) -> RobustMargin:
    """Return the robust stability margin of an uncertain system.

    Parameters
    ----------
    usys : Lft
        The uncertain closed loop.
    gap : float
        Relative distance between the certified bound of µ and the largest found at a frequency.

    Returns
    -------
    RobustMargin
        Above one: stable for all uncertainties. Zero if the nominal system is not stable.

    Raises
    ------
    InputError
        If nothing is uncertain.
    """
    if not _require_lft(usys).nominal.is_stable and usys.system.order:
        return RobustMargin(0.0, 0.0, np.nan, {}, _without_value(usys))
    least = _remove_copies(usys)
    made = robust_stability(least.system, least.structure, gap=gap)
    values = made.worst.values if made.worst is not None else {}
    return RobustMargin(
        *made.margin, made.frequency_rad_s, _worst_values(usys, values), _without_value(usys),
        _remaining_gap(*made.margin, gap),
    )  # fmt: skip


def robgain(usys: Lft, gamma: float, *, gap: float = 0.01) -> RobustMargin:
    """Return how large the uncertainty may be until the gain reaches a level.

    Parameters
    ----------
    usys : Lft
        The uncertain closed loop.
    gamma : float
        The level.
    gap : float
        As of `robstab`.

    Returns
    -------
    RobustMargin
        Above one: the gain is below γ for all uncertainties. Zero if the nominal gain is not.

    Raises
    ------
    InputError
        If nothing is uncertain, or the level is not positive.
    """
    if not _require_lft(usys).nominal.is_stable and usys.system.order:
        return RobustMargin(0.0, 0.0, np.nan, {}, _without_value(usys))
    least = _remove_copies(usys)
    made = performance_margin(least.system, least.structure, gamma, gap=gap)
    return RobustMargin(
        made.lower, made.upper, made.frequency_rad_s, _worst_values(usys, made.values),
        _without_value(usys), _remaining_gap(made.lower, made.upper, gap),
    )  # fmt: skip


def _remove_copies(usys: Lft) -> Lft:
    """Return the system without copies that have no effect, for which scalings have no optimum.

    Two copies of a parameter that take the same signal make every scaling better than the last, so
    that intervals of frequency become short without end. The matrices stay the same to about 2e-9,
    see `minimal`.
    """
    if all(times == 1 for times in usys.times):
        return usys
    least = minimal(usys)
    return least if least.uncertainties else usys


def _worst_values(usys: Lft, values: dict[str, float]) -> dict[str, float]:
    """Return worst values in units; those of parameters without any effect are nominal."""
    real = [one.name for one in usys.uncertainties if one.kind == "real"]
    known = {name: values.get(name, 0.0) for name in real} if values else {}
    return physical_values(usys.uncertainties, known)


def _remaining_gap(lower: float, upper: float, gap: float) -> float:
    """Return how far two bounds are apart, relatively; zero if that is about the gap asked for."""
    if upper <= lower * (1.0 + _EXCESS * gap):
        return 0.0
    return upper / lower - 1.0 if lower > 0.0 else np.inf


def _without_value(usys: Lft) -> tuple[str, ...]:
    """Return the names of the uncertainties that are no real parameters."""
    return tuple(one.name for one in usys.uncertainties if one.kind != "real")


@dataclass(frozen=True, eq=False, repr=False)
class GainBounds(Readable):
    """Bounds of the worst-case gain.

    Parameters
    ----------
    lower_bound : float
        The H∞ norm of the loop with the worst uncertainty found.
    upper_bound : float
        Certified at all frequencies; infinite if stability is not.
    critical_frequency_rad_s : float
        Where that uncertainty acts.
    worst : dict of str to float
        Values of its real parameters, in their units.
    without_value : tuple of str
        Names of the complex and dynamic uncertainties, whose values are not listed.
    undecided_gap : float
        As of `RobustMargin`, of the bounds of the gain.
    """

    lower_bound: float
    upper_bound: float
    critical_frequency_rad_s: float
    worst: dict[str, float]
    without_value: tuple[str, ...] = ()
    undecided_gap: float = 0.0


def wcgain(usys: Lft, *, size: float = 1.0, gap: float = 0.01) -> GainBounds:
    """Return bounds of the largest gain over all uncertainties.

    Parameters
    ----------
    usys : Lft
        The uncertain closed loop, nominally stable.
    size : float
        Size of the uncertainty relative to what the system says: MATLAB's option 'ULevel'.
    gap : float
        As of `robstab`.

    Returns
    -------
    GainBounds
        Lower and upper bound, and the perturbation that reaches the lower one.

    Raises
    ------
    InputError
        If nothing is uncertain, the nominal system is not stable or the size not positive.
    """
    least = _remove_copies(_require_lft(usys))
    made = worst_case_gain(least.system, least.structure, size=size, gap=gap)
    return GainBounds(
        made.lower, made.upper, made.frequency_rad_s, _worst_values(usys, made.values),
        _without_value(usys), _remaining_gap(made.lower, made.upper, gap),
    )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class MuSynthesis(Readable):
    """A controller of µ synthesis.

    Parameters
    ----------
    K : LtiSystem
        u = K y.
    CL : Lft
        The uncertain closed loop.
    mu : float
        Certified bound of µ for robust performance: below one, the gain of the closed loop is
        below one for all uncertainties.
    lower_bound : float
        µ is no smaller with this controller.
    steps : tuple of float
        Certified bounds of µ of the steps of D-K iteration; infinite where one failed.
    """

    K: LtiSystem
    CL: Lft
    mu: float
    lower_bound: float
    steps: tuple[float, ...]


def musyn(
    P: Lft,
    nmeas: int,
    ncont: int,
    *,
    iterations: int = 10,
    highest_order: int = 4,
    joint_steps: int = 6,
) -> MuSynthesis:
    """Return a controller that makes µ for robust performance small, by D-K iteration.

    Parameters
    ----------
    P : Lft
        Uncertain generalised plant; its last inputs are the controls, its last outputs the
        measurements.
    nmeas, ncont : int
        Numbers of measurements and controls.
    iterations, highest_order, joint_steps : int
        As of `hillsphere_controllers.dk.synthesis.dk_synthesis`.

    Returns
    -------
    MuSynthesis
        The controller and the bounds of µ that it reaches.

    Raises
    ------
    InputError, NotStabilisableError, SingularProblemError, SynthesisFailedError
        As `dk_synthesis`.
    """
    p, m = _require_lft(P).shape
    if not (0 < nmeas < p and 0 < ncont < m):
        raise InputError(
            f"{nmeas} measurements and {ncont} controls leave no performance of a plant of "
            f"{p} outputs and {m} inputs"
        )
    blocks = [*P.blocks, full(m - ncont, p - nmeas, "performance")]
    design = dk_synthesis(
        P.system, ncont, nmeas, BlockStructure(blocks), iterations=iterations,
        highest_order=highest_order, joint_steps=joint_steps, reduction=0.0,
    )  # fmt: skip
    loop = Lft(lower_lft(P.system, design.controller), P.uncertainties, P.times)
    return MuSynthesis(
        design.controller, loop, design.robustness.upper, design.robustness.lower,
        tuple(step.upper for step in design.iterations),
    )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class DiskMargins(Readable):
    """Disk margins of a loop.

    Parameters
    ----------
    disk_margin : float
        α: the size of the disk of factors on all channels at once; 0 if the loop is not stable.
    gain_margin : tuple of float
        Smallest and largest real factor of the disk.
    phase_margin_deg : float
        Largest change of phase in the disk, both ways.
    frequency_rad_s : float
        Where the smallest factor outside acts.
    loops : tuple of float
        α of each channel by itself, the others closed; empty for margins at both ends.
    """

    disk_margin: float
    gain_margin: tuple[float, float]
    phase_margin_deg: float
    frequency_rad_s: float
    loops: tuple[float, ...]


def diskmargin(L: LtiSystem, C: LtiSystem | None = None, *, skew: float = 0.0) -> DiskMargins:
    """Return the disk margins of a loop closed by negative feedback.

    Parameters
    ----------
    L : LtiSystem or system of python-control
        The loop, or the plant if a controller is given.
    C : LtiSystem or system of python-control, optional
        Controller, u = C (r − y): factors then act at the controls and the measurements at once.
    skew : float
        σ, MATLAB's and python-control's skew: 0 treats rise and fall of the gain alike.

    Returns
    -------
    DiskMargins
        The margins and the frequencies where they are reached.

    Raises
    ------
    InputError, ConvergenceError
        As `hillsphere_controllers.analysis.disk_margins.disk_margin`.
    """
    loop = as_lti(L, "the loop L")
    single: tuple[float, ...] = ()
    if C is not None:
        made = disk_margin_of_both_ends(loop, as_lti(C, "the controller C"), skew)
    else:
        made = disk_margin(loop, skew)
        channels = range(loop.shape[0])
        single = tuple(_channel(loop, k, skew).alpha if made.alpha > 0.0 else 0.0 for k in channels)
    return DiskMargins(
        made.alpha, (made.gain_lower, made.gain_upper), float(np.degrees(made.phase_rad)),
        made.frequency_rad_s, single,
    )  # fmt: skip


def _channel(loop: LtiSystem, channel: int, skew: float) -> DiskMargin:
    """Return the disk margin of one channel, the others closed."""
    others = -np.eye(loop.shape[0])
    others[channel, channel] = 0.0
    return disk_margin(close_with_gain(loop, others)[channel, channel], skew)


def _require_lft(usys: Lft) -> Lft:
    if not isinstance(usys, Lft) or not usys.uncertainties:
        raise InputError("an uncertain system is needed; ureal, ultidyn and ucover make such")
    return usys
