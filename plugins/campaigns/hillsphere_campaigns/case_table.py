"""The outcomes of a campaign's blocks as one table."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np

from hillsphere.cases.block_outcome import BlockOutcome, join_outcomes
from hillsphere.cases.plan import Plan
from hillsphere.cases.stored_blocks import StoredBlocks, texts_of
from hillsphere.products import CaseTable
from hillsphere.products.columns import Columns

__all__ = ["table_of"]


def table_of(plan: Plan, outcomes: Sequence[BlockOutcome], stage: str, stopped: str) -> CaseTable:
    """Merge the outcomes of a campaign; those in files stay there.

    Parameters
    ----------
    plan : Plan
        Which cases there are.
    outcomes : sequence of BlockOutcome
        Of its blocks from the first on, at least one.
    stage : str
        Name of the stage that was repeated.
    stopped : str
        Why not all blocks are there; ``""`` if they are.

    Returns
    -------
    CaseTable
        One row per case.
    """
    inputs: Any  # an array, or columns in files, which are read as one
    values: Any
    if isinstance(outcomes, StoredBlocks):
        rows, inputs, values = _read_rows(plan, outcomes)
    else:
        rows = join_outcomes(outcomes)
        inputs, values = plan.input_values(rows.numbers), rows.values
    return CaseTable(
        stage=stage,
        design=plan.design,
        planned=plan.cases,
        stopped=stopped,
        case=rows.numbers,
        draw=plan.draw_of(rows.numbers),
        point=plan.point_of(rows.numbers),
        inputs=plan.inputs,
        input_units=plan.input_units,
        input_values=inputs,
        metrics=rows.metrics,
        units=rows.units,
        values=values,
        status=np.asarray(rows.status),
        cause=np.asarray(rows.cause),
        failed=rows.failed,
        message_case=rows.message_case,
        messages=rows.messages,
        swept=plan.swept,
        swept_units=plan.swept_units,
        swept_labels=plan.swept_labels,
        points=plan.points,
        point_labels=plan.point_labels,
        ladder=plan.ladder,
        step_error=rows.step_error,
    )


def _read_rows(plan: Plan, outcomes: StoredBlocks) -> tuple[BlockOutcome, Columns, Columns]:
    """Return what the table holds in memory of all cases, and the columns that stay in files."""
    files, facts = outcomes.finish()
    known = next((one for one in facts if one["metrics"]), facts[0])
    metrics = tuple(known["metrics"])
    numbers = files.read("case").astype(np.int64)
    errors = files.rows("step_error", (0,), 0, files.cases)[0]
    rows = BlockOutcome(
        numbers=numbers,
        metrics=metrics,
        units=tuple(known["units"]),
        values=np.empty((0, 0)),
        status=texts_of(files, "status", facts),
        cause=texts_of(files, "cause", facts),
        failed=files.read("failed"),
        message_case=np.array(
            list(chain.from_iterable(one["message_case"] for one in facts)), dtype=np.int64
        ),
        messages=tuple(chain.from_iterable(one["messages"] for one in facts)),
        step_error=errors if any(one["step_error"] for one in facts) else None,
    )
    inputs = Columns(files, "inputs", range(len(plan.inputs)))
    return rows, inputs, Columns(files, "values", range(len(metrics)))
