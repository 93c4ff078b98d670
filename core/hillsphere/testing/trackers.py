"""Checks of trackers on a simulated pass of a satellite."""

from __future__ import annotations

from typing import Any

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.base.time import Epoch
from hillsphere.interfaces import Array, Tracker
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.testing.contract import check_close, require

__all__ = ["check_tracker"]

_GM = 3.986004418e14
"""Gravitational parameter of the Earth, m³/s² (WGS 84)."""
_EPOCH = Epoch.parse("2020-03-01T12:00:00", "UTC")
_ELEMENTS = np.array([7.2e6, 1e-3, 0.9, 4.0, 0.5, 0.2])
"""Nearly circular, so that a tracker of circular orbits may follow it."""
_OFF = np.array([0.0, 0.0, 0.0, 2e-3, 0.0, 4e-3])
"""True minus nominal elements: about 15 km across and 30 km along the track."""
_CASES = 6
"""Cases that are tracked at once: the two below with missing measurements, and four complete."""
_WITHOUT, _MISSING = 2, 4
"""Indices of two cases: one without any measurement, one without the last third of them."""
_TIMES = np.arange(-120.0, 0.0, 4.0)
_LATER = np.array([0.0, 20.0, 60.0, 180.0])
_SIGMA = 1e-3
"""Standard deviation of the measured angles, rad: 0.06°, that of a small antenna."""
_TURN = 2.0 * np.pi


def check_tracker(tracker: Tracker[Any], *, tol: float = 1e-9, learns: bool = True) -> None:
    """Check a tracker on a pass near the zenith of a station.

    Parameters
    ----------
    tracker : Tracker
        The tracker.
    tol : float
        Largest difference, rad, between results that must agree.
    learns : bool
        Whether it uses measurements; a stored table does not.

    Raises
    ------
    ContractViolation
        Unless

        - azimuths (K, N) lie in [0, 2π), elevations are finite, covariances (2, 2, K, N) finite,
          symmetric and not negative;
        - before any measurement it points at the nominal orbit, to 2° (the possible effect of the
          difference between mean and osculating elements);
        - results do not depend on the order of times or on their shape, (K,) or (K, N);
        - the difference of angles with and without biases is equal at all times, and zero before
          any measurement;
        - measured azimuths may be a revolution off, and equal standard deviations of any shape give
          equal results;
        - no argument and no state is changed, and the same call gives the same bits;
        - each case depends on itself only;
        - the uncertainty of a case without a measurement (NaN) does not decrease, and its
          prediction stays, to the 0.03° by which constant elements may lag behind in that time;
        - after measurements of an orbit some 30 km off it points closer to that orbit than before.
    """
    what = type(tracker).__name__
    require(isinstance(tracker.short_period, bool), f"{what}: short_period must be true or false")
    site = _station()
    kit = _Kit(what, tracker, site, tol)
    nominal = np.repeat(_ELEMENTS[:, None], _CASES, axis=1)
    start = kit.initial(nominal)
    azimuth, elevation, _ = kit.predicted(start, _LATER)
    there = _look_angles(site, _LATER)
    off = _apart(azimuth, elevation, *(q[:, None] for q in there))
    require(
        float(off.max()) < np.radians(2.0),
        f"{what} points {np.degrees(off.max()):.3g}° beside the nominal orbit before any "
        "measurement; azimuth counts from north over east, elements are in the frame teme",
    )
    # Measured angles of the true orbit, by the tracker's own theory.
    truth = kit.initial(nominal + _OFF[:, None])
    seen = [q.copy() for q in kit.predicted(truth, _TIMES)[:2]]
    later = kit.predicted(truth, _LATER)[:2]
    seen[0][:, _WITHOUT] = np.nan
    seen[1][-len(_TIMES) // 3 :, _MISSING] = np.nan
    states = [start]
    for k in range(len(_TIMES)):
        states.append(kit.update(states[-1], k, seen[0][k], seen[1][k], np.array(_SIGMA)))
    end = states[-1]
    kit.check_pure(start, end)
    kit.check_missing(start, states[-1 - len(_TIMES) // 3], end)
    kit.check_predictions(end)
    kit.check_alternatives(nominal, seen, end)
    kit.check_lanes(nominal, seen, end)
    before, after = (_apart(*kit.predicted(q, _LATER)[:2], *later).max(axis=0)
                     for q in (start, end))  # fmt: skip
    told = np.arange(_CASES) != _WITHOUT
    bound = 0.5 * before if learns else 1.01 * before + tol
    require(
        (after <= bound)[told].all(),
        f"{what} points {np.degrees(after[told].max()):.3g}° off after {len(_TIMES)} measurements, "
        f"{np.degrees(before[told].max()):.3g}° before any",
    )


class _Kit:
    """A tracker whose results are checked for their form at each call."""

    def __init__(self, what: str, tracker: Tracker[Any], site: Station, tol: float) -> None:
        self.what, self._tracker, self._site, self._tol = what, tracker, site, tol

    def initial(self, elements: Array) -> Any:
        """Return the state of a nominal orbit, and check that its elements are not changed."""
        given = elements.copy()
        state = self._tracker.initial(elements, np.zeros(1), (self._site,), _EPOCH)
        require(np.array_equal(given, elements), f"{self.what}: initial changes the elements")
        return state

    def update(self, state: Any, k: int, az: Array, el: Array, sigma: Array) -> Any:
        """Return the state after the k-th measurements, and check that they are not changed."""
        arguments = (np.full(az.shape, _TIMES[k]), az.copy(), el.copy(), sigma.copy())
        before = [a.copy() for a in arguments]
        after = self._tracker.update(state, *arguments)
        for a, b in zip(arguments, before, strict=True):
            require(
                np.array_equal(a, b, equal_nan=True), f"{self.what}: update changes an argument"
            )
        return after

    def fed(self, elements: Array, seen: list[Array], sigma: Array) -> Any:
        """Return the state after all measurements."""
        state = self.initial(elements)
        for k in range(len(_TIMES)):
            state = self.update(state, k, seen[0][k], seen[1][k], sigma)
        return state

    def predicted(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        """Return the prediction, after checks of its shapes, ranges and covariances."""
        what = self.what
        azimuth, elevation, covariance = self._tracker.predict(state, times_s, biased=biased)
        shape = (len(times_s), azimuth.shape[-1])
        require(
            azimuth.shape == elevation.shape == shape and covariance.shape == (2, 2, *shape),
            f"{what}: predict must return (K, N), (K, N) and (2, 2, K, N), got {azimuth.shape}, "
            f"{elevation.shape}, {covariance.shape}",
        )
        for name, values in (("azimuth", azimuth), ("elevation", elevation),
                             ("covariance", covariance)):  # fmt: skip
            require(np.isfinite(values).all(), f"{what}: {name} is not finite")
        require(
            (azimuth >= 0.0).all() and (azimuth < _TURN).all(),
            f"{what}: azimuths must lie in [0, 2π), got {azimuth.min():.4g} to {azimuth.max():.4g}",
        )
        size = np.abs(np.trace(covariance))
        lean = np.abs(covariance[0, 1] - covariance[1, 0])
        require((lean <= 1e-9 * size).all(), f"{what}: the covariance is not symmetric")
        require(
            (np.linalg.eigvalsh(covariance.transpose(2, 3, 0, 1)).T >= -1e-9 * size.T).all(),
            f"{what}: the covariance has a negative variance",
        )
        return azimuth, elevation, covariance

    def check_predictions(self, state: Any) -> None:
        """Check that times may have any order and shape, and the effect of biases."""
        what, tol = self.what, self._tol
        given = self.predicted(state, _LATER)
        back = self.predicted(state, _LATER[::-1])
        each = self.predicted(state, np.repeat(_LATER[:, None], _CASES, axis=1))
        for a, b, c in zip(given, back, each, strict=True):
            check_close(f"{what}: times in another order", b[..., ::-1, :], a, 1.0, tol)
            check_close(f"{what}: times (K, N) instead of (K,)", c, a, 1.0, tol)
        plain = self.predicted(state, _LATER, biased=False)
        for name, one, other in zip(("azimuth", "elevation"), given, plain, strict=False):
            bias = _wrap(one - other)
            require(
                float(np.abs(bias[:, _WITHOUT]).max()) <= tol,
                f"{what}: knows an {name} bias without a measurement",
            )

    def check_pure(self, start: Any, end: Any) -> None:
        """Check that updates and predictions do not change a state."""
        for name, state in (("first", start), ("last", end)):
            before = [q.copy() for q in self.predicted(state, _LATER)]
            made = [self._next(state), self._next(state)]
            for a, b in zip(before, self.predicted(state, _LATER), strict=True):
                require(
                    np.array_equal(a, b), f"{self.what}: update or predict changes the {name} state"
                )
            for a, b in zip(*made, strict=True):
                require(
                    np.array_equal(a, b),
                    f"{self.what}: the same update of the {name} state differs",
                )

    def check_alternatives(self, elements: Array, seen: list[Array], end: Any) -> None:
        """Check that azimuths count modulo a revolution, and all shapes of sigma."""
        given = self.predicted(end, _LATER)
        turns = _TURN * np.random.default_rng(3).integers(-1, 2, size=seen[0].shape)
        others = {
            "measured azimuths a revolution off": ([seen[0] + turns, seen[1]], np.array(_SIGMA)),
            "sigma of shape (N,)": (seen, np.full(_CASES, _SIGMA)),
            "sigma of shape (2, N)": (seen, np.full((2, _CASES), _SIGMA)),
        }
        for name, (angles, sigma) in others.items():
            predicted = self.predicted(self.fed(elements, angles, sigma), _LATER)
            self._check_same(name, predicted, given)

    def check_lanes(self, elements: Array, seen: list[Array], end: Any) -> None:
        """Check that cases do not depend on their order and their neighbours."""
        order = np.random.default_rng(4).permutation(_CASES)
        given = [q[..., order] for q in self.predicted(end, _LATER)]
        moved = self.fed(elements[:, order], [q[:, order] for q in seen], np.array(_SIGMA))
        self._check_same("the cases in another order", self.predicted(moved, _LATER), given)
        alone = self.fed(elements[:, :1], [q[:, :1] for q in seen], np.array(_SIGMA))
        given = [q[..., :1] for q in self.predicted(end, _LATER)]
        self._check_same("a case alone", self.predicted(alone, _LATER), given)

    def check_missing(self, start: Any, middle: Any, end: Any) -> None:
        """Check that missing measurements give no information."""
        after = self.predicted(end, _LATER)
        for case, state in ((_WITHOUT, start), (_MISSING, middle)):
            before = self.predicted(state, _LATER)
            moved = _apart(*(q[:, case] for q in (*before[:2], *after[:2])))
            require(
                float(moved.max()) < 5e-4,
                f"{self.what}: without measurements (NaN) the prediction moves by "
                f"{np.degrees(moved.max()):.3g}°",
            )
            known = [np.trace(q[2])[:, case] for q in (before, after)]
            require(
                (known[1] >= 0.95 * known[0]).all(),
                f"{self.what}: without measurements (NaN) the covariance shrinks",
            )

    def _next(self, state: Any) -> list[Array]:
        """Return copies of the predictions after one more measurement."""
        angles = np.ones((2, _CASES))
        after = self.update(state, -1, angles[0], angles[1], np.array(_SIGMA))
        return [q.copy() for q in self.predicted(after, _LATER)]

    def _check_same(self, name: str, values: Any, given: Any) -> None:
        for part, a, b in zip(("azimuth", "elevation", "covariance"), values, given, strict=True):
            off = _wrap(a - b) if part == "azimuth" else a - b
            check_close(f"{self.what}: {name}: {part}", off, np.zeros_like(b), 1.0, self._tol)


def _station() -> Station:
    """Return a station some 300 km beside the ground track, at the time zero."""
    place = _earth_fixed(np.zeros(1))[:, 0]
    below = Station.at("below", place)
    return Station("kit", below.latitude_rad + 0.04, below.longitude_rad - 0.03, 100.0)


def _earth_fixed(t_s: Array) -> Array:
    """Return Earth-fixed positions (3, K), m, on the Keplerian orbit of the nominal elements."""
    a, e, i, node, perigee, mean = _ELEMENTS
    mean = mean + np.sqrt(_GM / a**3) * t_s
    anomaly = mean
    for _ in range(20):
        anomaly = mean + e * np.sin(anomaly)
    along, across = a * (np.cos(anomaly) - e), a * np.sqrt(1.0 - e * e) * np.sin(anomaly)
    c, s = np.cos(perigee), np.sin(perigee)
    x, y = c * along - s * across, s * along + c * across
    c, s = np.cos(node), np.sin(node)
    r = np.array([c * x - s * np.cos(i) * y, s * x + c * np.cos(i) * y, np.sin(i) * y])
    return np.asarray(np.einsum("ijn,jn->in", earth_fixed("teme", _EPOCH, t_s), r))


def _look_angles(site: Station, t_s: Array) -> tuple[Array, Array]:
    """Return azimuth and elevation (K,), rad, of these positions."""
    east, north, up = site.axes @ (_earth_fixed(t_s) - site.ecef_m[:, None])
    return np.arctan2(east, north), np.arctan2(up, np.hypot(east, north))


def _apart(azimuth: Array, elevation: Array, azimuth2: Array, elevation2: Array) -> Array:
    """Return the angles between directions."""
    one, two = (
        np.array([np.cos(h) * np.sin(a), np.cos(h) * np.cos(a), np.sin(h)])
        for a, h in ((azimuth, elevation), (azimuth2, elevation2))
    )
    chord = np.sqrt(((one - two) ** 2).sum(axis=0))
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


def _wrap(angle: Array) -> Array:
    return np.asarray(np.remainder(angle + np.pi, _TURN) - np.pi)
