"""Which case inputs dispersions stand for, and what is said where they stand for none."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag
from scipy.special import ndtr
from tests.core.uncertainty.toy_mission import Ball, BallSpec, toy_mission, toy_repeated

from hillsphere.cases.repeated import Repeated
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter
from hillsphere.mission import MissionError
from hillsphere.runs.assembly import Assembly
from hillsphere.uncertainty.dispersed import Dispersed, Quantity, quantities_of, resolve
from hillsphere_controllers.uncertain import uncertain

FIELD = """
[dispersions.field]
type = "normal"
of = "gravity.phobos"
parameters = ["C*", "S2,2"]
sigma_relative = 0.1
"""


def resolved(repeated: Repeated) -> Dispersed:
    """Resolve all dispersions of a mission."""
    names = repeated.mission.specs["dispersions"]
    assembly = Assembly(repeated.mission)
    return resolve({name: assembly.get("dispersions", name) for name in names}, repeated)


def table(**keys: object) -> str:
    """Write a table ``[dispersions.one]``; a normal distribution of gm by default."""
    given: dict[str, object] = {
        "type": "'normal'",
        "of": "'gravity.phobos'",
        "parameters": "['gm']",
        **keys,
    }
    return "\n[dispersions.one]\n" + "".join(f"{key} = {value}\n" for key, value in given.items())


def test_patterns_find_quantities_in_their_order(tmp_path: Path) -> None:
    dispersed = resolved(toy_repeated(tmp_path, FIELD))
    names = ["C2,0", "C2,2", "C3,1", "S2,2"]
    assert [q.name for q in dispersed.quantities] == [f"gravity.phobos.{n}" for n in names]
    assert [q.inputs for q in dispersed.quantities] == [(f"gravity.{n}",) for n in names]
    mean, covariance = dispersed.moments()
    assert_array_equal(mean, [-0.1, 0.02, 0.004, 0.0])
    assert_allclose(np.sqrt(np.diag(covariance)), [0.01, 0.002, 0.0004, 0.0], rtol=1e-12)
    assert_array_equal(dispersed.values(np.full((4, 3), 0.5)), np.tile(mean, (3, 1)).T)


def test_a_quantity_reached_by_two_ways_takes_one_value(tmp_path: Path) -> None:
    repeated = toy_repeated(
        tmp_path, table(sigma_relative=0.1), sets=("compensator.own.model=phobos",)
    )
    assert set(repeated.paths("gravity.phobos")) == {"gravity.", "law.model."}
    (quantity,) = resolved(repeated).quantities
    assert quantity.name == "gravity.phobos.gm"
    assert quantity.inputs == ("gravity.gm", "law.model.gm")


def test_a_model_reached_through_another_table(tmp_path: Path) -> None:
    repeated = toy_repeated(
        tmp_path, table(of="'compensator.own'", parameters="['model.gm']", sigma_relative=0.1)
    )
    (quantity,) = resolved(repeated).quantities
    assert (quantity.name, quantity.nominal) == ("compensator.own.model.gm", 8e5)
    assert quantity.inputs == ("law.model.gm",)


def test_the_stage_itself_and_units(tmp_path: Path) -> None:
    start = table(of="'stage.hover'", parameters="['state.x', 'state.y']", sigma="[1, 2]")
    dispersed = resolved(toy_repeated(tmp_path, start + "unit = 'km'\n"))
    assert [q.name for q in dispersed.quantities] == ["state.x", "state.y"]
    mean, covariance = dispersed.moments()
    assert_array_equal(mean, [20e3, 0.0])
    assert_allclose(np.sqrt(np.diag(covariance)), [1e3, 2e3], rtol=1e-12)


def test_a_value_of_the_products_needs_limits_of_its_own(tmp_path: Path) -> None:
    keys = {"type": "'uniform'", "of": "'stage.hover'", "parameters": "['state.vx']"}
    fine = resolved(toy_repeated(tmp_path, table(**keys, lower=-1, upper=1)))
    assert_array_equal(fine.values(np.array([[0.5]])), [[0.0]])
    with pytest.raises(InputError, match=r"state\.vx has no nominal value before earlier stages"):
        resolved(toy_repeated(tmp_path, table(**keys, half_width=1)))
    with pytest.raises(InputError, match=r"state\.vx has no nominal value"):
        resolved(toy_repeated(tmp_path, table(**keys, half_width_relative=0.1)))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"parameters": "['C2_0']", "sigma": 1},
            "dispersions.one: gravity.phobos has no quantity 'C2_0'; did you mean 'C2,0'?",
        ),
        (
            {"parameters": "['gm', 'J*']", "sigma": 1},
            "dispersions.one: gravity.phobos has no quantity 'J*'; there are: gm, C2,0",
        ),
        (
            {"of": "'gravity.unused'", "sigma": 1},
            "dispersions.one: of: stage 'hover' does not use gravity.unused; it uses "
            "gravity.phobos, gravity.believed, compensator.own, stage.hover",
        ),
        (
            {"of": "'stage.idle'", "sigma": 1},
            "dispersions.one: of: stage 'hover' does not use stage.idle; it uses gravity.phobos",
        ),
        (
            {"unit": "'km'", "sigma": 1},
            "dispersions.one: its numbers are in m, but gravity.phobos.gm is in m3/s2",
        ),
        (
            {"parameters": "['C*']", "sigma": "[1, 2]"},
            "dispersions.one: sigma is given for 2 quantities, but parameters matches 3",
        ),
    ],
)
def test_what_is_said(tmp_path: Path, keys: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        resolved(toy_repeated(tmp_path, table(**keys)))


def test_a_table_that_offers_nothing_case_by_case(tmp_path: Path) -> None:
    more = '\n[gravity.heap]\ntype = "ball"\ngm_km3_s2 = 1.0\n'
    repeated = toy_repeated(tmp_path, FIELD + more)
    field = Assembly(repeated.mission).get("dispersions", "field")
    with pytest.raises(InputError, match=r"takes no quantity of gravity\.phobos case by case"):
        resolve({"field": field}, repeated, case_inputs=())


def test_a_quantity_is_dispersed_once(tmp_path: Path) -> None:
    again = table(parameters="['C2,0']", sigma=1)
    with pytest.raises(
        InputError,
        match=r"dispersions\.one: gravity\.phobos\.C2,0 is dispersed by dispersions\.field already",
    ):
        resolved(toy_repeated(tmp_path, FIELD + again))
    around = table(of="'stage.hover'", parameters="['gravity.C2,0']", sigma=1)
    with pytest.raises(InputError, match=r"gravity\.C2,0 is dispersed by dispersions\.field"):
        resolved(toy_repeated(tmp_path, FIELD + around))


def test_a_stage_that_cannot_be_repeated(tmp_path: Path) -> None:
    mission = toy_mission(tmp_path, FIELD)
    with pytest.raises(InputError, match=r"stage 'idle' \(idle\) cannot be repeated"):
        resolved(Repeated(mission, "idle"))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"of": "'gravity.fobos'", "sigma": 1}, "no table is named 'gravity.fobos'; did you mean"),
        ({"of": "'nothing.there'", "sigma": 1}, "no table is named 'nothing.there'; there are"),
        ({"of": "'phobos'", "sigma": 1}, "'phobos' does not match the pattern"),
        ({}, "dispersions.one.sigma: give one of sigma, sigma_relative; got none"),
        (
            {"sigma": 1, "sigma_relative": 1},
            "give one of sigma, sigma_relative; got sigma and sigma_relative",
        ),
        ({"sigma": -1}, "dispersions.one.sigma: must be ≥ 0"),
        ({"sigma": 1, "unit": "'kmm'"}, "dispersions.one.unit: no unit 'kmm' is known; did you"),
        ({"sigma": 1, "parameters": "['gm', 'gm']"}, "parameters: 'gm' stands there twice"),
        ({"sigma": 1, "parameters": "['']"}, "parameters: a name must not be empty"),
        ({"sigma": 1, "parameters": "[]"}, "dispersions.one.parameters"),
        ({"sigma": 1, "correlation": "[[1, 0]]"}, "correlation: must be square"),
        ({"sigma": 1, "correlation": "[[1, 0], [0, 2]]"}, "the diagonal must be 1, got 2 in row 1"),
        ({"sigma": 1, "correlation": "[[1, 0], [0.1, 1]]"}, "correlation: must be symmetric"),
        ({"sigma": 1, "correlation": "[[1, 3], [3, 1]]"}, "lies between -1 and 1, got 3 in row 1"),
        ({"type": "'uniform'", "lower": 1}, "one.upper: lower and upper belong together"),
        ({"type": "'uniform'", "upper": 1}, "give one of half_width, half_width_relative, lower"),
        (
            {"type": "'uniform'", "lower": 1, "upper": 2, "offset": 1},
            "one.offset: lower and upper say where the interval is; leave offset out",
        ),
        ({"type": "'log_normal'", "factor": 0.5}, "one.factor: must be ≥ 1"),
        (
            {"type": "'choice'", "values": "[1, 2]", "weights": "[1]"},
            "one.weights: must be as many",
        ),
        ({"type": "'choice'", "values": "[1]", "weights": "[0]"}, "at least one must be positive"),
        (
            {"type": "'samples'", "rows": "[[1], [1, 2]]"},
            "one.rows: every row must hold one number",
        ),
        ({"type": "'samples'"}, "give one of rows, file; got none"),
        ({"type": "'samples'", "file": "'toy.toml'", "parameters": "['C*']"}, "leave * out"),
        ({"type": "'gauss'"}, "no distribution of type 'gauss'; installed: choice, log_normal"),
        ({"type": "3"}, "one.type: expected a string"),
    ],
)
def test_a_mission_says_what_is_wrong(
    tmp_path: Path, keys: dict[str, object], message: str
) -> None:
    with pytest.raises(MissionError, match=re.escape(message)):
        toy_mission(tmp_path, table(**keys))


def test_a_table_without_type(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="missing: which distribution it is; installed: choice"):
        toy_mission(tmp_path, "\n[dispersions.one]\nof = 'gravity.phobos'\n")


def test_uncertain_parameters_of_a_model(tmp_path: Path) -> None:
    repeated = toy_repeated(tmp_path, FIELD)
    field = Assembly(repeated.mission).get("dispersions", "field")
    ball = Ball(BallSpec(gm_m3_s2=7e5))
    found = uncertain(ball, field, sigmas=2.0)
    assert found.names == ("C2,0", "C2,2", "C3,1", "S2,2")
    assert found.units == ("-",) * 4
    assert_array_equal(found.mean, found.nominal)
    sigma = np.array([0.01, 0.002, 0.0004, 0.0])
    assert_allclose(found.covariance, np.diag(sigma**2), rtol=1e-12)
    assert_allclose(found.lower, found.mean - 2 * sigma, rtol=1e-12)
    assert_allclose(found.upper, found.mean + 2 * sigma, rtol=1e-12)
    with pytest.raises(InputError, match=r"gravity\.phobos has no quantity 'C\*'; it offers none"):
        uncertain(Nameless(), field)


class Nameless:
    def parameters(self) -> tuple[()]:
        return ()


SEVERAL = """
[dispersions.start]
type = "normal"
of = "stage.hover"
parameters = ["state.x", "state.y"]
sigma = [100, 40]
correlation = [[1, 0.6], [0.6, 1]]
offset = [3, -2]

[dispersions.field]
type = "normal"
of = "gravity.phobos"
parameters = ["C2,0", "C2,2", "C3,1"]
sigma = [0.01, 0.002, 0.0004]
correlation = [[1, -0.5, 0.3], [-0.5, 1, 0.2], [0.3, 0.2, 1]]

[dispersions.believed]
type = "normal"
of = "compensator.own"
parameters = ["model.gm", "model.S2,2"]
sigma = [5e3, 0.001]
correlation = [[1, 0.9], [0.9, 1]]
"""


def covariance_of_several() -> Array:
    """Return σ_i σ_j ρ_ij by groups: quantities of different dispersions are independent."""
    blocks = (
        ([100.0, 40.0], [[1, 0.6], [0.6, 1]]),
        ([0.01, 0.002, 0.0004], [[1, -0.5, 0.3], [-0.5, 1, 0.2], [0.3, 0.2, 1]]),
        ([5e3, 0.001], [[1, 0.9], [0.9, 1]]),
    )
    return np.asarray(block_diag(*(np.outer(s, s) * np.array(rho) for s, rho in blocks)))


def test_several_correlated_dispersions_keep_their_rows(tmp_path: Path) -> None:
    """The draw is linear in normal numbers z, x = m + A z, and A Aᵀ is the covariance.

    Whichever root A of it is taken. A row of numbers given to two dispersions, or to the wrong
    one, makes quantities of different dispersions dependent.
    """
    dispersed = resolved(toy_repeated(tmp_path, SEVERAL))
    mean = np.array([20003.0, -2.0, -0.1, 0.02, 0.004, 8e5, 0.0])
    names = ["stage.hover.state.x", "stage.hover.state.y"]
    names += [f"gravity.phobos.{name}" for name in ("C2,0", "C2,2", "C3,1")]
    names += [f"compensator.own.model.{name}" for name in ("gm", "S2,2")]
    # the stage's own quantities are named without it, see `Quantity`
    assert [q.name for q in dispersed.quantities] == [n.removeprefix("stage.hover.") for n in names]
    assert [group.table for group in dispersed.groups] == ["start", "field", "believed"]
    assert_array_equal([q.nominal for q in dispersed.groups[2].quantities], [8e5, 0.0])
    middle = dispersed.values(np.full((7, 1), 0.5))
    assert_allclose(middle[:, 0], mean, rtol=1e-13)
    size = np.array([100.0, 40.0, 0.01, 0.002, 0.0004, 5e3, 0.001])
    slopes = (dispersed.values(ndtr(np.eye(7))) - middle) / size[:, None]
    expected = covariance_of_several()
    scaled = expected / np.outer(size, size)
    assert_allclose(slopes @ slopes.T, scaled, rtol=0, atol=1e-10)
    # a quantity depends on the numbers of its own dispersion only
    assert_array_equal(slopes != 0.0, np.tril(scaled != 0.0))
    found_mean, covariance = dispersed.moments()
    assert_allclose(found_mean, mean, rtol=1e-13)
    assert_allclose(covariance, expected, rtol=1e-12)


def test_a_swept_value_takes_the_place_of_its_own_nominal_one(tmp_path: Path) -> None:
    dispersed = resolved(toy_repeated(tmp_path, SEVERAL))
    half = np.full((7, 2), 0.5)
    moved = dispersed.values(half, {"gravity.phobos.C2,2": 0.5, "state.y": 7.0})
    assert_allclose(
        moved[:, 1] - dispersed.values(half)[:, 1], [0, 7, 0, 0.48, 0, 0, 0], atol=1e-15
    )
    # the dispersion itself is not changed by it
    assert_array_equal(dispersed.groups[1].nominal, [-0.1, 0.02, 0.004])


def test_a_relative_width_follows_the_swept_value(tmp_path: Path) -> None:
    dispersed = resolved(toy_repeated(tmp_path, FIELD))
    u = ndtr(np.diag([1.0, 1.0, 1.0, 1.0]))
    moved = dispersed.values(u, {"gravity.phobos.C2,0": -0.4})
    # σ is 10 % of |nominal|: one σ above it for the quantity whose number is one σ out
    assert_allclose(np.diag(moved), [-0.36, 0.022, 0.0044, 0.0], rtol=1e-12)


def test_nothing_dispersed() -> None:
    nothing = Dispersed(())
    assert nothing.values(np.empty((0, 5))).shape == (0, 5)
    mean, covariance = nothing.moments()
    assert mean.shape == (0,)
    assert covariance.shape == (0, 0)


@pytest.mark.parametrize("of", ["stage", "stage.hover"])
def test_the_own_stage_by_both_its_names(tmp_path: Path, of: str) -> None:
    repeated = toy_repeated(tmp_path)
    found = quantities_of(of, repeated, repeated.case_inputs())
    assert found["state.x"] == Quantity("state.x", ("state.x",), 20e3, "m")
    assert found["gravity.gm"] == Quantity("gravity.gm", ("gravity.gm",), 7e5, "m3/s2")
    assert len(found) == 5 + 5 + 3


def test_quantities_of_a_table_reached_twice(tmp_path: Path) -> None:
    repeated = toy_repeated(tmp_path, sets=("compensator.own.model=phobos",))
    inputs = (
        *repeated.case_inputs(),
        Parameter("gravity.", 1.0, "-"),  # the table itself is no quantity of it
        Parameter("gravitygm", 1.0, "-"),
    )
    found = quantities_of("gravity.phobos", repeated, inputs)
    both = ("gravity.C2,0", "law.model.C2,0")
    assert list(found) == ["gm", "C2,0", "C2,2", "S2,2", "C3,1"]
    assert found["C2,0"] == Quantity("gravity.phobos.C2,0", both, -0.1, "-")


def test_a_dispersion_in_a_unit_of_the_quantity_is_fine(tmp_path: Path) -> None:
    keys = {"of": "'stage.hover'", "parameters": "['state.x']", "sigma": 2, "unit": "'km'"}
    (group,) = resolved(toy_repeated(tmp_path, table(**keys))).groups
    assert group.table == "one"
    assert_allclose(group.dispersion.covariance(group.nominal), [[4e6]], rtol=1e-12)


def test_only_tables_that_offer_something_are_named(tmp_path: Path) -> None:
    """Of a stage that takes its state case by case, but nothing of a gravity model."""
    repeated = toy_repeated(tmp_path, table(of="'gravity.unused'", sigma=1))
    one = Assembly(repeated.mission).get("dispersions", "one")
    state = (Parameter("state.x", 0.0, "m"),)
    with pytest.raises(InputError, match=r"does not use gravity\.unused; it uses stage\.hover$"):
        resolve({"one": one}, repeated, state)
    with pytest.raises(InputError, match=r"gravity\.unused; it takes nothing case by case$"):
        resolve({"one": one}, repeated, ())
