"""Stages of a mission, and what the pipeline gives them."""

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
    """What the pipeline gives a running stage."""

    @property
    def seed(self) -> int:
        """Root seed of the mission."""
        ...

    def rng(self, stream: str = "") -> np.random.Generator:
        """Return a generator that depends on the mission's seed, the stage and the stream only."""
        ...

    def info(self, message: str) -> None:
        """Write a line to the run's log."""
        ...

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all that the stage's result depends on, in hexadecimal digits."""
        ...

    @property
    def executor(self) -> Executor:
        """Where campaigns, and stages by `hillsphere.runs.workers`, do what they divide."""
        ...

    def workspace(self) -> Path:
        """Return a directory that outlives an interruption, until the product is stored."""
        ...

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        """Show progress; the returned function advances it and raises if the run was stopped.

        `note` says what stands behind the bar; it is called whenever the bar is drawn.
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
    """A `Stage` with keys that name what the stages that it needs make: stations, trackers.

    What its keys make impossible by themselves, or with what they refer to, a component refuses
    when it is made.
    """

    @property
    def check_needs(self) -> Callable[..., None]:
        """Refuse keys that cannot be met: ``check_needs(**needs)``.

        It is called before any stage runs, with the components of those stages where `Stage.run`
        gets their products, and raises `hillsphere.errors.InputError`. A message that begins with a
        key of the stage (``stations: …``) is told at that key's line. The component may be of any
        class whose stage yields the product that is needed.
        """
        ...


@runtime_checkable
class CaseStage(Contract, Protocol):
    """A `Stage` that can be repeated over many cases, by ``monte_carlo`` and ``sweep``.

    Its cases are independent: what comes of one depends on nothing but its inputs, its noise and
    its lane's width (see `CaseBatch`).

    It may have a method ``prepare_cases(names, **inputs)``, called in each worker before the blocks
    with inputs of these names: what it compiles there does not count against a block's time limit.
    It may have a method ``case_warnings(product)``, given what its own run yielded, which returns
    sentences that warn of all its cases: they stand in every campaign that repeats it.
    """

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return what may differ from case to case, with nominal values, SI.

        Each is named by its path from the stage's own Spec: a run-time parameter of the plant that
        the field ``plant`` refers to is ``"plant.gravity.C2,0"``; what belongs to the stage itself
        has a plain name (``"state.x"``). A nominal value that only the products of earlier stages
        fix is NaN.
        """
        ...

    @property
    def run_cases(self) -> Callable[..., CaseResults]:
        """Compute one block: ``run_cases(batch, history=False, **inputs)``.

        `history` is True where all histories are wanted, or names and patterns (``*``) of those
        that are; others may be kept as well (see `hillsphere.interfaces.cases.histories_to_keep`).
        `inputs` are the products of the stage's needs, as for `Stage.run`. No context is given:
        the call is pure, may run in another process, and shows no progress.
        """
        ...
