"""Repetition of one case of a campaign, with its history and a bit-wise comparison."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hillsphere.base.errors import InputError, StageError
from hillsphere.cases.block_outcome import BlockOutcome, lost_rows
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.specs import PoolSpec
from hillsphere.cases.isolation import only
from hillsphere.cases.plan import Plan
from hillsphere.cases.repeated import RepeatedWork
from hillsphere.cases.stored_blocks import MOST_IN_MEMORY, BlockFiles
from hillsphere.interfaces.cases import CaseBatch, Histories
from hillsphere.interfaces.tasks import Executor, Failed, Finished, Lost, Task
from hillsphere.mission.load import Mission
from hillsphere.plugins.registry import Registry
from hillsphere.products.products import CaseTable
from hillsphere.runs.assembly import Assembly
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.resume_choices import ResumeChoices
from hillsphere.runs.run_record import RunRecord
from hillsphere.runs.wiring import (
    inputs_of,
    product_class,
    repeated_stages,
    stages_to_repeat,
    takes_from,
)
from hillsphere.show.drawing import draw
from hillsphere.show.history import history_chart, history_csv

__all__ = ["Rerun", "campaigns", "one_campaign", "rerun_case"]

PATIENCE = 2.0
"""Factor on a block's time limit for a repetition, since histories take additional time."""


@dataclass(frozen=True)
class Rerun:
    """A repeated case.

    Parameters
    ----------
    campaign, stage : str
        Name of the campaign's stage, and of the stage that it repeats.
    case, draw : int
        Number of the case, and of its random numbers.
    point : str
        Label of the swept point; ``""`` if nothing was swept.
    inputs : mapping
        Name → (value in SI, unit) of the dispersed inputs.
    now : BlockOutcome
        Result of the repetition: one row, with its history.
    then : BlockOutcome or None
        Row of the run; ``None`` if the run ended before the case.
    differences : tuple of str
        Quantities that are not bit-identical.
    files : tuple of Path
        Written files.
    """

    campaign: str
    stage: str
    case: int
    draw: int
    point: str
    inputs: Mapping[str, tuple[float, str]]
    now: BlockOutcome
    then: BlockOutcome | None
    differences: tuple[str, ...]
    files: tuple[Path, ...]

    @property
    def traceback(self) -> str:
        """Traceback of the case's error; ``""`` without one."""
        return self.now.tracebacks[0] if self.now.tracebacks else ""


def rerun_case(
    run: str | Path,
    case: int,
    *,
    stage: str | None = None,
    mission: str | os.PathLike[str] | None = None,
    allow_path: bool = False,
    executor: Executor | None = None,
    figures: bool = False,
    registry: Registry | None = None,
) -> Rerun:
    """Repeat one case of a campaign and write its history to ``cases/`` of the run directory.

    The whole block of the case is computed, on the same 64 lanes, so that results are
    bit-identical.

    Parameters
    ----------
    run : str or Path
        Run directory; its campaign need not be finished.
    case : int
        Number of the case.
    stage : str, optional
        The campaign; needed if the mission has several.
    mission : str or path, optional
        The mission of the run, needed if it is not a packaged one.
    allow_path : bool
        Accept input files outside the directory of the mission and the packaged data.
    executor : Executor, optional
        Executor of the computation; by default a separate process, so that a case that kills its
        process does not end this one.
    figures : bool
        Write the figure of the history as PNG too.
    registry : Registry, optional
        Registry of components; by default of all installed plugins.

    Returns
    -------
    Rerun
        The case in the run and in the repetition.

    Raises
    ------
    InputError
        If a choice must be given that is not taken from the run directory (the message has the
        command line); if there is no such campaign or case, a fact that the results depend on has
        changed, or the run has not ended.
    StageError
        If the stage cannot be built in the worker, or the files cannot be written.
    """
    given = ResumeChoices(mission, allow_path)
    command = ("rerun", "--case", str(case), *(("--stage", stage) if stage else ()))
    EarlierRun.open(run).choices(given, command, needs_executor=False)
    # Checkpoints of a campaign that goes on must not be touched by anybody else.
    with EarlierRun.open(run).directory.locked():
        earlier = EarlierRun.open(run)
        loaded = earlier.mission(registry, earlier.choices(given, command, needs_executor=False))
        record = RunRecord.begun(loaded)
        earlier.refuse_changes(record)
        name = one_campaign(campaigns(loaded), stage, run)
        spec = loaded.specs["stage"][name]
        plan, repeated_stage = _plan(earlier, loaded, name)
        if not 0 <= case < plan.cases:
            raise InputError(
                f"campaign {name!r} has no case {case}: they are 0 to {plan.cases - 1}"
            )
        number = _block_of(plan, case)
        then = _stored_row(earlier, name, record.stages[name].key, plan, number, case)
        limit_s = getattr(spec, "block_limit_s", None)
        limit_s = None if limit_s is None else PATIENCE * limit_s
        now = _compute_case(plan, number, case, executor or Pool(PoolSpec(workers=1)), limit_s)
        cases = np.array([case], dtype=np.int64)
        values = plan.input_values(cases)[:, 0].tolist()
        labels = plan.point_labels
        made = Rerun(
            campaign=name,
            stage=repeated_stage,
            case=case,
            draw=int(plan.draw_of(cases)[0]),
            point=labels[int(plan.point_of(cases)[0])] if labels else "",
            inputs=dict(zip(plan.inputs, zip(values, plan.input_units, strict=True), strict=True)),
            now=now,
            then=then,
            differences=() if then is None else tuple(_differences(then, now)),
            files=(),
        )
        return replace(made, files=_write(earlier, made, figures))


def campaigns(mission: Mission) -> list[str]:
    """Return the names of the stages that repeat another, in order."""
    return [name for name in mission.order() if any(repeated_stages(mission.specs["stage"][name]))]


def one_campaign(names: list[str], wanted: str | None, run: str | Path) -> str:
    """Return the selected campaign, or the only one.

    Raises
    ------
    InputError
        If the run has no campaign, none of the wanted name, or several and no name is given.
    """
    if not names:
        raise InputError(f"run {str(run)!r} has no campaign")
    listed = ", ".join(names)
    if wanted is None and len(names) > 1:
        raise InputError(f"run {str(run)!r} has several campaigns; choose with --stage: {listed}")
    if wanted is not None and wanted not in names:
        raise InputError(f"{wanted!r} is no campaign of run {str(run)!r}; it has {listed}")
    return wanted or names[0]


def _plan(earlier: EarlierRun, mission: Mission, name: str) -> tuple[Plan, str]:
    """Return the plan of a campaign, as the stage itself makes it, and the repeated stage."""
    specs = mission.specs["stage"]
    ((field, other),) = repeated_stages(specs[name])
    own = {ref.name for _, _, ref in specs[name].needs_of()}
    products: dict[str, Any] = {}
    for need in sorted({*own, *takes_from(specs[other])}):
        if not earlier.manifest["stages"].get(need, {}).get("product"):
            raise InputError(
                f"stage {need!r}, whose product is needed, is not finished in this run; resume it"
            )
        products[need] = earlier.product(need, product_class(mission, need))
    repeated = stages_to_repeat(mission, name, products)[field]
    component = Assembly(mission).get("stage", name)
    plan: Plan = component.plan(repeated, **inputs_of(specs[name], products))
    return plan, other


def _block_of(plan: Plan, case: int) -> int:
    """Return the block that holds a case; blocks hold ascending numbers without gaps."""
    low, high = 0, plan.blocks
    while high - low > 1:
        middle = (low + high) // 2
        if plan.block(middle)[0].numbers[0] <= case:
            low = middle
        else:
            high = middle
    return low


def _stored_row(
    earlier: EarlierRun, name: str, key: str | None, plan: Plan, number: int, case: int
) -> BlockOutcome | None:
    """Return the row of a case, from the campaign's table or from its checkpoints."""
    if earlier.manifest["stages"].get(name, {}).get("product"):
        return _row_of_table(earlier.product(name, CaseTable), case)
    place = earlier.directory.path / "work" / name
    if key is None or not place.is_dir():
        return None
    if plan.cases > MOST_IN_MEMORY:
        with suppress(InputError):  # no such file yet
            return _row(BlockFiles(place, key, plan).block(number), case)
    kept = Checkpoints(place, key).load().get(number)
    return None if kept is None else _row(kept, case)


def _row_of_table(table: CaseTable, case: int) -> BlockOutcome | None:
    rows = np.flatnonzero(table.case == case)
    if not len(rows):  # the campaign stopped before
        return None
    told = np.flatnonzero(table.message_case == case)
    return BlockOutcome(
        numbers=table.case[rows],
        metrics=table.metrics,
        units=table.units,
        values=table.values[:, rows],
        status=table.status[rows],
        cause=table.cause[rows],
        failed=table.failed[rows],
        message_case=table.message_case[told],
        messages=tuple(table.messages[i] for i in told),
        step_error=None if table.step_error is None else table.step_error[rows],
    )


def _row(outcome: BlockOutcome, case: int) -> BlockOutcome:
    """Return one case of a block."""
    rows = np.flatnonzero(outcome.numbers == case)
    told = np.flatnonzero(outcome.message_case == case)
    histories = outcome.histories
    if histories is not None:
        histories = _to_the_end(histories.of_cases(rows))
    return BlockOutcome(
        numbers=outcome.numbers[rows],
        metrics=outcome.metrics,
        units=outcome.units,
        values=outcome.values[:, rows],
        status=outcome.status[rows],
        cause=outcome.cause[rows],
        failed=outcome.failed[rows],
        message_case=outcome.message_case[told],
        messages=tuple(outcome.messages[i] for i in told),
        histories=histories,
        tracebacks=tuple(outcome.tracebacks[i] for i in told) if outcome.tracebacks else (),
        seconds=outcome.seconds,
        step_error=None if outcome.step_error is None else outcome.step_error[rows],
    )


def _to_the_end(histories: Histories) -> Histories:
    """Remove the samples after the end of a single case, and append its end as a sample."""
    there = np.flatnonzero(np.isfinite(histories.time_s[:, 0]))
    count = int(there[-1]) + 1 if len(there) else 0
    time, values = histories.time_s[:count], histories.values[:, :count]
    if histories.end_s is not None and histories.end_values is not None:
        ended = np.flatnonzero(np.isfinite(histories.end_s))  # none, or the case
        time = np.concatenate([time, histories.end_s[ended, None]])
        values = np.concatenate([values, histories.end_values[:, ended, None]], axis=1)
    return replace(histories, time_s=time, values=values, end_s=None, end_values=None)


def _compute_case(
    plan: Plan, number: int, case: int, executor: Executor, limit_s: float | None
) -> BlockOutcome:
    """Compute the block of a case; if it loses its worker, the case alone on its lane."""
    batch, variant = plan.block(number)
    lane = np.flatnonzero((batch.numbers == case) & ~batch.filler)
    lost: Lost | None = None
    with executor.crew(RepeatedWork(plan.variants)) as crew:
        for attempt, part in enumerate((batch, only(batch, lane))):
            crew.submit(_task(attempt, part, variant, limit_s))
            match crew.outcome():
                case Finished(value=value):
                    return _row(value[0], case)
                case Lost() as lost:
                    continue
                case Failed(error=error, detail=detail):
                    failure = StageError(error)
                    if detail:
                        failure.add_note(detail)
                    raise failure
    assert lost is not None
    what = "its worker was" if lost.how == "time_limit" else "its worker ended:"
    return lost_rows(batch.numbers[lane], lost.how, "", f"{what} {lost.detail}")


def _task(number: int, batch: CaseBatch, variant: int, limit_s: float | None) -> Task:
    return Task(number, (batch,), variant, history=True, limit_s=limit_s)


def _differences(then: BlockOutcome, now: BlockOutcome) -> list[str]:
    """Return the quantities of two outcomes that are not bit-identical."""
    differences = [
        f"{what}: {a or 'none'} -> {b or 'none'}"
        for what, a, b in [
            ("status", str(then.status[0]), str(now.status[0])),
            ("cause", str(then.cause[0]), str(now.cause[0])),
            ("failed", str(bool(then.failed[0])), str(bool(now.failed[0]))),
        ]
        if a != b
    ]
    values = dict(zip(now.metrics, now.values[:, 0], strict=True))
    for metric, a in zip(then.metrics, then.values[:, 0], strict=True):
        b = values.get(metric, np.float64(np.nan))
        if a.tobytes() != b.tobytes() and not (np.isnan(a) and np.isnan(b)):
            differences.append(f"{metric}: {float(a)!r} -> {float(b)!r}")
    return differences


def _write(earlier: EarlierRun, rerun: Rerun, figures: bool) -> tuple[Path, ...]:
    histories = rerun.now.histories
    if histories is None or not len(histories.time_s):
        return ()
    name = f"{rerun.campaign}-{rerun.case}"
    directory = earlier.directory
    directory.put_product(f"cases/{name}", histories)
    directory.put_text(f"cases/{name}.csv", history_csv(histories))
    title = f"Case {rerun.case} of {rerun.campaign}"
    drawing = draw(history_chart(title, histories), png=figures)
    files = [directory.path / "cases" / f"{name}.{end}" for end in ("csv", "npz")]
    files.append(directory.put_svg(name, drawing.svg, folder="cases"))
    if figures and drawing.png is not None:
        files.append(directory.put_png(name, drawing.png, folder="cases"))
    return tuple(files)
