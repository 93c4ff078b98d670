"""Plans: which cases there are, with which inputs, in which blocks, and what is refused."""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydantic import ValidationError
from tests.core.uncertainty.toy_mission import Ball, Hover, toy_repeated

from hillsphere.cases.plan import Plan
from hillsphere.cases.repeated import Repeated
from hillsphere.cases.specs import MonteCarloSpec, RangeSpec, SweepSpec
from hillsphere.cases.swept import Swept
from hillsphere.errors import InputError
from hillsphere.interfaces import Integers
from hillsphere.interfaces.cases import LANES
from hillsphere.products import CaseList, load_product, save_product
from hillsphere_campaigns.case_plan import plan_of
from hillsphere_campaigns.sweep_points import case_list, grid, points_of_list, sample_ranges

TABLES = """
[dispersions.field]
type = "normal"
of = "gravity.phobos"
parameters = ["C*", "S*"]
sigma_relative = 0.1

[dispersions.start]
type = "uniform"
of = "stage.hover"
parameters = ["state.x", "state.y"]
half_width = 100.0

[dispersions.mass]
type = "normal"
of = "gravity.believed"
parameters = ["gm"]
sigma_relative = 0.1

[dispersions.pair]
type = "normal"
of = "stage.hover"
parameters = ["state.x", "state.y"]
sigma = 1.0
correlation = [[1, 0.5], [0.5, 1]]

[dispersions.fixed]
type = "uniform"
of = "stage.hover"
parameters = ["state.x"]
lower = 0.0
upper = 1.0

[dispersions.peak]
type = "triangular"
of = "gravity.believed"
parameters = ["gm"]
lower = 7e5
upper = 9e5
"""
DISPERSIONS = ("field", "start")


@pytest.fixture
def repeated(tmp_path: Path) -> Repeated:
    return toy_repeated(tmp_path, TABLES)


def planned(repeated: Repeated, names: tuple[str, ...] = DISPERSIONS, **keys: Any) -> Plan:
    return plan_of(repeated, names, **{"cases": 100, "stream": "verify", **keys})


def case_rows(plan: Plan) -> tuple[Integers, list[tuple[Any, ...]]]:
    """Return the numbers of all cases and what each is given, from the blocks."""
    numbers, rows = [], []
    for i in range(plan.blocks):
        batch, variant = plan.block(i)
        assert batch.values.shape == (len(batch.names), LANES)
        assert batch.values.flags.c_contiguous
        assert len(set(batch.names)) == len(batch.names)
        for lane in np.flatnonzero(~batch.filler):
            numbers.append(batch.numbers[lane])
            given = dict(zip(batch.names, batch.values[:, lane].tolist(), strict=True))
            rows.append((int(batch.draws[lane]), variant, given))
    return np.array(numbers), rows


def test_blocks_and_filler(repeated: Repeated) -> None:
    plan = planned(repeated, cases=150)
    assert (plan.cases, plan.blocks, plan.repetitions, plan.design) == (150, 3, 150, "random")
    assert (plan.points, plan.point_labels, plan.swept, plan.notes) == (None, (), (), ())
    assert plan.variants == (repeated,)
    numbers, _ = case_rows(plan)
    assert_array_equal(numbers, np.arange(150))
    last, _ = plan.block(2)
    assert_array_equal(last.filler, np.arange(LANES) >= 150 - 128)
    assert (last.numbers[last.filler] == 149).all()
    assert (last.values[:, last.filler] == last.values[:, [21]]).all()
    assert (last.seed, last.stream) == (11, "verify")
    for wrong in (-1, 3):
        with pytest.raises(IndexError, match="of 3"):
            plan.block(wrong)


def test_inputs_and_their_values(repeated: Repeated) -> None:
    plan = planned(repeated)
    field = [f"gravity.phobos.{n}" for n in ("C2,0", "C2,2", "C3,1", "S2,2")]
    assert plan.inputs == (*field, "state.x", "state.y")
    assert plan.input_units == ("-", "-", "-", "-", "m", "m")
    batch, _ = plan.block(0)
    assert batch.names == ("gravity.C2,0", "gravity.C2,2", "gravity.C3,1", "gravity.S2,2",
                           "state.x", "state.y")  # fmt: skip
    assert_array_equal(plan.input_values(np.arange(LANES)), batch.values)
    some = np.array([99, 3, 70])
    assert_array_equal(plan.input_values(some), plan.input_values(np.arange(100))[:, some])
    x = plan.input_values(np.arange(100))[4]
    assert (np.abs(x - 20e3) <= 100).all()
    assert x.std() > 40


@pytest.mark.parametrize("design", ["random", "latin_hypercube", "sobol", "sobol_indices"])
def test_the_same_in_any_order_and_anew(repeated: Repeated, design: Any) -> None:
    forward = planned(repeated, cases=64, design=design)
    backward = planned(repeated, cases=64, design=design)
    blocks = [forward.block(i)[0] for i in range(forward.blocks)]
    for i in reversed(range(forward.blocks)):
        again = backward.block(i)[0]
        assert again.values.tobytes() == blocks[i].values.tobytes()
        assert_array_equal(again.draws, blocks[i].draws)


def test_random_cases_do_not_change_with_their_number(repeated: Repeated) -> None:
    short, long = planned(repeated, cases=100), planned(repeated, cases=2000)
    cases = np.arange(100)
    assert_array_equal(short.input_values(cases), long.input_values(cases))
    other = planned(repeated, ("start",)).input_values(cases)
    assert_array_equal(other, short.input_values(cases)[4:])


def test_noise_only(repeated: Repeated) -> None:
    plan = planned(repeated, ())
    batch, _ = plan.block(1)
    assert (plan.inputs, batch.names, batch.values.shape) == ((), (), (0, LANES))
    assert plan.input_values(np.arange(5)).shape == (0, 5)


def test_one_quantity_reached_by_two_ways(tmp_path: Path) -> None:
    repeated = toy_repeated(tmp_path, TABLES, sets=("compensator.own.model=phobos",))
    plan = planned(repeated, ("field",))
    batch, _ = plan.block(0)
    assert len(plan.inputs) == 4
    assert batch.names[:2] == ("gravity.C2,0", "law.model.C2,0")
    assert_array_equal(batch.values[0], batch.values[1])


# --- sweeps -------------------------------------------------------------------------------------


def test_a_point_of_lists_is_named_without_commas() -> None:
    """Commas separate the parts of a name, of which ticks of figures are made."""
    over = {"stage.a.sensors": (("camera", "lidar"), ("camera",)), "stage.a.b": (1.0,)}
    assert grid(over).named(("", "m")) == (
        "stage.a.sensors = camera + lidar, stage.a.b = 1 m",
        "stage.a.sensors = camera, stage.a.b = 1 m",
    )


def test_sweep_of_a_run_time_input(repeated: Repeated) -> None:
    over = {"stage.hover.state.y": (1.0, 2.0), "gravity.phobos.gm": (6e5, 7e5, 8e5)}
    plan = planned(repeated, cases=30, swept=grid(over))
    assert (plan.cases, plan.blocks, plan.design) == (180, 3, "grid")
    assert len(plan.variants) == 1
    assert plan.swept_units == ("m", "m3/s2")
    assert_array_equal(plan.points, [[1, 1, 1, 2, 2, 2], [6e5, 7e5, 8e5] * 2])
    assert plan.point_labels[4] == "stage.hover.state.y = 2 m, gravity.phobos.gm = 700000 m3/s2"
    numbers, rows = case_rows(plan)
    assert_array_equal(plan.point_of(numbers), np.repeat(np.arange(6), 30))
    assert_array_equal(plan.draw_of(numbers), np.tile(np.arange(30), 6))
    for number, (draw, variant, given) in zip(numbers, rows, strict=True):
        assert (draw, variant) == (number % 30, 0)
        assert plan.points is not None
        assert given["gravity.gm"] == plan.points[1, number // 30]
        assert abs(given["state.y"] - plan.points[0, number // 30]) <= 100  # dispersed about it


def test_a_dispersion_lies_about_the_swept_value(repeated: Repeated) -> None:
    plan = planned(repeated, ("mass",), cases=50, swept=grid({"gravity.believed.gm": (8e5, 4e5)}))
    values = plan.input_values(np.arange(100))[0]
    assert_allclose(values[50:], 0.5 * values[:50], rtol=1e-14)
    assert_array_equal(plan.block(0)[0].values[0], values[:64])
    with pytest.raises(InputError, match=r"state\.x: swept, but dispersions\.fixed sets it"):
        planned(repeated, ("fixed",), swept=grid({"stage.hover.state.x": (1.0, 2.0)}))


def test_the_peak_of_a_distribution_is_swept_within_its_limits(repeated: Repeated) -> None:
    plan = planned(repeated, ("peak",), cases=50, swept=grid({"gravity.believed.gm": (7e5, 9e5)}))
    low, high = plan.input_values(np.arange(100))[0].reshape(2, 50)
    assert (low < high).all()
    assert (low > 7e5).all()
    assert (high < 9e5).all()
    with pytest.raises(InputError, match="the nominal value 1000000, the most probable one, must"):
        planned(repeated, ("peak",), cases=50, swept=grid({"gravity.believed.gm": (7e5, 1e6)}))


def test_sweep_of_keys_makes_variants(repeated: Repeated) -> None:
    over = {
        "stage.hover.state.y": (1.0, 2.0),
        "stage.hover.period_s": (60, 120),
        "stage.hover.mode": ("calm", "wild"),
    }
    plan = planned(repeated, cases=40, swept=grid(over))
    assert (plan.cases, plan.blocks, len(plan.variants)) == (320, 8, 4)
    assert plan.swept == tuple(over)
    assert plan.swept_units == ("m", "s", "")
    assert_array_equal(
        plan.points,
        [[1, 2, 1, 2, 1, 2, 1, 2], [60, 60, 60, 60, 120, 120, 120, 120], [0, 0, 1, 1, 0, 0, 1, 1]],
    )
    assert plan.point_labels[3] == (
        "stage.hover.state.y = 2 m, stage.hover.period_s = 60 s, stage.hover.mode = wild"
    )
    # the repeated stage need not be named
    again = {name.replace("stage.hover.", "repeat."): values for name, values in over.items()}
    assert planned(repeated, cases=40, swept=grid(again)).swept == tuple(over)
    with pytest.raises(InputError, match=r"stage\.hover\.mode is swept twice"):
        planned(repeated, cases=40, swept=grid(over | {"repeat.mode": ("calm",)}))
    numbers, rows = case_rows(plan)
    assert_array_equal(numbers, np.arange(320))
    assert plan.points is not None
    for number, (_, variant, given) in zip(numbers, rows, strict=True):
        spec: Any = plan.variants[variant].mission.specs["stage"]["hover"]
        point = plan.points[:, number // 40]
        assert (spec.period_s, ("calm", "wild").index(spec.mode)) == tuple(point[1:])
        assert given["state.x"] == rows[number % 40][2]["state.x"]


def test_a_swept_dispersion_shares_the_stage(repeated: Repeated) -> None:
    plan = planned(repeated, cases=50, swept=grid({"dispersions.field.scale": (0, 1, 2.5)}))
    assert (plan.cases, plan.blocks, len(plan.variants)) == (150, 3, 1)
    nominal = np.array([-0.1, 0.02, 0.004, 0.0])[:, None]
    none, one, more = np.split(plan.input_values(np.arange(150))[:4], 3, axis=1)
    assert_array_equal(none, np.broadcast_to(nominal, none.shape))
    assert_allclose(more - nominal, 2.5 * (one - nominal), rtol=0, atol=1e-15)
    assert [plan.block(i)[1] for i in range(3)] == [0, 0, 0]
    assert_array_equal(plan.block(2)[0].values[:4, :50], more)


def test_quantities_that_a_variant_lacks(repeated: Repeated) -> None:
    swept = grid({"gravity.phobos.degree": (2, 3)})
    plan = planned(repeated, ("field",), cases=10, swept=swept)
    assert plan.inputs == tuple(f"gravity.phobos.{n}" for n in ("C2,0", "C2,2", "S2,2", "C3,1"))
    assert len(plan.variants) == 2
    assert "gravity.C3,1" not in plan.block(0)[0].names
    values = plan.input_values(np.arange(20))
    assert np.isnan(values[3, :10]).all()
    assert np.isfinite(values[3, 10:]).all()
    assert np.isfinite(values[:3]).all()


def test_a_nested_key_and_its_unit(repeated: Repeated) -> None:
    plan = planned(repeated, swept=grid({"stage.hover.limits.dv_mm_s": (1.0, 2.0)}))
    assert plan.swept_units == ("mm/s",)
    spec: Any = plan.variants[1].mission.specs["stage"]["hover"]
    assert spec.limits.dv_m_s == 2e-3


def test_ranges(repeated: Repeated) -> None:
    swept = grid(
        {
            "stage.hover.samples": RangeSpec(first=10, last=30, points=3),
            "gravity.phobos.gm": RangeSpec(first=1e5, last=1e7, points=3, spacing="log"),
        }
    )
    plan = planned(repeated, cases=1, swept=swept)
    assert plan.points is not None
    assert_allclose(plan.points[1, :3], [1e5, 1e6, 1e7], rtol=1e-14)
    assert (plan.points[1, 0], plan.points[1, 2]) == (1e5, 1e7)
    spec: Any = plan.variants[1].mission.specs["stage"]["hover"]
    assert spec.samples == 20


@pytest.mark.parametrize("design", ["latin_hypercube", "sobol"])
def test_sampled_points(repeated: Repeated, design: Any) -> None:
    over = {
        "stage.hover.state.y": RangeSpec(first=-5, last=5),
        "gravity.phobos.gm": RangeSpec(first=1e5, last=1e7, spacing="log"),
    }
    swept = sample_ranges(over, design, 64, seed=1, stream="s")
    plan = planned(repeated, (), cases=2, swept=swept)
    assert (plan.cases, plan.design, len(plan.variants)) == (128, design, 1)
    assert plan.points is not None
    y, gm = (plan.points[0] + 5) / 10, np.log(plan.points[1] / 1e5) / np.log(100)
    for share in (y, gm):
        assert_array_equal(np.sort(np.floor(share * 64)), np.arange(64))
    again = sample_ranges(over, design, 64, seed=1, stream="s")
    assert_array_equal(again.points, swept.points)
    assert (sample_ranges(over, design, 64, seed=2, stream="s").points != swept.points).all()


def test_a_list_of_cases(repeated: Repeated, tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text(
        'state.x [m],"gravity.phobos.C2,0",stage.hover.period_s\n'
        "20100,-0.1,60\n19900,-0.2,120\n20000,-0.3,60\n"
    )
    cases = case_list(path)
    assert cases.names == ("state.x", "gravity.phobos.C2,0", "stage.hover.period_s")
    assert cases.units == ("m", "", "")
    save_product(tmp_path / "rows.npz", cases)
    assert_array_equal(load_product(tmp_path / "rows.npz").values, cases.values)
    plan = planned(repeated, (), cases=2, swept=points_of_list(cases))
    assert (plan.cases, plan.blocks, len(plan.variants), plan.design) == (6, 2, 2, "list")
    assert_array_equal(plan.points, [[20100, 20000, 19900], [-0.1, -0.3, -0.2], [60, 60, 120]])
    batch, variant = plan.block(1)
    assert variant == 1
    assert batch.value("state.x", 0.0)[0] == 19900
    assert batch.value("gravity.C2,0", 0.0)[0] == -0.2


def test_labels_of_a_list_follow_its_points(repeated: Repeated) -> None:
    values = np.array([[120.0, 60.0, 120.0]])
    cases = CaseList(("stage.hover.period_s",), ("",), values, ("a", "b", "c"))
    plan = planned(repeated, (), cases=1, swept=points_of_list(cases))
    assert plan.point_labels == ("b", "a", "c")


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({"gravity.fobos.gm": (1,)}, "gravity.fobos.gm: no such key in this mission; did you mean"),
        ({"gm": (1,)}, "gm: no such key in this mission; tables: "),
        ({"gravity.phobos": (1,)}, "gravity.phobos: no such key in this mission"),
        ({"gravity.phobos.gmm": (1,)}, "(case by case; did you mean 'gm'?)"),
        ({"gravity.unused.gm": (1,)}, "changes nothing, as stage 'hover' does not use gravity.un"),
        ({"dispersions.mass.scale": (1,)}, "changes nothing, as stage 'hover' does not use disp"),
        ({"stage.hover.periods": (1,)}, "stage.hover.periods = 1: "),
        ({"stage.hover.period_s": (60, -1)}, "stage.hover.period_s = -1: period_s: must be > 0"),
        ({"stage.hover.samples": (10, 10.5)}, "stage.hover.samples = 10.5: samples: expected a"),
        ({"gravity.phobos.gm": (1.0, "a")}, "gravity.phobos.gm: expected a finite number (m3/s2"),
        ({"gravity.phobos.gm": (1.0, True)}, "gravity.phobos.gm: expected a finite number (m3/s2"),
        ({"state.x": (1.0,), "stage.hover.state.x": (2.0,)}, "set the same quantity; keep one"),
        ({"stage.hover.gravity.gm": (1.0,), "gravity.phobos.gm": (2.0,)}, "set the same quantity"),
        ({"gravity.phobos.gm": (1.0,), "gravity.phobos.gm_km3_s2": (8e-4,)}, "too; keep one"),
        ({"stage.hover.gravity.C2,0": (1.0,)}, "swept, but dispersions.field sets it for every"),
        (
            {"stage.hover.period_s": (60,), "stage.hover.period_min": (1,)},
            "stage.hover.period_s and stage.hover.period_min set the same key; keep one",
        ),
        ({"stage.hover.gravity": ("fobos",)}, "= 'fobos': no gravity table is named 'fobos'; did"),
        ({"dispersions.mass.scale": (2,)}, "dispersions.mass here; add 'mass' to the key disper"),
        ({"stage.hover.period_s": ()}, "stage.hover.period_s: no values"),
        ({"stage.hover.period_s": RangeSpec(first=1, last=2)}, "a grid needs the number of points"),
        (
            {f"stage.hover.state.{x}": tuple(range(4000)) for x in "xy"},
            "the grid has 16000000 points; at most 10000000",
        ),
        (
            {f"stage.hover.state.{x}": tuple(range(400)) for x in "xy"},
            "16000000 cases are planned; at most 10000000",
        ),
    ],
)
def test_what_cannot_be_swept(repeated: Repeated, over: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        planned(repeated, DISPERSIONS if len(over) == 1 else (), swept=grid(over))


@pytest.mark.parametrize(
    ("cases", "message"),
    [
        (CaseList(("state.x",), ("km",), np.ones((1, 2))), "state.x is in m, but the list says km"),
        (CaseList(("state.x",), (), np.ones((1, 2))), "1 names need 1 units and values (1, N)"),
        (CaseList(("state.x",), ("",), np.ones((2, 2))), "1 names need 1 units and values (1, N)"),
        (CaseList(("state.x",), ("",), np.ones((1, 0))), "needs at least one point"),
        (CaseList((), (), np.ones((0, 2))), "needs at least one point, and names that differ"),
        (CaseList(("a", "a"), ("", ""), np.ones((2, 2))), "names that differ"),
        (CaseList(("a",), ("",), np.ones((1, 2)), ("one",)), "1 labels for 2 points"),
        (CaseList(("a",), ("",), np.array([[1, np.nan]])), "a is not finite at point 1"),
    ],
)
def test_lists_that_are_refused(repeated: Repeated, cases: CaseList, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        planned(repeated, (), swept=points_of_list(cases))


# --- Sobol indices --------------------------------------------------------------------------------


def test_sobol_indices_leave_out_what_has_no_spread(repeated: Repeated) -> None:
    """S2,2 is nominally zero: with a relative size it does not differ."""
    plan = planned(repeated, ("field",), cases=16, design="sobol_indices")
    assert (plan.cases, plan.design) == (16 * 5, "sobol_indices")
    values = plan.input_values(np.arange(80))
    a, b, *mixed = np.split(values, 5, axis=1)
    assert (values[3] == 0.0).all()
    for i, ab in enumerate(mixed):
        expected = a.copy()
        expected[i] = b[i]
        assert_array_equal(ab, expected)
    assert_array_equal(plan.draw_of(np.arange(80)), np.tile(np.arange(16), 5))


def test_sobol_indices_need_independent_quantities_and_a_power_of_two(repeated: Repeated) -> None:
    with pytest.raises(InputError, match=r"dispersions\.pair: its quantities depend on each other"):
        planned(repeated, ("pair",), cases=16, design="sobol_indices")
    with pytest.raises(InputError, match="'sobol_indices' needs a power of two of cases, got 20"):
        planned(repeated, ("field",), cases=20, design="sobol_indices")
    with pytest.raises(InputError, match="nothing differs"):
        planned(
            repeated.changed({"dispersions.field.scale": 0}),
            ("field",),
            cases=16,
            design="sobol_indices",
        )


def test_a_note_for_an_unbalanced_sequence(repeated: Repeated) -> None:
    notes = planned(repeated, design="sobol").notes
    assert ["128 rather than 100" in note for note in notes] == [True]


# --- size -----------------------------------------------------------------------------------------


def test_stages_are_built_once_per_changed_stage(repeated: Repeated) -> None:
    before = Hover.built
    over = {"dispersions.field.scale": (1, 2, 3), "stage.hover.period_s": (60, 120)}
    plan = planned(repeated, swept=grid(over))
    assert len(plan.variants) == 2
    assert Hover.built - before == 3  # as it is, and the two


def test_large_plans_are_made_lazily(repeated: Repeated) -> None:
    swept = grid({"gravity.phobos.gm": tuple(float(i) for i in range(1000))})
    plan = planned(repeated, cases=10_000, swept=swept)
    assert (plan.cases, plan.blocks) == (10_000_000, 156_250)
    batch, _ = plan.block(156_249)
    assert batch.numbers[-1] == 9_999_999
    assert batch.value("gravity.gm", 0.0)[-1] == 999.0


def test_what_is_sent_to_workers_is_small(repeated: Repeated) -> None:
    plan = planned(repeated, cases=10_000)
    plan.block(3)
    assert len(pickle.dumps(plan.block(3))) < 10_000


def test_swept_values_of_no_number_are_counted() -> None:
    swept: Swept = grid({"a.b.c": ([1, 2], [3]), "a.b.d": (True, False)})
    assert swept.numeric == (False, False)
    assert_array_equal(swept.points, [[0, 0, 1, 1], [0, 1, 0, 1]])
    assert swept.named(("", ""))[1] == "a.b.c = [1, 2], a.b.d = False"


def test_the_toys_are_what_they_seem(repeated: Repeated) -> None:
    stage = repeated.build()
    assert isinstance(stage, Hover)
    assert isinstance(stage.spec.gravity.get(), Ball)


@pytest.mark.parametrize(
    "rule",
    [{"failure_half_width": 0.01}, {"mean_half_widths": {"x": 1.0}}, {"failures_above": 0.5}],
)
def test_a_sweep_does_not_end_early(rule: dict[str, Any]) -> None:
    """What its first points show is no estimate of the others."""
    tables = {"repeat": "hover", "stop": rule}
    assert MonteCarloSpec.model_validate({**tables, "cases": 10}).stop is not None
    with pytest.raises(ValidationError, match="stop"):
        SweepSpec.model_validate({**tables, "over": {"stage.hover.samples": [1, 2]}})
