r"""Linear systems with delays: an LTI system whose last outputs return, late, to its last inputs.

.. math::

    \begin{bmatrix} y \\ z \end{bmatrix} = M(s) \begin{bmatrix} u \\ w \end{bmatrix}, \quad
    w_i = e^{-s T_i} z_i, \qquad
    G = M_{11} + M_{12} E (I - M_{22} E)^{-1} M_{21}, \quad E = \operatorname{diag}(e^{-s T_i})

[1]_. Sums, products and feedback of such systems are again of this form: their M are connected and
the delays stay apart, so that nothing is approximated.

References
----------
.. [1] P. Gumussoy, B. Eryilmaz, P. Gahinet (2012), Working with time-delay systems in MATLAB, IFAC
   Proceedings Volumes 45(14), 108-113.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.algebra import close_with_gain, connect_inside
from hillsphere_controllers.systems.conversion import as_lti

__all__ = ["DelayOperand", "DelaySystem", "as_delay_system", "connect_delay_systems"]

Complex = NDArray[np.complex128]
Selection: TypeAlias = int | slice | str | Sequence[int] | Sequence[str]
DelayOperand: TypeAlias = "DelaySystem | LtiSystem | ArrayLike"
"""What a system with delays is added to and multiplied with: another one, one without delays of
this library or of python-control, a matrix or a number."""
_CHUNK = 4_000_000
"""Complex entries of matrices that are solved at once: 64 MB, for any number of frequencies."""


@dataclass(frozen=True, eq=False, repr=False)
class DelaySystem:
    """A system in continuous time with internal delays.

    ``G2 @ G1``, ``G2 * G1``, ``G1 + G2``, ``-G``, ``G[outputs, inputs]`` and ``G(s)`` are those of
    `hillsphere.lti.LtiSystem`, with systems of either kind, matrices and numbers on either side.

    Parameters
    ----------
    system : LtiSystem
        M, whose last inputs are the delayed values of its last outputs.
    delays_s : sequence of float
        Length of each delay, s, > 0: q of them.

    Raises
    ------
    InputError
        If M is in discrete time, a delay is not positive and finite, or M has too few signals.
    """

    system: LtiSystem
    delays_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.system, LtiSystem):
            raise InputError(f"an LtiSystem is needed, got {type(self.system).__name__}")
        if self.system.dt_s is not None:
            raise InputError(
                "delays are those of continuous time; in discrete time a delay of k periods is a "
                "chain of k states: `zero_order_hold(G, dt_s, delay_s)` makes such"
            )
        given = np.atleast_1d(np.asarray(self.delays_s))
        if given.ndim != 1 or (given.size and given.dtype.kind not in "iuf"):
            raise InputError(f"delays_s must be a row of numbers, s, got {self.delays_s!r}")
        for one in given.tolist():
            if not (np.isfinite(one) and one > 0.0):
                raise InputError(
                    f"a delay must be > 0 s and finite, got {one}; close a loop without delay by "
                    "close_with_gain"
                )
        object.__setattr__(self, "delays_s", tuple(float(one) for one in given))
        p, m = self.system.shape
        if len(self.delays_s) > min(p, m):
            raise InputError(
                f"{len(self.delays_s)} delays need as many outputs and inputs of the system, which "
                f"is {p} × {m}"
            )

    # numpy leaves sums and products with a system to the system
    __array_ufunc__ = None

    @property
    def order(self) -> int:
        """States of M; the delays have infinitely many besides."""
        return self.system.order

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of outputs and inputs that no delay closes."""
        (p, m), q = self.system.shape, len(self.delays_s)
        return p - q, m - q

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs; empty without names."""
        return self.system.inputs[: self.shape[1]]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs; empty without names."""
        return self.system.outputs[: self.shape[0]]

    @property
    def undelayed(self) -> LtiSystem:
        """The system with all delays zero.

        Raises
        ------
        InputError
            If its loops are not well posed without the delays.
        """
        (p, m), q = self.shape, len(self.delays_s)
        back = np.zeros((m + q, p + q))
        back[m:, p:] = np.eye(q)
        return close_with_gain(self.system, back)[:p, :m]

    def response(self, omega_rad_s: Array) -> Complex:
        """Return the exact frequency response.

        Parameters
        ----------
        omega_rad_s : ndarray, shape (K,)
            Frequencies, rad/s; infinite ones only where no delay joins an input to an output
            without a state between them.

        Returns
        -------
        ndarray, shape (K, p, m)
            G(jω).

        Raises
        ------
        InputError
            If a frequency is no real number or that of a pole, or there is no limit at infinity.
        """
        if np.iscomplexobj(omega_rad_s):
            raise InputError("frequencies must be real, in rad/s; s = jω is made of them")
        omega = np.atleast_1d(np.asarray(omega_rad_s, dtype=float))
        if omega.ndim != 1 or np.isnan(omega).any():
            raise InputError(f"frequencies must be one row of numbers, got {omega}")
        s = np.zeros(omega.size, dtype=complex)
        s.imag = omega
        return self(s)

    def __call__(self, s: complex | ArrayLike) -> Complex:
        """Return the transfer matrix at complex frequencies.

        Parameters
        ----------
        s : complex or array_like, shape (...)
            Frequencies, 1/s.

        Returns
        -------
        ndarray, shape (..., p, m)
            G(s), so (p, m) for a number s.

        Raises
        ------
        InputError
            As `response`.
        """
        at = np.asarray(s)
        if at.dtype.kind not in "biufc" or np.isnan(at).any():
            raise InputError(f"a transfer matrix is evaluated at complex numbers, got {s!r}")
        made = np.empty((*at.shape, *self.shape), dtype=complex)
        there = np.isfinite(at)
        if not there.all():
            made[~there] = self._limit()
        points = at[there].astype(complex)
        size = max(1, _CHUNK // max(1, (self.order + len(self.delays_s)) ** 2))
        parts = [self._evaluate(points[k : k + size]) for k in range(0, points.size, size)]
        if parts:
            made[there] = np.concatenate(parts)
        return made

    def _evaluate(self, s: Complex) -> Complex:
        """Return G at finite s (K,): x and z are solved together, so poles of M are no poles."""
        (p, m), n, q = self.shape, self.order, len(self.delays_s)
        a, b, c, d = self.system.a, self.system.b, self.system.c, self.system.d
        with np.errstate(over="ignore", invalid="ignore"):
            late = np.exp(-s[:, None] * np.array(self.delays_s))
            pencil = np.empty((s.size, n + q, n + q), dtype=complex)
            pencil[:, :n, :n] = s[:, None, None] * np.eye(n) - a
            pencil[:, :n, n:] = -b[:, m:] * late[:, None, :]
            pencil[:, n:, :n] = -c[p:]
            pencil[:, n:, n:] = np.eye(q) - d[p:, m:] * late[:, None, :]
        if not np.isfinite(pencil).all():
            raise InputError("e^{-sT} is no number so far to the left: choose a larger real part")
        try:
            inside = np.linalg.solve(pencil, np.vstack([b[:, :m], d[p:, :m]]) + 0j)
        except np.linalg.LinAlgError:
            raise InputError(
                "a frequency is that of a pole, where the response is infinite; choose another "
                "frequency"
            ) from None
        out = np.empty((s.size, p, n + q), dtype=complex)
        out[:, :, :n] = c[:p]
        out[:, :, n:] = d[:p, m:] * late[:, None, :]
        return np.asarray(d[:p, :m] + out @ inside)

    def _limit(self) -> Array:
        """Return G at infinity."""
        p, m = self.shape
        if self.system.d[:p, m:].any() and self.system.d[p:, :m].any():
            raise InputError(
                "the response has no limit at infinite frequency: a delay joins an input to an "
                "output without a state between them"
            )
        return self.system.d[:p, :m]

    def __repr__(self) -> str:
        """Return one line: order, signals, delays. Stability is a question of its own."""
        (p, m), n = self.shape, self.order
        late = ", ".join(f"{one:g}" for one in self.delays_s)
        return f"<DelaySystem: {n} states, {m} inputs, {p} outputs, delays ({late}) s>"

    def __matmul__(self, other: DelayOperand) -> DelaySystem:
        """Return the series connection, `other` first."""
        right = as_delay_system(other)
        (p, m), (r, k) = self.shape, right.shape
        if m != r:
            raise InputError(f"in series: {r} outputs into {m} inputs do not fit")
        feed = np.zeros((m + k, p + r))
        feed[:m, p:] = np.eye(m)
        into, out = np.vstack([np.zeros((m, k)), np.eye(k)]), np.eye(p, p + r)
        names = right.inputs, self.outputs
        return connect_delay_systems((self, right), feed, into, out, *names)

    def __rmatmul__(self, other: DelayOperand) -> DelaySystem:
        """Return the series connection, `self` first."""
        return as_delay_system(other) @ self

    def __mul__(self, other: DelayOperand) -> DelaySystem:
        """Return the series connection, `other` first, or the product with a number."""
        if not _is_number(other):
            return self @ other
        p, s, factor = self.shape[0], self.system, float(other)  # type: ignore[arg-type]
        scale = np.ones((len(s.c), 1))
        scale[:p] = factor
        return replace(self, system=replace(s, c=scale * s.c, d=scale * s.d))

    def __rmul__(self, other: DelayOperand) -> DelaySystem:
        """Return the series connection, `self` first, or the product with a number."""
        return self * other if _is_number(other) else as_delay_system(other) @ self

    def __truediv__(self, number: float) -> DelaySystem:
        """Return the system divided by a number."""
        return self * (1.0 / number) if _is_number(number) else NotImplemented

    def __neg__(self) -> DelaySystem:
        """Return the negative."""
        return self * -1.0

    def __add__(self, other: DelayOperand) -> DelaySystem:
        """Return the parallel connection; a number is a system of one input and one output."""
        right = as_delay_system(other)
        if right.shape != self.shape:
            raise InputError(f"a sum needs systems of one shape, got {self.shape}, {right.shape}")
        p, m = self.shape
        return connect_delay_systems(
            (self, right), np.zeros((2 * m, 2 * p)), np.vstack([np.eye(m)] * 2),
            np.hstack([np.eye(p)] * 2), self.inputs or right.inputs, self.outputs or right.outputs,
        )  # fmt: skip

    __radd__ = __add__

    def __sub__(self, other: DelayOperand) -> DelaySystem:
        """Return the parallel connection with the negative of the other."""
        return self + -as_delay_system(other)

    def __rsub__(self, other: DelayOperand) -> DelaySystem:
        """Return the parallel connection of the other with the negative."""
        return -self + other

    def __getitem__(self, part: tuple[Selection, Selection]) -> DelaySystem:
        """Return the part from some inputs to some outputs, ``G[outputs, inputs]``.

        Raises
        ------
        InputError
            If a name or an index is unknown, or there are not two of them.
        """
        (p, m), q = self.shape, len(self.delays_s)
        # the places of the outer signals, by the rules of LtiSystem
        numbers = LtiSystem(
            np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)),
            np.arange(float(p * m)).reshape(p, m), inputs=self.inputs, outputs=self.outputs,
        )[part].d.astype(int)  # fmt: skip
        rows = [*(numbers[:, 0] // m if numbers.size else []), *range(p, p + q)]
        columns = [*(numbers[0] % m if numbers.size else []), *range(m, m + q)]
        return replace(self, system=self.system[rows, columns])


def as_delay_system(given: object, what: str = "the system") -> DelaySystem:
    """Return a system, with or without delays, a matrix or a number as a `DelaySystem`.

    Parameters
    ----------
    given : DelaySystem, LtiSystem, system of python-control, array_like or float
        The system; one without delays has none afterwards either.
    what : str
        What it is, for messages.

    Returns
    -------
    DelaySystem
        The system.

    Raises
    ------
    InputError
        If it is something else, or in discrete time.
    """
    return given if isinstance(given, DelaySystem) else DelaySystem(as_lti(given, what), ())


def connect_delay_systems(
    parts: Sequence[DelaySystem],
    feed: Array,
    into: Array,
    out: Array,
    inputs: tuple[str, ...] = (),
    outputs: tuple[str, ...] = (),
) -> DelaySystem:
    """Return the interconnection of systems with delays, exactly.

    With u and y all their inputs and outputs one after the other, the result takes v and gives r:
    u = F y + N v, r = E y. All operations are of this kind.

    Parameters
    ----------
    parts : sequence of DelaySystem
        The systems.
    feed : ndarray, shape (m, p)
        F.
    into : ndarray, shape (m, k)
        N.
    out : ndarray, shape (r, p)
        E.
    inputs, outputs : tuple of str
        Names of the signals of the result.

    Returns
    -------
    DelaySystem
        Its states and delays are those of the systems, in their order.

    Raises
    ------
    InputError
        If the loops that no delay interrupts are not well posed.
    """
    ends, starts = list[int](), list[int]()
    late_out, late_in = list[int](), list[int]()
    row = column = 0
    for part in parts:
        (p, m), q = part.shape, len(part.delays_s)
        ends += range(row, row + p)
        late_out += range(row + p, row + p + q)
        starts += range(column, column + m)
        late_in += range(column + m, column + m + q)
        row, column = row + p + q, column + m + q
    closed = connect_inside([part.system for part in parts], starts, ends, feed)
    q = len(late_in)
    left = np.zeros((len(out) + q, row))
    left[: len(out), ends] = out
    left[len(out) :, late_out] = np.eye(q)
    right = np.zeros((column, into.shape[1] + q))
    right[starts, : into.shape[1]] = into
    right[late_in, into.shape[1] :] = np.eye(q)
    made = LtiSystem(
        closed.a, closed.b @ right, left @ closed.c, left @ closed.d @ right, None,
        _extend_names(inputs, q, "late"), _extend_names(outputs, q, "to delay"),
    )  # fmt: skip
    return DelaySystem(made, tuple(one for part in parts for one in part.delays_s))


def _extend_names(names: tuple[str, ...], count: int, what: str) -> tuple[str, ...]:
    """Return names for all signals of M, those at the delays numbered; none without names."""
    return (*names, *(f"{what} {k + 1}" for k in range(count))) if names else ()


def _is_number(given: object) -> bool:
    return isinstance(given, Real) or (isinstance(given, np.ndarray) and given.ndim == 0)
