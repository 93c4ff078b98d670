"""Synthesis of a fixed structure for the stage ``synthesis``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_products import UncertainModel, UncertainModels
from hillsphere_controllers.stages.synthesis.methods import (
    Design,
    channels_of,
    interrupt_synthesis,
    region_of,
)
from hillsphere_controllers.stages.synthesis.plants import restrict_channels
from hillsphere_controllers.stages.synthesis.products import (
    RobustResult,
    SearchResult,
    Synthesis,
)
from hillsphere_controllers.stages.synthesis.specs import PartSpec, StructuredSpec, SynthesisSpec
from hillsphere_controllers.stages.uncertain import remove_cover
from hillsphere_controllers.structured.requirements import DesignPlant
from hillsphere_controllers.structured.sampled_plants import synthesise_sampled
from hillsphere_controllers.structured.scenarios import (
    RobustDesign,
    UncertainPlant,
    synthesise_robust,
    worst_case,
)
from hillsphere_controllers.structured.search_runs import Progress
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import (
    Diagonal,
    Structure,
    controller_of,
    free_state_space,
    mask_gains,
)
from hillsphere_controllers.structured.synthesis import StructuredDesign, synthesise
from hillsphere_controllers.structured.verification import verify_controller
from hillsphere_controllers.systems.bilinear import discrete

__all__ = ["synthesise_fixed_structure"]

_OWN_STARTS, _OWN_SCATTER = 2, 0.1
"""Searches for one plant by itself, and their relative scatter around the joint controller. They
begin at a stabilising controller, so that two nearby starts suffice to show what the joint design
costs."""
_SAME = 1e-9
"""Relative difference of the entries up to which a stored controller is the one that its parameters
give, after saving and loading."""


def synthesise_fixed_structure(
    spec: SynthesisSpec,
    plants: Sequence[LtiSystem],
    labels: Sequence[str],
    controls: int,
    measurements: int,
    ctx: Context,
    uncertain: UncertainModels | None,
    wider: UncertainModels | None,
    start: Synthesis | None = None,
) -> Design:
    """Return a controller of a fixed structure, for plants or for uncertain ones.

    Raises
    ------
    InputError
        If sizes or names do not fit, or an uncertainty is not a real parameter.
    HillsphereError
        Errors of the synthesis.
    Interrupted
        If the run was stopped; the workspace has the best controller until then.
    """
    options = spec.structured
    assert options is not None
    structure = _structure(options, controls, measurements)
    if (structure.controls, structure.measurements) != (controls, measurements):
        raise InputError(
            f"structured.parts: they have {structure.controls} controls and "
            f"{structure.measurements} measurements, the models {controls} and {measurements}"
        )
    seed = int(ctx.rng("starts").integers(1 << 31))
    prefer = None
    if wider is not None:
        prefer = _make_worst_gamma(
            [_uncertain_plant(spec, wider, j) for j in range(len(wider.models))]
        )
    names = labels if uncertain is None else uncertain.labels
    weights = options.plant_weights or (1.0,) * len(names)
    if len(weights) != len(names):
        raise InputError(
            f"structured.plant_weights: {len(weights)} for {len(names)} plants; give one each"
        )
    said = [""]
    advance = ctx.track("searches", None, lambda: said[0])
    telling = _make_callback(said, advance, ctx.info)
    region = region_of(options.region)
    begun = _start_parameters(start, structure, plants[0].dt_s)
    scatter = options.scatter if begun else 0.0
    result: RobustResult | None = None
    if uncertain is None:
        alone = [
            DesignPlant(
                plant,
                channels_of("structured", options.channels, plant, controls, measurements),
                weight,
                label,
            )
            for plant, weight, label in zip(plants, weights, labels, strict=True)
        ]
        if any(plant.dt_s is not None for plant in plants):
            _check_sampled(spec)
            design = synthesise_sampled(
                alone, structure, starts=options.starts, seed=seed, effort=options.effort,
                initial=begun, scatter=scatter, target=options.target, region=region,
                largest_gain=options.largest_gain, controller_stable=options.controller_stable,
                bandwidth_rad_s=options.bandwidth_rad_s, shaken=options.shaken, progress=telling,
                ctx=ctx,
            )  # fmt: skip
        else:
            design = synthesise(
                alone, structure, starts=options.starts, seed=seed, effort=options.effort,
                initial=begun, scatter=scatter, target=options.target, region=region,
                largest_gain=options.largest_gain, controller_stable=options.controller_stable,
                bandwidth_rad_s=options.bandwidth_rad_s, shaken=options.shaken, prefer=prefer,
                tie=options.tie, progress=telling, ctx=ctx,
            )  # fmt: skip
    else:
        many = [
            replace(_uncertain_plant(spec, uncertain, j), weight=weight)
            for j, weight in enumerate(weights)
        ]
        robust = synthesise_robust(
            many, structure, rounds=options.rounds, starts=options.starts, seed=seed,
            effort=options.effort, initial=begun, scatter=scatter, target=options.target,
            region=region, largest_gain=options.largest_gain,
            controller_stable=options.controller_stable, bandwidth_rad_s=options.bandwidth_rad_s,
            shaken=options.shaken, prefer=prefer, tie=options.tie, told=ctx.info,
            progress=telling, ctx=ctx,
        )  # fmt: skip
        design = replace(robust.design, starts=robust.starts, ends=robust.ends)
        result = _robust(robust, uncertain)
        alone = [plant.at(np.zeros(len(plant.repeats))) for plant in many]
    if design.interrupted:
        done = int(design.starts.size + design.shaken.size)
        raise interrupt_synthesis(
            design.controller, f"γ = {design.gamma:.6g} ({done} searches)", ctx
        )
    own = joint = np.zeros(0)
    if options.per_plant:
        joint = np.array([verify_controller([plant], design.controller).gamma for plant in alone])
        own = np.array(
            [_gamma_for_one_plant(plant, j, structure, options, design, seed, telling, ctx)
             for j, plant in enumerate(alone)]
        )  # fmt: skip
    search = SearchResult(
        design.theta, design.starts, design.shaken, design.residual, len(design.active),
        design.converged, design.evaluations, own, joint, scatter, bool(begun),
        options.target, design.equals, result, design.verdict,
    )  # fmt: skip
    others = tuple(
        _controller(structure, design.ends[k], plants[0].dt_s)
        for k in np.argsort(design.starts, kind="stable").tolist()
        if np.isfinite(design.starts[k]) and not np.array_equal(design.ends[k], design.theta)
    )
    return Design(design.controller, design.gamma, design.lower_bound, search, others=others)


def _controller(structure: Structure, theta: Array, period_s: float | None) -> LtiSystem:
    """Return the controller of parameters, in discrete time if there is a period."""
    made = controller_of(structure, theta)
    return made if period_s is None else discrete(made, period_s)


def _start_parameters(
    start: Synthesis | None, structure: Structure, period_s: float | None
) -> list[Array]:
    """Return the parameters at which the first search begins, none without a start."""
    if start is None:
        return []
    if start.search is not None and start.search.theta.shape == (structure.size,):
        theta = start.search.theta
        made = _controller(structure, theta, period_s)
        pairs = [(getattr(made, m), getattr(start.controller, m)) for m in "abcd"]
        if made.dt_s == start.controller.dt_s and all(
            one.shape == other.shape and np.allclose(one, other, rtol=_SAME, atol=0.0)
            for one, other in pairs
        ):
            return [theta]
    raise InputError(
        f"needs.start: its controller, of order {start.controller.order}, is not one of this "
        f"structure with its {structure.size} parameters; begin at a synthesis by the method "
        "'structured' with the same parts, and of the same period"
    )


def _check_sampled(spec: SynthesisSpec) -> None:
    """Raise `InputError` for options that exist in continuous time only."""
    options = spec.structured
    assert options is not None
    for key, given in (
        ("structured.per_plant", options.per_plant),
        ("needs.wider", spec.needs.wider is not None),
    ):
        if given:
            raise InputError(f"{key}: it is for models in continuous time; leave it out")


def _gamma_for_one_plant(
    plant: DesignPlant,
    number: int,
    structure: Structure,
    options: StructuredSpec,
    design: StructuredDesign,
    seed: int,
    telling: Callable[[Progress], None],
    ctx: Context,
) -> float:
    """Return the γ that the structure reaches for one plant by itself."""
    return synthesise(
        plant, structure, starts=_OWN_STARTS, seed=seed, initial=[design.theta],
        scatter=_OWN_SCATTER, region=region_of(options.region), largest_gain=options.largest_gain,
        controller_stable=options.controller_stable, bandwidth_rad_s=options.bandwidth_rad_s,
        shaken=False, name=f"-own-{number}", progress=telling, ctx=ctx,
    ).gamma  # fmt: skip


def _make_worst_gamma(plants: Sequence[UncertainPlant]) -> Callable[[LtiSystem], float]:
    def worst(controller: LtiSystem) -> float:
        return max(worst_case(plant, controller)[0].gamma for plant in plants)

    return worst


def _uncertain_plant(spec: SynthesisSpec, many: UncertainModels, j: int) -> UncertainPlant:
    """Return an uncertain model as a plant of the search, with the chosen channels only."""
    # a search finds values of parameters; what it designs is certified with the cover afterwards
    model, label = remove_cover(many.models[j]), many.labels[j]
    options = spec.structured
    assert options is not None
    for name, kind in zip(model.names, model.kinds, strict=True):
        if kind != "real":
            raise InputError(
                f"the uncertainty {name!r} of {label!r} is {kind}: scenarios are values of real "
                "parameters; leave it out of the uncertain models for 'structured', or use 'dk'"
            )
    system, times = model.system, tuple(int(t) for t in model.times)
    if not times:
        raise InputError(f"the uncertain model {label!r} has no uncertainty")
    n, sizes = sum(times), (many.controls, many.measurements)
    kept = restrict_channels(system, spec.outputs, spec.inputs, *sizes, uncertain=n)
    inner = replace(
        kept, b=kept.b[:, n:], c=kept.c[n:], d=kept.d[n:, n:], inputs=kept.inputs[n:],
        outputs=kept.outputs[n:],
    )  # fmt: skip
    channels = channels_of("structured", options.channels, inner, *sizes)
    return UncertainPlant(replace(kept, inputs=(), outputs=()), times, channels, name=label)


def _robust(design: RobustDesign, models: UncertainModels) -> RobustResult:
    places = [*design.scenarios, design.worst]
    bare = [remove_cover(model) for model in models.models]
    return RobustResult(
        labels=models.labels,
        worst=design.each,
        plants=np.array([s.plant for s in places], dtype=np.int64),
        gammas=np.array([s.gamma for s in places]),
        values=tuple(_physical(bare[s.plant], s.delta) for s in places),
        names=tuple(bare[s.plant].names for s in places),
        rounds=design.rounds,
        converged=design.converged,
    )


def _physical(model: UncertainModel, delta: Array) -> Array:
    """Return values (k,) of parameters in their units: Δ is −1, 0, 1 at their bounds and middle."""
    up, down = model.upper - model.nominal, model.nominal - model.lower
    return np.asarray(model.nominal + np.where(delta > 0.0, up, down) * delta)


def _make_callback(
    said: list[str], advance: Callable[[int], None], log: Callable[[str], None]
) -> Callable[[Progress], None]:
    """Return the callback that updates the progress bar and the log."""

    def tell(progress: Progress) -> None:
        done, total, latest = progress.done, progress.total, progress.latest
        best = f"best γ = {progress.gamma:.6g}"
        if latest is None:
            at = progress.current
            now = f"at γ = {at:.6g}" if at < np.inf else "at a neighbouring structure"
            said[0] = f"search {done + 1} of {total} {now}, {best}"
            advance(0)  # ends it if the run was asked to stop
            return
        said[0] = f"{done} of {total}, {best}"
        log(
            f"search {done} of {total}, from start {latest.start.number}: "
            f"γ = {progress.current:.6g}, {best}"
        )
        advance(1)

    return tell


def _structure(spec: StructuredSpec, controls: int, measurements: int) -> Structure:
    if len(spec.parts) == 1:
        return _part(spec.parts[0], controls, measurements)
    return Diagonal([_part(part, 1, 1) for part in spec.parts], alike=spec.alike)


def _part(part: PartSpec, controls: int, measurements: int) -> Structure:
    if part.kind == "pid":
        return Pid(integral=part.integral, derivative=part.derivative)
    if part.kind == "transfer_function":
        return TransferFunction(part.order, part.relative_degree)
    if part.kind == "entries":
        rows = [[np.nan if entry == "free" else entry for entry in row] for row in part.entries]
        return mask_gains(np.array(rows, dtype=float), part.order)
    return free_state_space(
        part.order, part.controls or controls, part.measurements or measurements,
        strictly_proper=part.strictly_proper,
    )  # fmt: skip
