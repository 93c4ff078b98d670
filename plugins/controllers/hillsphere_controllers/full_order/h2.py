r"""H2 synthesis of full order by two Riccati equations.

With the plant of `hillsphere_controllers.full_order.hinf` and D11 = 0 in continuous time, the
controller that minimises the H2 norm from w to z is the state feedback that is optimal for all
disturbances, on the estimate of the states that is optimal for all controls [1]_. In discrete time
the estimate has the measurement of the moment, so that the controller has a direct term.

References
----------
.. [1] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall, sections
   14.5 and 21.7.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm, h2_rounding
from hillsphere_controllers.errors import SingularProblemError, SynthesisFailedError
from hillsphere_controllers.full_order.modes import check_modes
from hillsphere_controllers.full_order.regularisation import (
    Regularisation,
    choose_regularisations,
)
from hillsphere_controllers.full_order.regulation import optimal_cost
from hillsphere_controllers.full_order.scaling import Units
from hillsphere_controllers.systems.algebra import close_with_gain, lower_lft
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["H2Design", "h2_synthesis", "optimal_cost"]

_RANK = 1e-9
"""Of D12 and D21, beside columns [B2; D12] and rows [C2 D21] of norm one."""
_SIZES = tuple(10.0**-k for k in range(1, 9))
"""Regularisations relative to the size of the problem; the squares of smaller ones are rounding."""
_GAIN, _PATIENCE = 0.999, 2
"""The ladder ends after so many steps without a gain of 0.1 %."""
_AGREE = 1e-5
"""Relative difference between the closed loop's H2 norm and the one from the Riccati equations up
to which the design passes. A larger difference means that one of them has lost half of its
digits."""


@dataclass(frozen=True)
class H2Design:
    """An H2 controller, its closed loop and its norm.

    Parameters
    ----------
    controller : LtiSystem
        From y to u, of the order of the plant.
    norm : float
        The closed loop's H2 norm, computed from the closed loop.
    closed_loop : LtiSystem
        From w to z.
    least : float
        No controller has a smaller norm than this: `norm` where nothing was added, else 0, since
        the optimum of a regularised problem bounds that of the plant from above alone.
    added : Regularisation or None
        Weights and noise that were added for the synthesis alone; None if there are none.
    """

    controller: LtiSystem
    norm: float
    closed_loop: LtiSystem
    least: float = 0.0
    added: Regularisation | None = None


def h2_synthesis(
    plant: LtiSystem, controls: int, measurements: int, *, regularisation: float | None = None
) -> H2Design:
    """Return the controller that minimises the H2 norm from w to z.

    Parameters
    ----------
    plant : LtiSystem
        Its last inputs are the controls u, its last outputs the measurements y; in continuous or
        in discrete time.
    controls, measurements : int
        Numbers of u and y.
    regularisation : float or None
        Weight that is put on every control, and size of the noise that is put on every measurement,
        for the synthesis only. None: where the problem is singular or fails, weights and noise of
        falling size, on states too, are added until the norm no longer falls. 0: never.

    Returns
    -------
    H2Design
        The controller, checked.

    Raises
    ------
    InputError
        If the numbers do not fit, or the regularisation is out of range.
    NotStabilisableError
        If u cannot stabilise the plant, or y does not show an unstable mode.
    SingularProblemError
        If D11 is not zero (in continuous time); if no regularisation is allowed, or none helps, and
        a control has no weight, a measurement no noise, or the plant from u to z or from w to y has
        a zero on the stability boundary.
    SynthesisFailedError
        If the closed loop is not stable, or its norm not the one that the Riccati equations
        promise.
    """
    (p, m), k, q = plant.shape, controls, measurements
    if not (0 < k <= m and 0 < q <= p):
        raise InputError(f"{k} controls and {q} measurements do not fit a plant of {p} × {m}")
    if regularisation is not None and not 0.0 <= regularisation < np.inf:
        raise InputError(f"a regularisation must be ≥ 0 and finite, got {regularisation}")
    units = Units.of(plant, k, q)
    scaled = units.scale(plant)
    if regularisation:
        added = Regularisation.even(regularisation, k, q, plant.order)
        posed = units.scale_added(added).add_to(scaled)
        design = replace(_close(scaled, _solve_scaled(posed, k, q).controller), added=added)
    else:
        try:
            design = _solve_scaled(scaled, k, q)
        except (SingularProblemError, SynthesisFailedError):
            other = None if regularisation == 0.0 else _search_regularised(scaled, k, q)
            if other is None:
                raise
            assert other.added is not None
            design = replace(other, added=units.restore_added(other.added))
    return replace(design, controller=units.restore(design.controller))


def _search_regularised(plant: LtiSystem, k: int, q: int) -> H2Design | None:
    """Return the best loop of a plant by ever smaller regularisations, None if there is none."""
    best: H2Design | None = None
    since = 0
    for size in _SIZES:
        before = best
        for added in choose_regularisations(plant, k, q, size):
            try:
                made = _close(plant, _solve_scaled(added.add_to(plant), k, q).controller)
            except (SingularProblemError, SynthesisFailedError):
                continue
            if best is None or made.norm < best.norm:
                best = replace(made, added=added)
        if best is not None:
            gained = before is None or best.norm < _GAIN * before.norm
            since = 0 if gained else since + 1
            if since == _PATIENCE:
                break
    return best


def _close(plant: LtiSystem, controller: LtiSystem) -> H2Design:
    """Return the design of a controller for a plant, without a bound.

    Raises
    ------
    SynthesisFailedError
        If the closed loop is not stable.
    """
    loop = lower_lft(plant, controller)
    if plant.dt_s is None:  # D11 + D12 · 0 · D21, but for rounding
        loop = replace(loop, d=np.zeros_like(loop.d))
    if not loop.is_stable:
        raise SynthesisFailedError(
            "the closed loop is not stable in floating point; scale inputs, outputs and time to "
            "order one"
        )
    return H2Design(controller, h2_norm(loop), loop)


def _solve_scaled(plant: LtiSystem, k: int, q: int) -> H2Design:
    """Return the design for a plant whose controls and measurements have units of their size."""
    made, _ = balance_states(plant)
    p1, m1 = plant.shape[0] - q, plant.shape[1] - k
    a, b1, b2 = made.a, made.b[:, :m1], made.b[:, m1:]
    c1, c2 = made.c[:p1], made.c[p1:]
    d11, d12 = made.d[:p1, :m1], made.d[:p1, m1:]
    d21, d22 = made.d[p1:, :m1], made.d[p1:, m1:]
    discrete = plant.dt_s is not None
    if not discrete and d11.any():
        raise SingularProblemError(
            "white noise in w passes to z through D11 with infinite power; put a lag on the "
            "disturbance or the weight of each nonzero entry of D11"
        )
    check_modes(a, b2, c2, discrete=discrete)
    _check_rank(d12, "control")
    _check_rank(d21.T, "measurement")
    # state feedback, and the filter as the state feedback of the transposed plant
    x, f = optimal_cost(a, b2, c1, d12, discrete=discrete)
    y, h = optimal_cost(a.T, c2.T, b1.T, d21.T, discrete=discrete)
    gain = h.T
    if not discrete:
        weight = d12.T @ d12
        # ‖·‖₂² = tr(B1ᵀ X B1) + tr(R F Y Fᵀ), cost of the state feedback and of the estimate's
        # error
        square = np.sum((b1.T @ x) * b1.T) + np.sum((f @ y) * (weight @ f))
        controller = LtiSystem(a + b2 @ f + gain @ c2, -gain, f, np.zeros((k, q)))
    else:
        weight = d12.T @ d12 + b2.T @ x @ b2
        noise = d21 @ d21.T + c2 @ y @ c2.T
        # in discrete time the optimal u also depends on the present w: u = F x + F0 w
        f0 = -np.linalg.solve(weight, b2.T @ x @ b1 + d12.T @ d11)
        # of F x + F0 w, what the measurement of the moment tells
        told = f @ y @ c2.T + f0 @ d21.T
        l0: Array = np.asarray(np.linalg.solve(noise, told.T).T, dtype=float)
        missed = f @ y @ f.T + f0 @ f0.T - l0 @ noise @ l0.T
        square = (
            np.sum((b1.T @ x) * b1.T) + np.sum(d11**2)
            - np.sum((weight @ f0) * f0) + np.sum(weight * missed)
        )  # fmt: skip
        into = -gain + b2 @ l0
        controller = LtiSystem(a + b2 @ f - into @ c2, into, f - l0 @ c2, l0, plant.dt_s)
    if d22.any():  # y − D22 u is what the controller was made for
        controller = close_with_gain(controller, -d22)
    design = _close(plant, controller)
    norm, promised = design.norm, float(np.sqrt(max(square, 0.0)))
    if not abs(norm - promised) <= _AGREE * promised + h2_rounding(design.closed_loop):
        raise SynthesisFailedError(
            f"the closed loop has the H2 norm {norm:.9g}, the Riccati equations promise "
            f"{promised:.9g}; scale inputs, outputs and time to order one"
        )
    return replace(design, least=norm)


def _check_rank(d: Array, what: str) -> None:
    values = np.linalg.svd(d, compute_uv=False) if min(d.shape) else np.zeros(1)
    if d.shape[0] < d.shape[1] or values[-1] <= _RANK:
        name, remedy = ("D12", "weight") if what == "control" else ("D21", "noise")
        raise SingularProblemError(
            f"{name} lacks full rank: a combination of the {what}s has no {remedy}; add a small "
            f"direct {remedy} on each {what}"
        )
