"""Compilation of a plant, alone or with a continuous law, for the closed loop."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.enclosures import LinearRows
from hillsphere.engine.dynamics.step_map import StepMap
from hillsphere.engine.dynamics.system import External, PlantBounds, System, system
from hillsphere.engine.simulation.command_bounds import AffineLaw, affine_law
from hillsphere.engine.simulation.law_bounds import LawBounds, law_matrix
from hillsphere.interfaces.loop import ContinuousLaw
from hillsphere.interfaces.plant import Plant
from hillsphere.interfaces.quantities import Parameter, Variable
from hillsphere.symbolic.expressions import (
    Expr,
    dot,
    parameter,
    sqrt,
    substitute,
    sum_of,
    time,
    variable,
)

__all__ = [
    "closed_system",
    "compile_step_map",
    "compiled_events",
    "compiled_loop",
    "remember",
    "thrust_vectors",
    "velocity_rows",
]

EFFORT = "loop:effort"
_T = TypeVar("_T")
_MOST = 64
"""Largest number of cached systems, more than the plants and laws of a mission."""
_KEPT: OrderedDict[tuple[object, ...], tuple[tuple[object, ...], Any]] = OrderedDict()
"""Compiled systems in order of use, with their plants and laws. Keys contain ids of these objects,
which stay unique as long as the objects are referenced here. Weak references would never be
cleared, since a system refers to its plant."""


def remember(owners: tuple[object, ...], key: tuple[object, ...], make: Callable[[], _T]) -> _T:
    """Return the cached result for these objects and key, or make it.

    Parameters
    ----------
    owners : tuple
        Objects, such as plant and law, that the result is made of; compared by identity.
    key : tuple
        What else it depends on.
    make : callable
        Makes the result.
    """
    name = (*map(id, owners), *key)
    if name not in _KEPT:
        _KEPT[name] = owners, make()
        while len(_KEPT) > _MOST:
            _KEPT.popitem(last=False)
    _KEPT.move_to_end(name)
    result: _T = _KEPT[name][1]
    return result


def compile_step_map(
    plant: Plant, run_time: Sequence[str], method: str, *, controls: bool
) -> StepMap:
    """Return the step map of a plant, SI, compiled once.

    Parameters
    ----------
    plant : Plant
        Equations.
    run_time : sequence of str
        Run-time parameters.
    method : str
        Formula of the step map.
    controls : bool
        Whether the controls are additional run-time parameters.

    Returns
    -------
    StepMap
        Without derivatives.
    """

    def make() -> StepMap:
        return StepMap(system(plant, run_time=run_time, controls=controls), method, errors=True)

    return remember((plant,), (tuple(run_time), method, controls), make)


def compiled_loop(
    plant: Plant, law: ContinuousLaw, run_time: Sequence[str], method: str
) -> tuple[StepMap, ArrayFunction]:
    """Return the step map of `closed_system` and its compiled command, cached.

    A law that has the equations of another one, at another period, refers to it as ``equations``.
    """
    same: ContinuousLaw = getattr(law, "equations", law)

    def make() -> tuple[StepMap, ArrayFunction]:
        closed, command = closed_system(plant, law, run_time)
        return StepMap(closed, method, errors=True), closed.function(*command)

    return remember((plant, same), (tuple(run_time), method), make)


def compiled_events(equations: System) -> ArrayFunction | None:
    """Return the events of a system in their order as one function, cached; None without any."""
    if not equations.events:
        return None
    return remember((equations,), (), lambda: equations.function(*equations.events.values()))


def thrust_vectors(rows: int) -> int:
    """Return the number of thrust vectors of a command: one per three rows, or else one."""
    return rows // 3 if rows % 3 == 0 else 1


def velocity_rows(plant: Plant) -> list[int]:
    """Return the rows of the velocities, which are identified by their dimension, in order."""
    return [i for i, v in enumerate(plant.states) if (v.length, v.time) == (1, -1)]


def closed_system(
    plant: Plant, law: ContinuousLaw, run_time: Sequence[str], *, apart: bool = False
) -> tuple[System, tuple[Expr, ...]]:
    r"""Compose the closed-loop system of a plant and a continuous law, SI.

    Parameters
    ----------
    plant : Plant
        n equations with p controls.
    law : ContinuousLaw
        m equations with q inputs.
    run_time : sequence of str
        Run-time parameters of the plant.
    apart : bool
        As for `hillsphere.engine.dynamics.system`.

    Returns
    -------
    system : System
        n + m + 1 states: those of the plant, those of the law, and the effort
        :math:`\int |u|\,dt`. Its run-time parameters are those of the plant, then p rows of
        feedforward, p × p of the effectiveness of the actuator, q of the reference and, if the
        law's measurement is held, q of the measurement.
    command : tuple of Expr
        Sum of the law's command and the feedforward, p expressions in the symbols of that system.

    Raises
    ------
    InputError
        If numbers or names of states and controls do not match.
    """
    base = system(plant, run_time=run_time, controls=True, apart=apart)
    names = [v.name for v in base.states]
    own = [v.name for v in law.states]
    what = type(law).__name__
    if clash := sorted(set(own) & set(names)):
        raise InputError(f"{what}: states {clash} have names of states of the plant; rename them")
    held = law.measurement == "held"
    if not held and law.inputs != len(names):
        raise InputError(
            f"{what} sees {law.inputs} values; measured continuously it sees the "
            f"{len(names)} states of the plant"
        )
    p = len(plant.controls)
    feed = [Parameter(f"loop:feedforward{i}", 0.0) for i in range(p)]
    gain = [Parameter(f"loop:gain{i},{j}", float(i == j)) for i in range(p) for j in range(p)]
    goal = [Parameter(f"loop:ref{i}", 0.0) for i in range(law.inputs)]
    seen = [Parameter(f"loop:y{i}", 0.0) for i in range(law.inputs if held else 0)]

    xc = tuple(variable(name) for name in own)
    y = tuple(parameter(q.name) for q in seen) if held else base.x
    ref = tuple(parameter(q.name) for q in goal)
    command = tuple(law.control(xc, y, ref, time))
    rates = tuple(law.derivative(xc, y, ref, time))
    if len(command) != p or len(rates) != len(xc):
        raise InputError(
            f"{what}: {len(command)} commands for {p} controls of the plant, {len(rates)} "
            f"derivatives for {len(xc)} states"
        )
    total = [c + parameter(f.name) for c, f in zip(command, feed, strict=True)]
    done = [dot([parameter(g.name) for g in gain[i * p : (i + 1) * p]], total) for i in range(p)]
    rhs = substitute(
        base.rhs,
        {parameter("u:" + v.name): e for v, e in zip(plant.controls, done, strict=True)},
    )
    kept = base.run_time[: len(base.run_time) - p]
    matrix = law_matrix(law, law.inputs)
    inner = PlantBounds(plant, kept, False, base.unit, base.time_unit_s)
    affine = affine_law(law, inner, len(kept))
    law_scale, passing = _law_errors(plant, law, affine, len(names))
    bounded = LawBounds(
        inner,
        law,
        len(kept),
        thrust_vectors(p),
        None if matrix is None else LinearRows(len(names), matrix),
        affine,
    )
    closed = replace(
        base,
        states=(*base.states, *law.states, Variable(EFFORT, 1, -1)),
        x=(*base.x, *xc, variable(EFFORT)),
        rhs=(*rhs, *rates, _effort(done)),
        run_time=(*kept, *feed, *gain, *goal, *seen),
        integral=None,
        unit=np.ones(len(names) + len(own) + 1),
        scale=np.concatenate([base.scale, plant.scales.of(law.states), [1.0]]),
        error_scale=np.concatenate([base.scale, law_scale, [1.0]]),
        passing=passing,
        mirrors={},
        external=_widen_array_terms(base, len(own) + 1),
        bounded=bounded,
    )
    return closed, tuple(total)


def _law_errors(
    plant: Plant, law: ContinuousLaw, affine: AffineLaw | None, first: int
) -> tuple[Array, tuple[int, ...]]:
    """Return the scale of errors of a law's states, and the rows whose errors are transient.

    The error of a Runge–Kutta formula is largest for states whose time constant is about one step,
    and such an error decays within a few steps. The states of a linear law have no scale of their
    own. Their errors are therefore scaled by their effect on the command, in units of the plant's
    typical acceleration times its unit of time.
    """
    if affine is None or not len(law.states):
        return plant.scales.of(law.states), ()
    gain = np.abs(affine.c[:, : len(law.states)]) / plant.scales.of(plant.controls)[:, None]
    # The error of a state without effect on the command gets weight zero.
    scale = plant.scales.time_s / np.maximum(gain.max(axis=0, initial=0.0), 1e-100)
    return scale, tuple(range(first, first + len(law.states)))


def _effort(done: Sequence[Expr]) -> Expr:
    if not done:
        return sum_of([0.0])
    count = thrust_vectors(len(done))
    size = len(done) // count
    return sum_of(
        [sqrt(dot(v, v)) for v in (done[i * size : (i + 1) * size] for i in range(count))]
    )


def _widen_array_terms(base: System, more: int) -> External | None:
    """Wrap the plant's array terms for a state vector with `more` rows after the plant's."""
    inner = base.external
    if inner is None:
        return None
    n, k = len(base.x), len(base.run_time)

    def values(x: Array, t: Array, p: Array) -> Array:
        return inner.values(x[:n], t, p[:k])

    def jacobian(x: Array, t: Array, p: Array) -> Array:
        return np.pad(inner.jacobian(x[:n], t, p[:k]), ((0, 0), (0, more), (0, 0)))

    return External(inner.variables, values, jacobian)
