"""The mission ``eros-landing``: gravity, shape and motion written out again from the data files."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.special import sph_legendre_p_all
from tests.missions.pages import check_page

import hillsphere
from hillsphere.base.paths import missions_directory
from hillsphere.products import CaseTable, load_product
from hillsphere_controllers.linear_products import LinearModels, UncertainModels
from hillsphere_controllers.stages.linearise.products import LinearisedFlight
from hillsphere_controllers.stages.mu_analysis.products import MuAnalysis
from hillsphere_controllers.stages.synthesis.products import Synthesis
from hillsphere_controllers.stages.uncertain import to_lft
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_guidance.reference_trajectories.products import ReferenceTrajectories

Array = NDArray[np.float64]

GM, RADIUS = 4.46275472004e5, 16e3
SPIN = np.radians(1639.389232) / 86400.0
SITE_LATITUDE, SITE_LONGITUDE = np.radians([2.0, 178.0])


pytestmark = pytest.mark.slow  # 40 s


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run the packaged mission in short, in this process."""
    out = tmp_path_factory.mktemp("missions") / "eros"
    mission = hillsphere.load_mission("eros-landing", profile="fast")
    hillsphere.run_mission(mission, out=out, use_cache=False)
    return out


def series(degree: int, rows: Array, latitude: Array, longitude: Array) -> Array:
    """Terms of 4π-normalised rows n, m, C, S on a sphere, summed by degree, (degree + 1, N)."""
    # SciPy's are orthonormal, with the Condon-Shortley phase
    p = sph_legendre_p_all(degree, degree, np.pi / 2.0 - latitude)[0]
    total: Array = np.zeros((degree + 1, latitude.size))
    for n, m, c, s in rows:
        if n <= degree:
            size = (-1.0) ** m * np.sqrt(4.0 * np.pi * (1.0 if m == 0 else 2.0))
            angle = c * np.cos(m * longitude) + s * np.sin(m * longitude)
            total[int(n)] += size * p[int(n), int(m)] * angle
    return total


@cache
def field() -> Array:
    """Rows n, m, C, S and formal errors of both of the gravity field."""
    text = (missions_directory() / "data" / "eros-gravity-degree4.gfc").read_text("utf-8")
    rows = [line.split()[1:] for line in text.splitlines() if line.startswith("gfc ")]
    return np.array(rows, dtype=float)


def potential(r: Array) -> Array:
    """Potential of the series and of the rotation at places (3, N), m²/s²."""
    d = np.linalg.norm(r, axis=0)
    terms = series(4, field()[:, :4], np.arcsin(r[2] / d), np.arctan2(r[1], r[0]))
    near = (RADIUS / d) ** np.arange(5)[:, None]
    value: Array = GM / d * (near * terms).sum(axis=0) + SPIN**2 * (r[0] ** 2 + r[1] ** 2) / 2.0
    return value


def acceleration(x: Array) -> Array:
    """Acceleration of states (6, N) in axes that turn with the body, without the Sun."""
    steps = np.concatenate([np.eye(3), -np.eye(3)])[:, :, None]
    values = potential((x[:3] + steps).transpose(1, 0, 2).reshape(3, -1)).reshape(6, -1)
    difference = (values[:3] - values[3:]) / 2.0
    total: Array = difference + 2.0 * SPIN * np.stack([x[4], -x[3], np.zeros_like(x[3])])
    return total


def surface(r: Array) -> float:
    """Distance of the surface from the centre in the direction of a place."""
    rows = np.loadtxt(missions_directory() / "data" / "eros-shape-degree8.tab")
    latitude, longitude = np.arcsin(r[2] / np.linalg.norm(r)), np.arctan2(r[1], r[0])
    return float(series(8, rows, np.array([latitude]), np.array([longitude])).sum())


def flight(run: Path, stage: str) -> ClosedLoopFlight:
    product = load_product(run / f"{stage}.npz")
    assert isinstance(product, ClosedLoopFlight)
    return product


def campaign(run: Path, stage: str) -> CaseTable:
    product = load_product(run / f"{stage}.npz")
    assert isinstance(product, CaseTable)
    return product


def metric(table: CaseTable, name: str) -> Array:
    values: Array = table.values[table.metrics.index(name)]
    return values


def test_the_command_leads_to_the_site(run: Path) -> None:
    references = load_product(run / "references.npz")
    assert isinstance(references, ReferenceTrajectories)
    x, step = np.array([-22e3, 1e3, 1e3, 0.0, 0.0, 0.0])[:, None], 10.0

    def slope(x: Array, thrust: Array) -> Array:
        return np.concatenate([x[3:], acceleration(x) + thrust[:, None]])

    command = references.flights.u
    assert command is not None
    for thrust in command[:, :360, 0].T:
        a = slope(x, thrust)
        b = slope(x + step / 2.0 * a, thrust)
        c = slope(x + step / 2.0 * b, thrust)
        d = slope(x + step * c, thrust)
        x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    north, east = SITE_LATITUDE, SITE_LONGITUDE
    way = np.array([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)])
    assert_allclose(x[:3, 0], surface(way) * way, rtol=0, atol=0.05)
    assert np.linalg.norm(x[3:, 0]) == pytest.approx(0.5, abs=1e-4)
    assert references.replay_held_m.max() < 1e-3
    assert references.dv_m_s[0] == pytest.approx(
        step * np.linalg.norm(command[:, :360, 0], axis=0).sum(), rel=1e-3
    )


def test_linear_models_are_derivatives_of_the_motion(run: Path) -> None:
    linear = load_product(run / "linear.npz")
    assert isinstance(linear, LinearisedFlight)
    last = linear.labels.index("nominal, point 2")
    x, step = linear.x[:, -1:], np.repeat([10.0, 1e-2], 3)
    sides = [x + np.diag(step), x - np.diag(step)]
    expected = (acceleration(sides[0]) - acceleration(sides[1])) / (2.0 * step)
    found = linear.systems[last].a[3:]
    assert_allclose(found[:, :3], expected[:, :3], rtol=0, atol=2e-12)
    assert_allclose(found[:, 3:], expected[:, 3:], rtol=0, atol=1e-9)
    assert 1e-7 < np.abs(found[:, :3]).max() < 1e-6


def test_coefficients_are_a_thousand_formal_errors_uncertain(run: Path) -> None:
    linear = load_product(run / "linear.npz")
    assert isinstance(linear, LinearisedFlight)
    formal = {}
    for n, m, _, _, c, s in field():
        formal[f"gravity.eros.C{n:.0f},{m:.0f}"] = c
        formal[f"gravity.eros.S{n:.0f},{m:.0f}"] = s
    assert len(linear.dispersed) == 21
    assert linear.affine.all()
    expected = [1000.0 * formal[name] for name in linear.dispersed]
    assert_allclose(linear.sigma, expected, rtol=1e-9)


def test_one_compensator_suits_the_whole_descent(run: Path) -> None:
    design = load_product(run / "k.npz")
    plants = load_product(run / "nominal_plants.npz")
    assert isinstance(design, Synthesis)
    assert isinstance(plants, LinearModels)
    assert design.controller.poles.real.max() < 0.0
    assert design.gamma < 1.0
    omega = np.concatenate([[0.0], np.logspace(-7, 3, 1500)])
    reached = []
    for plant in plants.systems:
        loop = lower_lft(plant, design.controller)
        assert loop.poles.real.max() < 0.0
        # from the three commands to the weighted errors and controls, the last six outputs
        gains = np.linalg.norm(loop.response(omega)[:, -6:, -3:], 2, axis=(1, 2))
        reached.append(gains.max())
    assert_allclose(max(reached), design.gamma, rtol=1e-3)


def test_worst_case_of_mu_has_the_gain_that_it_says(run: Path) -> None:
    product = load_product(run / "mu.npz")
    uncertain = load_product(run / "uncertain.npz")
    design = load_product(run / "k.npz")
    assert isinstance(product, MuAnalysis)
    assert isinstance(uncertain, UncertainModels)
    assert isinstance(design, Synthesis)
    for bare, result, model in zip(
        product.without_cover, product.results, uncertain.models, strict=True
    ):
        assert design.gamma < bare.lower <= bare.upper < 1.2 * bare.lower
        # the certificate with the block that covers what the truncation left out
        assert bare.lower == result.lower <= result.upper
        # the largest uncertainty that counts is 1/µ times the declared one
        assert np.abs(result.normalised).max() <= 1.001 / result.lower
        worst = to_lft(model).at(dict(zip(result.names, result.values, strict=True)))
        loop = lower_lft(worst, design.controller)
        gain = np.linalg.norm(loop.response(np.array([result.frequency_rad_s]))[0], 2)
        assert gain >= 0.999 * result.lower


def test_flights_end_on_the_surface(run: Path) -> None:
    series_flight, solid = flight(run, "flight"), flight(run, "flight_solid")
    assert series_flight.position_error_m[0] == 0.0
    for one in (series_flight, solid):
        assert not one.failed
        height = np.linalg.norm(one.end_x[:3]) - surface(one.end_x[:3])
        assert abs(height) < 0.05
        assert np.linalg.norm(one.end_x[3:6]) == pytest.approx(0.5, abs=0.02)
        assert one.step_error_m is not None
        assert one.step_error_m < 1e-6
    # along its own reference only rounding and the steps of the held command are left
    assert np.nanmax(series_flight.position_error_m) < 0.05
    assert 0.5 < np.nanmax(solid.position_error_m) < 5.0


def test_no_case_fails(run: Path) -> None:
    random, solid, worst = (
        campaign(run, stage) for stage in ("verify", "verify_solid", "verify_worst")
    )
    assert random.case.size == 64
    for table in (random, solid, worst):
        assert set(table.status.tolist()) <= {"impact", "completed"}  # none is undecided
        assert not table.failed.any()
        assert metric(table, "early").max() < 60.0
        assert metric(table, "final_speed").max() < 1.0
    assert 0.3 < metric(random, "largest_position_error").mean() < 3.0
    # the series is off by more, near the surface, than the errors of its coefficients make it
    rows = [random.inputs.index(name) for name in solid.inputs]
    assert_allclose(random.input_values[rows][:, :2], solid.input_values, rtol=1e-12)
    errors = metric(random, "final_position_error")
    assert metric(solid, "final_position_error").min() > np.median(errors)


@pytest.mark.slow
def test_its_page_works_in_a_browser(run: Path) -> None:
    check_page(run)
