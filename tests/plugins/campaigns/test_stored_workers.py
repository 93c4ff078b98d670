"""Real processes, of a pool and of dask, write the files of a large campaign: the same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.core.cases.toy_cases import ROOT
from tests.core.uncertainty.toy_mission import toy_repeated
from tests.plugins.campaigns.test_stored_campaign import TABLES, digests

from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import PoolSpec, SerialSpec
from hillsphere.cases.repeated import RepeatedWork
from hillsphere.cases.stored_blocks import LEAST_BLOCKS, BlockFiles, FileReceipt, StoredBlocks
from hillsphere_campaigns.case_plan import plan_of
from hillsphere_campaigns.engine import run_campaign

pytestmark = pytest.mark.slow

FILES = 12


def write(directory: Path, executor: Any, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run a campaign; return how many files workers have written."""
    directory.mkdir(parents=True)
    repeated = toy_repeated(directory.parent, TABLES)
    plan = plan_of(repeated, ("start",), cases=64 * LEAST_BLOCKS * FILES - 5, stream="many")
    files = BlockFiles(directory, "f", plan)
    stored = StoredBlocks(files)
    accepted: list[FileReceipt] = []
    accept = stored.accept

    def count(receipt: FileReceipt) -> bool:
        accepted.append(receipt)
        return accept(receipt)

    monkeypatch.setattr(stored, "accept", count)
    run_campaign(
        plan, RepeatedWork(plan.variants, (), files), executor=executor,
        checkpoints=Checkpoints(directory, "f"), stored=stored,
    )  # fmt: skip
    stored.finish()
    return len(accepted)


def executors() -> dict[str, Any]:
    from hillsphere_dask.dask import Dask
    from hillsphere_dask.specs import DaskSpec

    pools = {f"pool {n}": Pool(PoolSpec(workers=n)) for n in (1, 2, 4)}
    return pools | {"dask": Dask(DaskSpec(workers=2))}


def test_processes_write_the_bytes_of_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    write(tmp_path / "serial" / "work", Serial(SerialSpec()), monkeypatch)
    reference = digests(tmp_path / "serial" / "work")
    assert len(reference) == FILES
    for name, executor in executors().items():
        place = tmp_path / name / "work"
        assert write(place, executor, monkeypatch) >= FILES - 2, name
        assert digests(place) == reference, name
