"""Other propagators of the point-mass Hill problem, for the benchmark of lanes.

Each function returns the ends of flights of the same duration from starts (6, N), normalised, with
a tolerance, or a number of equal steps, of its own. A peer that is not installed is None.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any

import heyoka
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hillsphere.dynamics import tableau

Array = NDArray[np.float64]
Fly = Callable[[Array], Array]
_TOGETHER = 64
"""Lanes of a block of the numba peer: its stages then stay in the second-level cache."""


def hill_equations() -> list[tuple[Any, Any]]:
    """Return the equations for heyoka, written for it by hand."""
    x, y, z, vx, vy, vz = heyoka.make_vars("x", "y", "z", "vx", "vy", "vz")
    pull = (x * x + y * y + z * z) ** -1.5
    return [
        (x, vx), (y, vy), (z, vz), (vx, 2.0 * vy + 3.0 * x - x * pull),
        (vy, -2.0 * vx - y * pull), (vz, -z - z * pull),
    ]  # fmt: skip


def heyoka_batch(
    equations: Sequence[tuple[Any, Any]],
    duration: float,
    tolerance: float,
    lanes: int,
    events: tuple[Any, Any] | None = None,
) -> tuple[Fly, Callable[[Array], NDArray[np.int64]]]:
    """Return heyoka's batch mode, and the function that returns the steps (N,) of flights.

    `events` are a function that ends a flight when it falls through zero, and one whose zeros are
    recorded with their states. The number of flights is a multiple of that of lanes.
    """
    options: dict[str, Any] = {}
    met: list[tuple[float, Array]] = []
    if events is not None:

        def note(integrator: Any, time: float, sign: int, lane: int) -> None:
            integrator.update_d_output([time] * lanes)
            met.append((time, integrator.d_output[:, lane].copy()))

        falls = heyoka.event_direction.negative
        options["t_events"] = [heyoka.t_event_batch(events[0], direction=falls)]
        options["nt_events"] = [heyoka.nt_event_batch(events[1], callback=note)]
    integrator: Any = heyoka.taylor_adaptive_batch(
        list(equations), np.zeros((6, lanes)), tol=tolerance, **options
    )
    ended = -1  # the outcome of the first terminal event that stops

    def batches(start: Array, read: Callable[[int], None]) -> None:
        met.clear()
        for k in range(0, start.shape[1], lanes):
            integrator.state[:] = start[:, k : k + lanes]
            integrator.set_time(0.0)
            if events is None:
                integrator.propagate_until(duration)
            else:
                integrator.reset_cooldowns()
                goal = np.full(lanes, duration)
                while True:
                    integrator.propagate_until(goal)
                    stopped = [int(r[0]) == ended for r in integrator.propagate_res]
                    # an ended lane flies no further; the others go on
                    goal = np.where(stopped, integrator.time, goal)
                    if not any(stopped) or (integrator.time == goal).all():
                        break
            read(k)

    def fly(start: Array) -> Array:
        end = np.empty_like(start)

        def read(k: int) -> None:
            end[:, k : k + lanes] = integrator.state

        batches(start, read)
        return end

    def steps(start: Array) -> NDArray[np.int64]:
        taken = np.empty(start.shape[1], dtype=np.int64)

        def read(k: int) -> None:
            taken[k : k + lanes] = [r[3] for r in integrator.propagate_res]

        batches(start, read)
        return taken

    return fly, steps


def scipy_flights(duration: float, tolerance: float) -> Fly:
    """Return SciPy's DOP853, flight by flight, with a right-hand side in Python's numbers."""

    def rate(t: float, s: Array) -> list[float]:
        x, y, z, vx, vy, vz = s.tolist()
        pull = (x * x + y * y + z * z) ** -1.5
        return [vx, vy, vz, 2 * vy + 3 * x - x * pull, -2 * vx - y * pull, -z - z * pull]

    def fly(start: Array) -> Array:
        ends = [
            solve_ivp(rate, (0.0, duration), one, "DOP853", rtol=tolerance, atol=tolerance).y[:, -1]
            for one in start.T
        ]
        return np.array(ends).T

    return fly


def numba_flights(duration: float) -> tuple[Callable[[float], Fly], Callable[[int], Fly]] | None:
    """Return numba's DOP853: adaptive flight by flight, and with equal steps over blocks of lanes.

    The first takes a tolerance, the second a number of steps.
    """
    if find_spec("numba") is None:
        return None
    from numba import njit

    formula = tableau("dop853")
    a, b, c5, c3 = formula.a, formula.b, formula.errors[0], formula.errors[1]
    stages = len(b)

    @njit(fastmath=True)  # type: ignore[untyped-decorator]
    def rate(s: Array, out: Array) -> None:
        for i in range(s.shape[1]):
            x, y, z = s[0, i], s[1, i], s[2, i]
            r2 = x * x + y * y + z * z
            pull = 1.0 / (r2 * np.sqrt(r2))
            out[0, i], out[1, i], out[2, i] = s[3, i], s[4, i], s[5, i]
            out[3, i] = 2.0 * s[4, i] + 3.0 * x - x * pull
            out[4, i] = -2.0 * s[3, i] - y * pull
            out[5, i] = -z - z * pull

    @njit(fastmath=True)  # type: ignore[untyped-decorator]
    def step(s: Array, h: float, k: Array, at: Array) -> None:
        lanes = s.shape[1]
        rate(s, k[0])
        for m in range(1, stages):
            for row in range(6):
                for i in range(lanes):
                    at[row, i] = s[row, i]
                for j in range(m):
                    w = h * a[m, j]
                    if w != 0.0:
                        for i in range(lanes):
                            at[row, i] += w * k[j, row, i]
            rate(at, k[m])

    @njit(fastmath=True)  # type: ignore[untyped-decorator]
    def together(start: Array, end: Array, steps: int) -> None:
        h = duration / steps
        for first in range(0, start.shape[1], _TOGETHER):
            s = start[:, first : first + _TOGETHER].copy()
            k, at = np.empty((stages, 6, s.shape[1])), np.empty_like(s)
            for _ in range(steps):
                step(s, h, k, at)
                for row in range(6):
                    for j in range(stages):
                        w = h * b[j]
                        if w != 0.0:
                            for i in range(s.shape[1]):
                                s[row, i] += w * k[j, row, i]
            end[:, first : first + _TOGETHER] = s

    @njit(fastmath=True)  # type: ignore[untyped-decorator]
    def apart(start: Array, end: Array, tolerance: float) -> None:
        k, at, new = np.empty((stages, 6, 1)), np.empty((6, 1)), np.empty((6, 1))
        for flight in range(start.shape[1]):
            s, t, h = start[:, flight : flight + 1].copy(), 0.0, 1e-3
            while t < duration:
                h = min(h, duration - t)
                step(s, h, k, at)
                high, low = 0.0, 0.0
                for row in range(6):
                    change, e5, e3 = 0.0, 0.0, 0.0
                    for j in range(stages):
                        change += b[j] * k[j, row, 0]
                        e5 += c5[j] * k[j, row, 0]
                        e3 += c3[j] * k[j, row, 0]
                    new[row, 0] = s[row, 0] + h * change
                    size = tolerance * (1.0 + max(abs(s[row, 0]), abs(new[row, 0])))
                    high += (h * e5 / size) ** 2
                    low += (h * e3 / size) ** 2
                error = high / np.sqrt(6.0 * (high + 0.01 * low) + 1e-300)
                if error <= 1.0:
                    t += h
                    s[:] = new
                h *= min(6.0, max(1.0 / 3.0, 0.9 * (error + 1e-30) ** -0.125))
            end[:, flight] = s[:, 0]

    def adaptive(tolerance: float) -> Fly:
        def fly(start: Array) -> Array:
            end = np.empty_like(start)
            apart(start, end, tolerance)
            return end

        return fly

    def equal(steps: int) -> Fly:
        def fly(start: Array) -> Array:
            end = np.empty_like(start)
            together(start, end, steps)
            return end

        return fly

    return adaptive, equal


def diffrax_flights(duration: float) -> Callable[[float], Fly] | None:
    """Return diffrax's adaptive Dopri8, mapped over all lanes and compiled."""
    if find_spec("diffrax") is None:
        return None
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    def rate(t: Any, s: Any, args: Any) -> Any:
        x, y, z, vx, vy, vz = s
        pull = (x * x + y * y + z * z) ** -1.5
        return jnp.stack([vx, vy, vz, 2 * vy + 3 * x - x * pull, -2 * vx - y * pull, -z - z * pull])

    def adaptive(tolerance: float) -> Fly:
        control = diffrax.PIDController(rtol=tolerance, atol=tolerance)

        @jax.jit
        @jax.vmap
        def one(start: Any) -> Any:
            solution = diffrax.diffeqsolve(
                diffrax.ODETerm(rate), diffrax.Dopri8(), 0.0, duration, 1e-3, start,
                stepsize_controller=control, max_steps=None,
            )  # fmt: skip
            return solution.ys[-1]

        return lambda start: np.asarray(one(start.T)).T

    return adaptive
