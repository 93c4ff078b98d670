"""The outcomes of a campaign's blocks as one table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.cases.block_outcome import BlockOutcome, join_outcomes
from hillsphere.cases.plan import Plan
from hillsphere.products import CaseTable

__all__ = ["table_of"]


def table_of(plan: Plan, outcomes: Sequence[BlockOutcome], stage: str, stopped: str) -> CaseTable:
    """Merge the outcomes of a campaign.

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
    rows = join_outcomes(outcomes)
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
        input_values=plan.input_values(rows.numbers),
        metrics=rows.metrics,
        units=rows.units,
        values=rows.values,
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
