"""A landing nobody has tuned: size, mass, field, spin and site of an asteroid drawn at random.

The draw is seeded by the release, so that every release meets a new body and a failure can be
repeated. The planned command is flown again among the stars by code of its own.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import hillsphere
from hillsphere.products import FlightSet, load_product

Array = NDArray[np.float64]

CONSTANT_G = 6.6743e-11
STEP_S = 30.0

MISSION = """
format = 1
name = "random-landing"
title = "Landing on an asteroid drawn at random"
seed = 2

[body.asteroid]
type = "asteroid"
name = "asteroid"
semi_major_axis_m = {orbit!r}
eccentricity = {eccentricity!r}
rotation_rate_rad_s = {rate!r}
obliquity_rad = {obliquity!r}
semi_axes_m = {axes}

[gravity.field]
type = "harmonics"
gm_m3_s2 = {gm!r}
reference_radius_m = {radius!r}
normalisation = "full"
tide_system = "none"
coefficients = [
    {{ n = 2, m = 0, c = {c20!r} }},
    {{ n = 2, m = 2, c = {c22!r}, s = {s22!r} }},
    {{ n = 3, m = 0, c = {c30!r} }},
]

[plant.field]
type = "three_body"
body = "asteroid"
gravity = "field"
orbit = "elliptic"
rotation = "spin"

[guidance.energy]
type = "minimum_energy"

[compensator.pd]
type = "pid"
period_s = {step!r}
proportional = [1e-4, 1e-4, 1e-4]
integral = [0, 0, 0]
derivative = [0.014, 0.014, 0.014]

[stage.references]
type = "reference_trajectories"
plant = "field"
guidance = "energy"
step_s = {step!r}
[[stage.references.descents]]
name = "down"
start = {{ position_m = {start}, others = {{ true_anomaly = 1.0, rotation_angle = 0.5 }} }}
site = {{ latitude_rad = {latitude!r}, longitude_rad = {longitude!r} }}
touchdown_speed_m_s = 0.1
duration_s = {duration!r}

[stage.flight]
type = "closed_loop"
plant = "field"
law = "pd"
needs = {{ reference = "references" }}
success = ["impact", "completed"]
substeps = 3
"""


@dataclass(frozen=True)
class Draw:
    """An asteroid, and where to land on it; SI."""

    orbit: float
    eccentricity: float
    rate: float
    obliquity: float
    axes: tuple[float, float, float]
    gm: float
    radius: float
    c20: float
    c22: float
    s22: float
    c30: float
    start: tuple[float, float, float]
    latitude: float
    longitude: float
    duration: float

    @property
    def mission(self) -> str:
        """The mission file."""
        values = {**vars(self), "axes": list(self.axes), "start": list(self.start)}
        return MISSION.format(step=STEP_S, **values)


def draw(text: str) -> Draw:
    """Draw an asteroid from a text.

    Longest semi-axis 0.2 to 8 km, the others 0.7-1 of the one before, density 1.2 to 3.5 g/cm³,
    spin up to 0.6 of that at which the ends float off, about an axis of any tilt. The field is that
    of the ellipsoid turned by up to 10° about its axis, with a C30 of up to 0.01. The site lies
    within 60° of the equator; the flight begins 1.2 to 1.8 times as far out, 20° away, at rest
    against the ground, and takes two to three times √(a³/GM).
    """
    rng = np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big"))
    a = float(np.exp(rng.uniform(np.log(200.0), np.log(8000.0))))
    b = a * float(rng.uniform(0.7, 1.0))
    c = b * float(rng.uniform(0.7, 1.0))
    gm = CONSTANT_G * float(rng.uniform(1200.0, 3500.0)) * 4.0 / 3.0 * np.pi * a * b * c
    turn = 2.0 * float(rng.uniform(-0.17, 0.17))
    c22 = np.sqrt(12 / 5) * (a * a - b * b) / 20.0 / a**2
    latitude, longitude = float(rng.uniform(-1.05, 1.05)), float(rng.uniform(-np.pi, np.pi))
    lat, lon = latitude + 0.25 * float(rng.choice([-1.0, 1.0])), longitude + 0.25
    way = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    surface = 1.0 / np.sqrt(np.sum((way / [a, b, c]) ** 2))
    x, y, z = (rng.uniform(1.2, 1.8) * surface * way).tolist()
    slow = np.sqrt(a**3 / gm)
    return Draw(
        orbit=float(rng.uniform(1.5e11, 5e11)),
        eccentricity=float(rng.uniform(0.0, 0.5)),
        rate=float(rng.uniform(0.1, 0.6) / slow),
        obliquity=float(rng.uniform(0.0, np.pi)),
        axes=(a, b, c),
        gm=float(gm),
        radius=a,
        c20=float((2 * c * c - a * a - b * b) / 10.0 / a**2 / np.sqrt(5)),
        c22=float(c22 * np.cos(turn)),
        s22=float(c22 * np.sin(turn)),
        c30=float(rng.uniform(-0.01, 0.01)),
        start=(x, y, z),
        latitude=latitude,
        longitude=longitude,
        duration=STEP_S * float(np.round(rng.uniform(2.0, 3.0) * slow / STEP_S)),
    )


def attraction(body: Draw, r: Array) -> Array:
    """Gradient of the series by complex steps of its potential in closed form."""
    pull = np.zeros(3)
    for axis in range(3):
        x, y, z = (r + 1e-30j * np.eye(3)[axis]).tolist()
        d = np.sqrt(x * x + y * y + z * z)
        s, near = z / d, body.radius / d
        second = np.sqrt(5) * (1.5 * s * s - 0.5) * body.c20
        second += np.sqrt(15 / 4) * (body.c22 * (x * x - y * y) + body.s22 * 2 * x * y) / d**2
        third = np.sqrt(7) * (2.5 * s**3 - 1.5 * s) * body.c30
        pull[axis] = (body.gm / d * (1.0 + near**2 * (second + near * third))).imag * 1e30
    return pull


def landed(body: Draw, command: Array) -> Array:
    """Where the held command (3, K) leads to, fixed in the body; without the Sun."""

    def turned(angle: float, v: Array) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])

    r = np.array(body.start)
    y = np.concatenate([r, np.cross([0.0, 0.0, body.rate], r)])
    for k, thrust in enumerate(command.T):

        def motion(t: float, y: Array, thrust: Array = thrust) -> Array:
            fixed = attraction(body, turned(-body.rate * t, y[:3])) + thrust
            return np.concatenate([y[3:], turned(body.rate * t, fixed)])

        span = (k * STEP_S, (k + 1) * STEP_S)
        y = solve_ivp(motion, span, y, "RK45", rtol=1e-10, atol=1e-8).y[:, -1]
    return turned(-body.rate * body.duration, y[:3])


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> tuple[Draw, dict[str, Any], FlightSet]:
    """Run the mission that this release draws, once."""
    drawn = draw(hillsphere.__version__)
    directory: Path = tmp_path_factory.mktemp("landing")
    (directory / "landing.toml").write_text(drawn.mission, "utf-8")
    mission = hillsphere.load_mission(str(directory / "landing.toml"))
    hillsphere.run_mission(mission, out=directory / "run", use_cache=False)
    summary = json.loads((directory / "run" / "summary.json").read_text("utf-8"))
    assert not summary["failures"], (drawn, summary["failures"])
    return drawn, summary, load_product(directory / "run" / "references.npz")


def test_the_planned_command_leads_to_the_site(
    outcome: tuple[Draw, dict[str, Any], FlightSet],
) -> None:
    body, _, references = outcome
    flights = references.flights
    assert flights.u is not None
    command = flights.u[:, :, 0]
    steps = round(body.duration / STEP_S)
    end = landed(body, command[:, :steps])
    lat, lon = body.latitude, body.longitude
    way = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    site = way / np.sqrt(np.sum((way / body.axes) ** 2))
    assert np.linalg.norm(end - site) < 0.02, body


def test_the_flight_lands_there(outcome: tuple[Draw, dict[str, Any], FlightSet]) -> None:
    """Held, the command leaves the path by centimetres between every second sample."""
    body, summary, _ = outcome
    metrics = summary["metrics"]
    assert metrics["closed_loop_final_position_error"]["value"] < 0.3, body
    assert metrics["closed_loop_largest_position_error"]["value"] < 0.3, body
    assert metrics["closed_loop_final_speed"]["value"] == pytest.approx(0.1, abs=0.01), body
