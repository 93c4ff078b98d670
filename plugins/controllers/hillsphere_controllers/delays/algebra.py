"""Algebra of systems with delays: elements, series, sum, feedback, connection by names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.delays.system import (
    DelayOperand,
    DelaySystem,
    as_delay_system,
    connect_delay_systems,
)
from hillsphere_controllers.systems.algebra import append as append_systems
from hillsphere_controllers.systems.algebra import gain
from hillsphere_controllers.systems.delay import pade_delay
from hillsphere_controllers.systems.interconnection import connect as connect_by_names
from hillsphere_controllers.systems.interconnection import with_names as with_names_of_lti

__all__ = [
    "append", "approximate_delays", "connect", "delay", "feedback", "parallel", "series",
    "with_delays", "with_names",
]  # fmt: skip


def delay(time_s: float, channels: int = 1) -> DelaySystem:
    """Return e^{-sT} on every channel.

    Parameters
    ----------
    time_s : float
        T, s, ≥ 0.
    channels : int
        Inputs and outputs.

    Returns
    -------
    DelaySystem
        e^{-sT} I.

    Raises
    ------
    InputError
        If the time is negative or not finite, or there is no channel.
    """
    if channels < 1:
        raise InputError(f"a delay needs at least one channel, got {channels}")
    return _late_channels(time_s, channels, "time_s")


def with_delays(
    system: LtiSystem | DelaySystem,
    *,
    input_s: float | Sequence[float] = 0.0,
    output_s: float | Sequence[float] = 0.0,
) -> DelaySystem:
    """Return a system whose inputs and outputs are late.

    Parameters
    ----------
    system : LtiSystem or DelaySystem
        In continuous time.
    input_s, output_s : float or sequence of float
        Delay of each input and output, s, ≥ 0; one number for all of them.

    Returns
    -------
    DelaySystem
        The system with delays, of which those of zero are left out.

    Raises
    ------
    InputError
        If a delay is negative or not finite, or they are not as many as the signals.
    """
    made = as_delay_system(system)
    p, m = made.shape
    return _late_channels(output_s, p, "output_s") @ made @ _late_channels(input_s, m, "input_s")


def _late_channels(given: float | Sequence[float], count: int, what: str) -> DelaySystem:
    """Return diag(e^{-sT}) of delays that may be zero."""
    times = np.asarray(given)
    if times.dtype.kind not in "biuf" or times.ndim > 1 or times.size not in (1, count):
        raise InputError(f"{what}: one delay, s, or one for each of {count} signals, got {given!r}")
    times = np.broadcast_to(times.astype(float), count)
    if not (np.isfinite(times) & (times >= 0.0)).all():
        raise InputError(f"{what}: a delay must be ≥ 0 s and finite, got {given!r}")
    late = np.flatnonzero(times)
    pick = np.eye(count)[late]
    direct = np.diag((times == 0.0).astype(float))
    matrix = np.block([[direct, pick.T], [pick, np.zeros((late.size, late.size))]])
    return DelaySystem(gain(matrix), tuple(times[late].tolist()))


def series(*systems: DelayOperand) -> DelaySystem:
    """Return systems one after the other, the first one first: Gₖ … G₂ G₁.

    Parameters
    ----------
    *systems : DelaySystem, LtiSystem, ndarray or float
        One or more.

    Returns
    -------
    DelaySystem
        The product.

    Raises
    ------
    InputError
        If there is none, or the numbers of outputs and inputs do not fit.
    """
    return reduce(lambda before, after: after @ before, _require_systems(systems))


def parallel(*systems: DelayOperand) -> DelaySystem:
    """Return the sum of systems of the same inputs and outputs.

    Parameters
    ----------
    *systems : DelaySystem, LtiSystem, ndarray or float
        One or more.

    Returns
    -------
    DelaySystem
        The sum.

    Raises
    ------
    InputError
        If there is none, or the shapes differ.
    """
    return reduce(add, _require_systems(systems))


def append(*systems: DelayOperand) -> DelaySystem:
    """Return the block-diagonal system, inputs and outputs one after the other.

    Parameters
    ----------
    *systems : DelaySystem, LtiSystem, ndarray or float
        One or more.

    Returns
    -------
    DelaySystem
        The block-diagonal system; names are kept as by
        `hillsphere_controllers.systems.algebra.append`.

    Raises
    ------
    InputError
        If there is none.
    """
    parts = _require_systems(systems)
    p, m = sum(part.shape[0] for part in parts), sum(part.shape[1] for part in parts)
    # the names are those that systems of the same names without states would have
    named = append_systems(*(_static_with_names(part) for part in parts))
    return connect_delay_systems(
        parts, np.zeros((m, p)), np.eye(m), np.eye(p), named.inputs, named.outputs
    )


def _static_with_names(part: DelaySystem) -> LtiSystem:
    return replace(gain(np.zeros(part.shape)), inputs=part.inputs, outputs=part.outputs)


def feedback(forward: DelayOperand, back: DelayOperand, sign: int = -1) -> DelaySystem:
    """Return the loop (I − sign G H)⁻¹ G of a system G with H in its feedback.

    Parameters
    ----------
    forward, back : DelaySystem, LtiSystem, ndarray or float
        G and H; H takes the outputs of G and gives what is added to its inputs.
    sign : {-1, 1}
        Negative or positive feedback.

    Returns
    -------
    DelaySystem
        The closed loop, from an input added to the feedback to the outputs of G.

    Raises
    ------
    InputError
        If the two do not fit, or the loops that no delay interrupts are not well posed.
    """
    g, h = as_delay_system(forward, "the system G"), as_delay_system(back, "the system H")
    p, m = g.shape
    if h.shape != (m, p):
        raise InputError(f"the feedback must be {m} × {p} to fit, got {h.shape}")
    if sign not in (-1, 1):
        raise InputError(f"sign must be -1 or 1, got {sign}")
    feed = np.block([[np.zeros((m, p)), sign * np.eye(m)], [np.eye(p), np.zeros((p, m))]])
    into = np.vstack([np.eye(m), np.zeros((p, m))])
    return connect_delay_systems((g, h), feed, into, np.eye(p, p + m), g.inputs, g.outputs)


def with_names(
    system: DelaySystem, inputs: str | Sequence[str], outputs: str | Sequence[str]
) -> DelaySystem:
    """Return a system with names for its signals.

    Parameters
    ----------
    system : DelaySystem
        Any.
    inputs, outputs : str or sequence of str
        As of `hillsphere_controllers.systems.interconnection.with_names`.

    Returns
    -------
    DelaySystem
        The same system with names.

    Raises
    ------
    InputError
        If the names are not as many as the signals, or one is listed twice.
    """
    named = with_names_of_lti(_static_with_names(system), inputs, outputs)
    p, m = system.shape
    feed, into, out = np.zeros((m, p)), np.eye(m), np.eye(p)
    return connect_delay_systems((system,), feed, into, out, named.inputs, named.outputs)


def connect(
    systems: Sequence[LtiSystem | DelaySystem],
    junctions: Sequence[str],
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> DelaySystem:
    """Connect every input to the signal of the same name.

    Parameters
    ----------
    systems : sequence of LtiSystem or DelaySystem
        With names for inputs and outputs.
    junctions, inputs, outputs : sequence of str
        As of `hillsphere_controllers.systems.interconnection.connect`.

    Returns
    -------
    DelaySystem
        Its delays are those of the systems, in their order.

    Raises
    ------
    InputError
        As that function.
    """
    plain, late, early, times = list[LtiSystem](), list[str](), list[str](), list[float]()
    for k, one in enumerate(systems):
        part = as_delay_system(one)
        if len(part.inputs) != part.shape[1] or len(part.outputs) != part.shape[0]:
            raise InputError(f"system {k} has no names for its signals; give them by with_names")
        marks = [f"{k}/{j}" for j in range(len(part.delays_s))]
        into, out = [f"late {one}" for one in marks], [f"to delay {one}" for one in marks]
        plain.append(
            replace(
                part.system, inputs=(*part.inputs, *into), outputs=(*part.outputs, *out), states=()
            )
        )
        late, early, times = late + into, early + out, [*times, *part.delays_s]
    made = connect_by_names(plain, junctions, [*inputs, *late], [*outputs, *early])
    return DelaySystem(made, tuple(times))


def approximate_delays(system: DelaySystem, order: int = 1) -> LtiSystem:
    """Return a system with Padé approximations in the place of its delays.

    Parameters
    ----------
    system : DelaySystem
        With q delays.
    order : int
        Of each approximation, from 1 to 8.

    Returns
    -------
    LtiSystem
        Of q · order states more. How far it is from the system says
        `hillsphere_controllers.delays.cover.pade_cover`.

    Raises
    ------
    InputError
        If the order is out of range, or the loops with the approximations, whose direct term is
        ±1, are not well posed.
    """
    parts = [as_delay_system(pade_delay(time, order)) for time in system.delays_s]
    (p, m), q = system.shape, len(system.delays_s)
    if not q:
        return system.system
    both = append(DelaySystem(system.system, ()), *parts)
    feed = np.zeros((m + 2 * q, p + 2 * q))
    feed[m : m + q, p + q :] = np.eye(q)
    feed[m + q :, p : p + q] = np.eye(q)
    into, out = np.eye(m + 2 * q, m), np.eye(p, p + 2 * q)
    made = connect_delay_systems((both,), feed, into, out, system.inputs, system.outputs)
    return made.system


def _require_systems(systems: Sequence[DelayOperand]) -> list[DelaySystem]:
    if not systems:
        raise InputError("at least one system is needed")
    return [as_delay_system(one) for one in systems]
