"""Parts of the control loop besides plant and compensator: one small Protocol per role.

All act on arrays of N lanes, lane by lane, and keep no state between calls. The loop passes blocks
of 64 lanes. Noise is passed in as standard normal numbers drawn per case, so that no case depends
on its neighbours.
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

__all__ = [
    "Actuator",
    "CommandSteps",
    "ContinuousLaw",
    "JointLaw",
    "KnownPoles",
    "Navigation",
    "Reference",
]


class Navigation(Protocol):
    """Navigation: from the true states to the law's input, by an error model or an estimator.

    Its memory (an error, a belief) is any object, which the loop passes from sample to sample.
    """

    @property
    def noise(self) -> int:
        """Numbers of standard normal numbers per case: at the start, and at each sample."""
        ...

    def initial(self, t_s: Array, x: Array, w: Array) -> Any:
        """Return the memory before the first sample.

        t_s (N,), x the true states (n, N), SI, w (noise, N).
        """
        ...

    def observe(
        self, k: int, t_s: Array, x: Array, u: Array, w: Array, memory: Any
    ) -> tuple[Array, Any]:
        """Return the navigated states y (q, N), SI, and the memory after sample k.

        u (p, N) is the law's command at the sample before (zero at the first sample; for a
        continuous law its value at that instant). w (noise, N) is new at each sample.
        """
        ...


@dataclass(frozen=True)
class CommandSteps:
    """A command that is piecewise constant between two samples.

    Parameters
    ----------
    shares : ndarray, shape (J,)
        Durations of the steps as fractions of the period, in order; positive, with the sum one.
    u : ndarray, shape (J, p, N) or (J, p, 1)
        Command of each step, SI.

    Raises
    ------
    InputError
        If a share is not positive, their sum is not one, or the shapes do not match.
    """

    shares: Array
    u: Array

    def __post_init__(self) -> None:
        fits = self.shares.shape == (len(self.u),) and self.u.ndim == 3
        if not fits or not (self.shares > 0).all() or abs(self.shares.sum() - 1.0) > 1e-9:
            raise InputError(
                "the shares (J,) of a command's steps must be positive with the sum one, and u "
                f"(J, p, N) or (J, p, 1); got {self.shares.tolist()} and {self.u.shape}"
            )

    def mean(self) -> Array:
        """Return the mean over the period, (p, N) or (p, 1)."""
        return np.asarray(np.tensordot(self.shares, self.u, axes=1))


@runtime_checkable
class Reference(Contract, Protocol):
    """The reference that the law tracks, and its feedforward command."""

    def at(self, k: int, t_s: Array, y: Array, cases: Integers) -> Array:
        """Return the reference (q, N), SI, at sample k.

        t_s (N,) is the time, y (q, N) the output of the navigation, cases (N,) the integer numbers
        of the cases, by which a reference can differ from case to case.
        """
        ...

    def feedforward(self, k: int, t_s: Array, cases: Integers) -> Array | CommandSteps | None:
        """Return the feedforward from sample k on, which is added to the law's command, or None.

        An array (p, N) or (p, 1) is held until the next sample. `CommandSteps` change within the
        period; laws that command impulses do not accept them.
        """
        ...


class Actuator(Protocol):
    """Actuator model: from the commanded to the executed control."""

    @property
    def noise(self) -> int:
        """Number of standard normal numbers per case and sample."""
        ...

    def execute(self, u: Array, w: Array) -> Array:
        """Return the executed control (p, N) for the command u (p, N), with noise w (noise, N)."""
        ...


@runtime_checkable
class ContinuousLaw(Contract, Protocol):
    """A continuous-time law, whose equations are compiled with those of the plant.

    Its states ẋ_c = f(x_c, y, r, t) are appended to those of the plant, and its command
    u = g(x_c, y, r, t) enters the plant's equations. The sub-step h must be short compared with the
    time constant 1/|λ| of its fastest pole: on the real axis the step map is stable up to
    |λ| h = 2.85 (rk6) and 6.39 (dop853), and reproduces the decay to 1e-3 up to 1.07 and 3.5. A
    filter of 0.05 Hz requires h ≤ 3.4 s and 11 s. `Simulator` refuses longer sub-steps if the law
    declares its poles (`KnownPoles`).
    """

    @property
    def period_s(self) -> float:
        """Sampling period, s: at each sample y and ref are updated, and `sample` is called."""
        ...

    @property
    def measurement(self) -> Literal["held", "continuous"]:
        """``"held"``: y is held between samples; ``"continuous"``: y is the true state."""
        ...

    @property
    def inputs(self) -> int:
        """Number q of rows of y and ref; the plant's number of states for ``"continuous"``."""
        ...

    @property
    def states(self) -> tuple[Variable, ...]:
        """The law's own states, with names that the plant does not use; may be empty."""
        ...

    def initial(self, n_cases: int) -> Array:
        """Return the law's own states (m, N) before the first sample, SI."""
        ...

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        """Return the law's states (m, N) after sample k; `xc` itself if they do not jump.

        An observer replaces its prediction by the corrected estimate here.
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
class JointLaw(ContinuousLaw, Contract, Protocol):
    """A `ContinuousLaw` whose rates contain its command, and which gives both at once.

    Bounds of its equations in interval arithmetic then evaluate the command once.
    """

    def rates_and_command(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[tuple[Expr, ...], tuple[Expr, ...]]:
        """Return `derivative` and `control`."""
        ...


@runtime_checkable
class KnownPoles(Contract, Protocol):
    """A `ContinuousLaw` with known poles, by which the length of its sub-steps is checked."""

    @property
    def fastest_rad_s(self) -> float:
        """Magnitude of the fastest pole of its own equations, 1/s; zero without states."""
        ...
