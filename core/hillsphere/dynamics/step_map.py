"""The step map: a fixed Runge–Kutta formula on many lanes at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.dynamics.compiled import ArrayFunction
from hillsphere.dynamics.lanes import (
    initial_derivatives,
    per_lane,
    refuse_non_finite,
    start_states,
)
from hillsphere.dynamics.root_finding import bracketed_roots
from hillsphere.dynamics.stages import Advance, ArrayStages, CompiledStep, Stepper
from hillsphere.dynamics.system import System
from hillsphere.dynamics.tableaux import tableau
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere.symbolic import Expr

__all__ = ["Crossing", "StepMap"]

_FIRST_STEPS = 8
_ROUNDING = 1e-9
"""Differences that stop shrinking below this are taken for rounding, above it for coarse steps."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """Where each of N lanes first meets an event.

    Parameters
    ----------
    found : ndarray of bool, shape (N,)
        Whether it does.
    time : ndarray, shape (N,)
        Time of the event on the system's clock (t0 included); NaN if not found.
    x : ndarray, shape (n, N)
        State at the event; at the end of the flight if not found.
    phi : ndarray, shape (n, n + k, N), or None
        Derivatives of the flow for the time of the event held fixed, from the start to `x`.
    """

    found: NDArray[np.bool_]
    time: Array
    x: Array
    phi: Array | None


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
    compact : bool
        Compile in compact mode: for right-hand sides so large (harmonics of high degree) that the
        compiler takes minutes; the code is slower.

    Raises
    ------
    InputError
        If the method is unknown or a parameter is not at run time.

    Notes
    -----
    The whole step is one compiled function of the states; steps and run-time parameters are its
    parameters, so that neither dispersions nor step sizes recompile it. Systems with terms that
    are functions of arrays run the same formula stage by stage in numpy.

    In the methods below x is (n, N) or, for one lane, (n,), and the results lose that axis
    likewise. Durations and steps are scalars or (N,), in the system's unit of time, and may be
    negative. Run-time parameters p are (k,) or (k, N), SI; nominal if absent. A lane that turns
    non-finite raises `PropagationError`, unless ``strict=False``: then it is returned as it is.
    """

    def __init__(
        self,
        system: System,
        method: Literal["dop853", "rk6"] | str = "dop853",
        stm: bool = False,
        *,
        parameters: Sequence[str] = (),
        compact: bool = False,
    ) -> None:
        if parameters and not stm:
            raise InputError("derivatives by parameters come with the STM: give stm=True")
        self.system, self.method, self.stm = system, method, stm
        self._n = len(system.x)
        self._columns = self._n + len(parameters) if stm else 0
        formula = tableau(method)
        self.order = formula.order
        self._stepper: Stepper = (
            CompiledStep(system, formula, stm, parameters, compact)
            if system.external is None
            else ArrayStages(system, formula, stm, parameters)
        )
        self._functions: dict[Expr, ArrayFunction] = {}

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
            How long.
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
        flight = _Flight(self, x, duration, steps, p, t0)
        y = flight.end(steps)
        if strict:
            refuse_non_finite(y, self._where(duration, steps))
        state, phi = self._split(y, flight.single)
        return (state, phi) if self.stm else state

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
        flight = _Flight(self, x, duration, steps, p, t0)
        out = np.empty((self._n, steps + 1, flight.cases))
        out[:, 0] = flight.y[: self._n]
        for j, y in enumerate(flight.march(steps), start=1):
            out[:, j] = y[: self._n]
        if strict:
            refuse_non_finite(out[:, -1], self._where(duration, steps))
        return out[:, :, 0] if flight.single else out

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
            Largest difference at the end between `steps` and twice as many, over all lanes: of the
            states in units of ``system.scale``, and with `stm` of the matrix (so scaled too)
            relative to its largest element.
        most : int
            Largest number of steps to try.

        Returns
        -------
        int
            Steps for which that difference was found to be at most `tol`; it estimates their
            error, that of twice as many is smaller by 2 to the order.

        Raises
        ------
        PropagationError
            If the difference stops shrinking (rounding), or `most` steps do not suffice.
        """
        if not (np.isfinite(tol) and tol > 0):
            raise InputError(f"tol must be positive, got {tol}")
        n, best, stalled = _FIRST_STEPS, np.inf, 0
        coarse = _Flight(self, x, duration, n, p, t0).end(n)
        while 2 * n <= most:
            fine = _Flight(self, x, duration, 2 * n, p, t0).end(2 * n)
            difference = self._difference(coarse, fine)
            if difference <= tol:
                return n
            stalled = stalled + 1 if difference > 0.5 * best and difference < _ROUNDING else 0
            best = min(best, difference)
            if stalled >= 2:
                raise PropagationError(
                    f"tolerance {tol:g} is below the rounding error: with {n} steps of "
                    f"{self.method} the difference stays at {best:.2g}; ask for more than that"
                )
            if np.isfinite(difference):
                guess = n * 1.05 * (difference / tol) ** (1.0 / self.order)
                following = int(min(4.0 * n, max(guess + 1.0, n + 1.0)))
            else:
                following = 2 * n
            if following == 2 * n:
                coarse = fine
            else:
                coarse = _Flight(self, x, duration, following, p, t0).end(following)
            n = following
        raise PropagationError(
            f"{self.method}: {most} steps do not meet the tolerance {tol:g} (best difference "
            f"{best:.2g}); the flight may meet a singularity, or is too long"
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
        """Find where each lane first meets an event.

        The event's sign is watched at the ends of the steps; in the step where it changes, the
        length of a partial step of the same formula is found for which the event is zero. A pair
        of roots inside one step goes unseen: take steps short beside the event's own time scale.

        Parameters
        ----------
        event : str or Expr
            Name of an event of the system, or an expression of its states, time and parameters.
        x, duration, steps, p, t0
            As for `propagate`.
        direction : {-1, 0, 1}
            Which crossings count along the flight: falling (as a plant's events are meant), both,
            or rising. A value of zero at the start is not a crossing.
        after : array_like, shape (N,) or scalar
            Length of flight before which nothing counts (as long as the flight, same sign).
        strict : bool
            Whether lanes that turn non-finite before they meet the event raise.

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
        value = self._event(event)
        flight = _Flight(self, x, duration, steps, p, t0)
        wait = np.abs(per_lane(after, flight.cases, "after"))
        cases, h, y0 = flight.cases, flight.h, flight.y
        before, begin = y0.copy(), flight.t0.copy()
        g_before, g_after = np.zeros(cases), np.zeros(cases)
        found = np.zeros(cases, dtype=bool)
        last, g_last = y0.copy(), value(y0[: self._n], flight.p, flight.t0)[0]
        end = y0
        for j, end in enumerate(flight.march(steps), start=1):
            g = value(end[: self._n], flight.p, flight.t0 + j * h)[0]
            hit = _crosses(g_last, g, direction) & ~found & (j * np.abs(h) > wait)
            before[:, hit], begin[hit] = last[:, hit], (flight.t0 + (j - 1) * h)[hit]
            g_before[hit], g_after[hit] = g_last[hit], g[hit]
            found |= hit
            if found.all():
                break
            last, g_last = end.copy(), g
        result = end.copy()
        if strict:
            lost = np.where(found, 0.0, result)
            refuse_non_finite(lost, self._where(duration, steps))
        partial = np.empty_like(before)

        def at(tau: Array) -> Array:
            self._stepper.bind(tau, flight.p)(before, partial, begin)
            values: Array = value(partial[: self._n], flight.p, begin + tau)[0]
            return values

        zero = np.zeros(cases)
        width = 4.0 * np.finfo(float).eps * np.maximum(np.abs(h), np.abs(begin))
        tau = bracketed_roots(at, zero, np.where(found, h, 0.0), g_before, g_after, width)
        at(tau)
        result = np.where(found, partial, result)
        state, phi = self._split(result, flight.single)
        time = np.where(found, begin + tau, np.nan)
        if flight.single:
            found, time = found[0], time[0]
        return Crossing(found, time, state, phi)

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

    def _split(self, y: Array, single: bool) -> tuple[Array, Array | None]:
        state = y[: self._n]
        phi = y[self._n :].reshape(self._n, self._columns, -1) if self.stm else None
        if single:
            return state[:, 0], None if phi is None else phi[:, :, 0]
        return state, phi

    def _difference(self, coarse: Array, fine: Array) -> float:
        if not (np.isfinite(coarse).all() and np.isfinite(fine).all()):
            return np.inf
        scale = self.system.scale
        largest = float(np.max(np.abs(coarse[: self._n] - fine[: self._n]) / scale[:, None]))
        if self.stm:
            columns = np.ones(self._columns)
            columns[: self._n] = scale
            factor = (columns / scale[:, None])[:, :, None]
            a, b = (self._split(y, False)[1] for y in (coarse, fine))
            assert a is not None
            assert b is not None
            size = np.max(np.abs(b * factor), axis=(0, 1))
            largest = max(largest, float(np.max(np.abs((a - b) * factor) / size)))
        return largest

    def _where(self, duration: ArrayLike, steps: int) -> str:
        longest = float(np.max(np.abs(duration)))
        return f"{self.method}, {steps} steps over up to {longest:g} units of time"


def _crosses(before: Array, after: Array, direction: int) -> NDArray[np.bool_]:
    falling, rising = (before > 0) & (after <= 0), (before < 0) & (after >= 0)
    if direction == 0:
        return falling | rising
    return falling if direction < 0 else rising


class _Flight:
    """Lanes made ready to march: checked, contiguous, with their initial derivatives."""

    def __init__(
        self,
        step_map: StepMap,
        x: ArrayLike,
        duration: ArrayLike,
        steps: int,
        p: ArrayLike | None,
        t0: ArrayLike,
    ) -> None:
        if steps < 1:
            raise InputError(f"steps must be at least 1, got {steps}")
        states, self.single = start_states(x, step_map._n)
        self.cases = states.shape[1]
        self.h = per_lane(duration, self.cases, "duration") / steps
        self.t0 = per_lane(t0, self.cases, "t0")
        self.p = step_map.system.parameters(p, self.cases)
        self.y = states
        if step_map.stm:
            extra = initial_derivatives(step_map._n, step_map._columns, self.cases)
            self.y = np.concatenate([states, extra])
        self._advance: Advance = step_map._stepper.bind(self.h, self.p)

    def march(self, steps: int) -> Iterator[Array]:
        """Yield y after each step; the array is overwritten two steps later."""
        here, there, spare = self.y, np.empty_like(self.y), np.empty_like(self.y)
        for j in range(steps):
            self._advance(here, there, self.t0 + j * self.h)
            yield there
            # The start is the caller's: it is never written to.
            here, there, spare = there, spare, there

    def end(self, steps: int) -> Array:
        """Return y after all steps."""
        y = self.y
        for y in self.march(steps):  # noqa: B007
            pass
        return y
