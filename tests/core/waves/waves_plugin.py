"""A plugin for tests of campaigns on the command line: waves, some of which cannot be computed."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hillsphere.base.seeds import draws
from hillsphere.cases.specs import MonteCarloSpec
from hillsphere.errors import StageError
from hillsphere.interfaces import Array, Context, Parameter
from hillsphere.interfaces.cases import CaseBatch, CaseResults, Histories
from hillsphere.plugins import Component, hookimpl
from hillsphere.presentation import Metric, Presentation
from hillsphere.products import CaseTable
from hillsphere.spec import Ref, Spec, StageSpec, need, option
from hillsphere_campaigns.monte_carlo import MonteCarlo

SAMPLES = 5


class WaveSpec(StageSpec):
    """A wave."""

    produces: ClassVar[str] = "waves_plugin:Wave"
    examples = ({},)

    height: float = option("nominal height", default=1.0)
    steps: int = option("how often it is folded", default=1, ge=1)
    fails: bool = option("whether the nominal case fails", default=False)
    raises_at: int = option("number of a case that raises", default=-1)
    kills_at: int = option("number of a case that kills its process", default=-1)


@dataclass(frozen=True)
class Wave:
    """A number."""

    height: float


class WaveStage:
    """Folds heights."""

    def __init__(self, spec: WaveSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context) -> Wave:
        """Fold the nominal one."""
        if self.spec.fails:
            raise StageError("the tide is out")
        return Wave(float(self._folded(np.full(64, self.spec.height))[0]))

    def present(self, product: Wave) -> Presentation:
        """Show it."""
        return Presentation(metrics={"height": Metric(product.height, "m")})

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return the height."""
        return (Parameter("height", self.spec.height, "m"),)

    def run_cases(self, batch: CaseBatch, history: bool = False) -> CaseResults:
        """Fold a block."""
        if self.spec.raises_at in batch.numbers:
            raise ArithmeticError("the wave\nbroke")
        if self.spec.kills_at in batch.numbers:
            os.kill(os.getpid(), signal.SIGKILL)
        noise = draws(batch.seed, batch.stream, batch.draws, "noise", (1,))[0]
        start = batch.value("height", self.spec.height)
        folded = self._folded(start + 0.1 * noise)
        histories = None
        if history:
            time = np.tile(np.arange(SAMPLES, dtype=float)[:, None], (1, 64))
            share = time / (SAMPLES - 1)
            path = (1.0 - share) * start + share * folded
            histories = Histories(time, ("height", "seen.height"), ("m", "m"), np.stack([path] * 2))
        count = len(batch.numbers)
        return CaseResults(
            ("folded",), ("m",), folded[None], ("completed",) * count, ("",) * count,
            np.zeros(count, dtype=bool), histories,
        )  # fmt: skip

    def _folded(self, x: Array) -> Array:
        for _ in range(self.spec.steps):
            x = np.cos(x) + np.abs(np.sin(3.0 * x)) ** 1.3
        # What no stage may do: depend on something that its key does not know.
        return np.asarray(x + float(os.environ.get("WAVES_TIDE", "0")))


class ManySpec(MonteCarloSpec):
    """A Monte Carlo campaign."""


class Many(MonteCarlo):
    """A Monte Carlo campaign whose figures, which take longer than its cases, are not drawn."""

    def present(self, product: CaseTable, **needs: Any) -> Presentation:
        """Show how many cases there are."""
        return Presentation(metrics={"cases": Metric(len(product.case))})


class EchoNeeds(Spec):
    """What it takes."""

    examples = ({"wave": "wave"},)
    wave: Ref = need("waves_plugin:Wave", "the wave")


class EchoSpec(StageSpec):
    """A stage that cannot be repeated."""

    produces: ClassVar[str] = "waves_plugin:Wave"
    examples = ({"needs": {"wave": "wave"}},)
    needs: EchoNeeds


class Echo:
    """Gives back what it takes."""

    def __init__(self, spec: EchoSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context, wave: Wave) -> Wave:
        """Return it."""
        return wave

    def present(self, product: Wave, wave: Wave) -> Presentation:
        """Show nothing."""
        return Presentation()


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components."""
    return [
        Component("stage", "wave", "waves_plugin:WaveStage", "waves_plugin:WaveSpec", "a wave"),
        Component("stage", "echo", "waves_plugin:Echo", "waves_plugin:EchoSpec", "an echo"),
        Component("stage", "many", "waves_plugin:Many", "waves_plugin:ManySpec", "many waves"),
    ]
