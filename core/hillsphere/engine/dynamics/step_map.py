"""The step map: a fixed Runge–Kutta formula on many lanes at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.adaptive import AdaptiveStages
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.crossing import Crossing, first_crossing
from hillsphere.engine.dynamics.enclosures import Bounded
from hillsphere.engine.dynamics.expression_bounds import bounds_of_event
from hillsphere.engine.dynamics.lanes import refuse_non_finite
from hillsphere.engine.dynamics.march import March
from hillsphere.engine.dynamics.stages import ArrayStages, CompiledStep, Stepper
from hillsphere.engine.dynamics.step_doubling import fewest_steps
from hillsphere.engine.dynamics.system import System
from hillsphere.engine.dynamics.tableaux import tableau
from hillsphere.symbolic.expressions import Expr

__all__ = ["StepMap"]


class StepMap:
    """Propagation of N independent lanes in lockstep by a fixed formula.

    Parameters
    ----------
    system : System
        n equations.
    method : {"dop853", "rk6"}
        Formula: order 8 in 12 stages, or order 6 in 7.
    stm : bool
        Whether the state transition matrix is carried along (variational equations, exact: the
        result is the derivative of the discrete map itself).
    parameters : sequence of str
        With `stm`: run-time parameters (or controls, ``"u:" + name``) by which to differentiate
        too; they append k columns to the matrix.
    tolerance : float, optional
        Only for systems with terms that are functions of arrays, without `stm`: every step is
        divided adaptively so that local errors stay below this, in units of ``system.scale``; see
        `AdaptiveStages`. A whole flight can then be one step.
    compact : bool
        Compile in compact mode, for right-hand sides so large (harmonics of high degree) that the
        compiler otherwise takes minutes; the code is slower.
    errors : bool
        Whether `stepper` can estimate the errors of its steps; not with `stm`.

    Raises
    ------
    InputError
        If the method is unknown or a parameter is not a run-time parameter.

    Notes
    -----
    The whole step is one compiled function of the states; steps and run-time parameters are its
    parameters, so that neither dispersions nor step sizes require a new compilation. Systems with
    terms that are functions of arrays evaluate the same formula stage by stage in numpy.

    In the methods below x is (n, N), where N may be zero, or (n,) for one lane; results then have
    no axis of lanes either. Durations and steps are scalars or (N,), in the system's unit of time,
    and may be negative. Run-time parameters p are (k,) or (k, N), SI; by default nominal. A lane
    that becomes non-finite raises `PropagationError`; with ``strict=False`` it is returned as is.
    """

    def __init__(
        self,
        system: System,
        method: Literal["dop853", "rk6"] | str = "dop853",
        stm: bool = False,
        *,
        parameters: Sequence[str] = (),
        tolerance: float | None = None,
        compact: bool = False,
        errors: bool = False,
    ) -> None:
        if parameters and not stm:
            raise InputError("derivatives by parameters come with the STM: give stm=True")
        if tolerance is not None and (stm or system.external is None):
            raise InputError(
                "a tolerance is for systems with terms that are functions of arrays, without "
                "derivatives; others choose their steps by choose_steps"
            )
        self.system, self.method, self.stm = system, method, stm
        self._n = len(system.x)
        self._columns = self._n + len(parameters) if stm else 0
        formula = tableau(method)
        self.order = formula.order
        self._stepper: Stepper
        if system.external is None:
            self._stepper = CompiledStep(system, formula, stm, parameters, compact, errors)
        elif tolerance is not None:
            self._stepper = AdaptiveStages(system, formula, tolerance)
        else:
            self._stepper = ArrayStages(system, formula, stm, parameters)
        self._functions: dict[Expr, ArrayFunction] = {}
        self._bounds: dict[str | Expr, Bounded | None] = {}

    @property
    def stepper(self) -> Stepper:
        """The step on unchecked arrays, for loops that step themselves."""
        return self._stepper

    def step(
        self,
        x: ArrayLike,
        h: ArrayLike,
        p: ArrayLike | None = None,
        t: ArrayLike = 0.0,
        *,
        strict: bool = True,
    ) -> Any:
        """Take one step.

        Parameters
        ----------
        x : array_like, shape (n, N)
            States.
        h : array_like, shape (N,) or scalar
            Steps.
        p : array_like, shape (k, N) or (k,), optional
            Run-time parameters.
        t : array_like, shape (N,) or scalar
            Time at the start.
        strict : bool
            Whether non-finite lanes raise.

        Returns
        -------
        x : ndarray, shape (n, N)
            States after the step.
        phi : ndarray, shape (n, n + k, N)
            Derivatives by the states before it (only with `stm`).

        Raises
        ------
        PropagationError
            If a lane turns non-finite.
        """
        return self.propagate(x, h, 1, p, t, strict=strict)

    def propagate(
        self,
        x: ArrayLike,
        duration: ArrayLike,
        steps: int,
        p: ArrayLike | None = None,
        t0: ArrayLike = 0.0,
        *,
        strict: bool = True,
    ) -> Any:
        """Propagate each lane over its duration in `steps` equal steps.

        Parameters
        ----------
        x : array_like, shape (n, N)
            States.
        duration : array_like, shape (N,) or scalar
            Duration in the system's unit of time.
        steps : int
            Number of steps, common to all lanes; `choose_steps` finds one.
        p : array_like, shape (k, N) or (k,), optional
            Run-time parameters.
        t0 : array_like, shape (N,) or scalar
            Time at the start.
        strict : bool
            Whether non-finite lanes raise.

        Returns
        -------
        x : ndarray, shape (n, N)
            States at the end.
        phi : ndarray, shape (n, n + k, N)
            Derivatives by the states at the start (only with `stm`).

        Raises
        ------
        PropagationError
            If a lane turns non-finite.
        """
        march = self._march(x, duration, steps, p, t0)
        y = march.end()
        if strict:
            refuse_non_finite(y, self._where(duration, steps))
        state, phi = march.split(y)
        return (state, phi) if self.stm else state

    def estimate_errors(
        self,
        x: ArrayLike,
        duration: ArrayLike,
        steps: int,
        p: ArrayLike | None = None,
        t0: ArrayLike = 0.0,
    ) -> Array:
        """Estimate the error of each lane that `propagate` flies in that many steps.

        `choose_steps` finds one number of steps for all lanes. Where the steps are given, this
        tells which lanes they suffice for, and which to fly by `Taylor`, whose steps are adaptive.

        Parameters
        ----------
        x, duration, steps, p, t0
            As for `propagate`.

        Returns
        -------
        ndarray, shape (N,)
            Largest difference of a state at the end between `steps` and twice as many, in units of
            ``system.scale``. It estimates the error of `steps` if it is small; that of steps which
            are far too long may be anything. Infinite for a lane that turns non-finite.
        """
        coarse, fine = (self._march(x, duration, n, p, t0).end() for n in (steps, 2 * steps))
        with np.errstate(invalid="ignore"):
            apart = self._apart(coarse, fine)
        return np.where(np.isfinite(apart), apart, np.inf)

    def trajectory(
        self,
        x: ArrayLike,
        duration: ArrayLike,
        steps: int,
        p: ArrayLike | None = None,
        t0: ArrayLike = 0.0,
        *,
        strict: bool = True,
    ) -> Array:
        """Propagate as `propagate` does and return the states after every step.

        Parameters
        ----------
        x, duration, steps, p, t0, strict
            As for `propagate`.

        Returns
        -------
        ndarray, shape (n, steps + 1, N)
            States at t0 + j·duration/steps; without derivatives.

        Raises
        ------
        PropagationError
            If a lane turns non-finite.
        """
        march = self._march(x, duration, steps, p, t0)
        out = np.empty((march.n, march.steps + 1, march.cases))
        out[:, 0] = march.start[: march.n]
        for j, y in enumerate(march, start=1):
            out[:, j] = y[: march.n]
        if strict:
            refuse_non_finite(out[:, -1], self._where(duration, steps))
        return out[:, :, 0] if march.single else out

    def choose_steps(
        self,
        x: ArrayLike,
        duration: ArrayLike,
        tol: float,
        p: ArrayLike | None = None,
        t0: ArrayLike = 0.0,
        *,
        most: int = 1 << 17,
    ) -> int:
        """Find a number of steps that meets a tolerance, by step doubling.

        Parameters
        ----------
        x, duration, p, t0
            As for `propagate`.
        tol : float
            Largest difference at the end, over all lanes, between `steps` and twice as many steps:
            of the states in units of ``system.scale``, and with `stm` of the equally scaled matrix
            relative to its largest element.
        most : int
            Largest number of steps to try.

        Returns
        -------
        int
            Number of steps whose computed difference is at most `tol`. The difference estimates
            their error; the error of twice as many steps is smaller by 2 to the order.

        Raises
        ------
        PropagationError
            If the difference stops decreasing (rounding), or `most` steps do not suffice.
        """
        known: dict[int, Array] = {}

        def end(steps: int) -> Array:
            if steps not in known:
                known[steps] = self._march(x, duration, steps, p, t0).end()
            return known[steps]

        return fewest_steps(
            lambda n: self._difference(end(n), end(2 * n)), self.order, tol, most, self.method
        )

    def locate(
        self,
        event: str | Expr,
        x: ArrayLike,
        duration: ArrayLike,
        steps: int,
        p: ArrayLike | None = None,
        t0: ArrayLike = 0.0,
        *,
        direction: Literal[-1, 0, 1] = -1,
        after: ArrayLike = 0.0,
        strict: bool = True,
    ) -> Crossing:
        """Find the first zero of an event in each lane.

        Bounds of the event's derivatives between the ends of the steps
        (`hillsphere.engine.dynamics.proof`) ensure that no pair of roots inside one step is missed.
        The root is the length of a partial step of the same formula for which the event is zero.
        Bounds exist for a plant's own events and for polynomials of degree two in the states. If
        they do not decide or do not exist, ``resolved`` is False.

        Parameters
        ----------
        event : str or Expr
            Name of an event of the system, or an expression of its states, time and parameters.
        x, duration, steps, p, t0
            As for `propagate`.
        direction : {-1, 0, 1}
            Direction of the counted crossings along the flight: falling (the convention of a
            plant's events), both, or rising. A value of zero at the start is not a crossing.
        after : array_like, shape (N,) or scalar
            Length of flight before which crossings are ignored, of the sign of the duration.
        strict : bool
            Whether lanes that become non-finite before the event raise.

        Returns
        -------
        Crossing
            Times and states; lanes without the event have ``found`` False.

        Raises
        ------
        InputError
            If there is no such event.
        PropagationError
            If a lane turns non-finite before the event.
        """
        march = self._march(x, duration, steps, p, t0)
        where = self._where(duration, steps) if strict else None
        value = self._event(event)
        if event not in self._bounds:
            self._bounds[event] = bounds_of_event(self.system, event)
        return first_crossing(march, value, direction, after, where, self._bounds[event])

    def _march(
        self,
        x: ArrayLike,
        duration: ArrayLike,
        steps: int,
        p: ArrayLike | None,
        t0: ArrayLike,
    ) -> March:
        return March(self.system, self._stepper, self._columns, x, duration, steps, p, t0)

    def _event(self, event: str | Expr) -> ArrayFunction:
        if isinstance(event, str):
            if event not in self.system.events:
                known = ", ".join(self.system.events) or "none"
                raise InputError(f"no event {event!r}; the system has: {known}")
            expression = self.system.events[event]
        else:
            expression = event
        if expression not in self._functions:
            self._functions[expression] = self.system.function(expression)
        return self._functions[expression]

    def _apart(self, coarse: Array, fine: Array) -> Array:
        """Return the largest difference of a state in each lane (N,), in units of its scale."""
        n = self._n
        return np.asarray((np.abs(coarse[:n] - fine[:n]) / self.system.scale[:, None]).max(axis=0))

    def _difference(self, coarse: Array, fine: Array) -> float:
        if not (np.isfinite(coarse).all() and np.isfinite(fine).all()):
            return float("inf")
        if not coarse.size:
            return 0.0
        n, scale = self._n, self.system.scale
        largest = float(self._apart(coarse, fine).max())
        if self.stm:
            columns = np.ones(self._columns)
            columns[:n] = scale
            factor = (columns / scale[:, None]).reshape(-1, 1)
            a, b = coarse[n:] * factor, fine[n:] * factor
            largest = max(largest, float(np.max(np.abs(a - b) / np.max(np.abs(b), axis=0))))
        return largest

    def _where(self, duration: ArrayLike, steps: int) -> str:
        longest = float(np.max(np.abs(duration), initial=0.0))
        return f"{self.method}, {steps} steps over up to {longest:g} units of time"
