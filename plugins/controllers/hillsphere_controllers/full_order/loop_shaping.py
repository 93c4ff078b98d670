r"""H∞ loop shaping: the controller of the largest margin for normalised coprime factors.

A plant P = M̃⁻¹ Ñ whose factors change by [ΔÑ ΔM̃] is stabilised by u = C y for all changes smaller
than

.. math::

    b(P, C) = \left\| \begin{bmatrix} I \\ C \end{bmatrix} (I - P C)^{-1}
    \begin{bmatrix} I & P \end{bmatrix} \right\|_\infty^{-1} \le
    (1 + λ_{max}(X Z))^{-1/2}

with X, Z of the two Riccati equations of the

References
----------
.. [1] K. Glover, D. McFarlane (1989), Robust stabilization of normalized coprime factor plant
   descriptions with H∞-bounded uncertainty, IEEE Transactions on Automatic Control 34(8), 821-830.
.. [2] S. Skogestad, I. Postlethwaite (2005), Multivariable Feedback Control, 2nd edition, Wiley,
   section 9.4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.full_order.coprime import coprime_riccati
from hillsphere_controllers.systems.algebra import gain, lower_lft
from hillsphere_controllers.systems.balancing import balance_states
from hillsphere_controllers.systems.bilinear import continuous, discrete

__all__ = ["LoopShapingDesign", "coprime_margin", "four_block_loop", "loop_shaping"]

_AGREE = 1e-4
"""Relative excess of the closed loop's norm over the γ that the controller was made for up to which
it passes: rounding of the two Riccati solutions near the least γ."""


@dataclass(frozen=True)
class LoopShapingDesign:
    """A controller for a shaped plant and its margin.

    Parameters
    ----------
    controller : LtiSystem
        W₁ C W₂, u = K y without a change of sign.
    shaped_plant : LtiSystem
        W₂ P W₁.
    shaped_controller : LtiSystem
        C, of the shaped plant.
    closed_loop : LtiSystem
        [I; C] (I − Pₛ C)⁻¹ [I Pₛ] of the shaped plant.
    gamma : float
        Its norm, computed from it.
    least : float
        The least γ of any controller; its inverse is the largest margin.
    """

    controller: LtiSystem
    shaped_plant: LtiSystem
    shaped_controller: LtiSystem
    closed_loop: LtiSystem
    gamma: float
    least: float


def four_block_loop(plant: LtiSystem, controller: LtiSystem) -> LtiSystem:
    """Return [I; C] (I − P C)⁻¹ [I P], the loop of a plant P with u = C y."""
    bare = [replace(s, inputs=(), outputs=(), states=()) for s in (plant, controller)]
    (p, m), g = plant.shape, bare[0]
    # z = (y, u) and y of the disturbances (of the outputs, of the inputs) and u
    with_signals = LtiSystem(
        g.a,
        np.hstack([np.zeros((g.order, p)), g.b, g.b]),
        np.vstack([g.c, np.zeros((m, g.order)), g.c]),
        np.block([
            [np.eye(p), g.d, g.d],
            [np.zeros((m, p)), np.zeros((m, m)), np.eye(m)],
            [np.eye(p), g.d, g.d],
        ]),
        g.dt_s,
    )  # fmt: skip
    return lower_lft(with_signals, bare[1])


def coprime_margin(plant: LtiSystem, controller: LtiSystem) -> float:
    """Return the margin b(P, C) of a loop closed by u = C y; 0 if it is not stable.

    Raises
    ------
    InputError
        If the two do not fit.
    """
    if controller.shape != plant.shape[::-1]:
        raise InputError(
            f"a plant of {plant.shape[0]} × {plant.shape[1]} needs a controller of "
            f"{plant.shape[1]} × {plant.shape[0]}, got {controller.shape[0]} × "
            f"{controller.shape[1]}"
        )
    norm = hinf_norm(four_block_loop(plant, controller)).value
    return 1.0 / norm if np.isfinite(norm) else 0.0


def loop_shaping(
    plant: LtiSystem,
    pre: LtiSystem | None = None,
    post: LtiSystem | None = None,
    *,
    back_off: float = 0.01,
) -> LoopShapingDesign:
    """Return the controller of H∞ loop shaping.

    Parameters
    ----------
    plant : LtiSystem
        P, in continuous or discrete time.
    pre, post : LtiSystem, optional
        W₁ at the inputs and W₂ at the outputs of the plant; 1 if left out.
    back_off : float
        By how much γ is larger than the least one, > 0: at the least one the controller is that of
        a descriptor system.

    Returns
    -------
    LoopShapingDesign
        The controller, checked; C is of the order of the shaped plant.

    Raises
    ------
    InputError
        If the weights do not fit or the back-off is not positive.
    NotStabilisableError
        If the shaped plant is not stabilisable or not detectable.
    SynthesisFailedError
        If the closed loop does not have the norm it should.
    """
    if not 0.0 < back_off < np.inf:
        raise InputError(f"a back-off must be > 0 and finite, got {back_off}")
    p, m = plant.shape
    w1 = gain(np.eye(m), plant.dt_s) if pre is None else pre
    w2 = gain(np.eye(p), plant.dt_s) if post is None else post
    shaped = w2 @ plant @ w1
    image = shaped if shaped.dt_s is None else continuous(shaped)
    inner, least = _central(balance_states(image)[0], 1.0 + back_off)
    if shaped.dt_s is not None:
        inner = discrete(inner, shaped.dt_s)
    loop = four_block_loop(shaped, inner)
    gamma = hinf_norm(loop).value
    if not gamma <= least * (1.0 + back_off) * (1.0 + _AGREE):
        raise SynthesisFailedError(
            f"the closed loop has the norm {gamma:.6g}, the Riccati equations promise "
            f"{least * (1.0 + back_off):.6g}; enlarge the back-off, or scale the states"
        )
    return LoopShapingDesign(w1 @ inner @ w2, shaped, inner, loop, gamma, least)


def _central(system: LtiSystem, factor: float) -> tuple[LtiSystem, float]:
    """Return the controller of γ = factor times the least one, and the least one."""
    a, b, c, d = system.a, system.b, system.c, system.d
    x, z = coprime_riccati(system)
    n, m = len(a), system.shape[1]
    largest = float(np.linalg.eigvals(x @ z).real.max(initial=0.0))
    least = float(np.sqrt(1.0 + max(largest, 0.0)))
    square = (factor * least) ** 2
    f = -np.linalg.solve(np.eye(m) + d.T @ d, d.T @ c + b.T @ x)
    left = (1.0 - square) * np.eye(n) + x @ z
    into: Array = np.asarray(square * np.linalg.solve(left.T, z @ c.T), dtype=float)
    return LtiSystem(a + b @ f + into @ (c + d @ f), into, b.T @ x, -d.T), least
