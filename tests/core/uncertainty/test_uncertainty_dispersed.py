"""Which case inputs dispersions stand for, and what is said where they stand for none."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.core.uncertainty.toy_mission import Ball, BallSpec, toy_mission, toy_repeated

from hillsphere.assembly import Assembly
from hillsphere.campaign.repeated import Repeated
from hillsphere.errors import InputError
from hillsphere.mission import MissionError
from hillsphere.uncertainty.dispersed import Dispersed, resolve
from hillsphere.uncertainty.uncertain import uncertain

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
            "dispersions.one: its numbers stand for m, but gravity.phobos.gm is in m3/s2",
        ),
        (
            {"parameters": "['C*']", "sigma": "[1, 2]"},
            "dispersions.one: sigma is given for 2 quantities, but parameters finds 3",
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
