"""A plugin for tests of the command line: stages that fail on demand, commands that misbehave."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import typer

from hillsphere.errors import StageError
from hillsphere.plugins import Component, hookimpl
from hillsphere.presentation import Metric, Presentation
from hillsphere.spec import StageSpec, option, quantity

if TYPE_CHECKING:
    from collections.abc import Callable

    from hillsphere.interfaces import Context


class StepSpec(StageSpec):
    """What the stage does."""

    produces: ClassVar[str] = "faulty_plugin:Done"
    examples = ({},)

    fails: Literal["", "plainly", "strangely"] = option("how it fails", default="")
    lasts_s: float = quantity("time", "how long it takes, or each part", default=0.0, ge=0)
    parts: int = option("parts that workers do", default=0, ge=0)
    shows_s: float = quantity("time", "how long showing it takes", default=0.0, ge=0)


@dataclass(frozen=True)
class Done:
    """That it was done."""

    value: float


@dataclass(frozen=True)
class Resting:
    """Work of which every piece is a rest; tells by which process."""

    def prepare(self) -> Callable[[float], int]:
        """Return the function that rests."""

        def rest(duration_s: float) -> int:
            time.sleep(duration_s)
            return os.getpid()

        return rest


class Step:
    """A stage."""

    def __init__(self, spec: StepSpec) -> None:
        self.spec = spec
        self.info: Callable[[str], object] = str

    def run(self, ctx: Context) -> Done:
        """Do as the Spec says."""
        ctx.info("under way")
        self.info = ctx.info
        if self.spec.parts:
            self._divided(ctx)
        else:
            time.sleep(self.spec.lasts_s)
        if self.spec.fails == "plainly":
            raise StageError("the tank is empty")
        if self.spec.fails == "strangely":
            raise ZeroDivisionError("never mind")
        return Done(1.0 / 3.0)

    def _divided(self, ctx: Context) -> None:
        from hillsphere.runs.workers import Workers

        with Workers(ctx, Resting()) as workers:
            for process in workers.map([self.spec.lasts_s] * self.spec.parts):
                ctx.info(f"process {process}")

    def present(self, product: Done) -> Presentation:
        """Show the number."""
        self.info("to be shown")
        time.sleep(self.spec.shows_s)
        metrics = {"third": Metric(product.value, "m²/s²"), "sound": Metric(True)}
        return Presentation(metrics=metrics, verdict=["All is well."])


greet = typer.Typer(add_completion=False)
explode = typer.Typer(add_completion=False)
leave = typer.Typer(add_completion=False)
wait = typer.Typer(add_completion=False)
not_an_application = "a string"


@greet.command()
def _greet(name: str, loud: bool = False) -> None:
    """Greet someone."""
    typer.echo(f"hello {name}" + "!" * loud)


@explode.command()
def _explode() -> None:
    raise RuntimeError("the fuse\nwas short")


@leave.command()
def _leave() -> None:
    sys.exit(7)


@wait.command()
def _wait() -> None:
    typer.echo("waiting")
    sys.stdout.flush()
    time.sleep(60)


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components."""
    commands = {
        "greet": "greet",
        "explode": "explode",
        "leave": "leave",
        "wait": "wait",
        "stringy": "not_an_application",
        "absent": "nowhere_to_be_found",
        "run": "greet",
    }
    return [
        Component("stage", "step", "faulty_plugin:Step", "faulty_plugin:StepSpec", "a step"),
        *(
            Component("command", name, f"faulty_plugin:{target}", "", f"the command {name}")
            for name, target in commands.items()
        ),
    ]
