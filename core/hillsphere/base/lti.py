r"""Linear time-invariant systems in state space, and their arithmetic.

.. math::

    \dot x = A x + B u, \quad y = C x + D u

in continuous time; in discrete time :math:`x_{k+1}` stands for :math:`\dot x`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError

__all__ = ["LtiSystem", "indices_of", "real_matrix"]

Complex = NDArray[np.complex128]
Selection: TypeAlias = int | slice | str | Sequence[int] | Sequence[str]
"""Outputs or inputs: index, slice, name, or several indices or names."""
_NAMED = 4
"""Names of signals in a `repr` at most: more do not fit one line."""


@dataclass(frozen=True, eq=False, repr=False)
class LtiSystem:
    """A system of order n with m inputs and p outputs.

    ``G2 @ G1`` and ``G2 * G1`` are the series connection in the order of matrices: G1 acts first.
    ``G1 + G2`` and ``G1 - G2`` are the parallel connections and ``-G`` the negative. A matrix is a
    constant gain. A number is a factor in a product; in a sum it is the gain of a system of one
    input and one output. ``G[outputs, inputs]`` is a part and ``G(s)`` the transfer matrix at s.

    Parameters
    ----------
    a, b, c, d : ndarray, shape (n, n), (n, m), (p, n), (p, m)
        Its matrices, real; n may be zero.
    dt_s : float or None
        Sampling period, s; None in continuous time.
    inputs, outputs, states : tuple of str
        Names of the signals, all different; by default signals have no names.

    Raises
    ------
    InputError
        If the shapes do not match, an entry is not finite, or the names are not one per signal and
        all different.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    dt_s: float | None = None
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    states: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        matrices = {}
        for name in ("a", "b", "c", "d"):
            matrix = real_matrix(getattr(self, name), name.upper())
            matrices[name] = matrix
            object.__setattr__(self, name, matrix)
        (p, m), n = matrices["d"].shape, len(matrices["a"])
        wanted = {"a": (n, n), "b": (n, m), "c": (p, n), "d": (p, m)}
        for name, shape in wanted.items():
            if matrices[name].shape != shape:
                raise InputError(
                    f"{name.upper()} must be {shape[0]} × {shape[1]} to fit the others, got "
                    f"{matrices[name].shape[0]} × {matrices[name].shape[1]}"
                )
        if self.dt_s is not None and not (
            isinstance(self.dt_s, Real) and np.isfinite(self.dt_s) and self.dt_s > 0.0
        ):
            raise InputError(f"a sampling period must be a number > 0 s, got {self.dt_s!r}")
        for what, names, count in (
            ("inputs", self.inputs, m), ("outputs", self.outputs, p), ("states", self.states, n),
        ):  # fmt: skip
            if isinstance(names, str):
                raise InputError(f"{what}: a tuple of names is needed, got the text {names!r}")
            object.__setattr__(self, what, tuple(names))
            if names and (len(names) != count or len(set(names)) < count):
                raise InputError(f"{what}: {count} different names are needed, got {names}")

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.a)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of outputs and inputs, p and m."""
        return self.d.shape[0], self.d.shape[1]

    @property
    def poles(self) -> Complex:
        """Eigenvalues of A (n,), 1/s in continuous time."""
        return np.asarray(np.linalg.eigvals(self.a), dtype=complex)

    @property
    def is_stable(self) -> bool:
        """Whether all poles lie in the open left half-plane, or in the open unit disc."""
        if self.order == 0:
            return True
        if self.dt_s is None:
            return bool(self.poles.real.max() < 0.0)
        return bool(np.abs(self.poles).max() < 1.0)

    def response(self, omega_rad_s: Array) -> Complex:
        """Return the frequency response.

        Parameters
        ----------
        omega_rad_s : ndarray, shape (K,)
            Frequencies; infinite ones give D in continuous time.

        Returns
        -------
        ndarray, shape (K, p, m)
            C (s I − A)⁻¹ B + D at s = jω, or at exp(jω dt).

        Raises
        ------
        InputError
            If a frequency is no real number, is infinite in discrete time, or is that of a pole.
        """
        if np.iscomplexobj(omega_rad_s):
            raise InputError("frequencies must be real, in rad/s; s = jω is made of them")
        omega = np.atleast_1d(np.asarray(omega_rad_s, dtype=float))
        if omega.ndim != 1 or np.isnan(omega).any():
            raise InputError(f"frequencies must be one row of numbers, got {omega}")
        if self.dt_s is not None and np.isinf(omega).any():
            raise InputError("in discrete time the response has no value at infinite frequency")
        if self.dt_s is not None:
            return self(np.exp(1j * omega * self.dt_s))
        s = np.zeros(omega.size, dtype=complex)
        s.imag = omega  # a product with 1j would make NaN of infinite frequencies
        return self(s)

    def __call__(self, s: complex | ArrayLike) -> Complex:
        """Return the transfer matrix at complex frequencies.

        Parameters
        ----------
        s : complex or array_like, shape (...)
            Frequencies, 1/s; the values of z in discrete time. An infinite one gives D.

        Returns
        -------
        ndarray, shape (..., p, m)
            C (s I − A)⁻¹ B + D, so (p, m) for a number s.

        Raises
        ------
        InputError
            If s is not a number or is a pole.
        """
        at = np.asarray(s)
        if at.dtype.kind not in "biufc" or np.isnan(at).any():
            raise InputError(f"a transfer matrix is evaluated at complex numbers, got {s!r}")
        made = np.empty((*at.shape, *self.shape), dtype=complex)
        made[...] = self.d
        there = np.isfinite(at)
        if self.order == 0 or not there.any():
            return made
        away = at[there].astype(complex)[:, None, None] * np.eye(self.order) - self.a
        try:
            made[there] += self.c @ np.linalg.solve(away, self.b + 0j)
        except np.linalg.LinAlgError:
            raise InputError(
                "a frequency is that of a pole, where the response is infinite; choose another "
                "frequency"
            ) from None
        return made

    def __repr__(self) -> str:
        """Return one line: order, signals, sampling, unstable poles."""
        (p, m), n = self.shape, self.order
        signals = [
            _count(count, what) + (f" ({', '.join(names)})" if 0 < len(names) <= _NAMED else "")
            for count, what, names in ((m, "input", self.inputs), (p, "output", self.outputs))
        ]
        time = "continuous time" if self.dt_s is None else f"sampled every {self.dt_s:g} s"
        poles = self.poles
        bad = poles.real >= 0.0 if self.dt_s is None else np.abs(poles) >= 1.0
        judged = f"{_count(int(bad.sum()), 'pole')} not stable" if bad.any() else "stable"
        return f"<LtiSystem: {_count(n, 'state')}, {', '.join(signals)}, {time}, {judged}>"

    # numpy leaves sums and products with a system to the system
    __array_ufunc__ = None

    def __matmul__(self, other: LtiSystem | ArrayLike) -> LtiSystem:
        """Return the series connection, `other` first."""
        right = self._operand(other)
        if right is None:
            return NotImplemented
        if self.shape[1] != right.shape[0]:
            raise InputError(
                f"in series: {right.shape[0]} outputs into {self.shape[1]} inputs do not fit"
            )
        dt_s = _common_period(self, right)
        return LtiSystem(
            np.block([[right.a, np.zeros((right.order, self.order))], [self.b @ right.c, self.a]]),
            np.vstack([right.b, self.b @ right.d]),
            np.hstack([self.d @ right.c, self.c]),
            self.d @ right.d,
            dt_s,
            right.inputs,
            self.outputs,
        )

    def __rmatmul__(self, other: ArrayLike) -> LtiSystem:
        """Return the series connection, `self` first."""
        left = self._operand(other)
        return NotImplemented if left is None else left @ self

    def __mul__(self, other: LtiSystem | ArrayLike) -> LtiSystem:
        """Return the series connection, `other` first, or the product with a number."""
        if _is_number(other):
            factor = float(other)  # type: ignore[arg-type]
            return replace(self, c=factor * self.c, d=factor * self.d)
        return self @ other

    def __rmul__(self, other: ArrayLike) -> LtiSystem:
        """Return the series connection, `self` first, or the product with a number."""
        return self * other if _is_number(other) else other @ self

    def __truediv__(self, number: float) -> LtiSystem:
        """Return the system divided by a number."""
        return self * (1.0 / number) if _is_number(number) else NotImplemented

    def __neg__(self) -> LtiSystem:
        """Return the negative."""
        return self * -1.0

    def __add__(self, other: LtiSystem | ArrayLike) -> LtiSystem:
        """Return the parallel connection."""
        right = self._operand(other)
        if right is None:
            return NotImplemented
        if right.shape != self.shape:
            shapes = sorted({self.shape, right.shape})
            raise InputError(f"a sum needs systems of one shape, got {shapes}")
        return LtiSystem(
            np.block(
                [
                    [self.a, np.zeros((self.order, right.order))],
                    [np.zeros((right.order, self.order)), right.a],
                ]
            ),
            np.vstack([self.b, right.b]),
            np.hstack([self.c, right.c]),
            self.d + right.d,
            _common_period(self, right),
            self.inputs or right.inputs,
            self.outputs or right.outputs,
        )

    __radd__ = __add__

    def __sub__(self, other: LtiSystem | ArrayLike) -> LtiSystem:
        """Return the parallel connection with the negative of the other."""
        right = self._operand(other)
        return NotImplemented if right is None else self + -right

    def __rsub__(self, other: ArrayLike) -> LtiSystem:
        """Return the parallel connection of the other with the negative."""
        return -self + other

    def __getitem__(self, part: tuple[Selection, Selection]) -> LtiSystem:
        """Return the part from some inputs to some outputs, ``G[outputs, inputs]``.

        Parameters
        ----------
        part : tuple
            Outputs and inputs: an index, a slice, a name, or a sequence of indices or names. The
            states stay.

        Raises
        ------
        InputError
            If a name or an index is unknown, or there are not two of them.
        """
        if not isinstance(part, tuple) or len(part) != 2:
            raise InputError(
                "a part of a system is named by outputs and inputs: G[outputs, inputs]"
            )
        rows = _select(part[0], self.shape[0], self.outputs, "output")
        columns = _select(part[1], self.shape[1], self.inputs, "input")
        return replace(
            self, b=self.b[:, columns], c=self.c[rows], d=self.d[np.ix_(rows, columns)],
            inputs=tuple(self.inputs[i] for i in columns) if self.inputs else (),
            outputs=tuple(self.outputs[i] for i in rows) if self.outputs else (),
        )  # fmt: skip

    def _operand(self, other: object) -> LtiSystem | None:
        """Return a system, matrix or number as a system; None if it is something else."""
        if isinstance(other, LtiSystem):
            return other
        if _is_number(other):
            if self.shape != (1, 1):
                raise InputError(
                    f"a number is no term of a sum of {self.shape[0]} × {self.shape[1]} systems; "
                    "write the matrix, k * np.eye(n) for k I"
                )
            other = [[other]]
        if not isinstance(other, np.ndarray | list | tuple):
            return None
        d = real_matrix(other, "a gain")
        p, m = d.shape
        return LtiSystem(np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)), d, self.dt_s)

    def of(self, outputs: Sequence[str], inputs: Sequence[str]) -> LtiSystem:
        """Return the subsystem from some inputs to some outputs, by name, in the order given.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        rows, columns = (
            indices_of(self.outputs, outputs, "output"),
            indices_of(self.inputs, inputs, "input"),
        )
        return replace(
            self, b=self.b[:, columns], c=self.c[rows], d=self.d[np.ix_(rows, columns)],
            inputs=tuple(inputs), outputs=tuple(outputs),
        )  # fmt: skip


def _is_number(given: object) -> bool:
    return isinstance(given, Real) or (isinstance(given, np.ndarray) and given.ndim == 0)


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _common_period(one: LtiSystem, other: LtiSystem) -> float | None:
    """Return the sampling period of two systems; a constant gain has that of the other."""
    periods = {s.dt_s for s in (one, other) if s.order or s.dt_s is not None}
    if len(periods) > 1:
        raise InputError(f"systems of different sampling periods do not connect: {periods}")
    return next(iter(periods), None)


def _select(chosen: Selection, count: int, names: tuple[str, ...], what: str) -> list[int]:
    """Return the indices of outputs or inputs."""
    if isinstance(chosen, slice):
        return list(range(count))[chosen]
    several = not isinstance(chosen, str | int | np.integer)
    wanted: list[int | str] = list(chosen) if several else [chosen]  # type: ignore[arg-type,list-item]
    places = []
    for one in wanted:
        if isinstance(one, str):
            places += indices_of(names, [one], what)
        elif not isinstance(one, bool) and -count <= one < count:
            places.append(int(one) % count)
        else:
            raise InputError(f"no {what} {one!r}; there are {count}, numbered from 0")
    return places


def real_matrix(given: object, name: str) -> Array:
    """Return a copy of a matrix; `InputError` unless it is a matrix of finite real numbers.

    Parameters
    ----------
    given : object
        Nested sequences of numbers, or an array.
    name : str
        Name of the matrix, for the message.

    Returns
    -------
    ndarray, shape (p, m)
        The copy.

    Raises
    ------
    InputError
        If it is no matrix of finite real numbers.
    """
    try:
        matrix = np.array(given)
    except ValueError:
        raise InputError(f"{name} must be a matrix, got rows of different lengths") from None
    if matrix.dtype.kind not in "biuf":
        kind = "complex ones" if matrix.dtype.kind == "c" else "others, or too large ones"
        raise InputError(f"{name} must be a matrix of real numbers, got {kind}")
    if matrix.ndim != 2 or not np.isfinite(matrix).all():
        raise InputError(
            f"{name} must be a matrix of finite numbers, got shape {matrix.shape}"
            + ("" if matrix.ndim != 2 else " with nan or inf")
        )
    return matrix.astype(float)


def indices_of(known: Sequence[str], wanted: Sequence[str], what: str) -> list[int]:
    """Return the indices of names among the known ones; `InputError` if one is unknown.

    Parameters
    ----------
    known : sequence of str
        Names in their order.
    wanted : sequence of str
        Names to be found.
    what : str
        What they name, for the message.

    Returns
    -------
    list of int
        Place of each wanted name.

    Raises
    ------
    InputError
        If a name is unknown; the message gives the nearest one.
    """
    places = []
    for name in wanted:
        if name not in known:
            raise InputError(f"no {what} {name!r}; there are: {', '.join(known) or 'no names'}")
        places.append(list(known).index(name))
    return places
