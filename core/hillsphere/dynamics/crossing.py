"""Event location on many lanes at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.dynamics.lanes import per_lane, refuse_non_finite
from hillsphere.dynamics.march import March
from hillsphere.dynamics.root_finding import bracketed_roots
from hillsphere.interfaces import Array

__all__ = ["Crossing", "first_crossing"]


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


def first_crossing(
    march: March,
    value: Callable[[Array, Array, Array], Array],
    direction: int,
    after: ArrayLike,
    where: str | None,
) -> Crossing:
    """Find where each lane of a march first meets an event.

    Parameters
    ----------
    march : March
        The flight.
    value : callable
        The event, (x (n, N), p (k, N), t (N,)) → (1, N).
    direction : {-1, 0, 1}
        Falling, both, rising, along the flight.
    after : array_like, shape (N,) or scalar
        Length of flight before which nothing counts.
    where : str or None
        What flies, for the error; None if non-finite lanes are to be let through.

    Returns
    -------
    Crossing
        Times and states.

    Raises
    ------
    PropagationError
        If a lane turns non-finite before the event and `where` is given.
    """
    n, cases, h, y0 = march.n, march.cases, march.h, march.start
    wait = np.abs(per_lane(after, cases, "after"))

    def event(y: Array, t: Array) -> Array:
        found: Array = value(y[:n], march.p, t)[0]
        return found

    before, begin = y0.copy(), march.t0.copy()
    g_before, g_after = np.zeros(cases), np.zeros(cases)
    found = np.zeros(cases, dtype=bool)
    end, last, g_last = y0, y0, event(y0, march.t0)
    for j, end in enumerate(march, start=1):
        g = event(end, march.t0 + j * h)
        hit = _crosses(g_last, g, direction) & ~found & (j * np.abs(h) > wait)
        before[:, hit], begin[hit] = last[:, hit], (march.t0 + (j - 1) * h)[hit]
        g_before[hit], g_after[hit] = g_last[hit], g[hit]
        found |= hit
        if found.all():
            break
        last, g_last = end, g
    if where is not None:
        refuse_non_finite(np.where(found, 0.0, end), where)

    partial = np.empty_like(before)

    def after_partial_step(tau: Array) -> Array:
        march.stepper.bind(tau, march.p)(before, partial, begin)
        return event(partial, begin + tau)

    # The partial step can be told no better than the clock: a few units in its last place.
    width = 4.0 * np.finfo(float).eps * np.maximum(np.abs(h), np.abs(begin))
    far = np.where(found, h, 0.0)
    tau = bracketed_roots(after_partial_step, np.zeros(cases), far, g_before, g_after, width)
    after_partial_step(tau)
    state, phi = march.split(np.where(found, partial, end))
    time = np.where(found, begin + tau, np.nan)
    if march.single:
        return Crossing(found[0], time[0], state, phi)
    return Crossing(found, time, state, phi)


def _crosses(before: Array, after: Array, direction: int) -> NDArray[np.bool_]:
    falling, rising = (before > 0) & (after <= 0), (before < 0) & (after >= 0)
    if direction == 0:
        return falling | rising
    return falling if direction < 0 else rising
