"""Families in space about an ellipsoid: both branches, multipliers, windows, errors.

Low resonances near the plane, which are quick; the published families are the mission's test.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eig

from hillsphere import create
from hillsphere.dynamics import StepMap, system
from hillsphere.errors import HillsphereError, InputError, StageError
from hillsphere.interfaces import Array
from hillsphere.products import Bifurcations
from hillsphere.testing import RecordingContext
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.spatial_qso_families import following
from hillsphere_orbits.spatial_qso_families.presentation import _name
from hillsphere_orbits.spatial_qso_families.products import SpatialFamilies, StationKeepingIndex
from hillsphere_orbits.spatial_qso_families.stability import (
    excess,
    is_stable,
    pair_indices,
    spectrum,
)
from hillsphere_orbits.station_keeping_index.stage import correction_speed

BODY = {"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 9377.0, "name": "phobos"}


def hill(gravity: Any) -> Any:
    return create("plant", "hill", body=create("body", "moon", **BODY), gravity=gravity)


@pytest.fixture(scope="module")
def plant() -> Any:
    return hill(
        create("gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], gm_km3_s2=7.0596507848715e-4)
    )


@pytest.fixture(scope="module")
def bifurcations(plant: Any) -> Bifurcations:
    keys = {"x_amplitudes_km": [30], "x_min_km": 27, "x_max_km": 32, "curve_members": 31}
    family = create("stage", "qso_family", plant=plant, drift_revolutions=1, **keys)
    stage = create(
        "stage", "bifurcations", plant=plant, needs={"family": "family"},
        vertical=["1:6", "1:7"], planar=["1:3"],
    )  # fmt: skip
    found = stage.run(RecordingContext(), family=family.run(RecordingContext()))
    assert isinstance(found, Bifurcations)
    return found


def stage(plant: Any, **keys: Any) -> Any:
    needs = {"bifurcations": "bifurcations"}
    return create("stage", "spatial_qso_families", plant=plant, needs=needs, **keys)


def run(plant: Any, bifurcations: Bifurcations, **keys: Any) -> SpatialFamilies:
    found = stage(plant, **keys).run(RecordingContext(), bifurcations=bifurcations)
    assert isinstance(found, SpatialFamilies)
    return found


@pytest.fixture(scope="module")
def position(plant: Any, bifurcations: Bifurcations) -> SpatialFamilies:
    return run(plant, bifurcations, z_amplitudes_km=[3, 8])


@pytest.fixture(scope="module")
def velocity(plant: Any, bifurcations: Bifurcations) -> SpatialFamilies:
    return run(plant, bifurcations, z_amplitudes_km=[3, 8], branch="velocity")


@pytest.fixture(scope="module", params=["position", "velocity"])
def families(request: pytest.FixtureRequest) -> SpatialFamilies:
    found = request.getfixturevalue(request.param)
    assert isinstance(found, SpatialFamilies)
    return found


def test_members_and_their_order(families: SpatialFamilies) -> None:
    assert families.d == (1, 1)
    assert families.n == (6, 7)
    assert families.members.labels == ("1:6, 3 km", "1:6, 8 km", "1:7, 3 km", "1:7, 8 km")
    np.testing.assert_array_equal(families.member_family, [0, 0, 1, 1])
    np.testing.assert_array_equal(families.member_z_m, [3e3, 8e3, 3e3, 8e3])
    assert set(families.ends) == {"the amplitude asked for"}


def test_start_on_the_mirror(position: SpatialFamilies, velocity: SpatialFamilies) -> None:
    x = position.members.x0
    np.testing.assert_allclose(x[2], position.member_z_m, rtol=0, atol=1e-9)
    assert not x[[1, 3, 5]].any()
    assert x[0].min() > 0.0
    x = velocity.members.x0
    assert not x[[1, 2, 3]].any()
    assert x[5].min() > 0.0


def test_amplitude_of_the_velocity_branch(velocity: SpatialFamilies) -> None:
    """The largest z along the orbit; the samples miss it by their spacing squared."""
    highest = np.abs(velocity.tracks_m[2]).max(axis=0)
    assert np.all(highest <= velocity.member_z_m * (1.0 + 1e-9))
    np.testing.assert_allclose(highest, velocity.member_z_m, rtol=5e-3)


def test_closure_by_taylor_series(families: SpatialFamilies) -> None:
    """Half a period to 1e-10 and a whole one to 1e-12·max(1e3, λ), all members."""
    assert families.member_half_residual.max() <= 1e-10
    assert families.curve_half_residual.max() <= 1e-10
    for orbits, multipliers in (
        (families.members, families.member_multipliers),
        (families.curve, families.curve_multipliers),
    ):
        bound = 1e-12 * np.maximum(1e3, np.abs(multipliers[0]))
        assert np.all(orbits.residual <= bound)


def test_families_leave_the_plane_at_the_bifurcations(
    families: SpatialFamilies, bifurcations: Bifurcations
) -> None:
    """N planar periods and x at the bifurcation, up to the square of the amplitude 0.01."""
    curve = families.curve
    for f, n in enumerate(families.n):
        i = bifurcations.n.index(n)
        first = np.flatnonzero(families.curve_family == f)[0]
        x0 = bifurcations.orbits.x0[0, i]
        assert curve.x0[0, first] == pytest.approx(x0, rel=1e-3)
        period = n * bifurcations.orbits.period_s[i]
        assert curve.period_s[first] == pytest.approx(period, rel=1e-3)
        assert families.bifurcation_x_m[f] == x0


def test_multipliers_are_the_monodromy_matrixs(families: SpatialFamilies) -> None:
    monodromy = families.members.monodromy
    for values, m in zip(families.member_multipliers.T, monodromy.transpose(2, 0, 1), strict=True):
        # power sums determine the spectrum, and are free of the defective ones' scatter
        for power in (1, 2, 3):
            trace = np.trace(np.linalg.matrix_power(m, power))
            assert np.sum(values**power) == pytest.approx(trace, rel=1e-6, abs=1e-6)
        assert np.prod(values) == pytest.approx(1.0, abs=1e-12)


def test_for_even_n_the_branches_are_one_family(
    position: SpatialFamilies, velocity: SpatialFamilies
) -> None:
    """Half a turn maps an ellipsoid on itself, so that z ≠ 0 becomes ż ≠ 0 if n is even."""
    even, odd = slice(0, 2), slice(2, 4)
    for name in ("period_s", "integral"):
        ours, theirs = (getattr(p.members, name) for p in (position, velocity))
        np.testing.assert_allclose(ours[even], theirs[even], rtol=1e-13)
        assert np.all(np.abs(ours[odd] / theirs[odd] - 1.0) > 1e-6)
    ours, theirs = position.member_multipliers[0], velocity.member_multipliers[0]
    for j in (0, 1):
        # an error of M of 1e-12 of its size, times the condition of this eigenvalue
        m = position.members.monodromy[..., j]
        values, left, right = eig(m, left=True, right=True)
        i = np.argmin(np.abs(values - ours[j]))
        allowed = 1e-12 * np.linalg.norm(m) / np.abs(left[:, i].conj() @ right[:, i])
        assert allowed < 1e-8
        assert abs(ours[j].real - theirs[j].real) < allowed
    assert np.all(np.abs(ours[odd] - theirs[odd]) > 1e-4)


def test_windows_of_stability(families: SpatialFamilies, plant: Any) -> None:
    """Every member of the curve is in a window of its family if and only if it is stable."""
    for f in range(len(families.n)):
        windows = families.window_z_m[:, families.window_family == f]
        own = families.curve_family == f
        z = families.curve_z_m[own]
        within = np.any((z[:, None] >= windows[0]) & (z[:, None] <= windows[1]), axis=1)
        np.testing.assert_array_equal(within, families.curve_stable[own])


def test_tracks_are_the_orbits(families: SpatialFamilies, plant: Any) -> None:
    tracks, orbits = families.tracks_m, families.members
    np.testing.assert_allclose(tracks[:, 0], orbits.x0[:3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(tracks[:, -1], tracks[:, 0], rtol=0, atol=1e-6)
    equations = system(plant, normalised=True)
    x, period = orbits.x0 / equations.unit[:, None], orbits.period_s / equations.time_unit_s
    way = StepMap(equations).trajectory(x, period, 1200)[:3] * orbits.length_m
    np.testing.assert_allclose(np.abs(way).max(axis=1), np.abs(tracks).max(axis=1), rtol=2e-2)


@pytest.fixture(scope="module")
def companion(plant: Any, bifurcations: Bifurcations) -> SpatialFamilies:
    return run(plant, bifurcations, z_amplitudes_km=[3], branch="companion")


def test_companion_is_always_the_other_family(
    position: SpatialFamilies, companion: SpatialFamilies
) -> None:
    """For even n it starts on the plane yz, for odd n on the x axis."""
    assert companion.starts == ("y_position", "velocity")
    assert companion.of_position == (False, False)
    x = companion.members.x0
    assert not x[[0, 4, 5], 0].any()
    assert not x[[1, 2, 3], 1].any()
    theirs = position.members.integral[[0, 2]]
    assert np.all(np.abs(companion.members.integral - theirs) > 1e-5)
    assert companion.curve_half_residual.max() <= 1e-10
    assert np.all(companion.members.residual <= 1e-9)


def test_same_family_is_said_to_be_it(
    plant: Any, position: SpatialFamilies, velocity: SpatialFamilies
) -> None:
    assert position.of_position == (True, True)
    assert velocity.of_position == (True, False)
    shown = stage(plant, z_amplitudes_km=[3]).present(velocity, None)
    assert any(
        "1:6: the start asked for (velocity) belongs to the same" in v for v in shown.verdict
    )
    rows = shown.tables["spatial_families"].rows
    assert [row["other"] for row in rows] == [False, True]


def test_verdict_tells_stages_apart_and_counts(plant: Any, bifurcations: Bifurcations) -> None:
    one = run(plant, bifurcations, z_amplitudes_km=[3], resonances=["1:6"])
    shown = stage(plant, z_amplitudes_km=[3], label="close_by").present(one, None)
    assert shown.verdict[0].startswith("Family in space (close by, branch position): 1:6 to ")
    assert shown.verdict[1].startswith("Its 1 member closes to ")


def test_secondary_bifurcations_are_where_the_index_passes(
    plant: Any, bifurcations: Bifurcations
) -> None:
    """λ = 1 or λ = −1 there; every edge of a window inside its family is one of them."""
    found = run(plant, bifurcations, z_amplitudes_km=[3], z_max_km=25)
    kinds = {"fold": 2.0, "branching": 2.0, "doubling": -2.0}
    assert found.secondary_kind
    for kind, index in zip(found.secondary_kind, found.secondary_index.T, strict=True):
        assert min(abs(index - kinds[kind])) < 1e-6
    for f, (begin, end) in zip(found.window_family, found.window_z_m.T, strict=True):
        own = found.curve_z_m[found.curve_family == f]
        inner = [z for z in (begin, end) if z not in (own[0], own[-1])]
        z = found.secondary_z_m[found.secondary_family == f]
        assert all(np.min(np.abs(z - edge)) < 1e-6 for edge in inner)


def test_resonances_of_higher_d(plant: Any) -> None:
    """2:13 leaves the plane after 13 planar periods; both of its families close."""
    keys = {"x_amplitudes_km": [30], "x_min_km": 27, "x_max_km": 32, "curve_members": 31}
    family = create("stage", "qso_family", plant=plant, drift_revolutions=1, **keys)
    made = create(
        "stage", "bifurcations", plant=plant, needs={"family": "family"}, vertical=["2:13"]
    )
    where = made.run(RecordingContext(), family=family.run(RecordingContext()))
    for branch in ("position", "companion"):
        found = run(plant, where, z_amplitudes_km=[2], branch=branch)
        assert (found.d, found.n) == ((2,), (13,))
        # to the square of the amplitude of the first member, 0.01
        period = 13 * where.orbits.period_s[0]
        assert found.curve.period_s[0] == pytest.approx(period, rel=1e-4)
        assert found.member_half_residual.max() <= 1e-10
        assert found.members.residual.max() <= 1e-9


def test_chosen_resonances_in_the_order_asked_for(plant: Any, bifurcations: Bifurcations) -> None:
    found = run(plant, bifurcations, resonances=["1:7", "1:6"], z_amplitudes_km=[0.5])
    assert found.n == (7, 6)


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"resonances": ["1:17"]}, "no vertical bifurcation 1:17 was found .found: 1:6, 1:7"),
        ({"resonances": ["1:3"]}, "no vertical bifurcation 1:3"),
        ({"z_amplitudes_km": [0.1]}, "has no member of amplitude 0.1 km .it has 0.238643 to "),
    ],
)
def test_what_does_not_exist(
    plant: Any, bifurcations: Bifurcations, keys: Mapping[str, Any], words: str
) -> None:
    made = stage(plant, **{"z_amplitudes_km": [3], **keys})
    with pytest.raises(InputError, match=words):
        made.run(RecordingContext(), bifurcations=bifurcations)


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"z_amplitudes_km": []}, "no orbit is asked for"),
        ({"z_amplitudes_km": [10], "z_max_km": 9}, "larger than z_max: 10 km"),
        ({"resonances": ["1-7"], "z_amplitudes_km": [3]}, "expected d:n"),
        ({"resonances": ["1:7", "1:7"], "z_amplitudes_km": [3]}, "is listed twice"),
        ({"z_amplitudes_km": [-3]}, "must be > 0 km"),
        ({"z_amplitudes_km": [3, 3.0]}, "z_amplitudes_km: a value is listed twice"),
        ({"z_amplitudes_km": [3], "branch": "sideways"}, "position"),
    ],
)
def test_bad_keys(plant: Any, keys: Mapping[str, Any], words: str) -> None:
    with pytest.raises(HillsphereError, match=words):
        stage(plant, **keys)


@pytest.mark.slow
def test_low_orders_end_at_the_surface(plant: Any, bifurcations: Bifurcations) -> None:
    """1:6 and 1:7 turn back below 60 km and meet the surface: not an error, but their end."""
    found = run(plant, bifurcations, z_amplitudes_km=[3], z_max_km=500)
    assert found.ends == ("the next orbit meets the surface",) * 2
    assert found.curve_half_residual.max() <= 1e-10
    # the last orbits come near the surface, and none is inside
    least = [clearance_km(plant, found, f) for f in range(2)]
    assert min(least) > 0.0
    assert max(least) < 3.0


def clearance_km(plant: Any, found: SpatialFamilies, f: int) -> float:
    """Least height above the ellipsoid, as the difference of r/ρ from 1, times the least axis."""
    own = np.flatnonzero(found.curve_family == f)[-1:]
    equations = system(plant, normalised=True)
    x = found.curve.x0[:, own] / equations.unit[:, None]
    period = found.curve.period_s[own] / equations.time_unit_s
    way = StepMap(equations).trajectory(x, period, 6000)[:3, :, 0] * found.curve.length_m
    axes = np.array(found.semi_axes_m)[:, None]
    return float((np.linalg.norm(way / axes, axis=0).min() - 1.0) * axes.min() / 1e3)


def test_an_amplitude_that_no_family_has(plant: Any, bifurcations: Bifurcations) -> None:
    words = r"1:6 has no member of amplitude 500 km \(it has 0.238643 to .* meets the surface\)"
    with pytest.raises(InputError, match=words):
        run(plant, bifurcations, resonances=["1:6"], z_amplitudes_km=[500])


def test_an_amplitude_that_some_families_have(plant: Any, bifurcations: Bifurcations) -> None:
    """The others are returned, and what is missing is said."""
    found = run(plant, bifurcations, z_amplitudes_km=[3, 26])
    assert found.members.labels == ("1:6, 3 km", "1:7, 3 km", "1:7, 26 km")
    (missing,) = found.missing
    assert missing.startswith("1:6 has no member of amplitude 26 km (it has 0.238643 to 25.4")


def test_a_family_ends_where_rounding_is_magnified_too_much(
    plant: Any, bifurcations: Bifurcations, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However far away an orbit asked for is, following ends where none could be confirmed.

    Rounding is made 100 times as large, so that the family 1:6 ends so, which else goes on to the
    surface: half a period magnifies an error 100 times near the plane and 15000 times there.
    """
    monkeypatch.setattr(following, "_ROUNDING", 100.0 * np.finfo(float).eps)
    found = run(plant, bifurcations, resonances=["1:6"], z_amplitudes_km=[3, 5000])
    assert found.members.labels == ("1:6, 3 km",)
    assert found.ends == (following.SENSITIVE,)
    (missing,) = found.missing
    assert missing.startswith("1:6 has no member of amplitude 5000 km (it has 0.238643 to 25.")
    assert following.SENSITIVE in missing
    # what rounding becomes over half a period, from its matrix and the largest state: the last
    # orbit is the first beyond the limit, but for the direction of the error
    flow, curve = flow_of(plant), found.curve
    x, half = curve.x0 / flow.system.unit[:, None], 0.5 * curve.period_s / flow.system.time_unit_s
    growth = np.max(np.abs(flow.with_matrix(x, half, 800)[1]), axis=(0, 1))
    blurred = 100.0 * np.finfo(float).eps * growth * np.max(np.abs(x), axis=0)
    assert 0.5 * following.HALF < blurred[-1] < 2.0 * following.HALF
    assert np.argmax(blurred) == blurred.size - 1


def test_no_vertical_bifurcation(plant: Any, bifurcations: Bifurcations) -> None:
    planar = Bifurcations(
        bifurcations.orbits, ("planar",) * len(bifurcations.n), bifurcations.d, bifurcations.n,
        bifurcations.index,
    )  # fmt: skip
    with pytest.raises(InputError, match="no vertical bifurcation to start from"):
        run(plant, planar, z_amplitudes_km=[3])


def test_bifurcations_of_another_plant(bifurcations: Bifurcations) -> None:
    other = hill(create("gravity", "point_mass", gm_km3_s2=7.0596507848715e-4))
    with pytest.raises(StageError, match="do not solve the equations"):
        run(other, bifurcations, z_amplitudes_km=[3])


def test_gravity_without_the_mirrors(bifurcations: Bifurcations) -> None:
    lopsided = hill(
        create(
            "gravity", "harmonics", gm_km3_s2=7.0875e-4, reference_radius_km=11.1,
            normalisation="full", tide_system="none",
            coefficients=[{"n": 2, "m": 1, "c": 1e-2, "s": 2e-2}],
        )
    )  # fmt: skip
    with pytest.raises(InputError, match="mirror planes xy and xz"):
        run(lopsided, bifurcations, z_amplitudes_km=[3])


def symplectic(*pairs: tuple[complex, complex]) -> Array:
    """Return a real matrix (6, 6, 1) with the given pairs λ, 1/λ, in coordinates that mix them."""
    blocks = np.zeros((6, 6))
    for k, (a, b) in enumerate(pairs):
        blocks[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[(a + b).real, -1.0], [1.0, 0.0]]
    mix = np.random.default_rng(3).normal(size=(6, 6))
    return np.asarray((mix @ blocks @ np.linalg.inv(mix))[:, :, None])


def turn(angle: float) -> tuple[complex, complex]:
    return complex(np.exp(1j * angle)), complex(np.exp(-1j * angle))


@pytest.mark.parametrize(
    "first, second, stable",
    [
        ((40.0, 0.025), turn(0.0), False),
        ((-3.0, -1 / 3), turn(1.0), False),
        (turn(2.0), turn(0.0), True),
        (turn(2.0), turn(0.7), True),
        (turn(3.0), (1.5, 1 / 1.5), False),
    ],
)
def test_indices_of_known_spectra(
    first: tuple[complex, complex], second: tuple[complex, complex], stable: bool
) -> None:
    m = symplectic(first, second, turn(0.0))
    b = pair_indices(m)[:, 0]
    expected = sorted((abs(sum(first)), abs(sum(second))))
    assert sorted(np.abs(b)) == pytest.approx(expected, abs=1e-9)
    assert bool(is_stable(m)[0]) is stable
    assert bool(excess(m)[0] <= 0.0) is stable
    found = np.sort_complex(np.round(spectrum(m)[:, 0], 6))
    values = np.sort_complex(np.round(np.array([*first, *second, 1.0, 1.0], complex), 6))
    np.testing.assert_allclose(found, values, rtol=0, atol=2e-6)


def test_complex_instability() -> None:
    """λ = 1.2 e^{±i} with its reciprocals: indices 1.2 e^{i} + e^{−i}/1.2 and the conjugate."""
    lam = 1.2 * np.exp(1j)
    b = lam + 1.0 / lam
    quartic = np.poly([lam, 1 / lam, np.conj(lam), 1 / np.conj(lam)]).real
    m = np.eye(6)
    m[:4, :4] = np.diag(np.ones(3), -1)
    m[0, :4] = -quartic[1:]
    found = pair_indices(m[:, :, None])[:, 0]
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex([b, np.conj(b)]), rtol=1e-12)
    assert not is_stable(m[:, :, None])[0]
    assert np.abs(spectrum(m[:, :, None])[0, 0]) == pytest.approx(1.2, rel=1e-12)


def test_correction_speed() -> None:
    """Left eigenvector (3, 0, 0, 0, 4, 0)/5 of λ = 9: σ² = σ_v² + σ_r² (3/4)²."""
    w = np.array([3.0, 0, 0, 0, 4.0, 0]) / 5.0
    m = np.eye(6) + 8.0 * np.outer(w, w)
    found = correction_speed(m[:, :, None], 2.0, 1.0)
    assert found == pytest.approx([np.hypot(1.0, 1.5)], rel=1e-12)


def test_station_keeping_scales(position: SpatialFamilies) -> None:
    def index(**keys: Any) -> StationKeepingIndex:
        made = create("stage", "station_keeping_index", needs={"families": "families"}, **keys)
        found = made.run(RecordingContext(), families=position)
        assert isinstance(found, StationKeepingIndex)
        return found

    once = index()
    np.testing.assert_array_equal(np.isnan(once.v_cm_m_s), once.stable)
    twice = index(sigmas=6, duration_d=60)
    np.testing.assert_allclose(twice.v_cm_m_s, 4.0 * once.v_cm_m_s, rtol=1e-12)


def test_reference_without_its_columns(tmp_path: Any) -> None:
    path = tmp_path / "table.csv"
    path.write_text("# source: nobody\nn,v_cm_m_s\n17,0.9\n", "utf-8")
    with pytest.raises(InputError, match="no column Az_km"):
        create("stage", "station_keeping_index", needs={"families": "f"}, reference=str(path))


def test_families_of_one_resonance_have_names_of_their_own() -> None:
    """The vertical resonance 1:5 is met twice along the planar family, 1:27 once."""
    product: Any = SimpleNamespace(
        d=(1, 1, 1), n=(5, 5, 27), bifurcation_x_m=np.array([23331.4, 17735.7, 54700.2])
    )
    names = [_name(product, family) for family in range(3)]
    assert names == ["1:5 at x = 23.33 km", "1:5 at x = 17.74 km", "1:27"]
