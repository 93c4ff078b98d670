"""Quasi-satellite orbits: the family, members at values, its ends, and gravity without mirrors."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from hillsphere import create
from hillsphere.errors import ConvergenceError, InputError, StageError
from hillsphere.interfaces import Array, Parameter
from hillsphere.products import Bifurcations
from hillsphere.testing import RecordingContext, check_stage
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.correction import tangents
from hillsphere_orbits.members import members_at
from hillsphere_orbits.qso.bifurcations import resonances_up_to
from hillsphere_orbits.qso.families import Family, Qso
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.shooting import PeriodicShooting, SymmetricShooting
from hillsphere_orbits.stability import determinant_error, stability_indices
from hillsphere_orbits.survey import Surveyor, extent, require_accuracy

# Phobos QSO bifurcation paper, section 2: axes, density, G; eq. 1 gives the mass.
GM = 7.059650784871513e5
PRIMARY = {"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 9377.0}


def plant(gravity: Any, *, semi_axes_m: tuple[float, ...] | None = None, **keys: Any) -> Any:
    body_keys = {} if semi_axes_m is None else {"semi_axes_m": semi_axes_m}
    body = create("body", "moon", name="phobos", **PRIMARY, **body_keys)
    return create("plant", "hill", body=body, gravity=gravity, **keys)


def harmonics(c22: float, s22: float) -> Any:
    return create(
        "gravity", "harmonics", gm_m3_s2=GM, reference_radius_km=11.1, normalisation="full",
        tide_system="none",
        coefficients=[{"n": 2, "m": 0, "c": -0.047}, {"n": 2, "m": 2, "c": c22, "s": s22}],
    )  # fmt: skip


class TabulatedPointMass:
    """A point mass that hides its formula, as a table or a polyhedron would."""

    frame = "body"
    gm_m3_s2 = GM

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", GM, "m3/s2"),)

    def potential_array(self, r: Array, p: Array) -> Array:
        return np.asarray(p[0] / np.linalg.norm(r, axis=0))

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return np.asarray(-p[0] * r / np.linalg.norm(r, axis=0) ** 3)

    def gradient_array(self, r: Array, p: Array) -> Array:
        d = np.linalg.norm(r, axis=0)
        return np.asarray(p[0] * (3 * r[:, None] * r[None] / d**5 - np.eye(3)[:, :, None] / d**3))


@pytest.fixture(scope="module")
def point_mass() -> Any:
    return plant(create("gravity", "point_mass", gm_m3_s2=GM), semi_axes_m=(13030, 11400, 9140))


@pytest.fixture(scope="module")
def qso(point_mass: Any) -> Qso:
    return create("orbit_family", "qso", Qso, plant=point_mass)


@pytest.fixture(scope="module")
def family(qso: Qso) -> Family:
    return qso.family(None, 110e3)


def stage(given: Any, **keys: Any) -> Any:
    return create("stage", "qso_family", plant=given, **keys)


def run(given: Any, **keys: Any) -> QsoFamily:
    found: QsoFamily = stage(given, **keys).run(RecordingContext())
    return found


@pytest.fixture(scope="module")
def computed(point_mass: Any) -> QsoFamily:
    return run(point_mass, x_amplitudes_km=[100, 20], periods_h=[7.0], jacobi_constants=[-1.0])


def amplitudes_km(qso: Qso, family: Family) -> Array:
    return family.amplitude(family.branch.z)[0] * qso.plant.scales.length_m / 1e3


def test_range_from_largest_amplitude_to_the_surface(qso: Qso, family: Family) -> None:
    """The x axis is crossed at x0 first of all, so that the grazing orbit has x0 = α."""
    x = amplitudes_km(qso, family)
    assert family.branch.ends == ("largest amplitude 110 km", "the orbit grazes the surface")
    assert x[0] == pytest.approx(110, abs=1e-9)
    assert x[-1] == pytest.approx(13.03, rel=1e-8)
    assert bool(np.all(np.diff(x) < 0))
    assert isinstance(family.problem, SymmetricShooting)


def test_far_orbits_tend_to_the_two_to_one_ellipse(qso: Qso) -> None:
    """Attraction over tide falls as 1/r³: at 40 units of length, 1e-5."""
    unit = qso.plant.scales.length_m
    far = qso.family(30 * unit, 40 * unit, members=21)
    z = far.branch.z[:, :1]
    assert far.problem.period(z)[0] == pytest.approx(2 * np.pi, rel=3e-5)
    assert far.problem.state(z)[4, 0] == pytest.approx(-80.0, rel=3e-5)
    y_max, vx = extent(far.problem, z)
    assert y_max[0] == pytest.approx(80.0, rel=3e-5)
    assert vx[0] == pytest.approx(40.0, rel=3e-5)


def test_range_inside_the_first_member(qso: Qso) -> None:
    near = qso.family(25e3, 45e3, members=21)
    x = amplitudes_km(qso, near)
    np.testing.assert_allclose(x[[0, -1]], [45, 25], rtol=1e-11)
    assert near.branch.ends == ("largest amplitude 45 km", "smallest amplitude 25 km")


def test_no_orbit_inside_the_body(qso: Qso) -> None:
    with pytest.raises(ConvergenceError, match=r"amplitude 12 km: the orbit grazes the surface"):
        qso.family(None, 12e3)


def test_body_without_surface_goes_on_to_almost_no_period() -> None:
    """Deep inside, members are retrograde Kepler circles seen from the turning frame.

    The rate is r^(−3/2) + 1, but for the tide, which is r³ of the attraction. The last member is
    the one whose period is that of a Kepler circle at 1e-3 units of length at rest.
    """
    gravity = create("gravity", "point_mass", gm_m3_s2=GM)
    bare = create("orbit_family", "qso", Qso, plant=plant(gravity))
    family = bare.family(None, 100e3, members=41)
    z = family.branch.z[:, -1:]
    last = float(family.amplitude(z)[0][0])
    assert family.problem.period(z)[0] == pytest.approx(2 * np.pi * 1e-3**1.5, rel=1e-6)
    assert family.problem.period(z)[0] == pytest.approx(2 * np.pi / (last**-1.5 + 1), rel=1e-8)
    assert family.branch.ends[1] == "the period of the next orbits is almost zero"


@pytest.mark.parametrize(("x0_km", "vy0", "period"), [
    (100.0, -8.409174939475, 6.225146165976),
    (20.0, -2.238228797055, 3.317797109272),
])  # fmt: skip
def test_members_against_another_integrator(
    qso: Qso, family: Family, x0_km: float, vy0: float, period: float
) -> None:
    """Literals and check: SciPy's DOP853 on a transcription, its own shooting."""
    unit = qso.plant.scales.length_m

    def motion(t: float, s: Array) -> list[float]:
        x, y, u, v = s
        k = (x * x + y * y) ** -1.5
        return [u, v, 2 * v + 3 * x - k * x, -2 * u - k * y]

    def crossing(w: Array) -> Array:
        start = [x0_km * 1e3 / unit, 0.0, 0.0, w[0]]
        end = solve_ivp(motion, (0, w[1]), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        return np.array([end[1], end[2]])

    independent = fsolve(crossing, [vy0, period / 2], xtol=1e-13)
    np.testing.assert_allclose(independent, [vy0, period / 2], rtol=1e-10)
    found = members_at(
        family.problem, family.branch, family.amplitude, np.array([x0_km * 1e3 / unit])
    )
    assert family.problem.state(found.z)[4, 0] == pytest.approx(vy0, rel=1e-11)
    assert family.problem.period(found.z)[0] == pytest.approx(period, rel=1e-11)


def test_members_by_period_and_jacobi_constant(computed: QsoFamily) -> None:
    members = computed.members
    assert members.labels == ("x = 100 km", "x = 20 km", "T = 7 h", "C = -1")
    np.testing.assert_allclose(members.x0[0, :2], [100e3, 20e3], rtol=1e-13)
    assert members.period_s[2] == pytest.approx(7 * 3600, rel=1e-13)
    assert members.integral[3] == pytest.approx(-1, rel=1e-12)


def test_checks_of_the_members(computed: QsoFamily) -> None:
    assert float(computed.members.residual.max()) < 1e-12
    assert computed.drift_revolutions == 100
    assert float(computed.drift.max()) < 2e-12
    assert float(np.abs(determinant_error(computed.members.monodromy)).max()) < 1e-12
    assert float(computed.curve.residual.max()) < 1e-12
    np.testing.assert_allclose(computed.tracks_m[:, 0], computed.members.x0[:3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(computed.tracks_m[:, -1], computed.members.x0[:3], rtol=0, atol=1e-6)


def test_indices_are_those_of_the_multipliers(computed: QsoFamily) -> None:
    for i in range(4):
        values = np.linalg.eigvals(computed.members.monodromy[:, :, i])
        sums = np.sort((values + 1 / values).real)
        expected = np.sort([2.0, 2.0, *np.repeat(computed.member_indices[:, i], 2)])
        np.testing.assert_allclose(
            sums, expected, rtol=0, atol=2e-6
        )  # the double pair 1, 1 is defective


def test_largest_y_on_the_track(computed: QsoFamily) -> None:
    by_samples = computed.tracks_m[1].max(axis=0)
    assert bool(np.all(computed.y_max_m >= by_samples))
    np.testing.assert_allclose(computed.y_max_m, by_samples, rtol=2e-3)


def test_all_that_is_missing_is_named(point_mass: Any) -> None:
    """The members that exist are returned; an error names all others only if there is none."""
    made = stage(point_mass, x_amplitudes_km=[5, 40, 12], periods_h=[9.5], curve_members=41)
    product = made.run(RecordingContext())
    assert product.members.labels == ("x = 40 km",)
    (text,) = product.missing
    assert "x = 5, 12 km (it has 13.03 to 95.4" in text
    assert "T = 9.5 h (it has 2.4" in text
    assert "grazes the surface (13.03 km)" in text
    assert f"Not all orbits exist: {text}." in made.present(product).verdict
    none = stage(point_mass, x_amplitudes_km=[5], periods_h=[9.5], curve_members=41)
    with pytest.raises(InputError, match=r"x = 5 km \(it has 13.03.*T = 9.5 h"):
        none.run(RecordingContext())


@pytest.mark.parametrize(("keys", "message"), [
    ({}, "x_amplitudes_m: no orbit is asked for"),
    ({"x_amplitudes_km": [50], "x_max_km": 40}, "outside the range from x_min to x_max: 50 km"),
    ({"x_amplitudes_km": [50], "x_max_km": 40, "x_min_km": 45}, "must be below the largest"),
    ({"x_amplitudes_km": [-1]}, "must be > 0"),
    ({"periods_h": [7, 5, 7.0]}, "periods_h: a value is listed twice"),
    ({"x_amplitudes_km": [50], "label": "Point mass"}, "label"),
    ({"x_amplitudes_km": [50], "family": object()}, "plant and family say the same thing"),
])  # fmt: skip
def test_bad_keys(point_mass: Any, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        stage(point_mass, **keys)


def test_some_family_is_needed() -> None:
    with pytest.raises(InputError, match="plant: missing: plant"):
        create("stage", "qso_family", x_amplitudes_km=[50])
    with pytest.raises(InputError, match="of type 'qso', got a object"):
        create("stage", "qso_family", family=object(), x_amplitudes_km=[50])


def test_family_from_a_table_of_its_own(qso: Qso) -> None:
    found: QsoFamily = create(
        "stage", "qso_family", family=qso, x_amplitudes_km=[40], curve_members=41
    ).run(RecordingContext())
    assert found.members.labels == ("x = 40 km",)
    assert found.body == "phobos"


def test_published_values_beside(point_mass: Any, tmp_path: Path) -> None:
    cited = tmp_path / "orbits.csv"
    cited.write_text("# source: a test\nname,x0_km,period_h\nfar,100,7.59\nother,70,7.4\n")
    keys = {"plant": point_mass, "x_amplitudes_km": [100, 50], "curve_members": 41,
            "reference": str(cited), "label": "cited"}  # fmt: skip
    product = check_stage("qso_family", keys, {})
    shown = create("stage", "qso_family", **keys).present(product)
    table = shown.tables["table_1_cited"]
    assert [row["name"] for row in table.rows] == ["far", "x = 50 km"]
    assert table.rows[0]["period_h_paper"] == 7.59
    assert "period_h_paper" not in table.rows[1]
    assert "x0_km_paper" not in [column.name for column in table.columns]
    assert any("1 of 1 values agree" in note for note in table.notes)
    assert "closure_max_cited" in shown.metrics


def test_compared_family_gives_the_range(point_mass: Any, computed: QsoFamily) -> None:
    bare = plant(create("gravity", "point_mass", gm_m3_s2=1.1 * GM))
    made = stage(bare, x_amplitudes_km=[50], curve_members=41)
    product = made.run(RecordingContext(), compare=computed)
    np.testing.assert_allclose(
        product.curve.x0[0, [0, -1]], computed.curve.x0[0, [0, -1]], rtol=1e-10
    )
    assert {"period", "stability", "orbits"} == set(made.present(product, computed).figures)


# --- bifurcations ---------------------------------------------------------------------------


def bifurcations(given: Any, family: QsoFamily, **keys: Any) -> Bifurcations:
    made = create("stage", "bifurcations", plant=given, needs={"family": "family"}, **keys)
    found: Bifurcations = made.run(RecordingContext(), family=family)
    return found


def test_every_root_is_found(point_mass: Any, computed: QsoFamily) -> None:
    """The vertical index has a minimum of 0.14: 2:9 (0.35) is met on either side, 1:4 (0) never."""
    found = bifurcations(point_mass, computed, vertical=["2:9", "1:4", "1:17"], planar=["1:3"])
    names = list(zip(found.plane, found.d, found.n, strict=True))
    assert [plane for plane, _, _ in names] == ["planar"] * 2 + ["vertical"] * 3
    assert [f"{d}:{n}" for _, d, n in names] == ["1:3", "1:3", "2:9", "2:9", "1:17"]
    expected = [2 * cos(2 * np.pi * d / n) for _, d, n in names]
    np.testing.assert_allclose(found.index, expected, rtol=0, atol=1e-11)
    assert found.orbits.x0[0, 2] > found.orbits.x0[0, 3]
    assert float(found.orbits.residual.max()) < 1e-12


def test_bifurcating_orbits_have_the_resonant_multipliers(
    point_mass: Any, computed: QsoFamily
) -> None:
    found = bifurcations(point_mass, computed, vertical=["1:7"], planar=["2:7"])
    for i in range(len(found.n)):
        power = np.linalg.matrix_power(found.orbits.monodromy[:, :, i], found.n[i])
        block = [2, 5] if found.plane[i] == "vertical" else [0, 1, 3, 4]
        values = np.linalg.eigvals(power[np.ix_(block, block)])
        # all of them 1; a defective pair is good to the root of the rounding
        np.testing.assert_allclose(values, 1.0, rtol=0, atol=3e-5)


def test_roots_by_the_curve_do_not_depend_on_its_members(
    point_mass: Any, computed: QsoFamily
) -> None:
    keys = {"vertical": ["1:5", "1:27"], "planar": ["1:9"]}
    coarse = run(point_mass, x_amplitudes_km=[50], curve_members=31, x_max_km=101)
    one, other = (bifurcations(point_mass, f, **keys).orbits for f in (computed, coarse))
    np.testing.assert_allclose(one.x0[0], other.x0[0], rtol=1e-11)


def test_bifurcations_are_shown(point_mass: Any, computed: QsoFamily) -> None:
    keys = {"plant": point_mass, "needs": {"family": "family"}, "n_max": 6, "vertical": ["1:4"]}
    product = check_stage("bifurcations", keys, {"family": computed})
    shown = create("stage", "bifurcations", **keys).present(product, computed)
    rows = shown.tables["bifurcations"].rows
    assert [r["resonance"] for r in rows if r["plane"] == "vertical"] == ["1:5", "1:6"]
    assert "vertical 1:4" in shown.verdict[1]


def test_family_of_other_equations_is_refused(computed: QsoFamily) -> None:
    heavier = plant(create("gravity", "point_mass", gm_m3_s2=1.1 * GM))
    with pytest.raises(StageError, match="do not solve the equations"):
        bifurcations(heavier, computed, vertical=["1:5"])


@pytest.mark.parametrize(("keys", "message"), [
    ({}, "no resonance is asked for"),
    ({"vertical": ["1-5"]}, "expected d:n such as '1:17', got '1-5'"),
    ({"vertical": ["0:5"]}, "expected d:n"),
    ({"planar": ["2:4"]}, "2:4 is 1:2"),
    ({"planar": ["3:4"]}, "3:4 has the stability index of 1:4"),
    ({"planar": ["7:4"]}, "7:4 has the stability index of 1:4"),
    ({"planar": ["5:1"]}, "5:1 is 1:1"),
    ({"planar": ["1:4", "1:4"]}, "is listed twice"),
])  # fmt: skip
def test_bad_resonances(point_mass: Any, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        create("stage", "bifurcations", plant=point_mass, needs={"family": "family"}, **keys)


def test_resonances_of_a_range() -> None:
    assert resonances_up_to(2, 5) == [(1, 1), (1, 2), (1, 3), (1, 4), (1, 5), (2, 5)]


# --- gravity of other symmetry --------------------------------------------------------------


def test_shallow_extrema_are_not_overlooked() -> None:
    """Planar index of the ellipsoid, Phobos paper: it turns twice between 15 and 20 km."""
    given = plant(create("gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], gm_m3_s2=GM))
    coarse = run(given, x_amplitudes_km=[100], curve_members=21)
    found = bifurcations(given, coarse, planar=["93:233"])
    # By bisection on the index along a curve of 4001 members, and by SciPy.
    np.testing.assert_allclose(
        found.orbits.x0[0] / 1e3, [19.580, 16.731, 15.279], atol=6e-4, rtol=0
    )


@pytest.mark.slow
def test_family_ends_where_its_amplitude_turns_back() -> None:
    """Harmonics of Phobos (Chao and Rubincam 1989) to degree 3, far inside the body."""
    terms = [(2, 0, -4.698, 0), (2, 1, 0.136, 0.138), (2, 2, 2.276, -0.0202), (3, 0, 0.293, 0),
             (3, 1, -0.309, 0.181), (3, 2, -0.847, -0.0655), (3, 3, 0.224, -1.392)]  # fmt: skip
    gravity = create(
        "gravity", "harmonics", gm_m3_s2=GM, reference_radius_km=11.1, normalisation="full",
        tide_system="none",
        coefficients=[{"n": n, "m": m, "c": c / 100, "s": s / 100} for n, m, c, s in terms],
    )  # fmt: skip
    given = plant(gravity)
    made = create("orbit_family", "qso", Qso, plant=given)
    family = made.family(2e3, 100e3, 41)
    x = amplitudes_km(made, family)
    assert bool(np.all(np.diff(x) < 0))
    assert "turns back near" in family.branch.ends[1]
    assert x[-1] < 20
    # Without a wish the family ends where the series is sure to converge, or turns back before.
    alone = made.family(None, 100e3, 41)
    assert amplitudes_km(made, alone)[-1] >= 11.1 * (1 - 1e-9)


def test_orbits_that_do_not_close_are_refused(computed: QsoFamily) -> None:
    require_accuracy(computed.members, 1e-11, computed.drift)
    x = computed.members.x0[0, 1] / 1e3
    torn = computed.members.residual.copy()
    torn[1] = 1e-9
    with pytest.raises(ConvergenceError, match=rf"x = {x:.6g} km \(worst: closure 1.0e-09"):
        require_accuracy(replace(computed.members, residual=torn), 1e-11)
    with pytest.raises(ConvergenceError, match=r"drift 1.0e-09"):
        require_accuracy(computed.members, 1e-11, computed.drift + 1e-9)
    swollen = computed.members.monodromy * 1.001
    with pytest.raises(ConvergenceError, match=r"determinant error 6.0e-03"):
        require_accuracy(replace(computed.members, monodromy=swollen), 1e-11)
    lost = np.full_like(torn, np.nan)
    with pytest.raises(ConvergenceError, match="closure nan"):
        require_accuracy(replace(computed.members, residual=lost), 1e-11)


def test_member_far_from_its_guess_is_refused(qso: Qso, family: Family) -> None:
    """No time of flight solves the half-period's equations too; a poor guess ends there."""
    unit = qso.plant.scales.length_m
    far = qso.family(90e3, 110e3, 21)
    z = np.column_stack([far.branch.z[:, 0], family.branch.z[:, -1]])
    names, u = ["rest"], np.array([0.5])
    sparse = Branch(z, tangents(family.problem, z, z[:, 1] - z[:, 0]), ("", ""))
    rest = np.array([[100e3 / unit], [-7.0], [0.0]])
    assert float(np.max(np.abs(family.problem.residual(rest)[0]))) == 0.0
    outside = z[:, :1] + 1.01 * (z[:, :1] - z[:, 1:])
    with pytest.raises(ConvergenceError, match="left the family for rest"):
        sparse.near(u, outside, "member", names)
    dense = Branch(family.branch.z[:, :2], family.branch.tangent[:, :2], ("", ""))
    with pytest.raises(ConvergenceError, match="left the family for rest"):
        dense.near(u, rest, "member", names)


def test_far_beyond_hill_is_said(point_mass: Any) -> None:
    far = run(point_mass, x_amplitudes_km=[5000, 100], curve_members=41, drift_revolutions=3)
    shown = stage(point_mass, x_amplitudes_km=[100]).present(far)
    assert any("beyond it" in sentence for sentence in shown.verdict)


@pytest.mark.slow
def test_sine_terms_take_the_way_without_a_mirror() -> None:
    """A body turned by 10° and the same field written with sine terms have the same orbits."""
    angle = radians(10.0)
    turned = plant(harmonics(0.0228, 0.0), prime_meridian_rad=np.pi + angle)
    written = plant(harmonics(0.0228 * cos(2 * angle), 0.0228 * sin(2 * angle)))
    keys: dict[str, Any] = {"x_amplitudes_km": [60, 25], "x_min_km": 20, "curve_members": 21}
    one, other = run(turned, **keys), run(written, **keys)
    for product in (one, other):
        assert "do not keep the mirror plane xz; in the plane z = 0" in product.method
        assert float(product.members.residual.max()) < 1e-12
        assert float(product.drift.max()) < 2e-12
        assert bool(np.all(np.abs(product.members.x0[3]) > 1e-5))  # the crossings are oblique
    np.testing.assert_allclose(one.members.x0, other.members.x0, rtol=0, atol=1e-6)
    np.testing.assert_allclose(one.members.period_s, other.members.period_s, rtol=1e-12)
    np.testing.assert_allclose(one.member_indices, other.member_indices, rtol=0, atol=1e-9)


def test_gravity_without_the_mirror_plane_xy_goes_into_space() -> None:
    """Two masses, one above the other: the orbits leave the plane z = 0, the mirror xz holds."""
    upper, lower = (create("gravity", "point_mass", gm_m3_s2=f * GM) for f in (0.7, 0.3))
    pair = create("gravity", "sum", parts=[
        {"model": upper, "position_km": [0, 0, 3]}, {"model": lower, "position_km": [0, 0, -4]},
    ])  # fmt: skip
    product = run(plant(pair), x_amplitudes_km=[25], x_min_km=24, curve_members=21)
    assert "half a period" in product.method
    assert "in space" in product.method
    assert abs(product.members.x0[2, 0]) > 100.0
    assert float(product.members.residual[0]) < 1e-12
    assert bool(np.all(np.isfinite(product.member_indices)))


def test_both_ways_agree_where_the_mirror_holds(qso: Qso, family: Family) -> None:
    whole = PeriodicShooting(qso.flow, "y", steps=2 * family.problem.steps)
    z = family.branch.z[:, ::20]
    guess = whole.unknowns_at(family.problem.state(z), family.problem.period(z))
    # vertical motion is free in this problem: the six states close, two of them trivially
    np.testing.assert_allclose(whole.residual(guess)[0], 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        np.array(stability_indices(whole.monodromy(guess))),
        np.array(stability_indices(family.problem.monodromy(z))),
        atol=1e-10,
    )


@pytest.mark.slow
def test_array_gravity_gives_the_same_family(family: Family, qso: Qso) -> None:
    tabulated = plant(TabulatedPointMass())
    product = run(tabulated, x_amplitudes_km=[90], jacobi_constants=[-7.5], x_min_km=85,
                  x_max_km=96, curve_members=21, drift_revolutions=2)  # fmt: skip
    assert product.members.integral[1] == pytest.approx(-7.5, abs=1e-12)
    found = members_at(
        family.problem, family.branch, family.amplitude,
        np.array([90e3 / qso.plant.scales.length_m]),
    )  # fmt: skip
    survey = Surveyor(qso.plant, family.problem).orbits(found.z, ("90",))
    first = product.members
    np.testing.assert_allclose(first.x0[:, :1], survey.x0, rtol=0, atol=1e-6)
    np.testing.assert_allclose(first.integral[:1], survey.integral, rtol=1e-12)
    np.testing.assert_allclose(first.monodromy[..., :1], survey.monodromy, rtol=0, atol=1e-9)
    assert product.check == "re-propagated with steps chosen by their error"
    assert float(product.members.residual[0]) < 1e-11


def test_only_hills_equations_are_judged_as_an_approximation() -> None:
    """A primary at its true distance neglects nothing of relative order r/a."""
    body = create(
        "body", "moon", primary_gm_m3_s2=9.0, semi_major_axis_m=2000.0, name="heavy",
        semi_axes_m=[80.0] * 3,
    )  # fmt: skip
    gravity = create("gravity", "point_mass", gm_m3_s2=1.0)
    keys = {"x_amplitudes_m": [300], "x_min_m": 280, "x_max_m": 320, "curve_members": 21}
    said = {}
    for kind in ("hill", "three_body"):
        made = stage(create("plant", kind, body=body, gravity=gravity), **keys, drift_revolutions=1)
        said[kind] = " ".join(made.present(made.run(RecordingContext())).verdict)
    assert "Hill approximation" in said["hill"]
    assert "Hill approximation" not in said["three_body"]
