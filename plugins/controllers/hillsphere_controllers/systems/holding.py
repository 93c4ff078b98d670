"""Zero-order hold discretisation: inputs held between samples, exact at the samples."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem, real_matrix

__all__ = ["mean_output_hold", "zero_order_hold", "zero_order_hold_matrices"]

_WHOLE = 1e-9
"""Share of a period by which a delay may differ from a whole number of periods by rounding; the
rest then counts as none and costs no states."""
_MOST_DELAYED = 10_000
"""Periods of delay at most. Each adds a state per input, and more than this is a wrong unit rather
than a delay."""


def zero_order_hold_matrices(a: Array, b: Array, h: float) -> tuple[Array, Array]:
    r"""Return the zero-order hold matrices of ẋ = A x + B e, exact for an e that is held [1]_.

    Parameters
    ----------
    a, b : ndarray, shape (m, m), (m, q)
        Matrices, 1/s.
    h : float
        Period, s.

    Returns
    -------
    a, b : ndarray
        :math:`e^{Ah}` and :math:`\int_0^h e^{As} ds\, B`, the upper blocks of
        :math:`\exp\left(\begin{bmatrix} A & B \\ 0 & 0 \end{bmatrix} h\right)`.

    Raises
    ------
    InputError
        If the matrices do not fit, or are not of finite numbers.

    References
    ----------
    .. [1] C. F. Van Loan (1978), Computing integrals involving the matrix exponential, IEEE
       Transactions on Automatic Control 23(3), 395-404.
    """
    a, b = real_matrix(a, "A"), real_matrix(b, "B")
    m, q = b.shape
    if a.shape != (m, m):
        raise InputError(f"A must be {m} × {m} to fit B, got {a.shape}")
    both = np.zeros((m + q, m + q))
    both[:m, :m], both[:m, m:] = a, b
    exponential = expm(both * h)
    return exponential[:m, :m], exponential[:m, m:]


def mean_output_hold(system: LtiSystem, dt_s: float) -> LtiSystem:
    r"""Discretise with held inputs and with the outputs' means over the periods.

    For a controller with held outputs this keeps :math:`\int u\,dt` over every period equal to that
    of the continuous system. Its response to held errors begins at once, not a period later.

    Parameters
    ----------
    system : LtiSystem
        In continuous time.
    dt_s : float
        Period, s.

    Returns
    -------
    LtiSystem
        In discrete time.

    Raises
    ------
    InputError
        If the system is one in discrete time already, or the period not positive.
    """
    (p, _), n = system.shape, system.order
    # append the integrals of the outputs as states: their growth over a period is the mean times it
    integral = np.block([[system.a, np.zeros((n, p))], [system.c, np.zeros((p, p))]])
    both = zero_order_hold(
        LtiSystem(integral, np.vstack([system.b, system.d]), np.zeros((0, n + p)),
                  np.zeros((0, system.shape[1]))), dt_s,
    )  # fmt: skip
    return LtiSystem(
        both.a[:n, :n], both.b[:n], both.a[n:, :n] / dt_s, both.b[n:] / dt_s, dt_s,
        system.inputs, system.outputs, system.states,
    )  # fmt: skip


def zero_order_hold(system: LtiSystem, dt_s: float, delay_s: float = 0.0) -> LtiSystem:
    """Discretise a system with held inputs and sampled outputs, and an optional input delay.

    Parameters
    ----------
    system : LtiSystem
        In continuous time.
    dt_s : float
        Period, s.
    delay_s : float
        Time from a sample to the moment at which the input that belongs to it begins, s; any, also
        more than a period. The inputs on their way are states, the oldest one first.

    Returns
    -------
    LtiSystem
        In discrete time. With a delay of a part of a period, the output at a sample has the input
        from before the change.

    Raises
    ------
    InputError
        If the system is one in discrete time, the period not positive or the delay negative or
        longer than 10 000 periods.
    """
    if system.dt_s is not None:
        raise InputError("the system is one in discrete time already")
    if not (np.isfinite(dt_s) and dt_s > 0.0):
        raise InputError(f"a sampling period must be > 0 s, got {dt_s}")
    if not 0.0 <= delay_s <= _MOST_DELAYED * dt_s:
        raise InputError(f"a delay must be from 0 s to {_MOST_DELAYED} periods, got {delay_s} s")
    whole = int(np.floor(delay_s / dt_s + _WHOLE))
    part = max(delay_s - whole * dt_s, 0.0)
    if part <= _WHOLE * dt_s:
        part = 0.0
    (p, m), n = system.shape, system.order
    over, new = zero_order_hold_matrices(system.a, system.b, dt_s - part)
    before, old = zero_order_hold_matrices(system.a, system.b, part)
    # the older input acts first, for `part`
    a, old = over @ before, over @ old
    length = whole + (1 if part else 0)
    if length == 0:
        return LtiSystem(
            a, new, system.c, system.d, dt_s, system.inputs, system.outputs, system.states
        )
    # inputs on their way are a shift register of states, the oldest one first
    size = n + length * m
    whole_a, whole_b = np.zeros((size, size)), np.zeros((size, m))
    whole_c = np.zeros((p, size))
    whole_a[:n, :n], whole_c[:, :n] = a, system.c
    first = slice(n, n + m)
    whole_c[:, first] = system.d
    whole_a[n : size - m, n + m :] = np.eye(size - n - m)
    whole_b[size - m :] = np.eye(m)
    if part:
        whole_a[:n, first] = old
        if length > 1:
            whole_a[:n, n + m : n + 2 * m] = new
        else:
            whole_b[:n] = new
    else:
        whole_a[:n, first] = new
    return LtiSystem(
        whole_a, whole_b, whole_c, np.zeros((p, m)), dt_s, system.inputs, system.outputs
    )
