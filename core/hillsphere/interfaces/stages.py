"""Stages of a mission, and the context in which the pipeline runs them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.interfaces.quantities import Parameter
from hillsphere.show.presentation import Presentation

if TYPE_CHECKING:
    from pathlib import Path

    from hillsphere.interfaces.cases import CaseResults
    from hillsphere.interfaces.tasks import Executor

__all__ = ["CaseStage", "Context", "NeedsCheck", "Stage"]


class Context(Protocol):
    """Services of the pipeline for a running stage: seed, log, progress, executor."""

    @property
    def seed(self) -> int:
        """Root seed of the mission."""
        ...

    def rng(self, stream: str = "") -> np.random.Generator:
        """Return a random generator, seeded by the mission's seed, the stage and the stream."""
        ...

    def info(self, message: str) -> None:
        """Write a line to the run's log."""
        ...

    @property
    def fingerprint(self) -> str:
        """SHA-256 of everything that the stage's result depends on, in hexadecimal digits."""
        ...

    @property
    def executor(self) -> Executor:
        """Executor for blocks of campaigns and for work divided by `hillsphere.runs.workers`."""
        ...

    def workspace(self) -> Path:
        """Return a directory that is kept when the run is interrupted, until the product exists."""
        ...

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        """Show progress; the returned function advances it and raises if the run was stopped.

        `note` returns a text to show behind the bar; it is called whenever the bar is drawn.
        """
        ...


class Stage(Protocol):
    """One step of a mission.

    ``run(ctx, **inputs)`` takes one product per field of its Spec's ``needs`` by keyword and
    returns an instance of its Spec's ``produces``; ``present(product, **inputs)`` shows it.
    Annotate both with the concrete product classes.
    """

    @property
    def run(self) -> Callable[..., Any]:
        """Do the work."""
        ...

    @property
    def present(self) -> Callable[..., Presentation]:
        """Return metrics, tables and figures of the product."""
        ...


@runtime_checkable
class NeedsCheck(Contract, Protocol):
    """A `Stage` with keys that name results of the stages that it needs, such as stations.

    Only keys that depend on needed stages are checked here; a component refuses other invalid keys
    when it is made.
    """

    @property
    def check_needs(self) -> Callable[..., None]:
        """Check keys against the stages that it needs: ``check_needs(**needs)``.

        Called before any stage runs, with the components of the needed stages in place of the
        products that `Stage.run` receives; raises `hillsphere.errors.InputError`. A message that
        begins with a key of the stage (``stations: …``) is shown at that key's line. A component
        may be of any class whose stage yields the needed product.
        """
        ...


@runtime_checkable
class CaseStage(Contract, Protocol):
    """A `Stage` that can be repeated over many cases, by ``monte_carlo`` and ``sweep``.

    Its cases are independent: the result of a case depends only on its inputs, its noise and the
    number of lanes of a block (see `CaseBatch`).

    An optional method ``prepare_cases(names, **inputs)`` is called in each worker before blocks
    whose inputs have these names; compilation there does not count against a block's time limit.

    An optional method ``case_warnings(product)`` receives the product of the stage's own run and
    returns sentences that concern all its cases; every campaign that repeats the stage shows them.
    """

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return the inputs that may differ from case to case, with nominal values, SI.

        An input is named by its path from the stage's Spec: a run-time parameter of the plant that
        the field ``plant`` refers to is ``"plant.gravity.C2,0"``; an input of the stage itself has
        a plain name (``"state.x"``). A nominal value that depends on products of earlier stages is
        NaN.
        """
        ...

    @property
    def run_cases(self) -> Callable[..., CaseResults]:
        """Compute one block: ``run_cases(batch, history=False, **inputs)``.

        `history` is True if all histories are wanted, or a sequence of names and patterns (``*``);
        others may be returned too (see `hillsphere.interfaces.cases.histories_to_keep`).
        `inputs` are the products of the stage's needs, as for `Stage.run`. There is no context:
        the function is pure, may run in another process, and shows no progress.
        """
        ...
