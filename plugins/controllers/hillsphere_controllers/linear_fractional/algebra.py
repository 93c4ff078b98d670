r"""Algebra of uncertain systems: uncertain elements, and their interconnections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_fractional.transformation import (
    Lft,
    connect_lfts,
    constant,
    inverse,
)
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty
from hillsphere_controllers.systems.algebra import gain

__all__ = [
    "diagonal",
    "dynamics",
    "feedback",
    "inverse",
    "join_inputs",
    "matrix_block",
    "number",
    "parameter",
    "stack_outputs",
    "star",
    "state_space",
]  # fmt: skip


def parameter(uncertainty: Uncertainty) -> Lft:
    """Return a real parameter as an uncertain 1 × 1 matrix.

    Parameters
    ----------
    uncertainty : Uncertainty
        The parameter with its bounds.

    Returns
    -------
    Lft
        The parameter, 1 × 1.

    Raises
    ------
    InputError
        If it is not real.
    """
    if uncertainty.kind != "real":
        raise InputError(f"{uncertainty.name!r} is {uncertainty.kind}, no real parameter")
    u = uncertainty
    return Lft(gain(np.array([[-u.curvature, 1.0], [u.slope, u.nominal]])), (u,), (1,))


def number(name: str, nominal: float, radius: float) -> Lft:
    """Return a complex number in a disc about a real one, 1 × 1.

    Parameters
    ----------
    name : str
        Of the uncertainty.
    nominal : float
        Centre of the disc.
    radius : float
        Its radius.

    Returns
    -------
    Lft
        The number, 1 × 1.

    Raises
    ------
    InputError
        If the radius is not positive.
    """
    if not radius > 0.0:
        raise InputError(f"{name}: a radius must be > 0, got {radius}")
    matrix = np.array([[0.0, 1.0], [radius, nominal]])
    return Lft(gain(matrix), (Uncertainty(name, "complex"),), (1,))


def matrix_block(name: str, rows: int, columns: int) -> Lft:
    """Return a matrix of which only ‖Δ‖ ≤ 1 is known.

    Parameters
    ----------
    name : str
        Of the uncertainty.
    rows, columns : int
        Size of the matrix.

    Returns
    -------
    Lft
        The matrix.
    """
    return _block(Uncertainty(name, "full", rows, columns))


def dynamics(name: str, rows: int = 1, columns: int = 1, weight: LtiSystem | None = None) -> Lft:
    """Return any stable system of norm at most one, times a weight from the left.

    Parameters
    ----------
    name : str
        Of the uncertainty.
    rows, columns : int
        Its outputs and inputs.
    weight : LtiSystem, optional
        Stable, rows × rows, or 1 × 1 for all outputs; 1 if left out.

    Returns
    -------
    Lft
        The weighted uncertainty.

    Raises
    ------
    InputError
        If the weight does not fit or is not stable.
    """
    bare = _block(Uncertainty(name, "full", rows, columns, dynamic=True))
    if weight is None:
        return bare
    if not weight.is_stable:
        raise InputError(f"{name}: a weight must be stable")
    if weight.shape == (1, 1) and rows > 1:
        return diagonal(*(rows * [weight])) @ bare
    return constant(weight) @ bare


def _block(uncertainty: Uncertainty) -> Lft:
    p, m = uncertainty.rows, uncertainty.columns
    # F_u(M, Δ) = Δ for M = [0 I; I 0]
    matrix = np.block([[np.zeros((m, p)), np.eye(m)], [np.eye(p), np.zeros((p, m))]])
    return Lft(gain(matrix), (uncertainty,), (1,))


def join_inputs(*parts: Lft | LtiSystem | Array) -> Lft:
    """Return [G₁ G₂ …]: the inputs side by side, the outputs added.

    Parameters
    ----------
    *parts : Lft, LtiSystem or ndarray
        One or more systems or matrices of the same number of outputs.

    Returns
    -------
    Lft
        The joined system.
    """
    lfts = [constant(part) for part in parts]
    _require_equal({part.shape[0] for part in lfts}, "outputs")
    count = len(lfts)
    return connect_lfts(
        lfts, *_unconnected_matrices(lfts), np.hstack(count * [np.eye(lfts[0].shape[0])])
    )


def stack_outputs(*parts: Lft | LtiSystem | Array) -> Lft:
    """Return [G₁; G₂; …]: one common input, the outputs stacked.

    Parameters
    ----------
    *parts : Lft, LtiSystem or ndarray
        One or more systems or matrices of the same number of inputs.

    Returns
    -------
    Lft
        The stacked system.
    """
    lfts = [constant(part) for part in parts]
    _require_equal({part.shape[1] for part in lfts}, "inputs")
    feed, _ = _unconnected_matrices(lfts)
    into = np.vstack(len(lfts) * [np.eye(lfts[0].shape[1])])
    return connect_lfts(lfts, feed, into, np.eye(feed.shape[1]))


def diagonal(*parts: Lft | LtiSystem | Array) -> Lft:
    """Return diag(G₁, G₂, …).

    Parameters
    ----------
    *parts : Lft, LtiSystem or ndarray
        One or more systems, or matrices of any shape.

    Returns
    -------
    Lft
        The block-diagonal system.
    """
    lfts = [constant(part) for part in parts]
    _require_equal({1 for _ in lfts}, "systems")
    feed, into = _unconnected_matrices(lfts)
    return connect_lfts(lfts, feed, into, np.eye(feed.shape[1]))


def feedback(forward: Lft, back: Lft | LtiSystem | Array, sign: int = -1) -> Lft:
    """Return (I − sign G H)⁻¹ G.

    Parameters
    ----------
    forward, back : Lft
        G (p, m), and H (m, p).
    sign : {-1, 1}
        Negative or positive feedback.

    Returns
    -------
    Lft
        The closed loop.

    Raises
    ------
    InputError
        If the two do not fit, or the loop is not well posed for Δ = 0.
    """
    behind = constant(back)
    p, m = forward.shape
    if behind.shape != (m, p):
        raise InputError(f"the feedback must be {m} × {p} to fit, got {behind.shape}")
    if sign not in (-1, 1):
        raise InputError(f"sign must be -1 or 1, got {sign}")
    feed = np.block([[np.zeros((m, p)), sign * np.eye(m)], [np.eye(p), np.zeros((p, m))]])
    into = np.vstack([np.eye(m), np.zeros((p, m))])
    return connect_lfts((forward, behind), feed, into, np.hstack([np.eye(p), np.zeros((p, m))]))


def star(upper: Lft, lower: Lft | LtiSystem | Array, controls: int, measurements: int) -> Lft:
    """Return Redheffer's star product, as `hillsphere_controllers.systems.algebra.star`.

    The last `measurements` outputs of `upper` go into the first inputs of `lower`, whose first
    `controls` outputs go into the last inputs of `upper`.

    Parameters
    ----------
    upper, lower : Lft
        The two systems.
    controls, measurements : int
        Numbers of signals from `lower` to `upper` and back.

    Returns
    -------
    Lft
        The two, connected.

    Raises
    ------
    InputError
        If the sizes do not fit, or the loop is not well posed for Δ = 0.
    """
    low = constant(lower)
    (p1, m1), (p2, m2) = upper.shape, low.shape
    if not (0 <= controls <= min(m1, p2) and 0 <= measurements <= min(p1, m2)):
        raise InputError(
            f"star product of {p1} × {m1} and {p2} × {m2}: {controls} controls and {measurements} "
            "measurements do not fit"
        )
    feed = np.zeros((m1 + m2, p1 + p2))
    feed[m1 - controls : m1, p1 : p1 + controls] = np.eye(controls)
    feed[m1 : m1 + measurements, p1 - measurements : p1] = np.eye(measurements)
    rows = [*range(p1 - measurements), *range(p1 + controls, p1 + p2)]
    columns = [*range(m1 - controls), *range(m1 + measurements, m1 + m2)]
    return connect_lfts((upper, low), feed, np.eye(m1 + m2)[:, columns], np.eye(p1 + p2)[rows])


def state_space(matrix: Lft, order: int, dt_s: float | None = None) -> Lft:
    """Return the uncertain system whose matrix [A B; C D] is uncertain.

    Parameters
    ----------
    matrix : Lft
        Without states; its first rows give the derivative of the state, its first columns take it.
    order : int
        n.
    dt_s : float, optional
        Sampling period, s, of a system in discrete time.

    Returns
    -------
    Lft
        The uncertain system.

    Raises
    ------
    InputError
        If the matrix has states or is too small.
    """
    p, m = matrix.shape
    if matrix.system.order or not 0 <= order <= min(p, m):
        raise InputError(
            f"a matrix without states of at least {order} × {order} is needed, got {p} × {m} with "
            f"{matrix.system.order} states"
        )
    m11, m12, m21, m22 = matrix.parts()
    n = order
    system = LtiSystem(
        m22[:n, :n],
        np.hstack([m21[:n], m22[:n, n:]]),
        np.vstack([m12[:, :n], m22[n:, :n]]),
        np.block([[m11, m12[:, n:]], [m21[n:], m22[n:, n:]]]),
        dt_s,
    )
    return Lft(system, matrix.uncertainties, matrix.times)


def _unconnected_matrices(parts: Sequence[Lft]) -> tuple[Array, Array]:
    """Return F of parts that are not connected, and N of one input each."""
    p, m = sum(part.shape[0] for part in parts), sum(part.shape[1] for part in parts)
    return np.zeros((m, p)), np.asarray(block_diag(*(np.eye(part.shape[1]) for part in parts)))


def _require_equal(counts: set[int], what: str) -> None:
    if len(counts) != 1:
        raise InputError(f"systems of one number of {what} are needed, got {sorted(counts)}")
