r"""µ synthesis by alternation of scalings and H∞ synthesis.

It is D–K iteration [1]_, for real blocks D,G–K iteration [2]_.

A controller is sought that keeps µ of its closed loop below β at all frequencies, hence stability,
or performance, for all Δ smaller than 1/β. From the best one known:

1. D-step: µ's upper bound at a set of frequencies; rational D, for real blocks D and G, of rising
   order, that prove nearly the same bounds. Where the norm of the scaled loop shows that they miss
   the bound between the frequencies, that frequency joins the set.
2. K-step: H∞ synthesis for the plant with the scalings in it.
3. Where that gains little, scalings and controller are moved together (`joint`).

Each controller has to pass one test: the certified supremum of µ over all frequencies must be lower
than that of the best one known. One that does not is dropped, and richer scalings are tried.

References
----------
.. [1] J. C. Doyle (1985), Structured uncertainty in control system design, Proc. 24th IEEE
   Conference on Decision and Control, 260-265.
.. [2] P. M. Young (1996), Controller design with real parametric uncertainty, International Journal
   of Control 65(3), 469-509.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from hillsphere.errors import InputError, Interrupted
from hillsphere.lti import LtiSystem
from hillsphere_controllers.dk.checkpoint import CheckpointFile
from hillsphere_controllers.dk.reduction import reduced_controller
from hillsphere_controllers.dk.results import DkDesign, DkIteration
from hillsphere_controllers.dk.search import KStep, Search
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.robustness import robust_stability
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.bilinear import continuous, discrete

__all__ = ["KStep", "dk_synthesis"]


def dk_synthesis(
    plant: LtiSystem,
    controls: int,
    measurements: int,
    structure: BlockStructure,
    *,
    controller: LtiSystem | None = None,
    iterations: int = 10,
    highest_order: int = 4,
    joint_steps: int = 6,
    target: float = 0.0,
    gap: float = 2e-3,
    back_off: float = 0.002,
    regularisation: float = 0.0,
    reduction: float = 0.01,
    k_step: KStep | None = None,
    progress: Callable[[DkIteration], None] | None = None,
    checkpoint: Path | None = None,
) -> DkDesign:
    """Return a controller that makes the certified peak of µ small.

    Parameters
    ----------
    plant : LtiSystem
        Its first outputs and inputs belong to Δ, performance included, the last ones are the
        measurements and controls. In discrete time its bilinear image is used.
    controls, measurements : int
        Numbers of u and y.
    structure : BlockStructure
        Of Δ, with a full block for performance.
    controller : LtiSystem, optional
        To begin with; constant scalings and H∞ synthesis give one, if left out.
    iterations : int
        At most so many steps after the first.
    highest_order : int
        Of one block's D, and of its G.
    joint_steps : int
        Quasi-Newton steps of each joint move of scalings and controller; zero for none. Each costs
        as many searches of γ as the scalings have parameters, each of a few Riccati equations,
        or as many calls of `k_step`.
    target : float
        It ends once µ is certified to be below.
    gap : float
        As of `certified_peak`.
    back_off : float
        As of `hinf_synthesis`.
    regularisation : float
        As of `hinf_synthesis`, in each K-step; µ is certified of the plant as it is.
    reduction : float
        By how much the bound of the reduced controller may be higher, relatively; zero: no reduced
        controller is looked for.
    k_step : callable, optional
        Another synthesis, such as a structured one, for the K-step.
    progress : callable, optional
        Called after each step, and for each that the checkpoint holds. An exception that it raises
        ends the synthesis; if that is KeyboardInterrupt, as from the keyboard, or
        `hillsphere.errors.Interrupted`, the best until then is returned.
    checkpoint : Path, optional
        File that holds the state after each step. If it is there, the synthesis goes on from it,
        to the same result as if it had never been interrupted.

    Returns
    -------
    DkDesign
        The best controller, and the steps.

    Raises
    ------
    InputError
        If numbers do not fit, or the checkpoint is damaged or of another synthesis.
    StageError
        If the checkpoint cannot be written.
    NotStabilisableError, SingularProblemError, SynthesisFailedError
        If there is no first controller, as of `hinf_synthesis`.
    """
    p, m = structure.shape
    if plant.shape != (p + measurements, m + controls) or min(controls, measurements) < 1:
        raise InputError(
            f"blocks of {p} outputs and {m} inputs, {measurements} measurements and {controls} "
            f"controls do not make a plant of {plant.shape[0]} × {plant.shape[1]}"
        )
    if controller is not None and controller.shape != (controls, measurements):
        raise InputError(
            f"the first controller must be {controls} × {measurements}, got "
            f"{controller.shape[0]} × {controller.shape[1]}"
        )
    if iterations < 0 or highest_order < 0 or joint_steps < 0:
        raise InputError("iterations, highest_order and joint_steps must be ≥ 0")
    image = plant if plant.dt_s is None else continuous(plant)
    options = (
        controls,
        measurements,
        iterations,
        highest_order,
        joint_steps,
        target,
        back_off,
        gap,
        regularisation,
    )
    given = (image,) if controller is None else (image, controller)
    kept = None if checkpoint is None else CheckpointFile(checkpoint, given, structure, options)
    search = Search(
        image, structure, (controls, measurements), k_step, back_off, gap, progress,
        None if kept is None else kept.keep, "" if kept is None else kept.key, regularisation,
    )  # fmt: skip
    reason, interrupted = "interrupted", False
    try:
        if controller is not None and plant.dt_s is not None:
            controller = continuous(controller)
        if kept is not None and (state := kept.load()) is not None:
            search.restore(state)
        else:
            search.begin(controller)
        reason = search.run(iterations, highest_order, joint_steps, target)
    except (KeyboardInterrupt, Interrupted):
        if search.best is None:
            raise
        interrupted = True
    best = search.best
    assert best is not None
    made = best.controller if plant.dt_s is None else discrete(best.controller, plant.dt_s)
    made = replace(made, inputs=plant.outputs[p:], outputs=plant.inputs[m:], states=())
    loop = lower_lft(plant, made)
    robustness = robust_stability(loop, structure, gap=gap, complex_shares=())
    reduced = None
    if reduction > 0.0 and not interrupted:
        limit = robustness.upper * (1.0 + reduction)
        reduced = reduced_controller(plant, made, structure, limit, gap=gap)
    return DkDesign(
        made, loop, robustness, best.multipliers, tuple(search.steps), reduced, reason, interrupted
    )
