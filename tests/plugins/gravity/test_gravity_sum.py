"""Sums: superposition, placement, rotation, voids, parts that are functions of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hillsphere.errors import InputError
from hillsphere.gravity import AnyGravityModel, GravityField
from hillsphere.interfaces import ArrayGravityModel, Parameter, SeriesGravity
from hillsphere_gravity.composite import (
    ArrayGravitySum,
    GravitySum,
    gravity_sum,
    rotation_zxz,
)
from hillsphere_gravity.ellipsoid import Ellipsoid
from hillsphere_gravity.harmonics import Harmonics
from hillsphere_gravity.point_mass import PointMass
from hillsphere_gravity.specs import EllipsoidSpec, HarmonicsSpec, PointMassSpec, SumSpec

Array = NDArray[np.float64]
POINTS = np.random.default_rng(2).normal(size=(3, 50)) * 3.0 + np.array([[9.0], [-8.0], [7.0]])


def point(gm: float) -> PointMass:
    return PointMass(PointMassSpec(gm_m3_s2=gm))


def ellipsoid(*axes: float, density: float = 1e4) -> Ellipsoid:
    return Ellipsoid(
        EllipsoidSpec.model_validate(
            {"axes_m": axes, "density_kg_m3": density, "gravitational_constant": 1e-4}
        )
    )


def total(*parts: dict[str, Any]) -> AnyGravityModel:
    return gravity_sum(SumSpec.model_validate({"parts": list(parts)}))


class ArrayPoint:
    """A point mass that says it cannot be written as an expression."""

    frame = "body"
    gm_m3_s2 = 2.0

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", 2.0, "m3/s2"),)

    def potential_array(self, r: Array, p: Array) -> Array:
        return np.asarray(p[0] / np.linalg.norm(r, axis=0))

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return np.asarray(-p[0] * r / np.linalg.norm(r, axis=0) ** 3)


def test_two_points_closed_form() -> None:
    model = total(
        {"model": point(3.0), "position_m": [1.0, 0.0, 0.0]},
        {"model": point(4.0), "position_m": [0.0, -2.0, 0.5], "scale": 0.5},
    )
    assert isinstance(model, GravitySum)
    assert model.gm_m3_s2 == 5.0
    first = POINTS - np.array([[1.0], [0.0], [0.0]])
    second = POINTS - np.array([[0.0], [-2.0], [0.5]])
    near, far = np.linalg.norm(first, axis=0), np.linalg.norm(second, axis=0)
    field = GravityField(model)
    np.testing.assert_allclose(field.potential(POINTS), 3.0 / near + 2.0 / far, rtol=1e-15)
    np.testing.assert_allclose(
        field.acceleration(POINTS), -3.0 * first / near**3 - 2.0 * second / far**3, rtol=2e-15
    )


@pytest.mark.parametrize("kind", ["ellipsoid", "harmonics"])
def test_rotation_is_intrinsic_zxz(kind: str) -> None:
    angles = np.array([25.0, 40.0, -70.0])
    offset = np.array([0.3, -0.2, 0.1])
    model: Ellipsoid | Harmonics = ellipsoid(3.0, 2.0, 1.0)
    if kind == "harmonics":
        model = Harmonics(
            HarmonicsSpec.model_validate(
                {
                    "gm_m3_s2": 5.0,
                    "reference_radius_m": 2.0,
                    "normalisation": "full",
                    "tide_system": "none",
                    "coefficients": [
                        {"n": 2, "m": 1, "c": 0.1, "s": -0.2},
                        {"n": 3, "m": 0, "c": 0.1},
                    ],
                }
            )
        )
    placed = total(
        {"model": model, "position_m": offset.tolist(), "rotation_zxz_deg": angles.tolist()}
    )
    # SciPy's intrinsic ZXZ rotation turns the axes: its columns are the part's axes.
    axes = Rotation.from_euler("ZXZ", angles, degrees=True).as_matrix()
    local = axes.T @ (POINTS - offset[:, None])
    own, found = GravityField(model), GravityField(placed)
    np.testing.assert_allclose(found.potential(POINTS), own.potential(local), rtol=2e-15)
    expected = axes @ own.acceleration(local)
    np.testing.assert_allclose(found.acceleration(POINTS), expected, rtol=1.5e-14)
    gradient = np.einsum("ik,klN,jl->ijN", axes, own.gradient(local), axes)
    size = np.abs(gradient).max(axis=(0, 1))
    assert np.max(np.abs(found.gradient(POINTS) - gradient) / size) <= 6e-15


def test_quarter_turn_exchanges_axes_exactly() -> None:
    placed = total({"model": ellipsoid(3.0, 2.0, 1.0), "rotation_zxz_deg": [90, 0, 0]})
    np.testing.assert_array_equal(
        rotation_zxz(np.pi / 2, 0.0, 0.0), [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    )
    found, expected = GravityField(placed), GravityField(ellipsoid(2.0, 3.0, 1.0))
    np.testing.assert_allclose(
        found.acceleration(POINTS), expected.acceleration(POINTS), rtol=2e-15
    )


def test_field_in_a_concentric_void_is_zero() -> None:
    # Newton's shell theorem.
    shell = total(
        {"model": ellipsoid(5.0, 5.0, 5.0), "name": "whole"},
        {"model": ellipsoid(4.0, 4.0, 4.0), "name": "void", "scale": -1.0},
    )
    within = np.random.default_rng(0).uniform(-2.0, 2.0, (3, 30))
    field, whole = GravityField(shell), GravityField(ellipsoid(5.0, 5.0, 5.0))
    size = np.abs(whole.acceleration(within)).max()
    assert np.abs(field.acceleration(within)).max() <= 1e-15 * size
    assert shell.gm_m3_s2 == pytest.approx(4 / 3 * np.pi * (125 - 64), rel=1e-15)


def test_field_in_an_excentric_void_is_uniform() -> None:
    # −(4π/3)Gρ times the offset of the void, anywhere within it.
    offset = np.array([0.6, -0.3, 0.2])
    holed = total(
        {"model": ellipsoid(5.0, 5.0, 5.0), "name": "whole"},
        {
            "model": ellipsoid(2.0, 2.0, 2.0),
            "name": "void",
            "scale": -1.0,
            "position_m": offset.tolist(),
        },
    )
    within = offset[:, None] + np.random.default_rng(0).uniform(-1.0, 1.0, (3, 30))
    found = GravityField(holed).acceleration(within)
    expected = np.repeat(-4 / 3 * np.pi * offset[:, None], 30, axis=1)
    np.testing.assert_allclose(found, expected, rtol=5e-15)


def test_parameters_are_prefixed_and_set_at_run_time() -> None:
    inner = total({"model": point(1.0), "name": "core"})
    model = total(
        {"model": inner, "name": "phobos", "position_m": [1.0, 0.0, 0.0]},
        {"model": ellipsoid(3.0, 2.0, 1.0)},
    )
    names = [q.name for q in model.parameters()]
    assert names == [
        "phobos.core.gm", "phobos.core.scale", "phobos.scale",
        "part2.density", "part2.axis_x", "part2.axis_y", "part2.axis_z", "part2.scale",
    ]  # fmt: skip
    field = GravityField(model, ["part2.scale", "phobos.core.gm"])
    other = total(
        {"model": point(7.0), "position_m": [1.0, 0.0, 0.0]},
        {"model": ellipsoid(3.0, 2.0, 1.0), "scale": 0.25},
    )
    np.testing.assert_allclose(
        field.acceleration(POINTS, [0.25, 7.0]), GravityField(other).acceleration(POINTS),
        rtol=3e-15,
    )  # fmt: skip


def test_array_parts_make_an_array_sum() -> None:
    angles, offset = [10.0, 20.0, 30.0], [0.5, 0.4, -0.3]
    parts = [
        {"model": ellipsoid(3.0, 2.0, 1.0), "name": "a", "rotation_zxz_deg": angles},
        {"model": ArrayPoint(), "name": "b", "position_m": offset, "scale": 1.5},
    ]
    mixed = total(*parts)
    symbolic = total(parts[0], {**parts[1], "model": point(2.0)})
    assert isinstance(mixed, ArrayGravitySum)
    assert isinstance(mixed, ArrayGravityModel)
    assert isinstance(symbolic, GravitySum)
    run_time = ["b.gm", "a.scale"]
    values = np.array([2.5, 0.8])
    found, expected = GravityField(mixed, run_time), GravityField(symbolic, run_time)
    np.testing.assert_allclose(
        found.potential(POINTS, values), expected.potential(POINTS, values), rtol=2e-15
    )
    np.testing.assert_allclose(
        found.acceleration(POINTS, values), expected.acceleration(POINTS, values), rtol=3e-15
    )
    exact = expected.gradient(POINTS, values)
    size = np.abs(exact).max(axis=(0, 1))
    # The array part is differentiated by differences; measured 3e-13.
    assert np.max(np.abs(found.gradient(POINTS, values) - exact) / size) <= 1.3e-12


def test_part_with_a_parameter_called_scale_is_refused() -> None:
    class Scaled(ArrayPoint):
        def parameters(self) -> tuple[Parameter, ...]:
            return (Parameter("scale", 1.0),)

    with pytest.raises(InputError, match="part 'part1' has a parameter 'scale' of its own"):
        total({"model": Scaled()})


def test_series_of_the_parts_are_sure_outside_a_common_sphere() -> None:
    series = Harmonics(
        HarmonicsSpec.model_validate(
            {"gm_m3_s2": 1.0, "reference_radius_m": 2.0, "normalisation": "full",
             "tide_system": "none", "coefficients": [{"n": 2, "m": 0, "c": -0.05}]}
        )
    )  # fmt: skip
    moved = {"model": series, "name": "series", "position_m": (3.0, 0.0, 4.0)}
    found = total({"model": point(1.0), "name": "core"}, moved)
    nested = total({"model": found, "name": "all"}, {"model": point(2.0), "name": "other"})
    for model in (found, nested):
        assert isinstance(model, SeriesGravity)
        assert model.series_radius_m == 7.0
    none = total({"model": point(1.0), "name": "a"}, {"model": point(2.0), "name": "b"})
    assert isinstance(none, SeriesGravity)
    assert none.series_radius_m is None
