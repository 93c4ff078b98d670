"""Campaigns as Parquet: read back by pyarrow to the last bit, with units and provenance."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from tests.plugins.campaigns.test_campaign_export import campaign, sweep

from hillsphere.cases.case_classes import decided_failures
from hillsphere.errors import InputError
from hillsphere.plugins.registry import default_registry
from hillsphere.products import CaseTable
from hillsphere_campaigns import parquet
from hillsphere_campaigns.export import export_cases, export_parquet

pq = pytest.importorskip("pyarrow.parquet")


@pytest.mark.parametrize("table", [campaign(5000), sweep(), campaign(0), campaign(3, 0, 0)])
def test_round_trip(table: CaseTable, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    export_parquet(table, path, {"mission_name": "höver"})
    file = pq.ParquetFile(path)
    assert file.num_row_groups == -(-table.case.size // 4096)
    read = file.read()
    about = read.schema.metadata
    assert about[b"hillsphere.mission_name"].decode() == "höver"
    assert about[b"hillsphere.stopped"].decode() == table.stopped
    assert int(about[b"hillsphere.planned"]) == table.planned
    assert_array_equal(read["case"].to_numpy(), table.case)
    assert_array_equal(read["draw"].to_numpy(), table.draw)
    assert read["status"].to_pylist() == table.status.tolist()
    assert read["cause"].to_pylist() == table.cause.tolist()
    assert_array_equal(read["failed"].to_numpy(), decided_failures(table))
    names = (table.metrics, table.units, np.asarray(table.values))
    for name, unit, values in zip(*names, strict=True):
        assert (read.schema.field(name).metadata or {}).get(b"unit", b"-").decode() == unit
        back = read[name].to_numpy()
        assert_array_equal(back.view(np.int64)[~np.isnan(values)],
                           values.view(np.int64)[~np.isnan(values)])  # fmt: skip
        assert_array_equal(np.isnan(back), np.isnan(values))
    said = dict(zip(table.message_case.tolist(), table.messages, strict=True))
    assert read["message"].to_pylist() == [said.get(n, "") for n in table.case.tolist()]


def test_memory_does_not_grow_with_the_cases(tmp_path: Path) -> None:
    def peak(n: int) -> int:
        table = campaign(n)
        tracemalloc.start()
        export_parquet(table, tmp_path / "a.parquet", {})
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(10)
    assert peak(40_000) < 1.5 * peak(10_000)


def test_without_pyarrow_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parquet, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs pyarrow.*pip install 'hillsphere\[parquet\]'"):
        export_cases(tmp_path, stage=None, format_="parquet", out=None, registry=default_registry())
