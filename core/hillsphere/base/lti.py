r"""Linear time-invariant systems in state space.

.. math::

    \dot x = A x + B u, \quad y = C x + D u

in continuous time; in discrete time :math:`x_{k+1}` stands for :math:`\dot x`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError

__all__ = ["LtiSystem", "indices_of", "real_matrix"]

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class LtiSystem:
    """A system of order n with m inputs and p outputs.

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
        made = np.empty((omega.size, *self.shape), dtype=complex)
        made[:] = self.d
        if self.order == 0:
            return made
        there = np.isfinite(omega)
        s = 1j * omega[there] if self.dt_s is None else np.exp(1j * omega[there] * self.dt_s)
        away = s[:, None, None] * np.eye(self.order) - self.a
        try:
            made[there] += self.c @ np.linalg.solve(away, self.b + 0j)
        except np.linalg.LinAlgError:
            raise InputError(
                "a frequency is that of a pole on the stability boundary, where the response is "
                "infinite; choose another frequency"
            ) from None
        return made

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


def real_matrix(given: object, name: str) -> Array:
    """Return a copy of a matrix; `InputError` unless it is a matrix of finite real numbers."""
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
    """Return the indices of names among the known ones; `InputError` if one is unknown."""
    places = []
    for name in wanted:
        if name not in known:
            raise InputError(f"no {what} {name!r}; there are: {', '.join(known) or 'no names'}")
        places.append(list(known).index(name))
    return places
