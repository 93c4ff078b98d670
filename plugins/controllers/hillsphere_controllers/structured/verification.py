"""Verification of a controller by methods independent of the search, and lower bounds of γ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm_bounds
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.analysis.stability import spectral_abscissa
from hillsphere_controllers.errors import (
    NotStabilisableError,
    SingularProblemError,
    SynthesisFailedError,
)
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.structured.requirements import Channel, DesignPlant, PoleRegion
from hillsphere_controllers.structured.structure import Structure
from hillsphere_controllers.systems.algebra import lower_lft

__all__ = [
    "FullOrder", "Verified", "full_order", "lower_bound",
    "verify_controller",
]  # fmt: skip

_LIMITS = 1e-5
"""Relative excess of a norm over its limit that counts as kept. The search keeps limits to 1e-6 of
its own evaluation, and the check uses another method."""
_REGION = 1e-4
"""Relative distance of a pole outside its region that counts as kept; poles are less accurate than
norms."""


@dataclass(frozen=True)
class Verified:
    """Norms and poles of the closed loops of all plants with one controller.

    Parameters
    ----------
    gamma : float
        Largest weighted norm of the channels without a limit.
    norms : tuple of tuple of float
        Of each plant's channels, without weights; infinite if the loop is not stable.
    limits : float
        Largest norm of a channel with a limit, relative to it; 0 if there is none.
    abscissae_1_s : tuple of float
        Largest real part of each closed loop's poles.
    closed_loops : tuple of LtiSystem
        From w to z.
    controller_abscissa_1_s : float
        Largest real part of the controller's own poles; −∞ if it has none.
    gamma_error : float
        Bound of what rounding can have changed in the H∞ norms, relative to each: γ is right but
        for this.
    doubt : str
        What is to be said against the norm of which that bound is largest; empty if all keep two
        digits at least.
    """

    gamma: float
    norms: tuple[tuple[float, ...], ...]
    limits: float
    abscissae_1_s: tuple[float, ...]
    closed_loops: tuple[LtiSystem, ...]
    controller_abscissa_1_s: float
    gamma_error: float = 0.0
    doubt: str = ""

    def wrong(self, region: PoleRegion | None) -> str:
        """Return a sentence about the first requirement that fails; empty if all are met."""
        if not max(self.abscissae_1_s) < 0.0:
            return f"a closed loop has poles with real part {max(self.abscissae_1_s):.3g} 1/s"
        if self.doubt:
            return f"the entries of a closed loop do not determine its norm: {self.doubt}"
        if self.limits > 1.0 + _LIMITS:
            return f"a norm is {self.limits:.6g} times its limit"
        if region is not None:
            worst = max(float(region.excess(loop.poles)[0].max()) for loop in self.closed_loops)
            if worst > _REGION:
                return f"a closed loop's pole is outside of the region by {worst:.3g}, relative"
        return ""


def verify_controller(plants: Sequence[DesignPlant], controller: LtiSystem) -> Verified:
    """Compute the norms and poles of the closed loops of plants as they were given.

    Parameters
    ----------
    plants : sequence of DesignPlant
        Plants and channels of the design.
    controller : LtiSystem
        The controller of all of them.

    Returns
    -------
    Verified
        Norm of each channel and abscissa of each loop, from the matrices as they were given.
    """
    loops = tuple(lower_lft(plant.system, controller) for plant in plants)
    closed = [
        [_norm(loop, channel) for channel in plant.channels]
        for loop, plant in zip(loops, plants, strict=True)
    ]
    norms = tuple(tuple(value for value, _, _ in of_plant) for of_plant in closed)
    _, error, doubt = max((one for row in closed for one in row), key=lambda one: one[1])
    gamma, limits = 0.0, 0.0
    for plant, values in zip(plants, norms, strict=True):
        for channel, value in zip(plant.channels, values, strict=True):
            if channel.limit is None:
                gamma = max(gamma, plant.weight * channel.weight * value)
            else:
                limits = max(limits, channel.weight * value / channel.limit)
    abscissae = tuple(spectral_abscissa(loop) for loop in loops)
    return Verified(
        gamma, norms, limits, abscissae, loops, spectral_abscissa(controller),
        error, doubt,
    )  # fmt: skip


@dataclass(frozen=True)
class FullOrder:
    """The controller of full order of the plant and channel that is hardest by itself.

    Parameters
    ----------
    bound : float
        No controller of any structure reaches a γ below this; 0 if nothing is proved.
    plant : LtiSystem
        The plant with no other channel.
    controller : LtiSystem
        From y to u.
    gamma : float
        The weighted norm that it reaches there.
    """

    bound: float
    plant: LtiSystem
    controller: LtiSystem
    gamma: float


def lower_bound(plants: Sequence[DesignPlant], structure: Structure) -> float:
    """Return a lower bound of γ for any structure, by synthesis of full order.

    It is that of the plant and channel that is hardest by itself; 0 if the Riccati equations apply
    to none.

    Parameters
    ----------
    plants : sequence of DesignPlant
        Plants and channels of the design.
    structure : Structure
        Of the controller, for its numbers of controls and measurements.

    Returns
    -------
    float
        The bound.

    Raises
    ------
    NotStabilisableError
        If no controller stabilises one of the plants.
    """
    design = full_order(plants, structure)
    return 0.0 if design is None else design.bound


def full_order(
    plants: Sequence[DesignPlant], structure: Structure, *, regularised: bool = False
) -> FullOrder | None:
    """Return a full-order design of the plant and channel that is hardest by itself.

    Parameters
    ----------
    plants : sequence of DesignPlant
        Plants and channels of the design.
    structure : Structure
        Of the controller, for its numbers of controls and measurements.
    regularised : bool
        Whether the synthesis may be regularised, where the Riccati equations do not apply: the
        controller is a good one of the plant as it is, and has no bound as a rule.

    Returns
    -------
    FullOrder or None
        That of the largest lower bound of γ; of the largest γ if regularised. None if the Riccati
        equations apply to no plant.

    Raises
    ------
    NotStabilisableError
        If no controller stabilises one of the plants.
    """
    return _hardest(plants, structure, None if regularised else 0.0)


def _hardest(
    plants: Sequence[DesignPlant], structure: Structure, regularisation: float | None
) -> FullOrder | None:
    nu, ny = structure.controls, structure.measurements
    best: FullOrder | None = None
    for plant in plants:
        for channel in plant.channels:
            if channel.norm != "hinf" or channel.limit is not None:
                continue
            try:
                alone = _channel_plant(plant, channel, nu, ny)
                design = hinf_synthesis(alone, nu, ny, regularisation=regularisation)
            except (SingularProblemError, SynthesisFailedError):
                continue
            except NotStabilisableError as error:
                name = f"plant {plant.name!r}" if plant.name else "the plant"
                raise NotStabilisableError(f"{name}: {error}") from error
            weight = plant.weight * channel.weight
            bound, gamma = weight * design.least, weight * design.gamma
            if best is None or (
                gamma > best.gamma if regularisation is None else bound > best.bound
            ):
                best = FullOrder(bound, alone, design.controller, gamma)
    return best


def _norm(loop: LtiSystem, channel: Channel) -> tuple[float, float, str]:
    """Return a norm, its relative rounding error, and a doubt about it in words."""
    part = _part(loop, *_places(loop, channel, 0, 0))
    if channel.norm == "h2":
        bounds = h2_norm_bounds(part)
        if not np.isfinite(bounds.upper):
            known = f"it is at least {bounds.lower:.6g}" if np.isfinite(bounds.lower) else ""
            return bounds.upper, 0.0, known
        return bounds.upper, 1.0 - bounds.lower / max(bounds.upper, 1e-300), ""
    norm = hinf_norm(part)
    return norm.value, norm.error, norm.doubt


def _channel_plant(plant: DesignPlant, channel: Channel, nu: int, ny: int) -> LtiSystem:
    system = plant.system
    rows, columns = _places(system, channel, nu, ny)
    p, m = system.shape
    return _part(system, rows + list(range(p - ny, p)), columns + list(range(m - nu, m)))


def _places(system: LtiSystem, channel: Channel, nu: int, ny: int) -> tuple[list[int], list[int]]:
    p, m = system.shape
    rows = list(range(p - ny)) if channel.outputs is None else list(channel.outputs)
    columns = list(range(m - nu)) if channel.inputs is None else list(channel.inputs)
    return rows, columns


def _part(system: LtiSystem, rows: list[int], columns: list[int]) -> LtiSystem:
    return replace(
        system, b=system.b[:, columns], c=system.c[rows], d=system.d[np.ix_(rows, columns)],
        inputs=(), outputs=(),
    )  # fmt: skip
