"""What plugs into the loop beside plant and compensator: one small Protocol per role.

All act on arrays of N lanes, lane by lane, and keep nothing between calls. The loop hands them
blocks of 64 lanes; noise arrives as standard normal numbers that were drawn per case, so that
no case depends on its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.contracts import Contract
from hillsphere.base.errors import InputError
from hillsphere.interfaces.quantities import Variable
from hillsphere.symbolic.expressions import Expr

__all__ = ["Actuator", "CommandSteps", "ContinuousLaw", "KnownPoles", "Navigation", "Reference"]


class Navigation(Protocol):
    """From the true states to what the law sees: errors, or sensors and an estimator.

    Its memory (an error, a belief) is any object, which the loop carries from sample to sample.
    """

    @property
    def noise(self) -> int:
        """Standard normal numbers per case: as many at the start, as many at each sample."""
        ...

    def initial(self, t_s: Array, x: Array, w: Array) -> Any:
        """Return the memory before the first sample.

        t_s (N,), x the true states (n, N), SI, w (noise, N).
        """
        ...

    def observe(
        self, k: int, t_s: Array, x: Array, u: Array, w: Array, memory: Any
    ) -> tuple[Array, Any]:
        """Return y (q, N), SI, and the memory after sample k.

        u (p, N) is what the law commanded at the sample before (zero at the first, and for a
        continuous law its command there), w (noise, N) is new at each sample.
        """
        ...


@dataclass(frozen=True)
class CommandSteps:
    """A command that changes between two samples, in steps.

    Parameters
    ----------
    shares : ndarray, shape (J,)
        What part of the period each step lasts, in their order; their sum is one.
    u : ndarray, shape (J, p, N) or (J, p, 1)
        The command of each, SI.
    """

    shares: Array
    u: Array

    def __post_init__(self) -> None:
        fits = self.shares.shape == (len(self.u),) and self.u.ndim == 3
        if not fits or not (self.shares > 0).all() or abs(self.shares.sum() - 1.0) > 1e-9:
            raise InputError(
                f"steps of a command need shares (J,) above zero whose sum is one, and u "
                f"(J, p, N); got {self.shares.tolist()} and {self.u.shape}"
            )

    def mean(self) -> Array:
        """Return the mean over the period, (p, N) or (p, 1)."""
        return np.asarray(np.tensordot(self.shares, self.u, axes=1))


@runtime_checkable
class Reference(Contract, Protocol):
    """What the law should see, and what it is told to do besides."""

    def at(self, k: int, t_s: Array, y: Array, cases: Integers) -> Array:
        """Return the reference (q, N), SI, at sample k.

        t_s (N,) is the time, y (q, N) what the navigation gives, cases (N,) the numbers of the
        cases, integers, with which a reference of its own for each case is looked up.
        """
        ...

    def feedforward(self, k: int, t_s: Array, cases: Integers) -> Array | CommandSteps | None:
        """Return what is added to the law's command from sample k on, or None.

        (p, N) or (p, 1), held until the next sample; or in steps, for laws that do not command
        impulses.
        """
        ...


class Actuator(Protocol):
    """From what is commanded to what is done."""

    @property
    def noise(self) -> int:
        """Standard normal numbers per case and sample."""
        ...

    def execute(self, u: Array, w: Array) -> Array:
        """Return what is done (p, N) for the command u (p, N), with w (noise, N)."""
        ...


@runtime_checkable
class ContinuousLaw(Contract, Protocol):
    """A law that acts between samples: its equations are compiled with those of the plant.

    Its states ẋ_c = f(x_c, y, r, t) join those of the plant, and its command u = g(x_c, y, r, t)
    stands in the plant's equations. Sub-steps must be short beside its fastest pole λ: on the real
    axis the step map is stable up to |λ| h = 2.85 (rk6) and 6.39 (dop853), and follows the decay
    to 1e-3 up to 1.07 and 3.5; a filter of 0.05 Hz asks for h ≤ 3.4 s and 11 s. `Simulator`
    refuses longer ones of a law that tells its poles (`KnownPoles`).
    """

    @property
    def period_s(self) -> float:
        """Time between two samples: then y and ref are renewed, and `sample` is called."""
        ...

    @property
    def measurement(self) -> Literal["held", "continuous"]:
        """Whether y is held between samples or is the plant's true states at every instant."""
        ...

    @property
    def inputs(self) -> int:
        """Number q of rows of y and ref; for ``"continuous"`` that of the plant's states."""
        ...

    @property
    def states(self) -> tuple[Variable, ...]:
        """The law's own states, of names that the plant does not use; may be none."""
        ...

    def initial(self, n_cases: int) -> Array:
        """Return the law's own states (m, N) before the first sample, SI."""
        ...

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        """Return the law's states (m, N) after sample k; `xc` itself if a sample changes none.

        An observer puts its corrected estimate in place here.
        """
        ...

    def derivative(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return dx_c/dt, one per state."""
        ...

    def control(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return the command u, one per control of the plant, SI."""
        ...


@runtime_checkable
class KnownPoles(Contract, Protocol):
    """A `ContinuousLaw` that can say how short its sub-steps must be."""

    @property
    def fastest_rad_s(self) -> float:
        """Size of the fastest pole of its own equations, 1/s; zero without states."""
        ...
