"""A toy campaign that a worker process can import, with a stage in which much goes wrong."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hillsphere.cases.block_outcome import BlockOutcome
from hillsphere.cases.isolation import compute
from hillsphere.errors import PropagationError
from hillsphere.interfaces import Array, CaseStage, Parameter
from hillsphere.interfaces.cases import LANES, CaseBatch, CaseResults, Histories
from hillsphere.interfaces.tasks import Task

ROOT = Path(__file__).parents[3]
"""On `sys.path` of the tests that start workers: these import this module by its full name."""


@dataclass(frozen=True)
class ToyPlan:
    """Cases 0 … total − 1 with two inputs; each variant has its own blocks, the last filled up."""

    total: int
    variants: int = 1

    @property
    def cases(self) -> int:
        return self.total * self.variants

    @property
    def per_variant(self) -> int:
        return -(-self.total // LANES)

    @property
    def blocks(self) -> int:
        return self.per_variant * self.variants

    def block(self, number: int) -> tuple[CaseBatch, int]:
        variant, block = divmod(number, self.per_variant)
        lanes = np.arange(block * LANES, (block + 1) * LANES)
        draws = np.minimum(lanes, self.total - 1)
        numbers = draws + variant * self.total
        values = np.stack([np.sin(numbers), 1.5 + np.cos(numbers)])
        filler = lanes >= self.total
        return CaseBatch(numbers, draws, filler, ("a", "b"), values, 7, "toy"), variant


@dataclass(frozen=True)
class Toy:
    """Powers and sines of its inputs; some cases go wrong, in a way of their own."""

    faults: Mapping[int, str] = field(default_factory=dict)
    scratch: str = ""
    rounds: int = 1

    def case_inputs(self) -> tuple[Parameter, ...]:
        return (Parameter("a", 0.0, ""), Parameter("b", 1.5, ""))

    def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
        a, b = batch.value("a", 0.0), batch.value("b", 1.5)
        x = np.zeros(LANES)
        for _ in range(self.rounds):
            x = np.sin(a + x) + np.power(b, 0.3)
        y = np.hypot(x, a)
        status, cause = ["completed"] * LANES, [""] * LANES
        failed = x > 1.75
        for lane in np.flatnonzero(failed):
            status[lane], cause[lane] = "constraint", "x"
        for place, number in enumerate(batch.numbers.tolist()):
            if number in self.faults:
                self._go_wrong(self.faults[number], number, y[place : place + 1])
        histories = None
        if history:
            time = np.tile(np.arange(3.0)[:, None], LANES)
            histories = Histories(time, ("x",), ("m",), (x * time)[None])
        return CaseResults(
            ("x", "y"), ("m", "m/s"), np.stack([x, y]), tuple(status), tuple(cause), failed,
            histories,
        )  # fmt: skip

    def _go_wrong(self, fault: str, number: int, y: Array) -> None:
        match fault:
            case "raise":
                raise ZeroDivisionError(f"case {number}\ncannot be\ncomputed")
            case "propagation":
                raise PropagationError("a step collapsed")
            case "memory":
                raise MemoryError
            case "nan":
                y[0] = np.nan
            case "exit":
                os._exit(3)
            case "leave":
                raise SystemExit(4)
            case "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            case "kill once":
                marker = Path(self.scratch, f"killed-{number}")
                if not marker.exists():
                    marker.touch()
                    os.kill(os.getpid(), signal.SIGKILL)
            case "wait":
                while True:
                    time.sleep(0.01)
            case "loop":
                while True:
                    pass
            case "print":
                print("printed by a stage")  # noqa: T201
                os.write(1, b"written by a stage\n")


@dataclass(frozen=True)
class Misshapen(Toy):
    """A stage whose results do not have the shape of a block."""

    def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
        results = super().run_cases(batch)
        return CaseResults(
            results.metrics, results.units, results.values[:, :3], results.status, results.cause,
            results.failed,
        )  # fmt: skip


@dataclass(frozen=True)
class StageWork:
    """`hillsphere.cases.repeated.RepeatedWork` for stages that no mission has."""

    stages: Sequence[Any]

    def prepare(self) -> Callable[[Task], tuple[BlockOutcome, ...]]:
        stages: list[CaseStage] = [stage() if callable(stage) else stage for stage in self.stages]

        def do(task: Task) -> tuple[BlockOutcome, ...]:
            return tuple(
                compute(stages[task.variant], block, {}, task.history) for block in task.blocks
            )

        return do


@dataclass(frozen=True)
class Unprepared:
    """Work that cannot be prepared."""

    how: Literal["raise", "exit"]

    def prepare(self) -> Callable[[Task], Any]:
        if self.how == "exit":
            os._exit(5)
        raise RuntimeError("there is\nno field")


def same(one: Sequence[BlockOutcome], other: Sequence[BlockOutcome]) -> bool:
    """Whether two campaigns came to the same bits."""
    return len(one) == len(other) and all(
        a.numbers.tobytes() == b.numbers.tobytes()
        and (a.metrics, a.units) == (b.metrics, b.units)
        and a.values.tobytes() == b.values.tobytes()
        and a.values.shape == b.values.shape
        and (a.status.dtype, a.cause.dtype) == (b.status.dtype, b.cause.dtype)
        and a.status.tolist() == b.status.tolist()
        and a.cause.tolist() == b.cause.tolist()
        and a.failed.tolist() == b.failed.tolist()
        and a.message_case.tolist() == b.message_case.tolist()
        and a.messages == b.messages
        for a, b in zip(one, other, strict=True)
    )
