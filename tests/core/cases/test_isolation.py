"""A case that cannot be computed becomes a row, and no other case changes a bit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from tests.core.cases.toy_cases import Toy, ToyPlan, same

from hillsphere.cases.block_outcome import (
    BlockOutcome,
    complete_metrics,
    divide_outcome,
    join_outcomes,
    lost_rows,
)
from hillsphere.cases.isolation import compute, only
from hillsphere.errors import StageError
from hillsphere.interfaces import Parameter
from hillsphere.interfaces.cases import LANES, CaseBatch, CaseResults, Histories
from hillsphere.products import load_product, save_product

FULL, _ = ToyPlan(64).block(0)
PARTLY, _ = ToyPlan(70).block(1)
SOUND = compute(Toy(), FULL, {})


@dataclass(frozen=True)
class Counting(Toy):
    """Keeps the blocks that it was given."""

    def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
        inputs["seen"].append(batch)
        return super().run_cases(batch, history)


def others(outcome: BlockOutcome, *cases: int) -> Any:
    """Every row but some, as bits."""
    kept = ~np.isin(outcome.numbers, cases)
    return [
        outcome.numbers[kept].tolist(),
        outcome.values[:, kept].tobytes(),
        outcome.status[kept].tolist(),
        outcome.cause[kept].tolist(),
        outcome.failed[kept].tolist(),
    ]


def test_rows_are_what_the_stage_returns() -> None:
    direct = Toy().run_cases(FULL)
    assert SOUND.numbers.tolist() == list(range(64))
    assert (SOUND.metrics, SOUND.units) == (("x", "y"), ("m", "m/s"))
    assert SOUND.values.tobytes() == direct.values.tobytes()
    assert tuple(SOUND.status) == direct.status
    assert tuple(SOUND.cause) == direct.cause
    assert_array_equal(SOUND.failed, direct.failed)
    assert 0 < SOUND.failed.sum() < 64
    assert (SOUND.messages, SOUND.histories) == ((), None)
    assert SOUND.seconds > 0


def test_filler_leaves_no_row() -> None:
    outcome = compute(Toy(), PARTLY, {})
    assert outcome.numbers.tolist() == list(range(64, 70))
    assert outcome.values.shape == (2, 6)
    assert outcome.values.tobytes() == Toy().run_cases(PARTLY).values[:, :6].tobytes()


@pytest.mark.parametrize(
    ("fault", "status", "cause", "message"),
    [
        ("raise", "error", "ZeroDivisionError", "ZeroDivisionError: case 9 cannot be computed"),
        ("propagation", "error", "PropagationError", "PropagationError: a step collapsed"),
        ("memory", "memory", "MemoryError", "MemoryError"),
        ("nan", "not_finite", "y", "completed, but not finite: y = nan"),
    ],
)
def test_one_case_goes_wrong(fault: str, status: str, cause: str, message: str) -> None:
    seen: list[CaseBatch] = []
    outcome = compute(Counting({9: fault}), FULL, {"seen": seen})
    assert others(outcome, 9) == others(SOUND, 9)
    assert (outcome.status[9], outcome.cause[9], outcome.failed[9]) == (status, cause, False)
    assert np.isnan(outcome.values[:, 9]).all()
    assert (outcome.message_case.tolist(), outcome.messages) == ([9], (message,))
    assert len(seen) <= 1 + 2 * 6
    assert all(batch.values.shape == (2, LANES) for batch in seen)


def test_cases_keep_their_lanes_while_others_are_left_out() -> None:
    lanes = np.array([5, 6, 40])
    part = only(FULL, lanes)
    assert_array_equal(np.flatnonzero(~part.filler), lanes)
    for own, whole in ((part.numbers, FULL.numbers), (part.draws, FULL.draws)):
        assert_array_equal(own[lanes], whole[lanes])
        assert_array_equal(np.delete(own, lanes), whole[5])
    assert_array_equal(part.values[:, lanes], FULL.values[:, lanes])
    assert_array_equal(np.delete(part.values, lanes, axis=1), np.tile(FULL.values[:, [5]], 61))


@settings(max_examples=30, deadline=None)
@given(st.dictionaries(st.integers(0, 63), st.sampled_from(["raise", "memory", "nan"])))
def test_any_cases_go_wrong(faults: dict[int, str]) -> None:
    outcome = compute(Toy(faults), FULL, {})
    assert outcome.numbers.tolist() == list(range(64))
    expected = {"raise": "error", "memory": "memory", "nan": "not_finite"}
    for number, fault in faults.items():
        # A case that failed by itself may have metrics that are not finite.
        sound = fault == "nan" and SOUND.failed[number]
        assert outcome.status[number] == (SOUND.status[number] if sound else expected[fault])
        # What could not be computed is no failure of what is flown.
        assert outcome.failed[number] == sound
    if set(range(64)) - set(faults):
        assert others(outcome, *faults) == others(SOUND, *faults)


def test_every_case_raises() -> None:
    outcome = compute(Toy(dict.fromkeys(range(64), "raise")), FULL, {})
    assert (outcome.metrics, outcome.units, outcome.values.shape) == ((), (), (0, 64))
    assert outcome.numbers.tolist() == list(range(64))
    assert set(outcome.status) == {"error"}
    assert not outcome.failed.any()
    assert len(outcome.messages) == 64


def test_last_case_of_a_block_that_is_filled_up_with_it() -> None:
    outcome = compute(Toy({69: "raise"}), PARTLY, {})
    assert outcome.status.tolist()[-1] == "error"
    assert others(outcome, 69) == others(compute(Toy(), PARTLY, {}), 69)


def test_values_of_a_failed_case_are_left_as_they_are() -> None:
    number = int(np.flatnonzero(SOUND.failed)[0])
    outcome = compute(Toy({number: "nan"}), FULL, {})
    assert (outcome.status[number], outcome.cause[number]) == ("constraint", "x")
    assert np.isfinite(outcome.values[:, number]).tolist() == [True, False]
    assert outcome.messages == ()


@pytest.mark.parametrize("leaving", [KeyboardInterrupt, SystemExit])
def test_what_ends_a_process_is_no_row(leaving: type[BaseException]) -> None:
    class Leaving(Toy):
        def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
            raise leaving

    with pytest.raises(leaving):
        compute(Leaving(), FULL, {})


def test_messages_are_short_and_on_one_line() -> None:
    class UnspeakableError(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    class Wordy(Toy):
        def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
            if 0 in batch.numbers:
                raise UnspeakableError
            raise ValueError("much\nto say " * 500)

    outcome = compute(Wordy(), FULL, {})
    assert outcome.messages[0] == "UnspeakableError: (its text cannot be had: RuntimeError)"
    assert len(outcome.messages[1]) == 400
    assert outcome.messages[1].startswith("ValueError: much to say much to say ")
    assert outcome.messages[1].endswith("…")


def test_histories_and_tracebacks() -> None:
    class Uneven(Toy):
        """Keeps fewer samples if case 63 is not there."""

        def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
            results = super().run_cases(batch, history)
            kept = results.histories
            assert kept is not None
            if 63 in batch.numbers:
                return results
            return replace(
                results,
                histories=replace(kept, time_s=kept.time_s[:2], values=kept.values[:, :2]),
            )

    outcome = compute(Uneven({9: "raise", 22: "nan"}), FULL, {}, history=True)
    kept = outcome.histories
    assert kept is not None
    assert kept.time_s.shape == (3, 64)
    assert kept.values.shape == (1, 3, 64)
    assert np.isnan(kept.time_s[:, 9]).all()
    assert np.isnan(kept.values[:, :, 9]).all()
    assert np.isnan(kept.time_s[2, 0])
    assert_array_equal(kept.time_s[:, 63], [0.0, 1.0, 2.0])
    assert_array_equal(kept.values[0, 1], np.where(np.arange(64) == 9, np.nan, SOUND.values[0]))
    assert outcome.message_case.tolist() == [9, 22]
    assert "ZeroDivisionError" in outcome.tracebacks[0]
    assert "_go_wrong" in outcome.tracebacks[0]
    assert outcome.tracebacks[1] == ""
    assert compute(Toy({9: "raise"}), FULL, {}).tracebacks == ()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"values": np.zeros((2, 3))}, r"values .* cases = 64, got \(2, 3\)"),
        ({"values": np.zeros((2, 64), dtype=complex)}, "values must be real numbers"),
        ({"units": ("m",)}, r"units .* metrics = 2 by metrics, got \(1,\)"),
        ({"status": ("completed",)}, r"status .* cases = 64, got \(1,\)"),
        ({"cause": ("",) * 63}, r"cause .*got \(63,\)"),
        ({"failed": np.zeros(64)}, "failed must be true or false"),
        ({"metrics": ("x", "x")}, "metrics must be different names"),
        (
            {"histories": Histories(np.zeros((5, 64)), ("x",), ("m",), np.zeros((1, 4, 64)))},
            r"Histories.values .* samples = 5 by time_s, .*got \(1, 4, 64\)",
        ),
    ],
)
def test_results_that_are_none(changes: dict[str, Any], told: str) -> None:
    class Wrong(Toy):
        def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
            return replace(super().run_cases(batch, history), **changes)

    with pytest.raises(StageError, match=f"Wrong.run_cases.*{told}"):
        compute(Wrong(), FULL, {})


def test_no_results_at_all() -> None:
    class Nothing(Toy):
        def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> Any:
            return None

    with pytest.raises(StageError, match="must return CaseResults, got a NoneType"):
        compute(Nothing(), FULL, {})


def test_outcomes_are_stored(tmp_path: Path) -> None:
    outcome = compute(Toy({9: "raise", 22: "nan"}), FULL, {}, history=True)
    save_product(tmp_path / "o.npz", outcome)
    read = load_product(tmp_path / "o.npz")
    assert same([read], [outcome])
    assert read.tracebacks == outcome.tracebacks
    assert read.seconds == outcome.seconds


def test_joined_outcomes_are_divided_again() -> None:
    plan = ToyPlan(150)
    stage = Toy({9: "raise", 68: "nan", 149: "memory"})
    blocks = [compute(stage, plan.block(i)[0], {}) for i in range(3)]
    whole = join_outcomes(blocks)
    assert whole.numbers.tolist() == list(range(150))
    assert whole.message_case.tolist() == [9, 68, 149]
    again = divide_outcome(whole, [64, 64, 22], [o.seconds for o in blocks])
    assert same(again, blocks)
    assert [o.seconds for o in again] == [o.seconds for o in blocks]


def test_cases_without_metrics_get_those_of_the_others() -> None:
    lost = lost_rows(np.arange(64, 66), "killed", "", "its worker ended: signal 9")
    alike = complete_metrics([lost, SOUND])
    assert [o.metrics for o in alike] == [("x", "y")] * 2
    assert np.isnan(alike[0].values).all()
    assert alike[0].values.shape == (2, 2)
    assert complete_metrics([lost, lost]) == [lost, lost]
    other = replace(SOUND, metrics=("x", "z"))
    with pytest.raises(StageError, match=r"x \(m\), z \(m/s\) for cases 0 to 63, but x \(m\), y"):
        complete_metrics([SOUND, other])


class Weighed(Toy):
    """Means nothing without a mass above zero."""

    def case_inputs(self) -> tuple[Parameter, ...]:
        return (Parameter("mass", 1.0, "kg", positive=True),)


def test_a_case_that_means_nothing_is_not_computed() -> None:
    """A quantity that must be positive and was drawn negative costs only its own case."""
    mass = np.ones((1, LANES))
    mass[0, 7] = -2.5
    names = (*FULL.names, "mass")
    batch = replace(FULL, names=names, values=np.concatenate([FULL.values, mass]))
    found = compute(Weighed(), batch, {})
    kept = np.arange(LANES) != 7
    assert_array_equal(found.numbers, FULL.numbers)
    assert_array_equal(found.failed, SOUND.failed & kept)
    assert (found.status[7], found.cause[7]) == ("input", "mass")
    assert "mass must be > 0, got -2.5 kg" in found.messages[0]
    assert_array_equal(found.values[:, kept], SOUND.values[:, kept])
