"""Conversion from and to transfer functions and objects of python-control.

`as_lti` is the one place where a function that takes systems of either library converts them, and
`like` the one place where its result is given back in the library of what was given.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.algebra import append, gain
from hillsphere_controllers.systems.balancing import balance_states
from hillsphere_controllers.systems.minimal import minimal_realisation

__all__ = ["as_lti", "from_control", "like", "to_control", "transfer_function"]


def as_lti(given: object, what: str = "the system") -> LtiSystem:
    """Return a system of this library, of python-control, or a constant matrix as an `LtiSystem`.

    Parameters
    ----------
    given : LtiSystem, control.StateSpace, control.TransferFunction, array_like or float
        The system; a matrix or a number is a constant gain.
    what : str
        What it is, for messages.

    Returns
    -------
    LtiSystem
        The system.

    Raises
    ------
    InputError
        If it is something else, or as `from_control`.
    """
    if isinstance(given, LtiSystem):
        return given
    if _is_of_control(given):
        return from_control(given)
    if isinstance(given, float | int | np.number | np.ndarray | list):
        return gain(np.asarray(given))
    if hasattr(given, "delays_s"):
        raise InputError(
            f"{what} has delays, which are not known here: replace them by states, by pade(G, "
            "order), or by uncertain dynamics, by padecover(G, order)"
        )
    raise InputError(
        f"{what} must be an LtiSystem, a control.StateSpace, a control.TransferFunction or a "
        f"matrix, got {type(given).__name__}"
    )


def like(made: LtiSystem, *given: object) -> Any:
    """Return a result as a `control.StateSpace` if one of the given systems is of python-control.

    Otherwise it is returned as it is.

    Parameters
    ----------
    made : LtiSystem
        The result.
    *given : object
        What the caller gave.

    Returns
    -------
    LtiSystem or control.StateSpace
        The result, in the form that the caller uses.
    """
    return to_control(made) if any(_is_of_control(one) for one in given) else made


def _is_of_control(given: object) -> bool:
    # who has made such an object has imported the package
    control = sys.modules.get("control")
    return control is not None and isinstance(given, control.InputOutputSystem)


def transfer_function(
    numerator: Sequence[float] | Array,
    denominator: Sequence[float] | Array,
    dt_s: float | None = None,
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

    Parameters
    ----------
    system : LtiSystem
        The system.

    Returns
    -------
    control.StateSpace
        The same system; dt is its period, 0 in continuous time.

    Raises
    ------
    InputError
        If python-control is not installed, or the system has no inputs or no outputs, for which it
        has no form.
    """
    system = as_lti(system)
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
        A transfer function of several inputs and outputs is realised entry by entry, and reduced
        to a minimal realisation. No period given (dt = 0 or None) counts as continuous time.

    Returns
    -------
    LtiSystem
        The same system; in discrete time with its period, s.

    Raises
    ------
    InputError
        If python-control is not installed, the object is another one, is not proper, or in
        discrete time of a period that is not given (dt = True).
    """
    control = _control()
    if not isinstance(system, control.StateSpace | control.TransferFunction):
        raise InputError(
            "a control.StateSpace or control.TransferFunction is needed, got "
            f"{type(system).__name__}; a delay in continuous time has none: take control.pade"
        )
    if system.dt is True:
        raise InputError("a system in discrete time needs its sampling period (dt = 0.1, say)")
    dt_s = float(system.dt) if system.dt else None
    labels = tuple(system.input_labels), tuple(system.output_labels)
    if isinstance(system, control.TransferFunction):
        return replace(_realise(system, dt_s), inputs=labels[0], outputs=labels[1])
    return LtiSystem(
        system.A, system.B, system.C, system.D, dt_s, *labels, tuple(system.state_labels)
    )


def _realise(function: Any, dt_s: float | None) -> LtiSystem:
    """Return a minimal realisation of a transfer function of python-control."""
    rows = []
    for numerators, denominators in zip(function.num_list, function.den_list, strict=True):
        row = [
            transfer_function(num, den, dt_s)
            for num, den in zip(numerators, denominators, strict=True)
        ]
        # the inputs of one row side by side, their outputs added
        rows.append(np.ones((1, len(row))) @ append(*row))
    if len(rows) == 1 and rows[0].shape[1] == 1:
        return rows[0]
    same_inputs = np.vstack([np.eye(rows[0].shape[1])] * len(rows))
    return minimal_realisation(append(*rows) @ same_inputs)


def _control() -> Any:
    # Imported here: python-control takes a second to import.
    try:
        return import_module("control")
    except ImportError as error:
        raise InputError(
            "python-control is not installed; install it with: pip install control"
        ) from error
