"""The methods of the stage ``synthesis``, each from plants to a controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError, Interrupted
from hillsphere.interfaces import Context
from hillsphere.lti import LtiSystem
from hillsphere.product_codec import save_product
from hillsphere_controllers.full_order.h2 import h2_synthesis
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.stages.linear_models.systems import connected_of, parts_of
from hillsphere_controllers.stages.signals import places
from hillsphere_controllers.stages.synthesis.products import Iterations, SearchResult
from hillsphere_controllers.stages.synthesis.specs import (
    ChannelSpec,
    HinfSpec,
    LmiSpec,
    PartSpec,
    RegionSpec,
    StructuredSpec,
    SynthesisSpec,
)
from hillsphere_controllers.structured.requirements import Channel, DesignPlant, PoleRegion
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import Diagonal, Structure, masked, of_order
from hillsphere_controllers.structured.synthesis import Progress, synthesise

__all__ = ["Designed", "designed", "stopped"]


@dataclass(frozen=True)
class Designed:
    """A controller, what was made small, a bound of it, and what the method says."""

    controller: LtiSystem
    gamma: float | None
    lower_bound: float
    search: SearchResult | None = None
    iterations: Iterations | None = None


def designed(
    spec: SynthesisSpec,
    plants: Sequence[LtiSystem],
    labels: Sequence[str],
    controls: int,
    measurements: int,
    ctx: Context,
) -> Designed:
    """Return the controller of generalised plants by the method asked for.

    Raises
    ------
    HillsphereError
        What the method raises.
    Interrupted
        If the run was stopped; the workspace has the best controller until then.
    """
    if spec.method == "given":
        assert spec.given is not None
        controller = connected_of(spec.given, parts_of(spec.given, {}, plants[0].dt_s))
        if controller.shape != (controls, measurements):
            raise InputError(
                f"given: the controller takes {controller.shape[1]} measurements and gives "
                f"{controller.shape[0]} controls, the models have {measurements} and {controls}"
            )
        return Designed(controller, None, 0.0)
    if spec.method == "structured":
        assert spec.structured is not None
        return _structured(spec.structured, plants, labels, controls, measurements, ctx)
    if spec.method == "lmi":
        return _by_inequalities(spec.lmi or LmiSpec(), plants[0], controls, measurements)
    if spec.method == "h2":
        square = h2_synthesis(plants[0], controls, measurements)
        return Designed(square.controller, square.norm, square.norm)
    options = spec.mixed_sensitivity or spec.hinf or HinfSpec()
    full = hinf_synthesis(
        plants[0], controls, measurements, tolerance=options.tolerance, back_off=options.back_off,
        regularisation=options.regularisation,
    )  # fmt: skip
    # with a regularisation the bound is that of another problem
    return Designed(full.controller, full.gamma, 0.0 if options.regularisation else full.least)


def _by_inequalities(spec: LmiSpec, plant: LtiSystem, controls: int, measurements: int) -> Designed:
    # cvxpy, which it needs, takes seconds to import
    from hillsphere_controllers.lmi.output_feedback import output_feedback

    channels = _channels("lmi", spec.channels, plant, controls, measurements)
    found = output_feedback(plant, controls, measurements, channels, _region(spec.region))
    minimised = [one.norm for one in found.channels if one.channel.limit is None]
    # with limits alone nothing is minimised: γ is then the H∞ norm of the whole
    return Designed(found.controller, max(minimised) if minimised else None, 0.0)


def _structured(
    spec: StructuredSpec,
    plants: Sequence[LtiSystem],
    labels: Sequence[str],
    controls: int,
    measurements: int,
    ctx: Context,
) -> Designed:
    structure = _structure(spec.parts, controls, measurements)
    if (structure.controls, structure.measurements) != (controls, measurements):
        raise InputError(
            f"structured.parts: they have {structure.controls} controls and "
            f"{structure.measurements} measurements, the models {controls} and {measurements}"
        )
    weights = spec.plant_weights or (1.0,) * len(plants)
    if len(weights) != len(plants):
        raise InputError(
            f"structured.plant_weights: {len(weights)} for {len(plants)} plants; give one each"
        )
    many = [
        DesignPlant(
            plant,
            _channels("structured", spec.channels, plant, controls, measurements),
            weight,
            label,
        )
        for plant, weight, label in zip(plants, weights, labels, strict=True)
    ]
    said = [""]
    advance = ctx.track("searches", None, lambda: said[0])
    found = synthesise(
        many, structure, starts=spec.starts, seed=int(ctx.rng("starts").integers(1 << 31)),
        region=_region(spec.region), largest_gain=spec.largest_gain,
        progress=_telling(said, advance, ctx.info), ctx=ctx,
    )  # fmt: skip
    if found.interrupted:
        done = int(found.starts.size + found.shaken.size)
        raise stopped(found.controller, f"γ = {found.gamma:.6g} ({done} searches)", ctx)
    result = SearchResult(
        found.theta, found.starts, found.shaken, found.residual, len(found.active),
        found.converged, found.evaluations,
    )  # fmt: skip
    return Designed(found.controller, found.gamma, found.lower_bound, result)


def stopped(controller: LtiSystem, what: str, ctx: Context) -> Interrupted:
    """Return the interruption of a synthesis; its best controller so far goes to a file."""
    path = ctx.workspace() / "best-controller.npz"
    save_product(path, controller)
    kept = f"the best controller so far has {what} and is in {path}, and resuming goes on from it"
    ctx.info(f"interrupted: {kept}")
    return Interrupted("interrupted during a synthesis", kept=kept)


def _telling(
    said: list[str], advance: Callable[[int], None], log: Callable[[str], None]
) -> Callable[[Progress], None]:
    """Return what keeps the bar's note and the log up to date."""

    def tell(progress: Progress) -> None:
        done, total, latest = progress.done, progress.total, progress.latest
        best = f"best γ = {progress.gamma:.6g}"
        if latest is None:
            said[0] = f"search {done + 1} of {total} at γ = {progress.current:.6g}, {best}"
            advance(0)  # ends it if the run was asked to stop
            return
        said[0] = f"{done} of {total}, {best}"
        log(
            f"search {done} of {total}, from start {latest.start.number}: "
            f"γ = {progress.current:.6g}, {best}"
        )
        advance(1)

    return tell


def _structure(parts: Sequence[PartSpec], controls: int, measurements: int) -> Structure:
    if len(parts) == 1:
        return _part(parts[0], controls, measurements)
    return Diagonal([_part(part, 1, 1) for part in parts])


def _part(part: PartSpec, controls: int, measurements: int) -> Structure:
    if part.kind == "pid":
        return Pid(integral=part.integral, derivative=part.derivative)
    if part.kind == "transfer_function":
        return TransferFunction(part.order, part.relative_degree)
    if part.kind == "entries":
        rows = [[np.nan if entry == "free" else entry for entry in row] for row in part.entries]
        return masked(np.array(rows, dtype=float), part.order)
    return of_order(
        part.order, part.controls or controls, part.measurements or measurements,
        strictly_proper=part.strictly_proper,
    )  # fmt: skip


def _channels(
    table: str, specs: Sequence[ChannelSpec], plant: LtiSystem, controls: int, measurements: int
) -> tuple[Channel, ...]:
    p, m = plant.shape
    outputs, inputs = plant.outputs[: p - measurements], plant.inputs[: m - controls]
    made = []
    for k, one in enumerate(specs):
        key = f"{table}.channels[{k}]"
        made.append(
            Channel(
                tuple(places(outputs, one.outputs, key)) if one.outputs else None,
                tuple(places(inputs, one.inputs, key)) if one.inputs else None,
                one.norm, one.weight, one.limit,
            )
        )  # fmt: skip
    return tuple(made) or (Channel(),)


def _region(spec: RegionSpec | None) -> PoleRegion | None:
    if spec is None:
        return None
    fastest = np.inf if spec.fastest_rad_s is None else spec.fastest_rad_s
    return PoleRegion(spec.decay_1_s, spec.damping, fastest)
