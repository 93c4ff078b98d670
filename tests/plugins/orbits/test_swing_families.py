"""Planar orbits of several revolutions about an ellipsoid: families, symmetry, closure, errors."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.dynamics import StepMap, Taylor, system
from hillsphere.errors import HillsphereError, InputError, StageError
from hillsphere.interfaces import Array
from hillsphere.products import Bifurcations
from hillsphere.testing import RecordingContext
from hillsphere_orbits.swing_qso_families.curves import Swing
from hillsphere_orbits.swing_qso_families.presentation import present_swing
from hillsphere_orbits.swing_qso_families.products import SwingFamilies

BODY = {"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 9377.0, "name": "phobos"}
GM = 7.059650784871513e-4


def hill(gravity: Any) -> Any:
    return create("plant", "hill", body=create("body", "moon", **BODY), gravity=gravity)


def resonances(plant: Any, planar: list[str], vertical: tuple[str, ...] = ()) -> Bifurcations:
    keys = {"x_amplitudes_km": [40], "x_min_km": 36, "x_max_km": 48, "curve_members": 21}
    family = create("stage", "qso_family", plant=plant, drift_revolutions=1, **keys)
    stage = create(
        "stage", "bifurcations", plant=plant, needs={"family": "family"},
        planar=planar, vertical=vertical,
    )  # fmt: skip
    found = stage.run(RecordingContext(), family=family.run(RecordingContext()))
    assert isinstance(found, Bifurcations)
    return found


@pytest.fixture(scope="module")
def bifurcations(plant: Any) -> Bifurcations:
    return resonances(plant, ["1:4", "1:5"])


def stage(plant: Any, **keys: Any) -> Any:
    needs = {"bifurcations": "bifurcations"}
    return create("stage", "swing_qso_families", plant=plant, needs=needs, **keys)


def run(plant: Any, bifurcations: Bifurcations, **keys: Any) -> SwingFamilies:
    found = stage(plant, **keys).run(RecordingContext(), bifurcations=bifurcations)
    assert isinstance(found, SwingFamilies)
    return found


@pytest.fixture(scope="module")
def families(plant: Any, bifurcations: Bifurcations) -> SwingFamilies:
    keys = {"jacobi_constants": [-2.0, -400.0], "symmetries": ["x", "y"], "x_max_km": 72}
    return run(plant, bifurcations, **keys)


def test_a_value_that_no_family_has_is_named_beside_the_others(families: SwingFamilies) -> None:
    assert all("C = -2" in label for label in families.members.labels)
    assert len(families.members.labels) > 0
    (note,) = (note for note in families.notes if "-400" in note)
    assert note.startswith("no family has an orbit with C = -400; they have: 1:4")


@pytest.fixture(scope="module")
def taylor(plant: Any) -> Taylor:
    return Taylor(system(plant, normalised=True))


def normalised(families: SwingFamilies, x_m: Array) -> Array:
    curve = families.curve
    speed = curve.length_m / curve.time_s
    return np.asarray(x_m / np.array([curve.length_m] * 3 + [speed] * 3)[:, None])


def test_two_families_of_every_resonance(families: SwingFamilies) -> None:
    """1:4 leaves on either axis; 1:5 keeps both mirrors, outside and inside the parent."""
    rows = zip(families.n, families.axis, families.direction, families.symmetry, strict=True)
    assert set(rows) == {(4, "x", 1, "x"), (4, "y", 1, "y"), (5, "x", 1, "xy"), (5, "x", -1, "xy")}
    assert families.parent == (-1,) * 4
    assert families.d == (1,) * 4


def test_families_leave_at_the_bifurcation(
    families: SwingFamilies, bifurcations: Bifurcations
) -> None:
    for f, n in enumerate(families.n):
        i = bifurcations.n.index(n)
        period = n * bifurcations.orbits.period_s[i]
        np.testing.assert_allclose(families.origin.period_s[f], period, rtol=1e-10)
        np.testing.assert_allclose(
            families.origin.integral[f], bifurcations.orbits.integral[i], rtol=1e-10
        )
        first = np.flatnonzero(families.curve_family == f)[0]
        unit = families.curve.length_m
        away = np.linalg.norm(families.curve.x0[:3, first] - families.origin.x0[:3, f]) / unit
        assert 1e-3 < away < 0.12
        np.testing.assert_allclose(families.curve.period_s[first], period, rtol=3e-3)


def test_closure_by_taylor_series(families: SwingFamilies) -> None:
    """Half a period to 1e-10 and a whole one to 1e-12·max(1e3, λ), every orbit of every curve."""
    assert families.member_half_residual.max() <= 1e-10
    assert families.curve_half_residual.max() <= 1e-10
    for orbits, indices in (
        (families.members, families.member_indices),
        (families.curve, families.curve_indices),
    ):
        # λ ≥ |b| − 1 of a real pair
        growth = np.maximum(1e3, np.max(np.abs(indices), axis=0))
        assert np.all(orbits.residual <= 1e-12 * growth)


def test_members_have_the_jacobi_constant(families: SwingFamilies) -> None:
    np.testing.assert_allclose(families.members.integral, -2.0, rtol=0, atol=1e-10)
    assert families.members.labels[0] == "1:4 x+, C = -2"
    assert sorted(set(families.member_family)) == [0, 1, 2, 3]


def test_orbits_go_round_n_times(families: SwingFamilies) -> None:
    """Retrograde: the angle of the position falls by n turns in one period, no less."""
    for i, f in enumerate(families.member_family):
        x, y, _ = families.tracks_m[:, :, i]
        turns = np.unwrap(np.arctan2(y, x))
        assert (turns[-1] - turns[0]) / (2.0 * np.pi) == pytest.approx(-families.n[f], abs=1e-6)
        assert np.hypot(x[-1] - x[0], y[-1] - y[0]) < 1e-3


def test_mirrors_that_are_kept(families: SwingFamilies, taylor: Taylor) -> None:
    """A quarter of a period on: on the other axis and across it, for both mirrors only."""
    x = normalised(families, families.members.x0)
    period = families.members.period_s / families.members.time_s
    quarter = taylor.propagate(x, 0.25 * period)
    half = taylor.propagate(x, 0.5 * period)
    for i, f in enumerate(families.member_family):
        zero = {"x": [1, 3], "y": [0, 4]}
        other = "y" if families.axis[f] == "x" else "x"
        assert np.abs(half[zero[families.axis[f]], i]).max() < 1e-9
        crossed = np.abs(quarter[zero[other], i]).max()
        assert crossed < 1e-9 if families.symmetry[f] == "xy" else crossed > 1e-2


def test_one_family_is_born_stable(families: SwingFamilies) -> None:
    """Poincaré–Birkhoff: of the two families of a resonance the multipliers lie on either side."""
    for n in (4, 5):
        own = [f for f, revolutions in enumerate(families.n) if revolutions == n]
        first = [np.flatnonzero(families.curve_family == f)[1] for f in own]
        b = families.curve_indices[0, first]
        assert min(b) < 2.0 < max(b)


def test_multipliers_and_stability(families: SwingFamilies) -> None:
    monodromy = families.members.monodromy
    for values, m in zip(families.member_multipliers.T, monodromy.transpose(2, 0, 1), strict=True):
        for power in (1, 2):
            trace = np.trace(np.linalg.matrix_power(m, power))
            assert np.sum(values**power) == pytest.approx(trace, rel=1e-7, abs=1e-6)
    expected = np.max(np.abs(families.curve_indices), axis=0) <= 2.0 + 1e-7
    differ = np.flatnonzero(expected != families.curve_stable)
    assert np.all(np.abs(np.abs(families.curve_indices[:, differ]).max(axis=0) - 2.0) < 1e-6)


def test_mirror_breaks_along_one_to_five(families: SwingFamilies) -> None:
    """The family outside the parent loses a mirror: the planar pair passes 1, C goes on."""
    outer = next(f for f in range(4) if families.n[f] == 5 and families.direction[f] == 1)
    found = [
        i for i, f in enumerate(families.event_family)
        if (f, families.event_kind[i], families.event_plane[i]) == (outer, "branching", "planar")
    ]  # fmt: skip
    assert len(found) == 1
    m = families.event_orbits.monodromy[:, :, found[0]]
    assert m[0, 0] + m[1, 1] + m[3, 3] + m[4, 4] - 2.0 == pytest.approx(2.0, abs=6e-6)


def test_orbits_where_a_mirror_breaks_keep_both(families: SwingFamilies, taylor: Taylor) -> None:
    """There half a period is solved to 1e-9 by orbits that lie 1e-3 off: the error grows as κ³."""
    both = [
        i for i, f in enumerate(families.event_family)
        if (families.symmetry[f], families.axis[f]) == ("xy", "x")
        and (families.event_kind[i], families.event_plane[i]) == ("branching", "planar")
    ]  # fmt: skip
    assert both
    orbits = families.event_orbits
    x = normalised(families, orbits.x0)[:, both]
    quarter = taylor.propagate(x, 0.25 * orbits.period_s[both] / orbits.time_s)
    # perpendicular to the y axis: x and vy vanish
    assert np.abs(quarter[[0, 4]]).max() < 1e-9


def test_swing_takes_families_up_again(families: SwingFamilies, plant: Any, taylor: Taylor) -> None:
    swing = Swing(families, plant)
    assert list(swing.families) == [0, 1, 2, 3]
    for f in swing.families:
        own = families.curve_family == f
        branch = swing.branch(f)
        assert branch.size == np.count_nonzero(own)
        x, period = swing.orbit(f, np.array([2.0, 2.5]))
        expected = normalised(families, families.curve.x0[:, own][:, [2]])
        np.testing.assert_allclose(x[:, [0]], expected, rtol=0, atol=1e-11)
        end = taylor.propagate(x, period)
        np.testing.assert_allclose(end, x, rtol=0, atol=1e-8)
        # the one between lies between, and is an orbit of its own
        low, high = branch.z[:, 2], branch.z[:, 3]
        z = swing.at(f, np.array([2.5]))[:, 0]
        assert np.linalg.norm(z - low) < np.linalg.norm(high - low)
        assert np.linalg.norm(z - low) > 0.3 * np.linalg.norm(high - low)
        assert swing.at(f, np.empty(0)).shape == (len(z), 0)


def test_swing_with_another_plant(families: SwingFamilies) -> None:
    other = hill(create("gravity", "point_mass", gm_km3_s2=GM))
    with pytest.raises(StageError, match="do not solve the equations"):
        Swing(families, other).branch(0)


def test_ends_and_extent(families: SwingFamilies, plant: Any) -> None:
    far = "the orbits reach as far out as was asked for"
    equations = system(plant, normalised=True)
    last = [np.flatnonzero(families.curve_family == f)[-1] for f in range(4)]
    x = families.curve.x0[:, last] / equations.unit[:, None]
    way = StepMap(equations).trajectory(
        x, families.curve.period_s[last] / equations.time_unit_s, 3000
    )
    reach = np.abs(way[0]).max(axis=0) * families.curve.length_m
    ended = [end == far for end in families.ends]
    assert any(ended)
    # the last orbit is put there, to a thousandth of a step
    np.testing.assert_allclose(reach[ended], 72e3, rtol=0, atol=30.0)
    radius = np.linalg.norm(way[:3], axis=0) * families.curve.length_m
    np.testing.assert_allclose(radius.min(axis=0), families.curve_least_m[last], rtol=1e-3)
    np.testing.assert_allclose(radius.max(axis=0), families.curve_largest_m[last], rtol=1e-3)


@pytest.fixture(scope="module")
def broken(plant: Any, bifurcations: Bifurcations) -> SwingFamilies:
    return run(plant, bifurcations, resonances=["1:5"], x_max_km=93)


def test_mirrors_break_one_after_the_other(broken: SwingFamilies) -> None:
    """1:5 outside its parent: both mirrors, then the x axis alone, then none."""
    chain = [broken.symmetry.index("none")]
    while broken.parent[chain[-1]] >= 0:
        chain.append(broken.parent[chain[-1]])
    assert [broken.symmetry[f] for f in chain] == ["none", "x", "xy"]
    assert [broken.n[f] for f in chain] == [5, 5, 5]
    # each begins at a branching of its parent, of which the sequence of events has the orbit
    for child, parent in pairwise(chain):
        there = [
            broken.event_orbits.integral[i]
            for i, f in enumerate(broken.event_family)
            if (f, broken.event_kind[i], broken.event_plane[i]) == (parent, "branching", "planar")
        ]
        assert np.min(np.abs(broken.origin.integral[child] - np.array(there))) < 3e-7


def test_empty_tables_are_left_out(families: SwingFamilies, broken: SwingFamilies) -> None:
    assert "swing_members" in present_swing(families, None, "").tables
    assert set(present_swing(broken, None, "").tables) == {"swing_families", "swing_events"}


def test_asymmetric_orbits_close_and_have_no_mirror(
    broken: SwingFamilies, plant: Any, taylor: Taylor
) -> None:
    f = broken.symmetry.index("none")
    own = broken.curve_family == f
    assert np.count_nonzero(own) > 5
    assert broken.curve_half_residual[own].max() <= 1e-10
    x, period = Swing(broken, plant).orbit(f, np.array([np.count_nonzero(own) - 2.0]))
    way = np.array(
        [taylor.propagate(x, period * part)[:2, 0] for part in np.linspace(0.0, 1.0, 400)]
    ).T
    for sign in ([1.0, -1.0], [-1.0, 1.0]):
        image = np.array(sign)[:, None] * way
        gap = np.linalg.norm(way[:, :, None] - image[:, None, :], axis=0).min(axis=1)
        # the samples are 0.1 apart at most: a kept mirror would leave gaps of half of that
        assert gap.max() > 0.15


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"resonances": ["1:9"]}, "no planar bifurcation 1:9 .* .found: 1:4, 1:5"),
        ({"resonances": ["1:4"], "jacobi_constants": [-400], "curve_length": 0.5},
         "no family has an orbit with C = -400; they have: 1:4"),
        ({"resonances": ["1:4"], "periods_h": [10.0], "curve_length": 0.5},
         "no family has an orbit with T = 10 h; they have: 1:4"),
    ],
)  # fmt: skip
def test_what_does_not_exist(
    plant: Any, bifurcations: Bifurcations, keys: Mapping[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        run(plant, bifurcations, **keys)


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"resonances": ["1-7"]}, "expected d:n"),
        ({"resonances": ["1:4", "1:4"]}, "is listed twice"),
        ({"symmetries": []}, "no family is asked for"),
        ({"symmetries": ["z"]}, "x"),
        ({"x_min_km": 50, "x_max_km": 40}, "must be below the largest"),
        ({"curve_length": 0}, "0"),
        ({"periods_h": [-1]}, "must be > 0"),
    ],
)
def test_bad_keys(plant: Any, keys: Mapping[str, Any], words: str) -> None:
    with pytest.raises(HillsphereError, match=words):
        stage(plant, **keys)


def test_no_planar_bifurcation(plant: Any, bifurcations: Bifurcations) -> None:
    vertical = Bifurcations(
        bifurcations.orbits, ("vertical",) * 2, bifurcations.d, bifurcations.n, bifurcations.index
    )
    with pytest.raises(InputError, match="no planar bifurcation with n ≥ 3"):
        run(plant, vertical)


def test_bifurcations_of_another_plant(bifurcations: Bifurcations) -> None:
    other = hill(create("gravity", "point_mass", gm_km3_s2=GM))
    with pytest.raises(StageError, match="do not solve the equations"):
        run(other, bifurcations)


def test_gravity_without_the_plane(bifurcations: Bifurcations) -> None:
    tilted = hill(harmonics([{"n": 2, "m": 1, "c": 1e-2}]))
    with pytest.raises(InputError, match="mirror plane xy"):
        run(tilted, bifurcations)


def harmonics(coefficients: list[dict[str, float]]) -> Any:
    return create(
        "gravity", "harmonics", gm_km3_s2=GM, reference_radius_km=11.1, normalisation="none",
        tide_system="none", coefficients=coefficients,
    )  # fmt: skip


@pytest.mark.slow
def test_gravity_with_one_mirror() -> None:
    """Without half a turn both sides of the body count: four crossings of the x axis.

    For even n an orbit crosses one side only, so that there are two families on the x axis; for
    odd n each crosses both sides, and there are two as well.
    """
    plant = hill(
        harmonics(
            [{"n": 2, "m": 0, "c": -0.1}, {"n": 2, "m": 2, "c": 0.02}, {"n": 3, "m": 1, "c": 0.01}]
        )
    )
    found = run(plant, resonances(plant, ["1:4", "1:5"]), curve_length=0.3, symmetries=["x", "y"])
    assert found.symmetry == ("x",) * 4
    sides = [(n, np.sign(x0)) for n, x0 in zip(found.n, found.origin.x0[0], strict=True)]
    assert sides == [(4, 1.0), (4, -1.0), (5, 1.0), (5, 1.0)]
    assert found.curve_half_residual.max() <= 1e-10


@pytest.mark.slow
def test_gravity_without_mirror() -> None:
    """An ellipsoid's field turned about z: orbits by a full period, two families all the same."""
    plant = hill(harmonics([{"n": 2, "m": 0, "c": -0.1}, {"n": 2, "m": 2, "c": 0.02, "s": 0.02}]))
    found = run(plant, resonances(plant, ["1:4", "1:5"]), curve_length=0.3, secondary=False)
    assert found.n == (4, 4, 5, 5)
    assert found.symmetry == ("none",) * 4
    assert found.curve_half_residual.max() <= 1e-10
    # one family of either kind: beyond 2 and below it
    for n in (4, 5):
        own = [f for f, turns in enumerate(found.n) if turns == n]
        b = [found.curve_indices[0, np.flatnonzero(found.curve_family == f)[-1]] for f in own]
        assert min(b) < 2.0 < max(b)
    with pytest.raises(InputError, match="asymmetric"):
        run(plant, resonances(plant, ["1:4"]), symmetries=["x"])
