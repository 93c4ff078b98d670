r"""Linear fractional transformations (LFTs): a system M closed by an uncertainty Δ.

.. math::

    F_u(M, \Delta) = M_{22} + M_{21} \Delta (I - M_{11} \Delta)^{-1} M_{12},
    \qquad \lVert \Delta \rVert \le 1

[1]_. Sums, products and feedback of LFTs are LFTs: their M are put side by side and connected, and
the copies of one uncertainty are gathered.

References
----------
.. [1] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall,
   chapter 10.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty
from hillsphere_controllers.mu.blocks import Block, BlockStructure
from hillsphere_controllers.systems.algebra import append, connect_inside, gain, upper_lft
from hillsphere_controllers.systems.conversion import as_lti

__all__ = ["Lft", "Operand", "connect_lfts", "constant", "inverse"]

_SINGULAR = 1e13
"""Factor by which the inverse of I − M₁₁ Δ may amplify M₁₂. Beyond it fewer than three of the
sixteen digits of the result are left."""
_RANK = 1e-13
"""Smallest singular value of the direct term, relative to the largest, below which its inverse is
rounding alone."""
Complex = NDArray[np.complex128]
Number = TypeVar("Number", np.float64, np.complex128)
Values = Mapping[str, ArrayLike | LtiSystem]
Operand: TypeAlias = "Lft | LtiSystem | ArrayLike | Any"
"""What is added to and multiplied with an uncertain system: another one, a certain one of this
library or of python-control, a matrix or a number."""


@dataclass(frozen=True, eq=False)
class Lft:
    """An uncertain system, or an uncertain matrix if M has no states.

    ``+``, ``-``, ``@``, ``/`` and whole powers make others, and ``*``, which is ``@`` or the
    product with a number or a 1 × 1 system; so do the functions of
    `hillsphere_controllers.linear_fractional.algebra`. Numbers, matrices, `LtiSystem` and systems
    of python-control, on either side, are taken for certain ones. A transfer function of
    python-control refuses to be divided by anything else: write ``G * a**-1`` instead.

    Parameters
    ----------
    system : LtiSystem
        M; its first outputs and inputs belong to Δ, the copies of one uncertainty together.
    uncertainties : tuple of Uncertainty
        Each once.
    times : tuple of int
        Copies of each.

    Raises
    ------
    InputError
        If names are listed twice, copies are too few, or M is too small.
    """

    system: LtiSystem
    uncertainties: tuple[Uncertainty, ...] = ()
    times: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        names = [u.name for u in self.uncertainties]
        if len(set(names)) < len(names):
            raise InputError(f"uncertainties of one name are one: {', '.join(names)}")
        if len(self.times) != len(names) or any(t < 1 for t in self.times):
            raise InputError(f"each uncertainty needs at least one copy, got {self.times}")
        (out, into), (p, m) = self.closed_channels, self.system.shape
        if out > p or into > m:
            raise InputError(f"M is {p} × {m}, but Δ closes {out} outputs and {into} inputs of it")

    # numpy leaves products with Lft to Lft
    __array_ufunc__ = None

    @property
    def closed_channels(self) -> tuple[int, int]:
        """Numbers of outputs and inputs of M that Δ closes."""
        out = sum(t * u.columns for t, u in zip(self.times, self.uncertainties, strict=True))
        return out, sum(t * u.rows for t, u in zip(self.times, self.uncertainties, strict=True))

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of outputs and inputs that are left."""
        (out, into), (p, m) = self.closed_channels, self.system.shape
        return p - out, m - into

    @property
    def size(self) -> int:
        """Inputs of M from Δ, a measure of how costly an analysis is."""
        return self.closed_channels[1]

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Normalised blocks of Δ; every copy of a full block is a block of its own."""
        made: list[Block] = []
        for one, times in zip(self.uncertainties, self.times, strict=True):
            if one.kind == "full":
                made += times * [Block("full", one.rows, one.columns, one.name)]
            else:
                made.append(Block(one.kind, times, times, one.name))
        return tuple(made)

    @property
    def structure(self) -> BlockStructure:
        """Structure of Δ, for the analysis by µ of `system`.

        There, copies of a full block count as independent: bounds from above stay true.

        Raises
        ------
        InputError
            If nothing is uncertain.
        """
        return BlockStructure(self.blocks)

    @property
    def nominal(self) -> LtiSystem:
        """The system for Δ = 0."""
        (out, into), s = self.closed_channels, self.system
        outputs, inputs = s.outputs[out:], s.inputs[into:]
        return LtiSystem(
            s.a, s.b[:, into:], s.c[out:], s.d[out:, into:], s.dt_s, inputs, outputs, s.states
        )

    def deltas(self, values: Values) -> Complex:
        """Return Δ (N, rows, columns) for N values each, see `matrices`; complex."""
        given = self._check_values(values)
        stacks = []
        for one, value in given:
            if isinstance(value, LtiSystem):
                raise InputError("a system takes the place of an uncertainty in `at` only")
            stack = np.asarray(value)
            numbers = "biuf" if one.kind == "real" else "biufc"
            if stack.dtype.kind not in numbers or not np.isfinite(stack).all():
                kind = "real" if one.kind == "real" else ""
                raise InputError(f"{one.name}: finite {kind} numbers are needed, got {value!r}")
            stacks.append(stack[None] if stack.ndim == (2 if one.kind == "full" else 0) else stack)
        count = max([len(s) for s in stacks], default=1)
        columns, rows = self.closed_channels
        made = np.zeros((count, rows, columns), dtype=complex)
        row = column = 0
        for (one, _), stack, times in zip(given, stacks, self.times, strict=True):
            block: NDArray[np.generic]
            if one.kind == "full":
                block = stack
            else:
                scalar = one.normalise(stack) if one.kind == "real" else stack
                block = scalar[:, None, None]
            if block.shape[1:] != (one.rows, one.columns) or len(block) not in (1, count):
                raise InputError(
                    f"{one.name}: values of shape {stack.shape} do not fit {count} samples of "
                    f"{one.rows} × {one.columns}"
                )
            for _ in range(times):
                made[:, row : row + one.rows, column : column + one.columns] = block
                row, column = row + one.rows, column + one.columns
        return made

    def matrices(self, values: Values) -> tuple[Array, Array, Array, Array]:
        """Return A, B, C, D for many values at once.

        Parameters
        ----------
        values : mapping of str to array_like
            Name → values: of a real parameter (N,) in its unit, of a complex number (N,) and of a
            full block (N, rows, columns) normalised and real. One value for all samples may stand
            alone; what is left out is nominal.

        Returns
        -------
        tuple of ndarray
            (N, n, n), (N, n, m), (N, p, n), (N, p, m).

        Raises
        ------
        InputError
            If a name is unknown, values do not fit or are complex, or I − M₁₁ Δ is singular.
        """
        delta = self.deltas(values)
        if delta.imag.any():
            raise InputError("complex values make no real matrices; ask for the response instead")
        m11, m12, m21, m22 = self.parts()
        made = evaluate_upper_lft(m11, m12, m21, m22, delta.real)
        n = self.system.order
        return made[:, :n, :n], made[:, :n, n:], made[:, n:, :n], made[:, n:, n:]

    def at(self, values: Values) -> LtiSystem:
        """Return the system for one value each, which may be a system for a dynamic uncertainty.

        Raises
        ------
        InputError
            As `matrices`.
        """
        if not any(isinstance(value, LtiSystem) for value in values.values()):
            a, b, c, d = self.matrices(values)
            if len(a) != 1:
                raise InputError(f"one value each is needed, got {len(a)}; see matrices")
            plain = self.nominal
            return LtiSystem(
                a[0], b[0], c[0], d[0], self.system.dt_s, plain.inputs, plain.outputs, plain.states
            )
        blocks: list[LtiSystem] = []
        for (one, value), times in zip(self._check_values(values), self.times, strict=True):
            if isinstance(value, LtiSystem):
                if value.shape != (one.rows, one.columns) or not one.dynamic:
                    raise InputError(
                        f"{one.name} is not dynamic, or not {value.shape[0]} × {value.shape[1]}"
                    )
                blocks += times * [value]
            else:
                delta = Lft(gain(np.zeros((one.columns, one.rows))), (one,), (1,)).deltas(
                    {one.name: value}
                )
                if len(delta) != 1 or delta.imag.any():
                    raise InputError(f"{one.name}: one real value is needed")
                blocks += times * [gain(delta[0].real)]
        return upper_lft(self.system, append(*blocks))

    def response(self, omega_rad_s: Array, values: Values) -> Complex:
        """Return frequency responses (N, K, p, m) at K frequencies for N values, see `matrices`.

        Complex values are taken here.
        """
        out, into = self.closed_channels
        m = self.system.response(omega_rad_s)
        delta = self.deltas(values)[:, None]
        return evaluate_upper_lft(
            m[:, :out, :into], m[:, :out, into:], m[:, out:, :into], m[:, out:, into:], delta
        )

    def parts(self) -> tuple[Array, Array, Array, Array]:
        """Return M₁₁ … M₂₂ of the matrix [A B; C D], which Δ closes as it closes the system."""
        (out, into), s = self.closed_channels, self.system
        return (
            s.d[:out, :into],
            np.hstack([s.c[:out], s.d[:out, into:]]),
            np.vstack([s.b[:, :into], s.d[out:, :into]]),
            np.block([[s.a, s.b[:, into:]], [s.c[out:], s.d[out:, into:]]]),
        )

    def with_parts(self, m11: Array, m12: Array, m21: Array, times: Mapping[str, int]) -> Lft:
        """Return the same nominal system with other M₁₁, M₁₂, M₂₁ and numbers of copies.

        An uncertainty without copies is left out.
        """
        n, s = self.system.order, self.nominal
        system = LtiSystem(
            s.a, np.hstack([m21[:n], s.b]), np.vstack([m12[:, :n], s.c]),
            np.block([[m11, m12[:, n:]], [m21[n:], s.d]]), s.dt_s,
        )  # fmt: skip
        kept = tuple(u for u in self.uncertainties if times[u.name])
        return Lft(system, kept, tuple(times[u.name] for u in kept))

    def _check_values(self, values: Values) -> list[tuple[Uncertainty, ArrayLike | LtiSystem]]:
        names = [u.name for u in self.uncertainties]
        for name in values:
            if name not in names:
                raise InputError(
                    f"no uncertainty {name!r}; there are: {', '.join(names) or 'none'}"
                )
        made: list[tuple[Uncertainty, ArrayLike | LtiSystem]] = []
        for one in self.uncertainties:
            none: ArrayLike = one.nominal
            if one.kind != "real":
                none = np.zeros((one.rows, one.columns)) if one.kind == "full" else 0.0
            made.append((one, values.get(one.name, none)))
        return made

    def __add__(self, other: Operand) -> Lft:
        """Return the sum."""
        right = constant(other)
        if right.shape != self.shape:
            raise InputError(f"a sum needs systems of one shape, got {self.shape}, {right.shape}")
        (p, m), zero = self.shape, np.zeros((2 * self.shape[1], 2 * self.shape[0]))
        one, both = np.eye(p), np.eye(m)
        return connect_lfts((self, right), zero, np.vstack([both, both]), np.hstack([one, one]))

    def __radd__(self, other: Operand) -> Lft:
        """Return the sum."""
        return constant(other) + self

    def __neg__(self) -> Lft:
        """Return the negative."""
        return self * -1.0

    def __sub__(self, other: Operand) -> Lft:
        """Return the difference."""
        return self + -constant(other)

    def __rsub__(self, other: Operand) -> Lft:
        """Return the difference."""
        return constant(other) - self

    def __mul__(self, other: Operand) -> Lft:
        """Return the product with a number or a 1 × 1 system, or `self @ other`."""
        factor = _as_number(other)
        if factor is None:
            left, right = _widen(self, constant(other))
            return left @ right
        (p, m) = self.shape
        return connect_lfts((self,), np.zeros((m, p)), np.eye(m), factor * np.eye(p))

    def __rmul__(self, other: Operand) -> Lft:
        """Return the product with a number or a 1 × 1 system, or `other @ self`."""
        factor = _as_number(other)
        return constant(other) * self if factor is None else self * factor

    def __truediv__(self, other: Operand) -> Lft:
        """Return the product with the inverse of the other."""
        divisor = _as_number(other)
        if divisor is None:
            return self * inverse(constant(other))
        if divisor == 0.0:
            raise InputError("an uncertain system is not divided by zero")
        return self * (1.0 / divisor)

    def __rtruediv__(self, other: Operand) -> Lft:
        """Return the other times the inverse."""
        factor = _as_number(other)
        return constant(other) * inverse(self) if factor is None else inverse(self) * factor

    def __pow__(self, power: int) -> Lft:
        """Return a whole power of a square system; a negative one is one of the inverse."""
        p, m = self.shape
        if not isinstance(power, int | np.integer) or p != m:
            raise InputError(
                f"only whole powers of square systems are known, got {power!r} of {p} × {m}"
            )
        factor = self if power >= 0 else inverse(self)
        made = constant(np.eye(p))
        for _ in range(abs(int(power))):
            made = made @ factor
        return made

    def __matmul__(self, other: Operand) -> Lft:
        """Return the product: the outputs of the right LFT are the inputs of the left one."""
        right = constant(other)
        (p, m), (q, k) = self.shape, right.shape
        if m != q:
            raise InputError(f"a product of {p} × {m} and {q} × {k} does not fit")
        feed = np.zeros((m + k, p + q))
        feed[:m, p:] = np.eye(m)
        into = np.vstack([np.zeros((m, k)), np.eye(k)])
        return connect_lfts((self, right), feed, into, np.hstack([np.eye(p), np.zeros((p, q))]))

    def __rmatmul__(self, other: Operand) -> Lft:
        """Return the product."""
        return constant(other) @ self


def constant(given: Operand) -> Lft:
    """Return a system or a matrix as one in which nothing is uncertain; an Lft as it is.

    Parameters
    ----------
    given : Lft, LtiSystem, system of python-control, array_like or float
        The system, matrix or number.

    Returns
    -------
    Lft
        An LFT without blocks.

    Raises
    ------
    InputError
        If it is something else.
    """
    return given if isinstance(given, Lft) else Lft(as_lti(given, "an operand"))


def inverse(of: Lft) -> Lft:
    """Return the inverse, which has as many copies.

    Parameters
    ----------
    of : Lft
        Square.

    Returns
    -------
    Lft
        The inverse.

    Raises
    ------
    InputError
        If the system is not square, or its direct term for Δ = 0 is singular.
    """
    p, m = of.shape
    if p != m:
        raise InputError(f"only a square system has an inverse, got {p} × {m}")
    (out, into), s = of.closed_channels, of.system
    d22 = s.d[out:, into:]
    values = np.linalg.svd(d22, compute_uv=False)
    if p and values[-1] <= _RANK * values[0]:
        raise InputError("the direct term is singular for Δ = 0: there is no proper inverse")
    # u = D22⁻¹ (y − C2 x − D21 w)
    back: Array = np.linalg.inv(d22).astype(float)
    state, delta = -back @ s.c[out:], -back @ s.d[out:, :into]
    b2, d12 = s.b[:, into:], s.d[:out, into:]
    system = LtiSystem(
        s.a + b2 @ state,
        np.hstack([s.b[:, :into] + b2 @ delta, b2 @ back]),
        np.vstack([s.c[:out] + d12 @ state, state]),
        np.block([[s.d[:out, :into] + d12 @ delta, d12 @ back], [delta, back]]),
        s.dt_s,
    )
    return Lft(system, of.uncertainties, of.times)


def _as_number(given: object) -> float | None:
    """Return a real number, also one in an array without dimensions; None for anything else."""
    if isinstance(given, np.ndarray) and given.ndim == 0:
        given = given[()]
    return float(given) if isinstance(given, Real) else None


def _widen(left: Lft, right: Lft) -> tuple[Lft, Lft]:
    """Return two factors of a product, one of them repeated if it is 1 × 1 and does not fit."""
    if left.shape[1] != right.shape[0]:
        if left.shape == (1, 1):
            return _repeat(left, right.shape[0]), right
        if right.shape == (1, 1):
            return left, _repeat(right, left.shape[1])
    return left, right


def _repeat(one: Lft, times: int) -> Lft:
    unit = np.eye(times)
    return connect_lfts((one,) * times, np.zeros((times, times)), unit, unit)


def evaluate_upper_lft(
    m11: NDArray[Number],
    m12: NDArray[Number],
    m21: NDArray[Number],
    m22: NDArray[Number],
    delta: NDArray[Number],
) -> NDArray[Number]:
    """Return the upper LFT F_u(M, Δ) for stacks of Δ.

    Raises
    ------
    InputError
        If I − M₁₁ Δ is singular for one of them.
    """
    loop = np.eye(m11.shape[-2]) - m11 @ delta
    try:
        inside = np.linalg.solve(loop, m12)
    except np.linalg.LinAlgError:
        inside = np.full_like(m12, np.inf)
    if not np.abs(inside).max(initial=0.0) <= _SINGULAR * np.abs(m12).max(initial=0.0):
        raise InputError(
            "the transformation does not exist for one of the values: I − M₁₁ Δ is singular"
        )
    return np.asarray(m22 + m21 @ delta @ inside)


def connect_lfts(parts: Sequence[Lft], feed: Array, into: Array, out: Array) -> Lft:
    """Return the interconnection of uncertain systems.

    With u and y all their inputs and outputs one after the other, the result takes v and gives r:
    u = F y + N v, r = E y. All operations are of this kind.

    Parameters
    ----------
    parts : sequence of Lft
        The systems.
    feed : ndarray, shape (m, p)
        F.
    into : ndarray, shape (m, k)
        N.
    out : ndarray, shape (q, p)
        E.

    Returns
    -------
    Lft
        Copies of one uncertainty stand together, in the order of their first appearance.

    Raises
    ------
    InputError
        If sampling periods differ, the loop is not well posed for Δ = 0, or two different
        uncertainties have one name.
    """
    known: dict[str, Uncertainty] = {}
    rows: dict[str, list[int]] = {}
    columns: dict[str, list[int]] = {}
    outputs: list[int] = []
    inputs: list[int] = []
    row = column = 0
    for part in parts:
        for one, times in zip(part.uncertainties, part.times, strict=True):
            if known.setdefault(one.name, one) != one:
                raise InputError(f"two different uncertainties have the name {one.name!r}")
            rows.setdefault(one.name, []).extend(range(row, row + times * one.columns))
            columns.setdefault(one.name, []).extend(range(column, column + times * one.rows))
            row, column = row + times * one.columns, column + times * one.rows
        p, m = part.shape
        outputs.extend(range(row, row + p))
        inputs.extend(range(column, column + m))
        row, column = row + p, column + m
    # close the connections first; Δ stays outside as inputs and outputs
    made = connect_inside([part.system for part in parts], inputs, outputs, feed)
    # then bring the copies of each uncertainty together
    first = [i for name in known for i in columns[name]]
    last = [i for name in known for i in rows[name]]
    b = np.hstack([made.b[:, first], made.b[:, inputs] @ into])
    c = np.vstack([made.c[last], out @ made.c[outputs]])
    d = np.block(
        [
            [made.d[np.ix_(last, first)], made.d[np.ix_(last, inputs)] @ into],
            [out @ made.d[np.ix_(outputs, first)], out @ made.d[np.ix_(outputs, inputs)] @ into],
        ]
    )
    copies = tuple(len(columns[name]) // one.rows for name, one in known.items())
    return Lft(LtiSystem(made.a, b, c, d, made.dt_s), tuple(known.values()), copies)
