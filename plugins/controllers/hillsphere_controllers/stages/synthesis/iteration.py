"""µ synthesis for the stage ``synthesis``."""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Context
from hillsphere.lti import LtiSystem
from hillsphere_controllers.dk.results import DkIteration
from hillsphere_controllers.dk.synthesis import dk_synthesis
from hillsphere_controllers.linear_products import UncertainModel
from hillsphere_controllers.mu.blocks import BlockStructure, full
from hillsphere_controllers.mu.robustness import Robustness, robust_stability
from hillsphere_controllers.stages.synthesis.methods import Design, interrupt_synthesis
from hillsphere_controllers.stages.synthesis.products import Iterations
from hillsphere_controllers.stages.synthesis.specs import DkSpec
from hillsphere_controllers.stages.uncertain import to_lft
from hillsphere_controllers.systems.algebra import lower_lft

__all__ = ["synthesise_by_dk"]


def synthesise_by_dk(
    spec: DkSpec,
    model: UncertainModel,
    controls: int,
    measurements: int,
    ctx: Context,
    first: LtiSystem | None = None,
) -> Design:
    """Return the controller that D–K iteration finds for an uncertain model.

    It begins with a first controller, if there is one.

    Raises
    ------
    InputError
        If nothing is uncertain, or nothing is left for performance.
    HillsphereError
        Errors of the synthesis.
    Interrupted
        If the run was stopped; the workspace has the best controller until then.
    """
    lft = to_lft(model)
    uncertainty = lft.structure
    (p, m), system = uncertainty.shape, model.system
    outputs = system.shape[0] - p - measurements
    inputs = system.shape[1] - m - controls
    if min(outputs, inputs) < 1:
        raise InputError("the uncertain model has no outputs or inputs left for performance")
    structure = BlockStructure([*uncertainty.blocks, full(inputs, outputs, "performance")])
    best = [np.inf]
    advance = ctx.track("D-K steps", spec.iterations + 1, lambda: f"µ ≤ {best[0]:.5g}")

    def tell(step: DkIteration) -> None:
        ctx.info(
            f"{step.kind}: µ ≤ {step.upper:.6g}, controller of order {step.controller_order}, "
            f"{step.seconds:.1f} s{'' if step.accepted else f'; refused: {step.refusal}'}"
        )
        best[0] = min(best[0], step.upper)
        advance(1)

    design = dk_synthesis(
        system, controls, measurements, structure, controller=first, iterations=spec.iterations,
        highest_order=spec.highest_order, joint_steps=spec.joint_steps, target=spec.target,
        gap=spec.gap, back_off=spec.back_off, regularisation=spec.regularisation,
        reduction=spec.reduction, progress=tell,
        checkpoint=ctx.workspace() / f"state-{ctx.fingerprint[:16]}.npz",
    )  # fmt: skip
    if design.interrupted:
        count = len(design.iterations)
        raise interrupt_synthesis(
            design.controller,
            f"µ ≤ {design.robustness.upper:.6g} ({count} step{'s' if count > 1 else ''})",
            ctx,
        )
    controller, robustness = design.controller, design.robustness
    if design.reduced is not None:
        controller = design.reduced.controller
        robustness = _robustness(system, controller, structure, spec.gap)
    steps = design.iterations
    result = Iterations(
        kinds=tuple(step.kind for step in steps),
        upper=np.array([step.upper for step in steps]),
        gamma=np.array([step.gamma for step in steps]),
        peak_rad_s=np.array([step.frequency_rad_s for step in steps]),
        scaling_order=np.array([sum(step.orders) for step in steps], dtype=np.int64),
        controller_order=np.array([step.controller_order for step in steps], dtype=np.int64),
        accepted=np.array([step.accepted for step in steps], dtype=bool),
        refusals=tuple(step.refusal for step in steps),
        upper_mu=float(robustness.upper),
        lower_mu=float(robustness.lower),
        full_order=design.controller.order,
        reason=design.reason,
    )
    return Design(controller, float(robustness.upper), 0.0, iterations=result)


def _robustness(
    plant: LtiSystem, controller: LtiSystem, structure: BlockStructure, gap: float
) -> Robustness:
    loop = lower_lft(plant, controller)
    return robust_stability(loop, structure, gap=gap, complex_shares=())
