"""The stage ``lft``: uncertain models that are what they were made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere.uncertainty.distributions import Uniform
from hillsphere.uncertainty.specs import UniformSpec
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.lft.products import FittedModels
from hillsphere_controllers.stages.lft.specs import LftSpec
from hillsphere_controllers.stages.lft.stage import LftStage
from hillsphere_controllers.stages.uncertain import to_lft


def plant(k: float, c: float) -> LtiSystem:
    """Return a damped oscillator whose entries are polynomials of both parameters."""
    return LtiSystem(
        np.array([[0.0, 1.0], [-k, -c * c - 0.1 * k * c]]),
        np.array([[0.0, 0.0, 0.0], [1.0, 0.3, 1.0]]),
        np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]),
        np.zeros((3, 3)),
        None,
        ("w", "d", "u"),
        ("z", "rate", "y"),
    )


def models(ks: Sequence[float], cs: Sequence[float]) -> LinearModels:
    points = np.array([(k, c) for k in ks for c in cs]).T
    systems = tuple(plant(*point) for point in points.T)
    return LinearModels(
        systems, tuple(f"{n}" for n in range(len(systems))), ("k", "c"), ("N/m", "-"), points,
        np.array([1.0, 0.5]), 1, 1, (),
    )  # fmt: skip


GRID = models([0.5, 1.0, 1.5, 2.0], [0.2, 0.4, 0.6, 0.8])


def run(product: LinearModels, **keys: Any) -> FittedModels:
    spec = validate(LftSpec, {"needs": {"models": "models"}} | keys, where="stage")
    assert isinstance(spec, LftSpec)
    stage = LftStage(spec)
    made = stage.run(RecordingContext(), product)
    check_product(made)
    check_presentation(stage.present(made, product))
    return made


def test_polynomials_are_found_exactly_and_hold_between_the_models() -> None:
    made = run(GRID, degree=2)
    assert {tuple(row) for row in made.exponents[0].tolist()} == {(0, 0), (1, 0), (0, 2), (1, 1),
                                                                  (0, 1)}  # fmt: skip
    assert float(np.nanmax(made.response_error)) < 1e-12
    lft = to_lft(made.models[0])
    for k, c in ((0.7, 0.33), (1.9, 0.71)):
        between = lft.at({"k": k, "c": c})
        assert_allclose(between.a, plant(k, c).a, rtol=1e-12, atol=1e-13)
    # nominal values are the models' own, not the middle
    assert_allclose(made.models[0].nominal, [1.0, 0.5], rtol=0.0)
    assert_allclose(lft.nominal.a, plant(1.0, 0.5).a, rtol=1e-12, atol=1e-14)


def test_known_parameters_make_a_model_each() -> None:
    made = run(GRID, known=["c"], degree=1)
    assert made.labels == ("c=0.2", "c=0.4", "c=0.6", "c=0.8")
    assert made.parameters == ("k",)
    for model, c in zip(made.models, (0.2, 0.4, 0.6, 0.8), strict=True):
        assert_allclose(to_lft(model).at({"k": 1.7}).a, plant(1.7, c).a, rtol=1e-12, atol=1e-13)


def test_blocks_stand_between_the_signals_named() -> None:
    block = {"name": "actuator", "outputs": ["rate"], "inputs": ["d"]}
    made = run(GRID, degree=2, blocks=[block])
    model = made.models[0]
    assert model.system.inputs[-2:] == ("w", "u")
    assert model.system.outputs[-2:] == ("z", "y")
    assert model.kinds[-1] == "full"
    # a real block closes them by its number: the feedback adds to the damping
    closed = to_lft(model).at({"actuator": np.array([[-0.5]])})
    expected = plant(1.0, 0.5).a + np.array([[0.0, 0.0], [0.0, -0.15]])
    assert_allclose(closed.a, expected, rtol=1e-12, atol=1e-14)


def test_dispersions_bound_parameters() -> None:
    dispersion = Uniform(
        UniformSpec.model_validate(
            {"of": "stage.models", "parameters": ["k"], "lower": 0.8, "upper": 1.4}
        )
    )
    made = run(GRID, degree=2, dispersions=[dispersion])
    assert_allclose(made.models[0].lower, [0.8, 0.2], rtol=1e-12)
    assert_allclose(made.models[0].upper, [1.4, 0.8], rtol=1e-12)
    # models beyond the bounds are no check of the uncertain model
    assert np.isnan(made.response_error).sum() == 12


def test_bounds_beyond_the_models_are_said() -> None:
    made = run(GRID, degree=2, bounds=[{"parameter": "k", "lower": 0.2, "upper": 2.0}])
    assert made.beyond == pytest.approx(0.2, rel=1e-12)


def test_reduction_costs_no_more_than_it_may() -> None:
    whole, less = run(GRID, degree=2), run(GRID, degree=2, reduction=0.2)
    assert less.after.sum() < whole.after.sum()
    assert 0.0 < less.sampled[0] <= less.bound[0] <= 0.2
    assert float(np.nanmax(less.response_error)) > 1e-6


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"bounds": [{"parameter": "m", "lower": 0, "upper": 1}]}, "no parameter 'm'"),
        ({"known": ["m"]}, "no parameter 'm'"),
        ({"known": ["k", "c"]}, "nothing is uncertain"),
        ({"degree": 1}, "raise the degree"),
        ({"degree": 2, "blocks": [{"name": "a", "outputs": ["y"], "inputs": ["d"]}]},
         r"blocks\[0\].*no signal 'y'"),
        ({"degree": 2, "blocks": [{"name": "a", "outputs": ["z"], "inputs": ["d"]},
                                  {"name": "b", "outputs": ["z"], "inputs": ["w"]}]},
         "two blocks"),
    ],
)  # fmt: skip
def test_faults_are_said_with_their_key(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(GRID, **keys)


def test_a_bound_needs_models_that_differ() -> None:
    with pytest.raises(InputError, match="same value"):
        run(models([1.0], [0.2, 0.4, 0.6]), bounds=[{"parameter": "k", "lower": 0, "upper": 2}])


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"bounds": [{"parameter": "k", "lower": 2, "upper": 1}]}, "above the lower"),
        ({"bounds": [{"parameter": "k", "lower": 0, "upper": 1, "nominal": 3}]}, "between"),
        ({"bounds": [{"parameter": "k", "lower": 0, "upper": 1}], "known": ["k"]}, "not known"),
    ],
)
def test_faults_are_found_before_anything_runs(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        validate(LftSpec, {"needs": {"models": "m"}} | keys, where="stage")


def along(positions: Sequence[float], *, bent: float = 0.0) -> LinearModels:
    """Return oscillators at points, whose damping and stiffness are each known to 10 %."""
    values = [(0.0, 0.0), (0.1, 0.0), (0.0, 0.1), (-0.1, 0.1), (0.1, -0.1)]
    points = np.array([(p, *v) for p in positions for v in values]).T
    systems = []
    for place, k, c in points.T:
        a = np.array([[0.0, 1.0], [-1.0 - k - bent * k * c, -0.5 - place * c]])
        systems.append(LtiSystem(a, np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1)), None,
                                 ("u",), ("y[0]", "y[1]")))  # fmt: skip
    return LinearModels(
        tuple(systems), tuple(map(str, range(len(systems)))),
        ("point", "spring.own.k", "spring.own.c"), ("-", "N/m", "-"), points,
        np.array([1.0, 0.0, 0.0]), 1, 2, (),
    )  # fmt: skip


SPRING = Uniform(
    UniformSpec.model_validate(
        {"of": "spring.own", "parameters": ["k", "c"], "lower": -0.1, "upper": 0.1}
    )
)


def test_affine_models_along_points_are_met_to_the_last_digit() -> None:
    keys = {"known": ["point"], "fit": "affine", "dispersions": [SPRING]}
    made = run(along([1.0, 2.0]), **keys)
    assert made.labels == ("point=1", "point=2")
    assert made.exponents == ()
    assert made.checks.tolist() == [2, 2]
    for model, place in zip(made.models, (1.0, 2.0), strict=True):
        # the dispersion's own table tells which parameters are meant
        assert model.names == ("spring.own.k", "spring.own.c")
        assert model.times.tolist() == [1, 1]
        at = to_lft(model).at({"spring.own.k": 0.07, "spring.own.c": -0.03})
        assert_allclose(at.a, [[0.0, 1.0], [-1.07, -0.5 + 0.03 * place]], rtol=1e-14)


def test_affine_models_lose_their_weakest_directions() -> None:
    keys = {"known": ["point"], "fit": "affine", "dispersions": [SPRING], "sigmas": 1}
    size = 0.1 / 3**0.5 / float(np.hypot(1.0, 0.5))  # one σ of each, relative to the lower row
    made = run(
        along([0.1, 10.0]),
        truncation=1.001 * size,
        truncation_of="nominal",
        compare_sigmas=[0.5, 1.0, 1.5],
        **keys,
    )
    # near the start the damping hardly matters, near the end the stiffness
    assert made.after.tolist() == [[1, 0], [0, 1]]
    assert made.sizes.tolist() == [[0, 1], [1, 1], [1, 2]]
    assert made.size_sigmas.tolist() == [0.5, 1.0, 1.5]


def test_truncation_is_a_share_of_the_change_by_default() -> None:
    """A change of 1e-3 of the nominal matrix keeps both directions under 5 % of the change.

    At 0.5 the weaker one goes: damping near the start, 0.1 and 1 times the spread of both.
    """
    keys = {"known": ["point"], "fit": "affine", "dispersions": [SPRING], "sigmas": 0.01}
    for place, share, after in ((0.1, 0.05, [1, 1]), (0.1, 0.5, [1, 0]), (10.0, 0.5, [0, 1])):
        made = run(along([place]), truncation=share, **keys)
        assert made.truncation_of == "change"
        assert made.after.tolist() == [after]
        assert made.models[0].covers.any() == (0 in after)
    # 0.1/√(1 + 0.1²) of the change is left out, and covered
    assert_allclose(made.dropped, 0.1 / np.hypot(1.0, 0.1), rtol=1e-9)
    assert made.models[0].names == ("spring.own.c", "left_out")
    # of the nominal matrix, nothing would be left
    none = run(along([0.1]), truncation=0.05, truncation_of="nominal", **keys)
    assert none.after.tolist() == [[0, 0]]


@pytest.mark.parametrize(
    ("positions", "size", "said"),
    [
        (
            [0.1, 10.0],
            0.9,
            "the truncation leaves all of them out at point=0.1, point=10: nothing but",
        ),
        (
            [0.1, 10.0],
            0.2,
            "strongest directions, but none at point=0.1: nothing but the cover is left",
        ),
        ([0.1, 10.0], 1e-3, "keep their strongest directions."),
    ],
)
def test_models_without_any_direction_left_are_told(
    positions: list[float], size: float, said: str
) -> None:
    keys = {"known": ["point"], "fit": "affine", "dispersions": [SPRING], "sigmas": 1}
    made = run(along(positions), truncation=size, truncation_of="nominal", **keys)
    assert (made.after.sum(axis=1) == 0).tolist() == [f"point={p:g}" in said for p in positions]
    spec = validate(LftSpec, {"needs": {"models": "models"}} | keys, where="stage")
    assert isinstance(spec, LftSpec)
    verdict = " ".join(LftStage(spec).present(made, along(positions)).verdict)
    assert said in verdict


def test_a_dispersion_without_spread_has_no_parameter() -> None:
    """A stage that linearises leaves it out: it is certain."""
    full = along([0.1, 10.0])
    rows = [0, 1]
    lost = replace(
        full, parameters=("point", "spring.own.k"), units=("-", "N/m"),
        values=full.values[rows], nominal=full.nominal[rows],
    )  # fmt: skip
    with pytest.raises(InputError, match=r"dispersions: .*spring\.own has no quantity 'c'.*sigma"):
        run(lost, known=["point"], fit="affine", dispersions=[SPRING])


def test_models_that_are_not_affine_are_refused() -> None:
    with pytest.raises(InputError, match="not affine"):
        run(along([1.0], bent=1e-3), known=["point"], fit="affine")


def test_one_number_may_stand_on_several_channels() -> None:
    blocks = [
        {"name": "gain", "kind": "real", "lower": 0.9, "upper": 1.1, "outputs": ["rate", "z"],
         "inputs": ["d", "w"]},
    ]  # fmt: skip
    made = run(models([1.0], [0.5]), blocks=blocks)
    model = made.models[0]
    assert (model.kinds, model.times.tolist(), model.rows.tolist()) == (("real",), [2], [1])
    assert_allclose([model.lower[0], model.nominal[0], model.upper[0]], [0.9, 1.0, 1.1], rtol=1e-15)
    # its value stands for δ = 0.5 on both channels: rate → 0.3 of the rate's equation, z → all
    closed = to_lft(model).at({"gain": 1.05})
    expected = plant(1.0, 0.5).a + 0.5 * np.array([[0.0, 0.0], [1.0, 0.3]])
    assert_allclose(closed.a, expected, rtol=1e-12, atol=1e-14)


def test_a_number_may_be_normalised_by_its_bounds() -> None:
    """The signals carry the deviation itself; the same loop as with its size put in before."""
    own = {"name": "gain", "kind": "real", "lower": 0.9, "upper": 1.3, "outputs": ["rate"],
           "inputs": ["d"]}  # fmt: skip
    model = run(models([1.0], [0.5]), blocks=[own | {"normalise": True}]).models[0]
    assert model.nominal[0] == pytest.approx(1.1, rel=1e-15)
    for value in (0.9, 1.0, 1.3):  # rate → 0.3 (value − 1.1) of the rate's equation
        closed = to_lft(model).at({"gain": value})
        expected = plant(1.0, 0.5).a + (value - 1.1) * np.array([[0.0, 0.0], [0.0, 0.3]])
        assert_allclose(closed.a, expected, rtol=1e-12, atol=1e-14)
    plain = run(models([1.0], [0.5]), blocks=[own]).models[0]
    expected = plant(1.0, 0.5).a + np.array([[0.0, 0.0], [0.0, 0.3]])
    assert_allclose(to_lft(plain).at({"gain": 1.3}).a, expected, rtol=1e-12, atol=1e-14)
    bare = {key: value for key, value in own.items() if key not in ("lower", "upper")}
    with pytest.raises(InputError, match="give both"):
        run(models([1.0], [0.5]), blocks=[bare | {"normalise": True}])


def test_a_nominal_value_off_the_middle_stays_that_of_the_models() -> None:
    """δ = −1, 0, 1 are lower, nominal and upper; the signals carry the deviation in between."""
    own = {"name": "gain", "kind": "real", "lower": 0.9, "upper": 1.3, "nominal": 1.0,
           "normalise": True, "outputs": ["rate", "z"], "inputs": ["d", "w"]}  # fmt: skip
    product = run(models([1.0], [0.5]), blocks=[own])
    model = product.models[0]
    ends = [float(each[0]) for each in (model.lower, model.nominal, model.upper)]
    assert ends == [0.9, 1.0, 1.3]
    made = to_lft(model)
    assert_allclose(made.nominal.a, plant(1.0, 0.5).a, rtol=0, atol=1e-15)
    for value in (0.9, 0.95, 1.0, 1.2, 1.3):
        # rate → 0.3 (value − 1) of the rate's equation, z → all of it
        expected = plant(1.0, 0.5).a + (value - 1.0) * np.array([[0.0, 0.0], [1.0, 0.3]])
        assert_allclose(made.at({"gain": value}).a, expected, rtol=1e-12, atol=1e-14)


def test_a_nominal_value_after_a_block_of_another_shape() -> None:
    """Its rows and columns are counted apart, as those of a full block before it are."""
    system = plant(1.0, 0.5)
    wide = LtiSystem(
        system.a, system.b[:, [0, 1, 0, 2]], system.c, np.zeros((3, 4)), None,
        ("w", "d", "e", "u"), system.outputs,
    )  # fmt: skip
    product = LinearModels(
        (wide,), ("0",), ("k", "c"), ("N/m", "-"), np.array([[1.0], [0.5]]), np.array([1.0, 0.5]),
        1, 1, (),
    )  # fmt: skip
    blocks = [
        {"name": "any", "outputs": ["z"], "inputs": ["w", "e"], "dynamic": False},
        {"name": "gain", "kind": "real", "lower": 0.9, "upper": 1.3, "nominal": 1.0,
         "normalise": True, "outputs": ["rate"], "inputs": ["d"]},
    ]  # fmt: skip
    made = to_lft(run(product, blocks=blocks).models[0])
    closed = made.at({"any": np.zeros((2, 1)), "gain": 1.3})
    expected = system.a + 0.3 * np.array([[0.0, 0.0], [0.0, 0.3]])
    assert_allclose(closed.a, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"nominal": 1.0}, "nominal.*set normalise = true"),
        ({"nominal": 1.3, "normalise": True}, "nominal.*between lower and upper"),
        ({"kind": "full", "nominal": 0.0}, "only a real number|set normalise = true"),
    ],
)
def test_a_nominal_value_that_cannot_be(keys: dict[str, Any], said: str) -> None:
    own = {"name": "gain", "kind": "real", "lower": 0.9, "upper": 1.3, "outputs": ["rate"],
           "inputs": ["d"]}  # fmt: skip
    with pytest.raises(InputError, match=said):
        run(models([1.0], [0.5]), blocks=[own | keys])


def test_a_complex_number_stands_on_the_diagonal() -> None:
    blocks = [{"name": "lag", "kind": "complex", "outputs": ["rate"], "inputs": ["d"]}]
    model = run(models([1.0], [0.5]), blocks=blocks).models[0]
    assert (model.kinds, model.dynamic.tolist()) == (("complex",), [True])
    with pytest.raises(InputError, match=r"blocks\[0\].*as many outputs"):
        run(models([1.0], [0.5]), blocks=[blocks[0] | {"outputs": ["rate", "z"]}])


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"fit": "affine", "degree": 2}, "degree.*fit = 'polynomial'"),
        ({"truncation": 0.1}, "truncation.*fit = 'affine'"),
        ({"truncation_of": "nominal"}, "truncation_of.*fit = 'affine'"),
        ({"fit": "affine", "compare_sigmas": [2]}, "needs dispersions"),
        ({"blocks": [{"name": "a", "outputs": ["y"], "inputs": ["d"], "lower": 0.5}]},
         "only a real number"),
        ({"blocks": [{"name": "a", "kind": "real", "outputs": ["y"], "inputs": ["d"],
                      "lower": 2.0}]}, "above lower"),
    ],
)  # fmt: skip
def test_faults_of_fits_and_blocks(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        validate(LftSpec, {"needs": {"models": "m"}} | keys, where="stage")
