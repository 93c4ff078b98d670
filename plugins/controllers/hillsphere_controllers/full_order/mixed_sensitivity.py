r"""Mixed-sensitivity synthesis: shapes S, K S and T of a loop by weights.

The controller of u = K e, e = r − y, minimises

.. math::

    \left\| \begin{bmatrix} W_1 S \\ W_2 K S \\ W_3 T \end{bmatrix} \right\|_\infty,
    \quad S = (I + G K)^{-1}, \quad T = I - S.

It cancels stable poles of G, badly damped ones too, and has no solution for poles on the axis; a
disturbance at the controls, of some size, mends both: the norm is then that of the same outputs
under [r; d].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.full_order.hinf import HinfDesign, hinf_synthesis
from hillsphere_controllers.systems.algebra import feedback, gain, series
from hillsphere_controllers.systems.interconnection import connect, with_names
from hillsphere_controllers.systems.weights import on_every_channel

__all__ = ["MixedSensitivityDesign", "mixed_sensitivity", "mixed_sensitivity_plant"]


@dataclass(frozen=True)
class MixedSensitivityDesign:
    """A controller, its check, and the transfers that it shapes.

    Parameters
    ----------
    controller : LtiSystem
        K from the error e = r − y to u.
    gamma : float
        The norm reached, computed from the closed loop.
    design : HinfDesign
        What the synthesis says of the generalised plant.
    plant : LtiSystem
        The generalised plant, outputs (z1, z2, z3, e), inputs (r, d, u).
    sensitivity, control, complementary : LtiSystem
        S, K S and T.
    """

    controller: LtiSystem
    gamma: float
    design: HinfDesign
    plant: LtiSystem
    sensitivity: LtiSystem
    control: LtiSystem
    complementary: LtiSystem


def mixed_sensitivity_plant(
    system: LtiSystem,
    w1: LtiSystem | float | None,
    w2: LtiSystem | float | None = None,
    w3: LtiSystem | float | None = None,
    *,
    disturbance: float = 0.0,
) -> LtiSystem:
    """Return the generalised plant of a mixed-sensitivity problem.

    Parameters
    ----------
    system : LtiSystem
        G, of m controls and p outputs.
    w1, w2, w3 : LtiSystem, float or None
        Weights of the error, the controls and the outputs; one of a single input and output acts on
        every channel. None: left out.
    disturbance : float
        Size of a disturbance at every control.

    Returns
    -------
    LtiSystem
        Its last m inputs are the controls, its last p outputs the errors.

    Raises
    ------
    InputError
        If a weight does not fit, there is none, or the disturbance is negative.
    """
    p, m = system.shape
    if not disturbance >= 0.0:
        raise InputError(f"a disturbance must be ≥ 0, got {disturbance}")
    parts = [with_names(system, "v", "y")]
    outputs = []
    for k, (weight, signal, width) in enumerate(((w1, "e", p), (w2, "u", m), (w3, "y", p)), 1):
        if weight is None:
            continue
        made = _weight(weight, width, k, system.dt_s)
        names = (f"z{k}",) if len(made.d) == 1 else tuple(f"z{k}[{i}]" for i in range(len(made.d)))
        parts.append(with_names(made, signal, names))
        outputs.append(f"z{k}")
    if not outputs:
        raise InputError("a mixed-sensitivity problem needs at least one weight")
    inputs = ["r", "u"]
    if disturbance:
        parts.append(with_names(gain(disturbance * np.eye(m)), "d", "du"))
        inputs.insert(1, "d")
    sums = ["e = r - y", "v = u + du" if disturbance else "v = u"]
    return connect(parts, sums, inputs, [*outputs, "e"])


def mixed_sensitivity(
    system: LtiSystem,
    w1: LtiSystem | float | None,
    w2: LtiSystem | float | None = None,
    w3: LtiSystem | float | None = None,
    *,
    disturbance: float = 0.0,
    tolerance: float = 1e-4,
    back_off: float = 0.005,
    regularisation: float | None = None,
) -> MixedSensitivityDesign:
    """Return the controller of a mixed-sensitivity problem.

    Parameters
    ----------
    system, w1, w2, w3, disturbance
        As in `mixed_sensitivity_plant`.
    tolerance, back_off, regularisation
        As in `hillsphere_controllers.full_order.hinf.hinf_synthesis`.

    Returns
    -------
    MixedSensitivityDesign
        The controller, checked.

    Raises
    ------
    InputError, NotStabilisableError, SingularProblemError, SynthesisFailedError
        As `mixed_sensitivity_plant` and `hinf_synthesis` do.
    """
    plant = mixed_sensitivity_plant(system, w1, w2, w3, disturbance=disturbance)
    p, m = system.shape
    design = hinf_synthesis(
        plant, m, p, tolerance=tolerance, back_off=back_off, regularisation=regularisation
    )
    controller = design.controller
    loop = series(controller, system)
    one = gain(np.eye(p), system.dt_s)
    return MixedSensitivityDesign(
        controller,
        design.gamma,
        design,
        plant,
        feedback(one, loop),
        feedback(controller, system),
        feedback(loop, one),
    )


def _weight(weight: LtiSystem | float, width: int, number: int, dt_s: float | None) -> LtiSystem:
    if not isinstance(weight, LtiSystem):
        if np.ndim(weight):
            raise InputError(
                f"W{number} must be a number or a system; `gain` makes one of a matrix"
            )
        return gain(float(weight) * np.eye(width), dt_s)
    if weight.shape == (1, 1):
        return on_every_channel(weight, width)
    if weight.shape[1] != width:
        raise InputError(f"W{number} must take {width} signals, got {weight.shape[1]}")
    return weight
