"""One block computed so that a case that cannot be computed costs nobody but itself.

A block that raises is divided, always on the same 64 lanes: lanes that are left out repeat a case
that is kept, so that the others keep their lane, the block its width, and every case its bits. What
is alone at last when it raises becomes a row of its own, classified and with a message.
"""

from __future__ import annotations

import traceback
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from hillsphere.base.arrays import Integers
from hillsphere.base.errors import InputError, StageError
from hillsphere.base.matching import match_names
from hillsphere.cases.block_outcome import BlockOutcome, join_outcomes, lost_rows, reorder_cases
from hillsphere.cases.case_classes import is_undecided
from hillsphere.interfaces.cases import CaseBatch, CaseResults, Histories
from hillsphere.interfaces.stages import CaseStage
from hillsphere.products.fields import dimension_sizes
from hillsphere.products.product_codec import canonical

__all__ = ["BlockOutcome", "compute", "only"]

LONGEST_MESSAGE = 400
"""Characters of a message that are kept."""


def compute(
    stage: CaseStage,
    batch: CaseBatch,
    inputs: Mapping[str, Any],
    history: bool = False,
    bands: Sequence[str] = (),
) -> BlockOutcome:
    """Compute a block.

    Parameters
    ----------
    stage : CaseStage
        What is repeated.
    batch : CaseBatch
        The block.
    inputs : mapping
        Products of the stage's needs.
    history : bool
        Whether histories are wanted; messages then come with tracebacks.
    bands : sequence of str
        Names or patterns of quantities whose histories are wanted if `history` does not ask for
        all.

    Returns
    -------
    BlockOutcome
        Outcome of every case that does not only fill the block, whatever the stage raised. A case
        that raises costs at most 2 log₂ 64 further calls of `run_cases`.

    Raises
    ------
    StageError
        If what the stage returns is not what `CaseStage` promises: an error in its code, not in
        one case. If it keeps no history of what `bands` names.
    """
    begin = perf_counter()
    cases = np.flatnonzero(~batch.filler)
    impossible = _impossible_inputs(stage, batch)
    rows: list[BlockOutcome] = [
        lost_rows(batch.numbers[[lane]], "input", name, message, ("",) if history else ())
        for lane, (name, message) in impossible.items()
    ]
    sound = np.array([lane for lane in cases.tolist() if lane not in impossible], dtype=np.int64)
    waiting = [sound] if len(sound) else []
    while waiting:
        lanes = waiting.pop()
        part = batch if len(lanes) == len(cases) else only(batch, lanes)
        try:
            results = stage.run_cases(part, history or tuple(bands), **inputs)
        except Exception as error:
            if len(lanes) > 1:
                middle = (len(lanes) + 1) // 2
                waiting += [lanes[middle:], lanes[:middle]]
            else:
                rows.append(_rows_of_error(batch.numbers[lanes], error, history))
            continue
        _check(stage, results, len(batch.numbers))
        kept = results.histories if history else _of_bands(stage, results.histories, bands)
        rows.append(_rows(results, lanes, batch.numbers[lanes], kept, history))
    outcome = join_outcomes(rows)
    if impossible:
        outcome = reorder_cases(outcome, np.argsort(outcome.numbers, kind="stable"))
    # In the order of memory that a checkpoint gives back, whoever computed it.
    return replace(canonical(outcome), seconds=perf_counter() - begin)


def _impossible_inputs(stage: CaseStage, batch: CaseBatch) -> dict[int, tuple[str, str]]:
    """Return the lanes with an impossible draw (a negative density), with input and reason."""
    found: dict[int, tuple[str, str]] = {}
    for q in stage.case_inputs():
        if q.name not in batch.names:
            continue
        values = batch.values[batch.names.index(q.name)]
        sound = np.isfinite(values) & ((values > 0.0) | (not q.positive))
        for lane in np.flatnonzero(~sound & ~batch.filler).tolist():
            must = "> 0" if q.positive else "finite"
            text = f"{q.name} must be {must}, got {values[lane]:.6g} {q.unit}".rstrip(" -")
            found.setdefault(lane, (q.name, text))
    return found


def only(batch: CaseBatch, lanes: Integers) -> CaseBatch:
    """Return a block in which all lanes but these repeat the first of them, as filler."""
    source = np.full(len(batch.numbers), lanes[0])
    source[lanes] = lanes
    filler = np.ones(len(source), dtype=np.bool_)
    filler[lanes] = False
    return replace(
        batch,
        numbers=batch.numbers[source],
        draws=batch.draws[source],
        filler=filler,
        values=np.ascontiguousarray(batch.values[:, source]),
    )


def _shorten(text: str) -> str:
    """Return a text on one line, of at most `LONGEST_MESSAGE` characters."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_MESSAGE else line[: LONGEST_MESSAGE - 1] + "…"


def _rows_of_error(number: Integers, error: Exception, history: bool) -> BlockOutcome:
    name = type(error).__name__
    kind = "memory" if isinstance(error, MemoryError) else "error"
    if isinstance(error, InputError):
        # What a stage refuses of one case's inputs is an impossible draw, no fault of its code.
        kind = "input"
    try:
        text = str(error)
    except Exception as other:  # an exception that cannot even be told must not cost the others
        text = f"(its text cannot be had: {type(other).__name__})"
    return lost_rows(
        number,
        kind,
        name,
        _shorten(f"{name}: {text}" if text else name),
        ("".join(traceback.format_exception(error)),) if history else (),
    )


def _of_bands(
    stage: CaseStage, histories: Histories | None, bands: Sequence[str]
) -> Histories | None:
    """Return the histories of the quantities of bands alone."""
    if not bands:
        return None
    what = f"{type(stage).__name__}.run_cases"
    if histories is None:
        raise StageError(f"{what} keeps no histories, which bands need; leave bands out")
    try:
        names = match_names(bands, histories.names, "bands: the history of a case")
    except InputError as error:
        raise StageError(str(error)) from error
    return histories.of_quantities([histories.names.index(name) for name in names])


def _rows(
    results: CaseResults,
    lanes: Integers,
    numbers: Integers,
    kept: Histories | None,
    tracebacks: bool,
) -> BlockOutcome:
    """Return the rows of these lanes; a case with metrics that are not finite is undecided."""
    values = np.array(results.values, dtype=np.float64)[:, lanes]
    status = [results.status[i] for i in lanes]
    cause = [results.cause[i] for i in lanes]
    undecided = is_undecided(status)
    failed = np.array(results.failed, dtype=np.bool_)[lanes] & ~undecided
    messages = []
    bad = np.flatnonzero(~failed & ~undecided & ~np.isfinite(values).all(axis=0))
    for j in bad:
        wrong = np.flatnonzero(~np.isfinite(values[:, j]))
        told = ", ".join(f"{results.metrics[i]} = {values[i, j]}" for i in wrong)
        messages.append(_shorten(f"{status[j]}, but not finite: {told}"))
        status[j], cause[j] = "not_finite", results.metrics[wrong[0]]
    values[:, bad] = np.nan
    errors = results.step_error
    return BlockOutcome(
        numbers=numbers,
        metrics=tuple(results.metrics),
        units=tuple(results.units),
        values=values,
        status=np.array(status, dtype=np.str_),
        cause=np.array(cause, dtype=np.str_),
        failed=failed,
        message_case=numbers[bad],
        messages=tuple(messages),
        histories=kept and kept.of_cases(lanes),
        tracebacks=("",) * len(bad) if tracebacks else (),
        step_error=None if errors is None else np.array(errors, dtype=np.float64)[lanes],
    )


def _check(stage: CaseStage, results: Any, lanes: int) -> None:
    """Raise unless results are those of a block of so many lanes."""
    what = f"{type(stage).__name__}.run_cases"
    if not isinstance(results, CaseResults):
        raise StageError(f"{what} must return CaseResults, got a {type(results).__name__}")
    m = len(results.metrics)
    if len(set(results.metrics)) < m or not all(isinstance(n, str) for n in results.metrics):
        raise StageError(f"{what}: metrics must be different names, got {results.metrics!r}")
    try:
        for part in (results, results.histories):
            if isinstance(part, CaseResults | Histories):
                dimension_sizes(part, cases=lanes)
    except InputError as error:
        raise StageError(f"{what} returned arrays of wrong shape: {error}") from error
    if np.asarray(results.values).dtype.kind not in "fiub":
        raise StageError(
            f"{what}: values must be real numbers, got {np.asarray(results.values).dtype}"
        )
    if np.asarray(results.failed).dtype.kind != "b":
        raise StageError(
            f"{what}: failed must be true or false, got {np.asarray(results.failed).dtype}"
        )
