"""A plugin for tests: it forks and lets both processes return, or compiles without end."""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from hillsphere.base.seeds import draws
from hillsphere.cases.specs import MonteCarloSpec
from hillsphere.interfaces import Context, Parameter
from hillsphere.interfaces.cases import CaseBatch, CaseResults
from hillsphere.interfaces.tasks import Job
from hillsphere.plugins import Component, hookimpl
from hillsphere.presentation import Metric, Presentation
from hillsphere.products import CaseTable
from hillsphere.runs.workers import Workers
from hillsphere.spec import StageSpec, option
from hillsphere_campaigns.monte_carlo import MonteCarlo

PIECES = 40

if os.environ.get("UNRULY_PLUGIN") == "import":
    os.fork()


class ForkingSpec(StageSpec):
    """Where it forks."""

    produces: ClassVar[str] = "unruly_plugin:Number"
    examples = ({},)

    where: Literal[
        "nowhere", "construct", "run", "raise", "leave", "thread", "advance", "pieces", "between",
        "present", "case", "inputs", "sound", "stays",
    ] = option("where it forks", default="nowhere")  # fmt: skip


@dataclass(frozen=True)
class Number:
    """A number."""

    value: float


@dataclass(frozen=True)
class Doubling:
    """Work on pieces."""

    forks: bool

    def prepare(self) -> Callable[[int], int]:
        """Return the function that doubles."""

        def double(piece: int) -> int:
            if self.forks:
                os.fork()
            return 2 * piece

        return double


def _negative(number: int) -> int:
    return -number


def _wait() -> None:
    time.sleep(600)


class Forking:
    """Forks where it is told to."""

    def __init__(self, spec: ForkingSpec) -> None:
        self.where = spec.where
        if self.where == "construct":
            os.fork()

    def run(self, ctx: Context) -> Number:
        """Return a number, the same wherever it forks."""
        match self.where:
            case "run":
                os.fork()
            case "raise":
                if os.fork() == 0:
                    raise RuntimeError("raised in the child")
            case "leave":
                if os.fork() == 0:
                    sys.exit(0)
            case "thread":
                thread = threading.Thread(target=os.fork)
                thread.start()
                thread.join()
            case "sound":
                self._sound()
            case "stays":
                # A child of a plugin that lives on, such as one of a pool, must hold no lock.
                multiprocessing.get_context("fork").Process(target=_wait, daemon=True).start()
                sys.stderr.write("child started\n")
                sys.stderr.flush()
                _wait()
        advance = ctx.track("pieces", PIECES)
        for _ in range(PIECES):
            advance(1)
            if self.where == "advance":
                os.fork()
        total = 0
        with Workers(ctx, Doubling(self.where == "pieces")) as workers:
            for number in workers.map(range(PIECES)):
                if self.where == "between":
                    os.fork()
                total += number
        return Number(float(total))

    def _sound(self) -> None:
        """Fork as a plugin may: none of these children comes back."""
        child = os.fork()
        if child == 0:
            os._exit(5)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 5
        with multiprocessing.get_context("fork").Pool(2) as pool:
            assert pool.map(_negative, range(4)) == [0, -1, -2, -3]

    def present(self, product: Number, **needs: Any) -> Presentation:
        """Show it."""
        if self.where == "present":
            os.fork()
        return Presentation(metrics={"number": Metric(product.value)})

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return the height."""
        if self.where == "inputs":
            os.fork()
        return (Parameter("height", 1.0, "m"),)

    def run_cases(self, batch: CaseBatch, history: bool = False, **needs: Any) -> CaseResults:
        """Add noise to a block."""
        if self.where == "case":
            os.fork()
        noise = draws(batch.seed, batch.stream, batch.draws, "noise", (1,))[0]
        values = batch.value("height", 1.0) + noise
        count = len(batch.numbers)
        return CaseResults(
            ("sum",), ("m",), values[None], ("completed",) * count, ("",) * count,
            np.zeros(count, dtype=bool),
        )  # fmt: skip


class CompilingSpec(StageSpec):
    """Where it compiles."""

    produces: ClassVar[str] = "unruly_plugin:Number"
    examples = ({},)

    elsewhere: bool = option("whether it compiles in a worker", default=False)


class Compiling:
    """Compiles something that takes minutes."""

    def __init__(self, spec: CompilingSpec) -> None:
        self.elsewhere = spec.elsewhere

    def run(self, ctx: Context) -> Number:
        """Compile."""
        ctx.info("compiling")
        if self.elsewhere:
            with ctx.executor.crew(_Compiling()) as crew:
                crew.submit(Job(0))
                crew.outcome()
        else:
            _compile_without_end()
        return Number(0.0)

    def present(self, product: Number) -> Presentation:
        """Show nothing."""
        return Presentation()


@dataclass(frozen=True)
class _Compiling:
    """Work that compiles, in a worker if there is one."""

    def prepare(self) -> Callable[[Job], float]:
        """Return a function that does not come to its end."""
        return _compile_for


def _compile_for(job: Job) -> float:
    _compile_without_end()
    return 0.0


def _compile_without_end() -> None:
    """Compile an integrator term by term, not in a loop: the compiler takes minutes."""
    from hillsphere.symbolic._heyoka import heyoka

    x, y, u, v = heyoka.make_vars("x", "y", "u", "v")
    force = sum(heyoka.sin(x * float(i) + y) / (1.0 + x * x + float(i)) for i in range(1, 60))
    heyoka.taylor_adaptive([(x, u), (y, v), (u, force), (v, -force)], [1.0] * 4)


class ManyForksSpec(MonteCarloSpec):
    """A Monte Carlo campaign."""


class ManyForks(MonteCarlo):
    """A campaign whose figures are not drawn."""

    def present(self, product: CaseTable, **needs: Mapping[str, Any]) -> Presentation:
        """Show how many cases there are."""
        return Presentation(metrics={"cases": Metric(len(product.case))})


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components."""
    here = "unruly_plugin"
    return [
        Component("stage", "forking", f"{here}:Forking", f"{here}:ForkingSpec", "forks"),
        Component("stage", "compiling", f"{here}:Compiling", f"{here}:CompilingSpec", "compiles"),
        Component("stage", "many_forks", f"{here}:ManyForks", f"{here}:ManyForksSpec", "many"),
    ]
