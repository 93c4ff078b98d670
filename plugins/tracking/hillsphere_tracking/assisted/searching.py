"""How long a search takes until it finds the satellite, case by case."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.assisted.specs import SearchSpec
from hillsphere_tracking.pointing.search import Search, plan_search

__all__ = ["times_to_reacquire"]

_STEPS_PER_BEAM = 20.0
_FIRST_LOOK_S = 10.0


def times_to_reacquire(
    spec: SearchSpec, beam_rad: float, times_s: Array, off_rad: Array, covariance: Array
) -> Array:
    """Return how long each case searches.

    When the signal comes back the antenna stays at the prediction for one dwell; then it searches,
    back and forth, about the prediction as that moves on.

    Parameters
    ----------
    spec : SearchSpec
        How it is searched.
    beam_rad : float
        Error up to which the signal is received.
    times_s : ndarray, shape (K,)
        From the signal's return to the set, rising.
    off_rad : ndarray, shape (2, K, N)
        Arcs from the prediction to where the antenna would show the satellite.
    covariance : ndarray, shape (2, 2, N)
        Of the prediction when the signal returns, rad².

    Returns
    -------
    ndarray, shape (N,)
        Seconds, until the set if it is not found. NaN for errors that are not finite.
    """
    since = times_s - times_s[0]
    wait = min(spec.dwell_s, float(since[-1]))
    known = np.isfinite(off_rad).all(axis=(0, 1))
    found = np.full(off_rad.shape[2], np.nan)
    first = int(np.searchsorted(since, wait)) + 1
    # at all samples up to the end of the dwell: errors hardly change between two of them
    at_once = known & (np.hypot(*off_rad[:, :first]) <= beam_rad).all(axis=0)
    found[at_once] = wait
    for n in np.flatnonzero(known & ~at_once):
        search = plan_search(
            covariance[:, :, n], beam_rad, spec.speed_rad_s, begin_s=wait, dwell_s=spec.dwell_s,
            sigmas=spec.sigmas,
        )  # fmt: skip
        found[n] = _time(search, since, off_rad[:, :, n])
    return found


def _time(search: Search, since: Array, off: Array) -> float:
    """Return when the satellite has been in the beam for the dwell."""
    end, horizon = float(since[-1]), _FIRST_LOOK_S
    step = search.beam_rad / search.speed_rad_s / _STEPS_PER_BEAM
    while True:
        t = np.arange(0.0, min(horizon, end) + step, step)
        right, up = search.at(t)
        away = np.hypot(np.interp(t, since, off[0]) - right, np.interp(t, since, off[1]) - up)
        outside = away > search.beam_rad
        entered = np.maximum.accumulate(np.where(outside, np.arange(t.size) + 1, 0))
        held = ~outside & ((np.arange(t.size) - entered) * step >= search.dwell_s - 1e-9)
        if held.any():
            return min(float(t[np.argmax(held)]), end)
        if horizon >= end:
            return end
        horizon *= 4.0
