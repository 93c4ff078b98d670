"""Passes of Kuga and Carrara (1990): flown, measured without errors, tracked by the averager.

The satellite is flown by the plant `earth_orbit` with zonals to degree 6, tesserals 4 × 4 and drag
from the paper's elements taken as Brouwer's mean ones; the antenna of the sensors measures it; one
tracker is fed second by second. The averager is written here a second time, for one measurement
after the other, from the paper's equations (1) to (20): with the sign of (8) mended, the means of
(17) and (19) taken modulo 2π, and the iteration carried to its end.
"""

from __future__ import annotations

from math import asin, atan2, cos, fmod, pi, sin, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere import create
from hillsphere.base.geodetic import Station
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import earth_angle, earth_fixed
from hillsphere.time import Epoch
from hillsphere_tracking.kepler import elements_from_states
from hillsphere_tracking.mean_elements import EARTH_FIELD
from hillsphere_tracking.passes.flights import PlantFlights
from hillsphere_tracking.recording import record
from hillsphere_tracking.satellites import MeanElementsOrbit
from hillsphere_tracking.trackers.streaming import StreamingTracker

EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
PAPER = np.array([7180e3, 0.0436, *np.radians([23.82, 240.14, 15.47, 350.56])])
FIELD = str(Path(__file__).parents[3] / "missions" / "data" / "earth-gravity-degree6.gfc")
GM = 398600.4418e9
ALCANTARA = Station("A", np.radians(-2.18), np.radians(-44.26), 39.0)
PLACE = {"station": "A", "latitude_deg": -2.18, "longitude_deg": -44.26, "height_m": 39}
SILENT: dict[str, Any] = {
    f"{angle}_{kind}_deg": [0, 0, 0] for angle in ("azimuth", "elevation")
    for kind in ("noise", "bias")
}  # fmt: skip


class Pass(NamedTuple):
    t: Array
    x: Array
    azimuth: Array
    elevation: Array


def measured(x: Array, t: Array, seed: int | None) -> Array:
    """Return both angles (2, K) as Alcântara's antenna shows them; without errors if no seed."""
    sensor = create("sensor", "antenna", **PLACE, **(SILENT if seed is None else {}))
    scene = {"earth_fixed": earth_fixed("teme", EPOCH, t)}
    shown = record(
        sensor, x[:, :, None], t, scene, seed=seed or 0, stage="pass", cases=np.array([3])
    )
    return np.asarray(shown[:, :, 0])


@pytest.fixture(scope="module")
def passes() -> dict[int, Pass]:
    gravity = create("gravity", "harmonics", file=FIELD, max_degree=6, max_tesseral_degree=4)
    plant = create(
        "plant", "earth_orbit", gravity=gravity, epoch="1989-01-31T09:58:00",
        body=create("body", "planet", orientation="constant"),
        drag={"drag_coefficient": 2.2, "area_to_mass_m2_kg": 0.01, "f107": 150.0,
              "f107_average": 150.0, "ap": 15.0},
    )  # fmt: skip
    orbit = MeanElementsOrbit("paper", EPOCH, PAPER, EARTH_FIELD)
    flown = PlantFlights(plant).fly(orbit, EPOCH, 39600.0)
    found = {}
    for number, begin, end in ((2, 5900.0, 6700.0), (7, 38200.0, 39500.0)):
        t = np.arange(begin, end)
        x = flown.states(t)
        azimuth, elevation = measured(x, t, None)
        above = np.isfinite(elevation)  # the antenna's mask is 5°
        found[number] = Pass(t[above], x[:, above], azimuth[above], elevation[above])
    return found


def streamed(flown: Pass, count: int) -> StreamingTracker:
    nominal = elements_from_states(flown.x[:, :1], GM)[:, 0]
    stream = StreamingTracker(create("tracker", "average"), nominal, flown.t[0], ALCANTARA, EPOCH)
    for k in range(count):
        assert stream.update(flown.t[k], flown.azimuth[k], flown.elevation[k])
    return stream


# The values are of another flight with constants of its own; these and drag move them by 1e-2°.
@pytest.mark.parametrize(
    ("number", "acquisition_s", "first", "count", "node", "mean"),
    [
        (2, 6036.0, (284.031369, 5.048786), 60, 239.724871, 353.588970),
        (7, 38370.0, (316.156110, 5.044038), 300, 237.400213, 130.749915),
    ],
)
def test_error_free_passes(
    passes: dict[int, Pass], number: int, acquisition_s: float, first: tuple[float, float],
    count: int, node: float, mean: float,
) -> None:  # fmt: skip
    flown = passes[number]
    assert flown.t[0] == acquisition_s
    assert (np.diff(flown.t) == 1.0).all()
    assert_allclose(np.degrees([flown.azimuth[0], flown.elevation[0]]), first, rtol=0, atol=1e-2)
    state = streamed(flown, count).state
    found = np.degrees(np.remainder(state.elements[[3, 5], 0], 2.0 * pi))
    assert_allclose(found, [node, mean], rtol=0, atol=1e-2)


def test_largest_errors_of_the_prediction(passes: dict[int, Pass]) -> None:
    """Equation (26) in pass 2 after a minute: 0.1266° with dA, 0.1226° with dA cos h."""
    flown = passes[2]
    azimuth, elevation, _ = streamed(flown, 60).predict(flown.t[60:])
    off = np.degrees([azimuth - flown.azimuth[60:], elevation - flown.elevation[60:]])
    off[0] = (off[0] + 180.0) % 360.0 - 180.0
    assert np.hypot(*off).max() == pytest.approx(0.1266, abs=1e-3)
    off[0] *= np.cos(flown.elevation[60:])
    assert np.hypot(*off).max() == pytest.approx(0.1226, abs=1e-3)


def wrap(angle: float) -> float:
    return angle - 2.0 * pi * round(angle / (2.0 * pi))


class PlainAverager:
    """The paper's section 3, equation by equation, in floats."""

    def __init__(self, elements: Array, t: float) -> None:
        self.a, self.e, self.i, self.node, self.perigee, self.mean = (float(q) for q in elements)
        self.t, self.count = t, 0
        latitude, longitude, height = (*np.radians([-2.18, -44.26]), 39.0)
        flat = 1.0 / 298.257223563
        square = flat * (2.0 - flat)
        normal = 6378137.0 / sqrt(1.0 - square * sin(latitude) ** 2)
        self.latitude, self.longitude = latitude, longitude
        self.station = (
            (normal + height) * cos(latitude) * cos(longitude),
            (normal + height) * cos(latitude) * sin(longitude),
            (normal * (1.0 - square) + height) * sin(latitude),
        )
        n = sqrt(GM / self.a**3)
        self.rate = n * (  # (20), (21)
            1.0
            + 1.5 * 1.08262668e-3 * (6378137.0 / self.a) ** 2
            * (1.0 - 1.5 * sin(self.i) ** 2) / (1.0 - self.e**2) ** 1.5
        )  # fmt: skip

    def eccentric(self, mean: float) -> float:
        found = mean
        for _ in range(50):
            found -= (found - self.e * sin(found) - mean) / (1.0 - self.e * cos(found))
        return found

    def update(self, t: float, azimuth: float, elevation: float, sidereal: float) -> None:
        e, i, w = self.e, self.i, self.perigee
        predicted = self.mean + self.rate * (t - self.t)  # (18)
        anomaly = self.eccentric(predicted)
        f = 2.0 * atan2(sqrt(1 + e) * sin(anomaly / 2), sqrt(1 - e) * cos(anomaly / 2))
        descending = cos(w + f) < 0.0
        south = (-cos(azimuth) * cos(elevation), sin(azimuth) * cos(elevation), sin(elevation))
        sp, cp = sin(self.latitude), cos(self.latitude)
        sl, cl = sin(self.longitude), cos(self.longitude)
        c = (  # (2), (3)
            sp * cl * south[0] - sl * south[1] + cp * cl * south[2],
            sp * sl * south[0] + cl * south[1] + cp * sl * south[2],
            -cp * south[0] + sp * south[2],
        )
        r = self.a * (1.0 - e * cos(anomaly))
        b = sum(p * q for p, q in zip(self.station, c, strict=True))  # (5)
        far = sum(p * p for p in self.station)
        for _ in range(200):
            rho = sqrt(r * r - far + b * b) - b  # (4)
            x, y, z = (p + rho * q for p, q in zip(self.station, c, strict=True))  # (6)
            sine = max(-1.0, min(1.0, z / (r * sin(i))))  # (7)
            u = pi - asin(sine) if descending else asin(sine)
            node = sidereal + atan2(y, x) - atan2(cos(i) * sin(u), cos(u))  # (8), (9), (10)
            f = u - w
            anomaly = 2.0 * atan2(sqrt(1 - e) * sin(f / 2), sqrt(1 + e) * cos(f / 2))
            better = self.a * (1.0 - e * cos(anomaly))  # (16)
            change, r = abs(better - r), better
            if change < 1e-13 * r:
                break
        mean = anomaly - e * sin(anomaly)  # (15)
        self.count += 1
        self.node += wrap(node - self.node) / self.count  # (17)
        self.mean = predicted + wrap(mean - predicted) / self.count  # (19)
        self.t = t


@pytest.mark.parametrize("number", [2, 7])
def test_every_estimate_of_a_noisy_pass_is_that_of_a_plain_averager(
    passes: dict[int, Pass], number: int
) -> None:
    flown = passes[number]
    noisy = flown._replace(**dict(zip(
        ("azimuth", "elevation"), measured(flown.x, flown.t, 1990), strict=True)))  # fmt: skip
    assert np.abs(noisy.elevation - flown.elevation).max() > 2e-3
    nominal = elements_from_states(flown.x[:, :1], GM)[:, 0]
    nominal[[3, 5]] += 0.01, -0.02
    plain = PlainAverager(nominal, flown.t[0])
    stream = StreamingTracker(create("tracker", "average"), nominal, flown.t[0], ALCANTARA, EPOCH)
    angle = earth_angle("teme", EPOCH, flown.t)
    for t, azimuth, elevation, turned in zip(
        flown.t, noisy.azimuth, noisy.elevation, angle, strict=True
    ):
        plain.update(float(t), float(azimuth), float(elevation), float(turned))
        stream.update(t, azimuth, elevation)
        found = stream.state.elements[[3, 5], 0]
        assert abs(fmod(found[0] - plain.node + 9.0 * pi, 2.0 * pi) - pi) < 1e-9
        assert abs(fmod(found[1] - plain.mean + 9.0 * pi, 2.0 * pi) - pi) < 1e-9
    assert stream.state.count[0] == plain.count == flown.t.size
