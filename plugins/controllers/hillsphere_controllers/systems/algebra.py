r"""Algebra of linear systems: series, sum, feedback, star product, LFTs.

All are special cases of one: some outputs of an appended system are fed into some of its inputs,

.. math::

    u = F y + v \quad\Rightarrow\quad u = (I - F D)^{-1} (F C x + v),

which is well posed if I − F D is invertible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem, real_matrix

__all__ = [
    "append", "close_with_gain", "connect_inside", "feedback", "gain", "lower_lft", "parallel",
    "series", "star", "upper_lft",
]  # fmt: skip

_SINGULAR, _NEAR = 1e-12, 1e-6
"""A loop is refused only if I − F D fails both tests: its smallest singular value is below the
first share of its size, and its smallest eigenvalue, which does not depend on the units of signals,
below the second. A looser singular-value test alone would refuse loops in uneven units."""


def gain(matrix: Array, dt_s: float | None = None) -> LtiSystem:
    """Return a constant matrix (p, m) as a system without states.

    Parameters
    ----------
    matrix : array_like, shape (p, m)
        The constant.
    dt_s : float, optional
        Sampling period, s, of a system in discrete time.

    Returns
    -------
    LtiSystem
        A system without states.

    Raises
    ------
    InputError
        If it is no matrix of finite real numbers.
    """
    d = real_matrix(np.atleast_2d(matrix), "a gain")
    p, m = d.shape
    return LtiSystem(np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)), d, dt_s)


def append(*systems: LtiSystem) -> LtiSystem:
    """Return the block-diagonal system, inputs and outputs one after the other.

    Names are kept if every system has them and none is listed twice.

    Parameters
    ----------
    *systems : LtiSystem
        One or more.

    Returns
    -------
    LtiSystem
        The block-diagonal system.

    Raises
    ------
    InputError
        If there is none, or the sampling periods differ.
    """
    if not systems:
        raise InputError("nothing to append")
    dt_s = _common_period(systems)
    return LtiSystem(
        _diagonal([s.a for s in systems]),
        _diagonal([s.b for s in systems]),
        _diagonal([s.c for s in systems]),
        _diagonal([s.d for s in systems]),
        dt_s,
        _join_names([s.inputs for s in systems], [s.shape[1] for s in systems]),
        _join_names([s.outputs for s in systems], [s.shape[0] for s in systems]),
        _join_names([s.states for s in systems], [s.order for s in systems]),
    )


def close_with_gain(system: LtiSystem, matrix: Array) -> LtiSystem:
    """Close a system by a constant feedback matrix, u = F y + v.

    Parameters
    ----------
    system : LtiSystem
        From u, shape (m,), to y, shape (p,).
    matrix : ndarray, shape (m, p)
        F.

    Returns
    -------
    LtiSystem
        From v to y, names kept.

    Raises
    ------
    InputError
        If F does not fit, or the loop is not well posed.
    """
    p, m = system.shape
    f = real_matrix(matrix, "a feedback matrix")
    if f.shape != (m, p):
        raise InputError(f"a feedback matrix must be {m} × {p}, got {f.shape}")
    loop = np.eye(m) - f @ system.d
    if m and _singular(loop):
        raise InputError(
            "the loop is not well posed: its direct terms alone close it (I − F D is singular)"
        )
    inside = np.linalg.solve(loop, np.hstack([f @ system.c, np.eye(m)]))
    into, through = inside[:, : system.order], inside[:, system.order :]
    return replace(
        system,
        a=system.a + system.b @ into,
        b=system.b @ through,
        c=system.c + system.d @ into,
        d=system.d @ through,
    )


def connect_inside(
    systems: Sequence[LtiSystem], inputs: Sequence[int], outputs: Sequence[int], matrix: Array
) -> LtiSystem:
    """Close some signals of systems by a constant matrix; all signals stay, without names.

    Parameters
    ----------
    systems : sequence of LtiSystem
        With all their inputs and outputs one after the other.
    inputs, outputs : sequence of int
        Those between which the matrix is, k inputs and r outputs.
    matrix : ndarray, shape (k, r)
        F: these inputs become F times these outputs, plus what enters from outside.

    Returns
    -------
    LtiSystem
        Of all inputs and outputs.

    Raises
    ------
    InputError
        If sampling periods differ or the loop is not well posed.
    """
    whole = append(*(replace(one, inputs=(), outputs=(), states=()) for one in systems))
    feed = np.zeros(whole.shape[::-1])
    feed[np.ix_(inputs, outputs)] = matrix
    return close_with_gain(whole, feed)


def series(*systems: LtiSystem) -> LtiSystem:
    """Return systems one after the other, the first one first: Gₖ … G₂ G₁.

    Parameters
    ----------
    *systems : LtiSystem
        One or more, the first to act first.

    Returns
    -------
    LtiSystem
        The product.

    Raises
    ------
    InputError
        If there is none, or the numbers of outputs and inputs or the sampling periods do not fit.
    """
    if not systems:
        raise InputError("nothing to put in series")
    made = systems[0]
    for after in systems[1:]:
        made = after @ made
    return made


def parallel(*systems: LtiSystem) -> LtiSystem:
    """Return the sum of systems of the same inputs and outputs.

    Parameters
    ----------
    *systems : LtiSystem
        One or more.

    Returns
    -------
    LtiSystem
        The sum.

    Raises
    ------
    InputError
        If there is none, or shapes or sampling periods differ.
    """
    if not systems:
        raise InputError("nothing to add")
    made = systems[0]
    for other in systems[1:]:
        made = made + other
    return made


def feedback(forward: LtiSystem, back: LtiSystem, sign: int = -1) -> LtiSystem:
    """Return the loop (I − sign G H)⁻¹ G of a system G with H in its feedback.

    Parameters
    ----------
    forward, back : LtiSystem
        G and H; H takes the outputs of G and gives what is added to its inputs.
    sign : {-1, 1}
        Negative or positive feedback.

    Returns
    -------
    LtiSystem
        The closed loop, from an input added to the feedback to the outputs of G.

    Raises
    ------
    InputError
        If the two do not fit, or the loop is not well posed.
    """
    p, m = forward.shape
    if back.shape != (m, p):
        raise InputError(f"the feedback must be {m} × {p} to fit, got {back.shape}")
    if sign not in (-1, 1):
        raise InputError(f"sign must be -1 or 1, got {sign}")
    both = append(_strip_names(forward), _strip_names(back))
    f = np.zeros((m + p, p + m))
    f[:m, p:] = sign * np.eye(m)
    f[m:, :p] = np.eye(p)
    closed = close_with_gain(both, f)
    return LtiSystem(
        closed.a, closed.b[:, :m], closed.c[:p], closed.d[:p, :m], closed.dt_s,
        forward.inputs, forward.outputs,
    )  # fmt: skip


def star(upper: LtiSystem, lower: LtiSystem, controls: int, measurements: int) -> LtiSystem:
    """Return Redheffer's star product.

    The last `measurements` outputs of `upper` go into the first inputs of `lower`, whose first
    `controls` outputs go into the last inputs of `upper`. What is left are the other inputs and
    outputs, those of `upper` first.

    Parameters
    ----------
    upper, lower : LtiSystem
        The two systems.
    controls, measurements : int
        Numbers of signals from `lower` to `upper` and back.

    Returns
    -------
    LtiSystem
        The two, connected.

    Raises
    ------
    InputError
        If the sizes do not fit, or the loop is not well posed.
    """
    (p1, m1), (p2, m2) = upper.shape, lower.shape
    if not (0 <= controls <= min(m1, p2) and 0 <= measurements <= min(p1, m2)):
        raise InputError(
            f"star product of {p1} × {m1} and {p2} × {m2}: {controls} controls and {measurements} "
            "measurements do not fit"
        )
    both = append(_strip_names(upper), _strip_names(lower))
    f = np.zeros((m1 + m2, p1 + p2))
    f[m1 - controls : m1, p1 : p1 + controls] = np.eye(controls)
    f[m1 : m1 + measurements, p1 - measurements : p1] = np.eye(measurements)
    closed = close_with_gain(both, f)
    rows = [*range(p1 - measurements), *range(p1 + controls, p1 + p2)]
    columns = [*range(m1 - controls), *range(m1 + measurements, m1 + m2)]
    closes = lower.shape == (controls, measurements)
    inputs = upper.inputs[: m1 - controls] if closes else ()
    outputs = upper.outputs[: p1 - measurements] if closes else ()
    return LtiSystem(
        closed.a, closed.b[:, columns], closed.c[rows], closed.d[np.ix_(rows, columns)],
        closed.dt_s, inputs, outputs,
    )  # fmt: skip


def lower_lft(plant: LtiSystem, controller: LtiSystem) -> LtiSystem:
    """Return F_l(P, K): the controller closes the last outputs and inputs of the plant.

    Parameters
    ----------
    plant : LtiSystem
        P.
    controller : LtiSystem
        K, from the last outputs of P to its last inputs.

    Returns
    -------
    LtiSystem
        P closed by K.

    Raises
    ------
    InputError
        If the sizes do not fit, or the loop is not well posed.
    """
    controls, measurements = controller.shape
    return star(plant, controller, controls, measurements)


def upper_lft(plant: LtiSystem, block: LtiSystem) -> LtiSystem:
    """Return F_u(M, Δ): the block closes the first outputs and inputs of the plant.

    Parameters
    ----------
    plant : LtiSystem
        M.
    block : LtiSystem
        Δ, from the first outputs of M to its first inputs.

    Returns
    -------
    LtiSystem
        M closed by Δ.

    Raises
    ------
    InputError
        If the sizes do not fit, or the loop is not well posed.
    """
    p, m = plant.shape
    controls, measurements = block.shape
    rows = [*range(measurements, p), *range(measurements)]
    columns = [*range(controls, m), *range(controls)]
    turned = LtiSystem(
        plant.a, plant.b[:, columns], plant.c[rows], plant.d[np.ix_(rows, columns)], plant.dt_s,
        tuple(plant.inputs[j] for j in columns) if plant.inputs else (),
        tuple(plant.outputs[i] for i in rows) if plant.outputs else (),
    )  # fmt: skip
    return star(turned, block, controls, measurements)


def _singular(loop: Array) -> bool:
    """Return whether a matrix I − F D is singular, for any units of its rows and columns."""
    if np.linalg.svd(loop, compute_uv=False)[-1] >= _SINGULAR * max(1.0, np.abs(loop).max()):
        return False
    # the units of signals change singular values, but not the eigenvalues
    sizes = np.abs(np.linalg.eigvals(loop))
    return bool(sizes.min() < _NEAR * max(1.0, sizes.max()))


def _strip_names(system: LtiSystem) -> LtiSystem:
    return replace(system, inputs=(), outputs=(), states=())


def _common_period(systems: tuple[LtiSystem, ...]) -> float | None:
    periods = {s.dt_s for s in systems if s.order or s.dt_s is not None}
    if len(periods) > 1:
        raise InputError(f"systems of different sampling periods do not connect: {periods}")
    return next(iter(periods), None)


def _diagonal(blocks: list[Array]) -> Array:
    # block_diag keeps the columns of blocks without rows
    return np.asarray(block_diag(*blocks), dtype=float)


def _join_names(names: list[tuple[str, ...]], counts: list[int]) -> tuple[str, ...]:
    if any(len(one) != count for one, count in zip(names, counts, strict=True)):
        return ()
    joined = tuple(name for one in names for name in one)
    return joined if len(set(joined)) == len(joined) else ()
