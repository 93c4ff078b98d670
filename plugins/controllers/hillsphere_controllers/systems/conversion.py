"""Conversion from and to transfer functions and objects of python-control."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["from_control", "to_control", "transfer_function"]


def transfer_function(
    numerator: Sequence[float], denominator: Sequence[float], dt_s: float | None = None
) -> LtiSystem:
    """Return a transfer function of one input and one output as a system.

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients, the highest power of s (or of z) first.
    dt_s : float or None
        Sampling period, s.

    Returns
    -------
    LtiSystem
        In controllable companion form, states scaled by powers of two. For an order above ten or
        so, connect systems of low order by `series` instead: the roots of a polynomial of high
        degree are not known to its coefficients' precision.

    Raises
    ------
    InputError
        If the denominator is zero or of lower degree than the numerator.
    """
    top = np.trim_zeros(np.atleast_1d(np.asarray(numerator, dtype=float)), "f")
    bottom = np.trim_zeros(np.atleast_1d(np.asarray(denominator, dtype=float)), "f")
    n = bottom.size - 1
    if n < 0:
        raise InputError("the denominator of a transfer function is zero")
    if top.size > n + 1:
        raise InputError(
            f"a numerator of degree {top.size - 1} over a denominator of degree {n} is not proper; "
            "add fast poles"
        )
    top = np.concatenate([np.zeros(n + 1 - top.size), top]) / bottom[0]
    bottom = bottom[1:] / bottom[0]
    a = np.zeros((n, n))
    b = np.zeros((n, 1))
    if n:
        a[0] = -bottom
        a[1:, :-1] = np.eye(n - 1)
        b[0] = 1.0
    # the direct term is split off the numerator
    c = (top[1:] - top[0] * bottom)[None]
    made, _ = balance_states(LtiSystem(a, b, c, top[:1, None], dt_s))
    return made


def to_control(system: LtiSystem) -> Any:
    """Return a system as a `control.StateSpace`, with its names.

    Raises
    ------
    InputError
        If python-control is not installed, or the system has no inputs or no outputs, for which it
        has no form.
    """
    if 0 in system.shape:
        raise InputError("python-control has no systems without inputs or outputs")
    names = {
        key: list(value)
        for key, value in (
            ("inputs", system.inputs), ("outputs", system.outputs), ("states", system.states),
        )
        if value
    }  # fmt: skip
    period = 0.0 if system.dt_s is None else system.dt_s
    return _control().StateSpace(system.a, system.b, system.c, system.d, period, **names)


def from_control(system: Any) -> LtiSystem:
    """Return a system of python-control as an `LtiSystem`, with its names.

    Parameters
    ----------
    system : control.StateSpace or control.TransferFunction
        A transfer function is realised by python-control; one of several inputs and outputs needs
        its optional package slycot for that. No period given counts as continuous time.

    Raises
    ------
    InputError
        If python-control is not installed, the object is another one, is not proper, or in
        discrete time of a period that is not given.
    """
    control = _control()
    if isinstance(system, control.TransferFunction):
        try:
            system = control.ss(system)
        except Exception as error:
            raise InputError(
                f"python-control makes no state space of this transfer function: {error}"
            ) from error
    if not isinstance(system, control.StateSpace):
        raise InputError(
            "a control.StateSpace or control.TransferFunction is needed, got "
            f"{type(system).__name__}"
        )
    if system.dt is True:
        raise InputError("a system in discrete time needs its sampling period (dt = 0.1, say)")
    return LtiSystem(
        system.A, system.B, system.C, system.D,
        None if not system.dt else float(system.dt),
        tuple(system.input_labels), tuple(system.output_labels), tuple(system.state_labels),
    )  # fmt: skip


def _control() -> Any:
    # Imported here: python-control takes a second to import.
    try:
        return import_module("control")
    except ImportError as error:
        raise InputError(
            "python-control is not installed; install it with: pip install control"
        ) from error
