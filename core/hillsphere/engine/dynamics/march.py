"""Propagation of checked lanes in equal steps."""

from __future__ import annotations

from collections.abc import Iterator
from operator import index

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.lanes import initial_derivatives, per_lane, start_states
from hillsphere.engine.dynamics.stages import Advance, Stepper
from hillsphere.engine.dynamics.system import System

__all__ = ["March"]


class March:
    """Propagation of N lanes in equal steps, with the derivatives carried along.

    Parameters
    ----------
    system : System
        n equations.
    stepper : Stepper
        One step of a formula.
    columns : int
        Columns of the derivatives carried along; 0 without.
    x, duration, steps, p, t0
        As for `StepMap.propagate`.

    Raises
    ------
    InputError
        If a shape does not match, a value is not finite or `steps` is not a positive whole number.
    """

    def __init__(
        self,
        system: System,
        stepper: Stepper,
        columns: int,
        x: ArrayLike,
        duration: ArrayLike,
        steps: int,
        p: ArrayLike | None,
        t0: ArrayLike,
    ) -> None:
        try:
            steps = index(steps)
        except TypeError:
            raise InputError(f"steps must be a whole number, got {steps!r}") from None
        if steps < 1:
            raise InputError(f"steps must be at least 1, got {steps}")
        self.n, self.columns, self.steps, self.stepper = len(system.x), columns, steps, stepper
        states, self.single = start_states(x, self.n)
        self.cases = states.shape[1]
        self.h = per_lane(duration, self.cases, "duration") / steps
        self.t0 = per_lane(t0, self.cases, "t0")
        self.p = system.parameters(p, self.cases)
        self.start = states
        if columns:
            extra = initial_derivatives(self.n, columns, self.cases)
            self.start = np.concatenate([states, extra])
        self._advance: Advance = stepper.bind(self.h, self.p)

    def __iter__(self) -> Iterator[Array]:
        """Yield the rows (states, derivatives) after each step; each array lives for two steps."""
        # The start may be the caller's array: it is never written to.
        here, there, spare = self.start, np.empty_like(self.start), np.empty_like(self.start)
        advance, t, moving = self._advance, self.t0, self.stepper.needs_time
        for j in range(self.steps):
            if moving:  # computing the time costs a twelfth of a single lane's step
                t = self.t0 + j * self.h
            advance(here, there, t)
            yield there
            here, there, spare = there, spare, there

    def end(self) -> Array:
        """Return the rows after all steps."""
        y = self.start
        for y in self:  # noqa: B007
            pass
        return y

    def split(self, y: Array) -> tuple[Array, Array | None]:
        """Split rows into states (n, N) and derivatives (n, columns, N); no lane axis if single."""
        state = y[: self.n]
        phi = y[self.n :].reshape(self.n, self.columns, -1) if self.columns else None
        if self.single:
            return state[:, 0], None if phi is None else phi[:, :, 0]
        return state, phi
