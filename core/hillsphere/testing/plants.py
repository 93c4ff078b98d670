"""Checks of plants: consistent equations, conserved quantities and symmetries."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.engine.dynamics.step_map import StepMap
from hillsphere.engine.dynamics.system import System, system
from hillsphere.interfaces import Array
from hillsphere.symbolic.expressions import jacobian, parameter, substitute
from hillsphere.testing.contract import check_close, derivative_by_differences, require
from hillsphere.testing.frames import frame

__all__ = ["check_plant"]

_STEP = 2e-3
"""Step of the differences, part of a state's size: balances the truncation of sixth order (h⁶ =
6e-17) with rounding (eps/h = 1e-13)."""


def check_plant(
    plant: Any,
    x: ArrayLike,
    *,
    duration_s: float | None = None,
    tol: float = 1e-8,
) -> None:
    """Check a plant.

    Parameters
    ----------
    plant : Plant
        The plant.
    x : array_like, shape (n, N)
        States, SI, best at random, in free flight.
    duration_s : float, optional
        Duration of the flights for the check of an integral of motion; by default a fifth of the
        plant's unit of time. No flight may meet the body.
    tol : float
        Largest relative difference between derivatives and finite differences.

    Raises
    ------
    ContractViolation
        Unless

        - states, controls and parameters have different names, scales are positive, the frame is
          known;
        - there is one derivative per state, finite at all points, and each control and run-time
          parameter (of many, a dozen) changes some;
        - the exact Jacobian agrees with sixth-order differences;
        - events are finite;
        - a declared integral of motion is conserved along the flight to 1e-10;
        - each declared mirror is a symmetry of the equations;
        - the derivative is unchanged if its declared terms of time are passed to it.
    """
    what = type(plant).__name__
    states = np.ascontiguousarray(x, dtype=float)
    names = [v.name for v in plant.states]
    require(
        states.ndim == 2 and states.shape[0] == len(names),
        f"x must be ({len(names)}, N), got {states.shape}",
    )
    for group in (names, [v.name for v in plant.controls], [q.name for q in plant.parameters()]):
        require(len(set(group)) == len(group), f"{what}: names repeat: {group}")
    frame(plant.frame)

    flow = system(plant, normalised=True)
    require(
        len(flow.rhs) == len(names), f"{what}: {len(names)} states, {len(flow.rhs)} derivatives"
    )
    scaled = states / flow.unit[:, None]
    if flow.external is None:
        _check_jacobian(what, flow, scaled, tol)
        _check_mirrors(what, flow, scaled, tol)
        _check_inputs(what, plant, states)
        _check_time_terms(what, plant, states)
    events = list(flow.events.values())
    if events:
        values = flow.function(*events)(scaled)
        for name, row in zip(flow.events, values, strict=True):
            require(np.all(np.isfinite(row)), f"{what}: event {name!r} is not finite everywhere")
    if flow.integral is not None:
        duration = 0.2 if duration_s is None else duration_s / flow.time_unit_s
        _check_integral(what, flow, scaled, duration)


def _check_jacobian(what: str, flow: System, x: Array, tol: float) -> None:
    n = len(flow.x)
    rhs = flow.function(*flow.rhs)
    require(np.all(np.isfinite(rhs(x))), f"{what}: a derivative is not finite at every point")
    exact = flow.function(*(slope for row in jacobian(flow.rhs, flow.x) for slope in row))
    table = exact(x).reshape(n, n, -1)
    steps = np.broadcast_to(_STEP * _sizes(flow, x), x.shape)
    by_differences = derivative_by_differences(rhs, x, steps)
    size = np.abs(table).max(axis=(0, 1))
    check_close(f"{what}: Jacobian against differences", table, by_differences, size, tol)


def _sizes(flow: System, x: Array) -> Array:
    """Return the size of each state in each case: that of all states of equal dimension."""
    kinds = [(v.length, v.time) for v in flow.states]
    same = np.array([[a == b for b in kinds] for a in kinds], dtype=float)
    size = np.sqrt(same @ x**2)
    return np.asarray(np.where(size > 0, size, 1.0))


def _check_mirrors(what: str, flow: System, x: Array, tol: float) -> None:
    rhs = flow.function(*flow.rhs)
    here = rhs(x)
    for name, signs in flow.mirrors.items():
        require(
            len(signs) == len(flow.x) and set(signs) <= {1, -1},
            f"{what}: mirror {name!r} needs one sign per state, got {signs}",
        )
        flip = np.array(signs, dtype=float)[:, None]
        # A time reversal S: if x(t) is a flight, so is S x(−t), hence f(S x) = −S f(x).
        size = np.abs(here).max(axis=0)
        check_close(f"{what}: mirror {name!r}", rhs(flip * x), -flip * here, size, tol)


def _check_time_terms(what: str, plant: Any, x: Array) -> None:
    whole, apart = system(plant), system(plant, apart=True)
    if not apart.time_terms:
        return
    terms = {parameter(name): e for name, e in apart.time_terms.items()}
    rejoined = whole.function(*substitute(apart.rhs, terms))
    t = np.linspace(-1.0, 1.0, x.shape[1]) * plant.scales.time_s
    want = whole.function(*whole.rhs)(x, None, t)
    size = np.abs(want).max(axis=1)[:, None]
    check_close(f"{what}: derivative with terms of time", rejoined(x, None, t), want, size, 1e-12)


def _check_inputs(what: str, plant: Any, x: Array) -> None:
    parameters = tuple(plant.parameters())
    chosen = parameters[:: max(1, -(-len(parameters) // 12))]
    flow = system(plant, run_time=[q.name for q in chosen], controls=True)
    rhs = flow.function(*flow.rhs)
    nominal = np.array([q.value for q in flow.run_time])
    if not nominal.size:
        return
    # not at time zero, where a rate that multiplies the time changes nothing
    when = 0.1 * plant.scales.time_s
    here = rhs(x, nominal, when)
    for i, q in enumerate(flow.run_time):
        changed = nominal.copy()
        changed[i] = q.value * 1.001 if q.value else 1e-3
        role = "control" if q.name.startswith("u:") else "run-time parameter"
        require(
            not np.array_equal(rhs(x, changed, when), here),
            f"{what}: {role} {q.name!r} changes nothing",
        )


def _check_integral(what: str, flow: System, x: Array, duration: float) -> None:
    if flow.integral is None:
        return
    integral = flow.function(flow.integral)
    stepper = StepMap(flow)
    steps = stepper.choose_steps(x, duration, 1e-13)
    end = stepper.propagate(x, duration, steps)
    before, after = integral(x), integral(end)
    size = np.maximum(1.0, np.abs(before))
    check_close(f"{what}: integral of motion along a flight", after, before, size, 1e-10)
