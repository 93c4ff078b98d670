"""Assisted tracking, measurement by measurement and in batches; finding passes.

Trackers follow pass 7 over Alcântara of the assisted-tracking paper of 1990. Beside ours stands
what a user would otherwise write:

- the averager in plain Python, its iteration carried to the same tolerance;
- an extended Kalman filter of a, Ω, M and two angle biases in numpy, with a Jacobian by
  differences, as one is written around a filter package; beside it `least_squares` without
  short-period terms and repeated linearisation, which must agree but for what is of second order in
  the noise (a fifteenth of a standard deviation);
- the stage `assisted_tracking` with trackers of the plain interface, pass by pass and with the
  covariances of all predictions;
- skyfield's search for events, satellite by satellite and station by station, as it is (to half a
  second) and to the millisecond.

Times are CPU times, the shortest of some runs; "streamed" is one call for each measurement of one
antenna, "batch" a call for a thousand antennas, divided by them.
"""

from __future__ import annotations

from math import acos, asin, atan2, cos, fmod, pi, radians, sin, sqrt
from time import process_time
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from sgp4.api import WGS72, Satrec
from skyfield import sgp4lib
from skyfield.api import EarthSatellite, load, wgs84

from hillsphere import create
from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import ConstantOrientation, EarthOrientation, OrientationTable
from hillsphere.interfaces.cases import CaseBatch
from hillsphere.model.earth.rotation import earth_angle, to_earth_fixed
from hillsphere.spec import Ref
from hillsphere.time import Epoch
from hillsphere_tracking.assisted_tracking.specs import AssistedTrackingSpec
from hillsphere_tracking.assisted_tracking.stage import AssistedTrackingStage
from hillsphere_tracking.ground_track import EarthTrack
from hillsphere_tracking.mean_elements import propagate_secular, secular_rates, states
from hillsphere_tracking.passes.masks import HorizonMask
from hillsphere_tracking.passes.passes import find_all_passes
from hillsphere_tracking.satellites import orbits_of
from hillsphere_tracking.sgp4_near_earth import elements_of, propagate_near_earth
from hillsphere_tracking.topocentric import angles
from hillsphere_tracking.trackers.average import Average
from hillsphere_tracking.trackers.least_squares import LeastSquares
from hillsphere_tracking.trackers.specs import AverageSpec, LeastSquaresSpec
from hillsphere_tracking.trackers.streaming import StreamingTracker

Array = NDArray[np.float64]
GM, RADIUS, J2, RATE = 3.986004418e14, 6378137.0, 1.08262668e-3, 7.292115855306589e-5
EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
ELEMENTS = np.array([7180e3, 0.0436, *np.radians([23.82, 240.14, 15.47, 350.56])])
ALCANTARA = Station("Alcântara", radians(-2.18), radians(-44.26), 39.0)
CUIABA = Station("Cuiabá", radians(-15.53), radians(-56.07), 277.0)
ACQUIRED, COUNT, CASES = 38370.0, 300, 1000
TIMES = ACQUIRED + np.arange(COUNT)
SIGMA = 1e-3
ANGLE = float(earth_angle("teme", EPOCH, np.zeros(1))[0])
LATER = ACQUIRED + 500.0
DAYS, MASK, PAIRS = 3.0, 5.0, 7


def measured(*, short_period: bool) -> tuple[Array, Array]:
    """Return noisy azimuths and elevations (COUNT,) of the pass, the node 0.2° from the nominal."""
    true = ELEMENTS + radians(0.2) * np.eye(6)[3]
    x = states(true[:, None], TIMES, short_period=short_period)
    azimuth, elevation, _ = angles(ALCANTARA, to_earth_fixed("teme", x, EPOCH, TIMES)[:3])
    noise = np.random.default_rng(1).normal(size=(2, COUNT)) * SIGMA
    return azimuth + noise[0], elevation + noise[1]


def streamed_us(tracker: Any, azimuth: Array, elevation: Array) -> float:
    """Time per measurement of one antenna, µs."""
    best = np.inf
    for _ in range(8):
        stream = StreamingTracker(tracker, ELEMENTS, 0.0, ALCANTARA, EPOCH, sigma_rad=SIGMA)
        samples = list(zip(TIMES.tolist(), azimuth.tolist(), elevation.tolist(), strict=True))
        begin = process_time()
        for sample in samples:
            stream.update(*sample)
        best = min(best, (process_time() - begin) / COUNT)
    return best * 1e6


def batch_us(tracker: Any, azimuth: Array, elevation: Array) -> float:
    """Time per measurement and antenna of a thousand antennas, µs."""
    elements = np.repeat(ELEMENTS[:, None], CASES, axis=1)
    sigma, one = np.array(SIGMA), np.ones(CASES)
    best = np.inf
    for _ in range(3):
        state = tracker.initial(elements, np.zeros(1), (ALCANTARA,), EPOCH)
        begin = process_time()
        for k in range(0, COUNT, 5):
            state = tracker.update(state, TIMES[k] * one, azimuth[k] * one, elevation[k] * one,
                                   sigma)  # fmt: skip
        best = min(best, (process_time() - begin) / (COUNT // 5) / CASES)
    return best * 1e6


# -- what a user would otherwise write -------------------------------------------------------------


def wrapped(angle: float) -> float:
    """Return an angle in [−π, π)."""
    return fmod(fmod(angle + pi, 2.0 * pi) + 2.0 * pi, 2.0 * pi) - pi


def kepler(mean: float, e: float) -> float:
    """Return the eccentric anomaly."""
    anomaly = mean
    for _ in range(20):
        step = (anomaly - e * sin(anomaly) - mean) / (1.0 - e * cos(anomaly))
        anomaly -= step
        if abs(step) < 1e-13:
            break
    return anomaly


class PlainAverager:
    """Running means of node and mean anomaly, in floats."""

    def __init__(self, elements: Array) -> None:
        self.a, self.e, self.i, self.node, self.perigee, self.mean = elements.tolist()
        shape = (1.0 - 1.5 * sin(self.i) ** 2) / (1.0 - self.e**2) ** 1.5
        self.rate = sqrt(GM / self.a**3) * (1.0 + 1.5 * J2 * (RADIUS / self.a) ** 2 * shape)
        self.place, self.axes = ALCANTARA.ecef_m.tolist(), ALCANTARA.axes.tolist()
        self.t, self.count = TIMES[0], 0

    def update(self, t: float, azimuth: float, elevation: float) -> None:
        """Take a measurement."""
        a, e, inclination, perigee = self.a, self.e, self.i, self.perigee
        mean = self.mean + self.rate * (t - self.t)
        level = cos(elevation)
        local = (level * sin(azimuth), level * cos(azimuth), sin(elevation))
        c = [sum(local[k] * self.axes[k][j] for k in range(3)) for j in range(3)]
        b = sum(p * q for p, q in zip(self.place, c, strict=True))
        size2 = sum(p * p for p in self.place)
        anomaly = kepler(mean, e)
        r = a * (1.0 - e * cos(anomaly))
        f = 2.0 * atan2(sqrt(1.0 + e) * sin(0.5 * anomaly), sqrt(1.0 - e) * cos(0.5 * anomaly))
        falling = cos(perigee + f) < 0.0
        for _ in range(60):
            distance = sqrt(r * r - size2 + b * b) - b
            x, y, z = (p + distance * q for p, q in zip(self.place, c, strict=True))
            u = asin(max(-1.0, min(1.0, z / (r * sin(inclination)))))
            if falling:
                u = pi - u
            f = u - perigee
            anomaly = 2.0 * atan2(sqrt(1.0 - e) * sin(0.5 * f), sqrt(1.0 + e) * cos(0.5 * f))
            better = a * (1.0 - e * cos(anomaly))
            done = abs(better - r) < 1e-12 * a
            r = better
            if done:
                break
        node = ANGLE + RATE * t + atan2(y, x) - atan2(cos(inclination) * sin(u), cos(u))
        self.count += 1
        self.node += wrapped(node - self.node) / self.count
        self.mean = mean + wrapped(anomaly - e * sin(anomaly) - mean) / self.count
        self.t = t


class PlainFilter:
    """Extended Kalman filter of a, Ω, M and the biases of azimuth and elevation, in numpy."""

    def __init__(self, spec: LeastSquaresSpec) -> None:
        self.held = propagate_secular(ELEMENTS[:, None], TIMES[:1])[:, 0]
        self.x = np.array([*self.held[[0, 3, 5]], 0.0, 0.0])
        sigmas = [spec.semi_major_axis_sigma_m, spec.node_sigma_rad, spec.mean_anomaly_sigma_rad]
        self.p = np.diag(np.square([*sigmas, spec.bias_sigma_rad, spec.bias_sigma_rad]))
        # what an error of a has done by the acquisition
        change = np.eye(5)
        change[1:3, 0] = self.slopes(TIMES[0])[1:]
        self.p = change @ self.p @ change.T
        self.t = TIMES[0]
        self.steps = np.array([10.0, 1e-6, 1e-6, 1e-6, 1e-6])

    def rates(self, a: float) -> Array:
        """Return the rates of Ω, ω and M."""
        elements = self.held.copy()
        elements[0] = a
        return np.asarray(secular_rates(elements[:, None])[:, 0])

    def slopes(self, dt: float) -> Array:
        """Return what a unit of a changes in a, Ω and M after a time."""
        later = (self.rates(self.x[0] + 10.0) - self.rates(self.x[0] - 10.0)) / 20.0 * dt
        return np.array([1.0, later[0], later[2]])

    def look(self, x: Array, t: float) -> Array:
        """Return the angles that the antenna shows."""
        a, node, mean = x[:3].tolist()
        _, e, i, _, perigee, _ = self.held.tolist()
        anomaly = kepler(mean, e)
        along, across = a * (cos(anomaly) - e), a * sqrt(1.0 - e * e) * sin(anomaly)
        c, s = cos(perigee), sin(perigee)
        p, q = c * along - s * across, s * along + c * across
        turned = node - (ANGLE + RATE * t)
        c, s = cos(turned), sin(turned)
        place = np.array([c * p - s * cos(i) * q, s * p + c * cos(i) * q, sin(i) * q])
        east, north, up = ALCANTARA.axes @ (place - ALCANTARA.ecef_m)
        return np.array([atan2(east, north) + x[3], atan2(up, sqrt(east**2 + north**2)) + x[4]])

    def update(self, t: float, azimuth: float, elevation: float) -> None:
        """Take a measurement."""
        dt = t - self.t
        change = np.eye(5)
        change[:3, 0] = self.slopes(dt)
        rates = self.rates(self.x[0])
        self.x[1] += rates[0] * dt
        self.held[4] += rates[1] * dt
        self.x[2] += rates[2] * dt
        self.p = change @ self.p @ change.T
        slopes = np.empty((2, 5))
        for k in range(5):
            shift = self.steps * (np.arange(5) == k)
            slopes[:, k] = self.look(self.x + shift, t) - self.look(self.x - shift, t)
            slopes[0, k] = wrapped(slopes[0, k])
        slopes /= 2.0 * self.steps
        off = np.array([azimuth, elevation]) - self.look(self.x, t)
        off[0] = wrapped(off[0])
        gain = self.p @ slopes.T @ np.linalg.inv(slopes @ self.p @ slopes.T + SIGMA**2 * np.eye(2))
        self.x = self.x + gain @ off
        rest = np.eye(5) - gain @ slopes
        self.p = rest @ self.p @ rest.T + SIGMA**2 * gain @ gain.T
        self.t = t

    def predicted(self, t: float) -> Array:
        """Return the angles at a later time."""
        x = self.x.copy()
        rates = self.rates(x[0]) * (t - self.t)
        x[1:3] += rates[[0, 2]]
        self.held[4] += rates[1]
        found = self.look(x, t)
        self.held[4] -= rates[1]
        return found


def plain_us(filter_: Any, azimuth: Array, elevation: Array) -> float:
    """Feed a filter the pass and return its time per measurement, µs."""
    samples = list(zip(TIMES.tolist(), azimuth.tolist(), elevation.tolist(), strict=True))
    begin = process_time()
    for sample in samples:
        filter_.update(*sample)
    return (process_time() - begin) / COUNT * 1e6


def element_sets(count: int = 10) -> list[str]:
    """Return two-line element sets of low orbits, of all inclinations and phases."""
    found = []
    for number in range(count):
        k, turn = 10.0 * number / count, 36.0 * number % 360.0
        first = f"1 {10000 + number}U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  999"
        second = (
            f"2 {10000 + number} {15.0 + 9.0 * k:8.4f} {turn:8.4f} {int(7417 + 5000 * k):07d}  "
            f"17.6667 {33.0 * number % 360.0:8.4f} {15.5 - 0.25 * k:11.8f}20247"
        )
        found.append("\n".join(line + str(_checksum(line)) for line in (first, second)))
    return found


def _checksum(line: str) -> int:
    return (sum(int(q) for q in line if q.isdigit()) + line.count("-")) % 10


def random_sets(count: int) -> list[Satrec]:
    """Return random element sets: periods of 88 to 220 min, much drag, low perigees."""
    random = np.random.default_rng(7)
    found: list[Satrec] = []
    while len(found) < count:
        one = Satrec()
        one.sgp4init(
            WGS72, "i", len(found) + 1, 25000.0, 10.0 ** random.uniform(-6.0, -2.5), 0.0, 0.0,
            10.0 ** random.uniform(-5.0, -0.4), random.uniform(0.0, 2.0 * pi),
            radians(random.uniform(0.0, 179.0)), random.uniform(0.0, 2.0 * pi),
            random.uniform(6.6, 16.4) * 2.0 * pi / 1440.0, random.uniform(0.0, 2.0 * pi),
        )  # fmt: skip
        perigee_km = (one.a * (1.0 - one.ecco) - 1.0) * one.radiusearthkm
        if perigee_km > 140.0 and one.method == "n" and one.sgp4_tsince(0.0)[0] == 0:
            found.append(one)
    return found


def sgp4_figures() -> dict[str, float]:
    """Compare the compiled SGP4 with the package sgp4, 1000 element sets at 50 times in a week."""
    sets = random_sets(1000)
    t_s = np.linspace(-1.0, 7.0, 50) * 86400.0
    codes, x = [], []
    begin = process_time()
    for one in sets:
        code, r, _ = one.sgp4_array(
            np.full(t_s.size, one.jdsatepoch), one.jdsatepochF + t_s / 86400.0
        )
        codes.append(code)
        x.append(r)
    theirs = process_time() - begin
    # the array call dates by Julian days, whose rounding counts: compare the call in minutes
    exact = np.array([[one.sgp4_tsince(t / 60.0)[1] for t in t_s] for one in sets])
    elements = np.repeat(np.array([elements_of(one) for one in sets]).T, t_s.size, axis=1)
    times = np.tile(t_s, len(sets))
    propagate_near_earth(elements, times)
    begin = process_time()
    code, ours = propagate_near_earth(elements, times)
    mine = process_time() - begin
    known = np.array(codes).ravel()
    sound = known == 0
    off = np.abs(1e-3 * ours[:3].T - exact.reshape(-1, 3)).max(axis=1)
    return {
        "sgp4_ns_per_state": mine / times.size * 1e9,
        "sgp4_package_ns_per_state": theirs / times.size * 1e9,
        "sgp4_faster_than_package": theirs / mine,
        "sgp4_difference_km": float(off[sound].max()),
        "sgp4_other_error_codes": float(np.count_nonzero(code != known)),
    }


def find_ours(
    orbits: list[Any],
    stations: list[Station],
    days: float,
    orientation: EarthOrientation | None = None,
) -> list[list[Array]]:
    """Return rises and sets, by station and satellite."""
    start, table = Epoch.parse("2019-12-10", "UTC"), orientation or OrientationTable.installed()
    tracks = [EarthTrack(orbit, start, days * 86400.0, table) for orbit in orbits]
    mask = HorizonMask((radians(MASK),))
    return [
        [np.concatenate([one.rise_s[~one.begun], one.set_s[~one.unfinished]]) for one in row]
        for row in find_all_passes(stations, tracks, [mask] * len(stations))
    ]


def find_skyfield(
    sets: list[str], stations: list[Station], days: float, accuracy_s: float | None = None
) -> list[list[Array]]:
    """Return rises and sets by skyfield, as it is or to another accuracy than its half second."""
    scale = load.timescale(builtin=True)
    first, last = scale.utc(2019, 12, 10), scale.utc(2019, 12, 10 + days)
    searches = {name: getattr(sgp4lib, name) for name in ("find_maxima", "_find_discrete")}

    def finer(search: Any) -> Any:
        def run(*given: Any) -> Any:
            *front, _, count = given
            return search(*front, (accuracy_s or 0.5) / 86400.0, count)

        return run

    found = []
    with mock.patch.multiple(sgp4lib, **{k: finer(v) for k, v in searches.items()}):
        for station in stations:
            place = wgs84.latlon(np.degrees(station.latitude_rad),
                                 np.degrees(station.longitude_rad), station.height_m)  # fmt: skip
            row = []
            for text in sets:
                satellite = EarthSatellite(*text.splitlines(), "", scale)
                times, events = satellite.find_events(place, first, last, altitude_degrees=MASK)
                since = (times.tai - first.tai) * 86400.0
                row.append(np.concatenate([since[events == 0], since[events == 2]]))
            found.append(row)
    return found


def passes_figures() -> dict[str, float]:
    """Find passes by both, and compare; ratios are medians of seven paired repeats."""
    sets, stations = element_sets(), [ALCANTARA, CUIABA]
    orbits = [orbits_of(text, "tle")[0] for text in sets]
    mine = find_ours(orbits, stations, DAYS)
    times = np.empty((3, PAIRS))
    for k in range(PAIRS):
        begin = process_time()
        find_ours(orbits, stations, DAYS)
        middle = process_time()
        theirs = find_skyfield(sets, stations, DAYS)
        end = process_time()
        exact = find_skyfield(sets, stations, DAYS, 1e-3)
        times[:, k] = middle - begin, end - middle, process_time() - end
    pairs = [
        (a, b, c)
        for row in zip(mine, theirs, exact, strict=True)
        for a, b, c in zip(*row, strict=True)
    ]
    same = [a.size == b.size for a, b, _ in pairs]
    off = max(np.max(np.abs(a - b), initial=0.0) for a, b, _ in pairs if a.size == b.size)
    # with skyfield's own UT1 and no polar motion, which it leaves out, only the searches differ
    ut1 = float(load.timescale(builtin=True).utc(2019, 12, 11).dut1)
    turned = find_ours(orbits, stations, DAYS, ConstantOrientation(ut1))
    near = max(
        np.max(np.abs(a - c), initial=0.0)
        for row, other in zip(turned, exact, strict=True)
        for a, c in zip(row, other, strict=True)
        if a.size == c.size
    )
    ratio, finer = times[1] / times[0], times[2] / times[0]
    random = np.random.default_rng(3)
    many = [
        Station(f"{k}", radians(random.uniform(-70.0, 70.0)), random.uniform(-pi, pi), 100.0)
        for k in range(10)
    ]
    hundred = [orbits_of(text, "tle")[0] for text in element_sets(100)]
    week = np.inf
    for _ in range(3):
        begin = process_time()
        found = find_ours(hundred, many, 7.0)
        week = min(week, process_time() - begin)
    return {
        "passes_10_satellites_2_stations_3_days_cpu_s": float(np.median(times[0])),
        "passes_skyfield_cpu_s": float(np.median(times[1])),
        "passes_skyfield_to_1_ms_cpu_s": float(np.median(times[2])),
        "passes_faster_than_skyfield": float(np.median(ratio)),
        "passes_faster_than_skyfield_lowest": float(ratio.min()),
        "passes_faster_than_skyfield_to_1_ms": float(np.median(finer)),
        "passes_searches_with_other_counts_than_skyfield": float(same.count(False)),
        "passes_rise_and_set_difference_s": float(off),
        "passes_rise_and_set_difference_to_1_ms_s": float(near),
        "passes_100_satellites_10_stations_7_days_cpu_s": week,
        "passes_100_satellites_10_stations_7_days_events": float(
            sum(one.size for row in found for one in row)
        ),
    }


class PlainInterface:
    """A tracker without `join`, `select` and `point`: each pass is followed by itself."""

    def __init__(self, tracker: Any) -> None:
        self.short_period = tracker.short_period
        self.initial, self.update, self.predict = tracker.initial, tracker.update, tracker.predict


def outage_stage(tracker: Any) -> AssistedTrackingStage:
    """Return four passes with two losses of the signal, followed by one tracker."""
    a, e, i, node, perigee, mean = ELEMENTS.tolist()
    elements = {
        "epoch": "1989-01-31T09:58:00", "semi_major_axis_m": a, "eccentricity": e,
        "inclination_rad": i, "node_rad": node, "perigee_rad": perigee, "mean_anomaly_rad": mean,
    }  # fmt: skip
    antennas = [
        create("sensor", "antenna", station=s.name, latitude_rad=s.latitude_rad,
               longitude_rad=s.longitude_rad, height_m=s.height_m)
        for s in (ALCANTARA, CUIABA)
    ]  # fmt: skip
    passes = [
        {"name": f"p{k}", "sensor": antennas[k // 2], "revolution": revolution,
         "elevation_max_deg": 40.0, "outages_s": [60.0, 120.0]}
        for k, revolution in enumerate((7, 8, 8, 9))
    ]  # fmt: skip
    return AssistedTrackingStage(
        AssistedTrackingSpec.model_validate(
            {"satellite": {"name": "SCD", "elements": elements}, "passes": passes,
             "trackers": [Ref("one", tracker)],
             "nominal_error": {"position_km": 3, "velocity_m_s": 3}}
        )
    )  # fmt: skip


def campaign_figures() -> dict[str, float]:
    """Follow a block of a campaign as it is, and pass by pass by the plain interface of trackers.

    Ratios are medians of paired repeats; histories of one error are kept, as for bands over time.
    """
    lanes = np.arange(64)
    batch = CaseBatch(lanes, lanes, lanes < 0, (), np.zeros((0, 64)), 1, "bench")
    tracker = LeastSquares(LeastSquaresSpec())
    stages = [outage_stage(one) for one in (tracker, PlainInterface(tracker))]
    results = [stage.run_cases(batch, ["*.error"]) for stage in stages]
    times = np.empty((2, PAIRS))
    for k in range(PAIRS):
        for row, stage in zip(times, stages, strict=True):
            begin = process_time()
            stage.run_cases(batch, ["*.error"])
            row[k] = process_time() - begin
    one, other = (result.values for result in results)
    off = np.abs(one - other) / np.maximum(np.abs(other), 1e-300)
    ratio = times[1] / times[0]
    return {
        "outages_block_cpu_ms": float(np.median(times[0])) * 1e3,
        "outages_faster_than_pass_by_pass": float(np.median(ratio)),
        "outages_faster_than_pass_by_pass_lowest": float(ratio.min()),
        "outages_difference_from_pass_by_pass": float(off.max()),
    }


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    seen = measured(short_period=True)
    average, best = Average(AverageSpec()), LeastSquares(LeastSquaresSpec())
    found = {
        "average_streamed_us": streamed_us(average, *seen),
        "average_batch_us": batch_us(average, *seen),
        "least_squares_streamed_us": streamed_us(best, *seen),
        "least_squares_batch_us": batch_us(best, *seen),
    }
    at_acquisition = propagate_secular(ELEMENTS[:, None], TIMES[:1])[:, 0]
    plain = np.inf
    for _ in range(8):
        averager = PlainAverager(at_acquisition)
        plain = min(plain, plain_us(averager, *seen))
    stream = StreamingTracker(average, ELEMENTS, 0.0, ALCANTARA, EPOCH)
    for sample in zip(TIMES.tolist(), *(q.tolist() for q in seen), strict=True):
        stream.update(*sample)
    off = [averager.node - stream.state.elements[3, 0], averager.mean - stream.state.elements[5, 0]]
    found |= {
        "plain_averager_us": plain,
        "average_streamed_faster_than_plain": plain / found["average_streamed_us"],
        "average_batch_faster_than_plain": plain / found["average_batch_us"],
        "average_difference_from_plain_rad": max(abs(wrapped(q)) for q in off),
    }
    seen = measured(short_period=False)
    spec = LeastSquaresSpec(
        horizon_bias=False, short_period=False, drift_m=0.0, gate=100.0, relinearisations=0
    )
    plain = np.inf
    for _ in range(3):
        filter_ = PlainFilter(spec)
        plain = min(plain, plain_us(filter_, *seen))
    stream = StreamingTracker(LeastSquares(spec), ELEMENTS, 0.0, ALCANTARA, EPOCH, sigma_rad=SIGMA)
    for sample in zip(TIMES.tolist(), *(q.tolist() for q in seen), strict=True):
        stream.update(*sample)
    azimuth, elevation, _ = stream.predict(np.array([LATER]))
    one, two = (
        np.array([cos(h) * sin(a), cos(h) * cos(a), sin(h)])
        for a, h in ((azimuth[0], elevation[0]), filter_.predicted(LATER).tolist())
    )
    found |= {
        "plain_filter_us": plain,
        "least_squares_streamed_faster_than_plain": plain / found["least_squares_streamed_us"],
        "least_squares_batch_faster_than_plain": plain / found["least_squares_batch_us"],
        "least_squares_difference_from_plain_deg": float(np.degrees(acos(min(one @ two, 1.0)))),
    }
    return found | campaign_figures() | sgp4_figures() | passes_figures()


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<50} {number:12.4g}")
