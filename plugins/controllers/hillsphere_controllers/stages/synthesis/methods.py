"""Methods of the stage ``synthesis`` without a search, and parts that all methods share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError, Interrupted
from hillsphere.interfaces import Context
from hillsphere.lti import LtiSystem
from hillsphere.products.product_codec import save_product
from hillsphere_controllers.full_order.h2 import h2_synthesis
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.stages.linear_models.systems import build_parts, connect_systems
from hillsphere_controllers.stages.signals import find_signals
from hillsphere_controllers.stages.synthesis.products import Iterations, SearchResult
from hillsphere_controllers.stages.synthesis.specs import (
    ChannelSpec,
    HinfSpec,
    LmiSpec,
    RegionSpec,
    SynthesisSpec,
)
from hillsphere_controllers.structured.requirements import Channel, PoleRegion

__all__ = ["Design", "channels_of", "design_controller", "interrupt_synthesis", "region_of"]


@dataclass(frozen=True)
class Design:
    """Result of a method: controller, minimised value, its lower bound, and details."""

    controller: LtiSystem
    gamma: float | None
    lower_bound: float
    search: SearchResult | None = None
    iterations: Iterations | None = None
    others: tuple[LtiSystem, ...] = ()
    added: str = ""
    """Weights and noise that were added for the synthesis alone, in words."""


def design_controller(
    spec: SynthesisSpec,
    plants: Sequence[LtiSystem],
    labels: Sequence[str],
    controls: int,
    measurements: int,
) -> Design:
    """Return the controller of generalised plants by the method asked for.

    Raises
    ------
    HillsphereError
        Errors of the method.
    """
    if spec.method == "given":
        assert spec.given is not None
        controller = connect_systems(spec.given, build_parts(spec.given, {}, plants[0].dt_s))
        if controller.shape != (controls, measurements):
            raise InputError(
                f"given: the controller takes {controller.shape[1]} measurements and gives "
                f"{controller.shape[0]} controls, the models have {measurements} and {controls}"
            )
        return Design(controller, None, 0.0)
    if spec.method == "lmi":
        return _synthesise_by_lmi(spec.lmi or LmiSpec(), plants[0], controls, measurements)
    if spec.method == "h2":
        square = h2_synthesis(plants[0], controls, measurements)
        return Design(square.controller, square.norm, square.least, added=str(square.added or ""))
    options = spec.mixed_sensitivity or spec.hinf or HinfSpec()
    full = hinf_synthesis(
        plants[0], controls, measurements, tolerance=options.tolerance, back_off=options.back_off,
        regularisation=options.regularisation,
    )  # fmt: skip
    return Design(full.controller, full.gamma, full.least, added=str(full.added or ""))


def _synthesise_by_lmi(spec: LmiSpec, plant: LtiSystem, controls: int, measurements: int) -> Design:
    # cvxpy, which it needs, takes seconds to import
    from hillsphere_controllers.lmi.output_feedback import output_feedback

    channels = channels_of("lmi", spec.channels, plant, controls, measurements)
    design = output_feedback(plant, controls, measurements, channels, region_of(spec.region))
    minimised = [one.norm for one in design.channels if one.channel.limit is None]
    # with limits alone nothing is minimised: γ is then the H∞ norm of the whole
    return Design(design.controller, max(minimised) if minimised else None, 0.0)


def interrupt_synthesis(controller: LtiSystem, what: str, ctx: Context) -> Interrupted:
    """Store the best controller so far, and return the interruption of the synthesis."""
    path = ctx.workspace() / "best-controller.npz"
    save_product(path, controller)
    kept = (
        f"the best controller so far has {what} and is stored in {path}; "
        "a resumed run goes on from it"
    )
    ctx.info(f"interrupted: {kept}")
    return Interrupted("interrupted during a synthesis", kept=kept)


def channels_of(
    table: str, specs: Sequence[ChannelSpec], plant: LtiSystem, controls: int, measurements: int
) -> tuple[Channel, ...]:
    """Return the channels of a table, by the names of the plant's signals; one of all without."""
    p, m = plant.shape
    outputs, inputs = plant.outputs[: p - measurements], plant.inputs[: m - controls]
    made = []
    for k, one in enumerate(specs):
        key = f"{table}.channels[{k}]"
        made.append(
            Channel(
                tuple(find_signals(outputs, one.outputs, key)) if one.outputs else None,
                tuple(find_signals(inputs, one.inputs, key)) if one.inputs else None,
                one.norm, one.weight, one.limit,
            )
        )  # fmt: skip
    return tuple(made) or (Channel(),)


def region_of(spec: RegionSpec | None) -> PoleRegion | None:
    """Return the pole region of a table."""
    if spec is None:
        return None
    fastest = np.inf if spec.fastest_rad_s is None else spec.fastest_rad_s
    return PoleRegion(spec.decay_1_s, spec.damping, fastest)
