"""Simulated searches after a loss of signal: time until the satellite is found, case by case."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.assisted_tracking.specs import SearchSpec
from hillsphere_tracking.pointing.search import Search, plan_search

__all__ = ["SearchOutcome", "simulate_search"]

_STEPS_PER_BEAM = 20.0
"""Steps of time in which the search moves by the beam's radius: when the satellite enters the beam
is known to a twentieth of that, and only a chord shorter than that is stepped over."""
_FIRST_LOOK_S = 10.0
"""Part of the search (s) that is sampled first, four times as much after each failure: most
searches end in it, and only the rare long ones pay for more samples. The result does not depend on
it."""


@dataclass(frozen=True, eq=False)
class SearchOutcome:
    """Results of the searches of N cases; NaN for errors that are not finite.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
        Time from the return of the signal until the satellite is found, or until the set.
    found : ndarray, shape (N,)
        1 if the satellite is found before it sets, else 0.
    at_once : ndarray, shape (N,)
        1 if the satellite is found at the prediction, without a search, else 0.
    """

    time_s: Array
    found: Array
    at_once: Array


def simulate_search(
    spec: SearchSpec, beam_rad: float, times_s: Array, off_rad: Array, covariance: Array
) -> SearchOutcome:
    """Simulate the search for the satellite in each case.

    When the signal returns the antenna stays at the prediction for one dwell. It then searches back
    and forth about the moving prediction.

    Parameters
    ----------
    spec : SearchSpec
        Parameters of the search.
    beam_rad : float
        Largest error at which the signal is received.
    times_s : ndarray, shape (K,)
        Times from the return of the signal to the set, in increasing order.
    off_rad : ndarray, shape (2, K, N)
        Arcs on the sky from the prediction to the satellite's direction at the encoders.
    covariance : ndarray, shape (2, 2, N)
        Covariance of the prediction at the return of the signal, rad².

    Returns
    -------
    SearchOutcome
        Results of all cases.
    """
    since = times_s - times_s[0]
    wait = min(spec.dwell_s, float(since[-1]))
    known = np.isfinite(off_rad).all(axis=(0, 1)) & np.isfinite(covariance).all(axis=(0, 1))
    time, found = np.full((2, off_rad.shape[2]), np.nan)
    first = int(np.searchsorted(since, wait)) + 1
    # in the beam at all samples of the dwell; errors change little between samples
    at_once = known & (np.hypot(*off_rad[:, :first]) <= beam_rad).all(axis=0)
    time[at_once], found[at_once] = wait, 1.0
    for n in np.flatnonzero(known & ~at_once):
        search = plan_search(
            covariance[:, :, n], beam_rad, spec.speed_rad_s, begin_s=wait, dwell_s=spec.dwell_s,
            sigmas=spec.sigmas,
        )  # fmt: skip
        held_s = _time(search, since, off_rad[:, :, n])
        found[n] = held_s is not None
        time[n] = since[-1] if held_s is None else held_s
    return SearchOutcome(time, found, np.where(known, at_once, np.nan))


def _time(search: Search, since: Array, off: Array) -> float | None:
    """Return the time at which the satellite has been in the beam for the dwell, or None."""
    end, horizon = float(since[-1]), _FIRST_LOOK_S
    step = search.beam_rad / search.speed_rad_s / _STEPS_PER_BEAM
    while True:
        t = np.arange(0.0, min(horizon, end) + step, step)
        right, up = search.at(t)
        away = np.hypot(np.interp(t, since, off[0]) - right, np.interp(t, since, off[1]) - up)
        outside = away > search.beam_rad
        # index of the last entry into the beam, at every step
        entered = np.maximum.accumulate(np.where(outside, np.arange(t.size) + 1, 0))
        held = ~outside & ((np.arange(t.size) - entered) * step >= search.dwell_s - 1e-9)
        if held.any():
            return min(float(t[np.argmax(held)]), end)
        if horizon >= end:
            return None
        horizon *= 4.0
