r"""Structured synthesis for sampled plants, by their images in continuous time.

The bilinear map keeps stability and the H∞ norm; it keeps the H2 norm too if what it yields is
weighted: with z = exp(jθ) and ω = (2/T) tan(θ/2),

.. math::

    \frac{1}{2\pi}\int_{-\pi}^{\pi} |G|^2 d\theta
    = \frac{1}{2\pi}\int_{-\infty}^{\infty}
      \left|\frac{2/\sqrt T}{j\omega + 2/T}\,G\right|^2 d\omega .

A structure of the controller in discrete time is one of its image too (`sampled_structure`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.structured.effort import Effort
from hillsphere_controllers.structured.requirements import (
    Channel,
    Complex,
    DesignPlant,
    PoleRegion,
    SampledPoleRegion,
)
from hillsphere_controllers.structured.sampled_structure import (
    image_structure,
    sampled_controller_of,
)
from hillsphere_controllers.structured.search_runs import Progress
from hillsphere_controllers.structured.structure import Structure
from hillsphere_controllers.structured.synthesis import StructuredDesign, synthesise
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.bilinear import continuous

__all__ = ["sampled_norms", "synthesise_sampled"]

_SAME = 1e-5
"""Share by which a norm of the sampled closed loop may differ from that of its image."""
_OUTSIDE = 1e-5
"""Relative distance from the region at which a pole of the sampled loop counts as within: poles are
less accurate than norms."""


def synthesise_sampled(
    plants: DesignPlant | Sequence[DesignPlant],
    structure: Structure,
    *,
    starts: int = 10,
    seed: int = 1,
    effort: Effort = "normal",
    initial: Iterable[Array] = (),
    scatter: float = 0.0,
    target: float = 0.0,
    region: PoleRegion | None = None,
    largest_gain: float | None = None,
    controller_stable: bool = False,
    bandwidth_rad_s: float | None = None,
    shaken: bool = True,
    progress: Callable[[Progress], None] | None = None,
    ctx: Context | None = None,
) -> StructuredDesign:
    """Return the best controller in discrete time found from several starts.

    Parameters
    ----------
    plants : DesignPlant or sequence of DesignPlant
        In discrete time, of one period. An H2 norm is the root of the sum of squares of the
        response to unit impulses.
    structure : Structure
        Of the controller in discrete time, see `sampled_structure.image_structure`.
    starts, seed, effort, initial, scatter, target, largest_gain, controller_stable, bandwidth_rad_s
        As for `synthesise`; the gain is that of the controller's image, and so are the parameters
        of a PID and of a controller without fixed entries.
    region : PoleRegion or None
        Where s = ln z/T is to be for the poles z of all closed loops.
    shaken, progress, ctx
        As for `synthesise`.

    Returns
    -------
    StructuredDesign
        Its controller in discrete time; `theta` and `verified` are of the images, and γ has been
        recomputed from the sampled closed loops.

    Raises
    ------
    InputError
        If periods differ, or the structure is of a kind that has no image.
    NotStabilisableError, SynthesisFailedError
        As `synthesise`; also if the sampled closed loops do not have the norms of the images.
    """
    many = (plants,) if isinstance(plants, DesignPlant) else tuple(plants)
    periods = {plant.system.dt_s for plant in many}
    if len(periods) != 1 or None in periods:
        raise InputError(
            "plants must be in discrete time and of one period, got "
            f"{', '.join('continuous' if p is None else f'{p:g} s' for p in periods) or 'none'}"
        )
    period = next(p for p in periods if p is not None)
    image = image_structure(structure, period)
    images = [_image(plant, structure) for plant in many]
    design = synthesise(
        images, image, starts=starts, seed=seed, effort=effort, initial=initial, scatter=scatter,
        target=target, region=_sampled_region(region, many, images, period),
        largest_gain=largest_gain, controller_stable=controller_stable,
        bandwidth_rad_s=bandwidth_rad_s, shaken=shaken, progress=progress, ctx=ctx,
    )  # fmt: skip
    controller = sampled_controller_of(image, design.theta, period)
    gamma = 0.0
    for plant in many:
        for channel, norm in zip(plant.channels, sampled_norms(plant, controller), strict=True):
            if channel.limit is None:
                gamma = max(gamma, plant.weight * norm)
            elif not norm <= channel.limit * (1.0 + _SAME):
                raise SynthesisFailedError(
                    f"{plant.name or 'the plant'}: a limited norm is {norm:.9g} in the sampled "
                    f"loop, above its limit {channel.limit:.9g}; scale signals and states"
                )
    if not abs(gamma - design.gamma) <= _SAME * max(gamma, design.gamma):
        raise SynthesisFailedError(
            f"γ is {gamma:.9g} in the sampled loops, {design.gamma:.9g} in their images; scale "
            "signals and states"
        )
    if region is not None:
        for plant in many:
            poles = lower_lft(plant.system, controller).poles
            off = float(_own_region(region, period).excess(_images_of(poles, period))[0].max())
            if off > _OUTSIDE:
                raise SynthesisFailedError(
                    f"{plant.name or 'the plant'}: a pole of the sampled loop is outside of the "
                    f"region by {off:.3g}, relative; scale signals and states"
                )
    return replace(design, controller=controller, gamma=gamma)


def _sampled_region(
    region: PoleRegion | None,
    plants: Sequence[DesignPlant],
    images: Sequence[DesignPlant],
    period: float,
) -> SampledPoleRegion | None:
    """Return the region of the images' poles, of which those of the filters are none."""
    if region is None:
        return None
    filters = {
        image.system.order - plant.system.order for plant, image in zip(plants, images, strict=True)
    }
    if len(filters) > 1:
        raise InputError(
            "with a region of poles the H2 norms of all sampled plants must be of as many outputs, "
            f"got {sorted(filters)}"
        )
    return replace(_own_region(region, period), filters=filters.pop())


def _own_region(region: PoleRegion, period: float) -> SampledPoleRegion:
    return SampledPoleRegion(region.decay_1_s, region.damping, region.fastest_rad_s, period)


def _images_of(poles: Complex, period: float) -> Complex:
    """Return λ = (2/T)(z − 1)/(z + 1)."""
    return np.asarray(2.0 / period * (poles - 1.0) / np.where(poles == -1.0, 1e-300, poles + 1.0))


def sampled_norms(plant: DesignPlant, controller: LtiSystem) -> list[float]:
    """Return the weighted norm of every channel of a sampled closed loop.

    Parameters
    ----------
    plant : DesignPlant
        In discrete time.
    controller : LtiSystem
        Of the same period, u = K(z) y.

    Returns
    -------
    list of float
        In the order of the channels; infinite if the loop is not stable.
    """
    loop = lower_lft(plant.system, controller)
    if loop.order and np.abs(loop.poles).max() >= 1.0:
        return [np.inf for _ in plant.channels]
    norms = []
    for channel in plant.channels:
        rows = list(range(loop.shape[0]) if channel.outputs is None else channel.outputs)
        columns = list(range(loop.shape[1]) if channel.inputs is None else channel.inputs)
        part = LtiSystem(
            loop.a, loop.b[:, columns], loop.c[rows], loop.d[np.ix_(rows, columns)], loop.dt_s
        )
        size = hinf_norm(part).upper if channel.norm == "hinf" else h2_norm(part)
        norms.append(channel.weight * float(size))
    return norms


def _image(plant: DesignPlant, structure: Structure) -> DesignPlant:
    """Return the image of a plant: filtered copies of the outputs of H2 channels stand first."""
    period = plant.system.dt_s
    assert period is not None  # checked by the caller
    image = continuous(plant.system)
    p = image.shape[0] - structure.measurements
    wanted = sorted(
        {
            row
            for channel in plant.channels
            if channel.norm == "h2"
            for row in (range(p) if channel.outputs is None else channel.outputs)
        }
    )
    n, k = image.order, len(wanted)
    a = np.zeros((n + k, n + k))
    a[:n, :n] = image.a
    # states of the filters (2/√T)/(s + 2/T), one for each output of an H2 channel
    a[n:, :n], a[n:, n:] = image.c[wanted], -2.0 / period * np.eye(k)
    b = np.concatenate([image.b, image.d[wanted]])
    c = np.zeros((k + image.shape[0], n + k))
    c[:k, n:], c[k:, :n] = 2.0 / np.sqrt(period) * np.eye(k), image.c
    d = np.concatenate([np.zeros((k, image.shape[1])), image.d])
    channels = []
    for channel in plant.channels:
        rows = range(p) if channel.outputs is None else channel.outputs
        moved = (
            tuple(wanted.index(row) for row in rows)
            if channel.norm == "h2"
            else tuple(k + row for row in rows)
        )
        channels.append(Channel(moved, channel.inputs, channel.norm, channel.weight, channel.limit))
    return replace(plant, system=LtiSystem(a, b, c, d), channels=tuple(channels))
