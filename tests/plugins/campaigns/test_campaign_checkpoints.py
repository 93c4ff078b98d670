"""Finished blocks in files: what is kept is whole, and what is not whole is not taken."""

from __future__ import annotations

import errno
import os
import random
import zipfile
from pathlib import Path
from typing import Any

import pytest
from tests.core.cases.toy_cases import StageWork, Toy, ToyPlan, same

from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import SerialSpec
from hillsphere.cases.isolation import compute
from hillsphere.errors import StageError
from hillsphere.products import save_product
from hillsphere_campaigns.engine import run_campaign

PLAN = ToyPlan(500)
STAGE = Toy({9: "raise", 130: "nan", **dict.fromkeys(range(256, 320), "memory")})
BLOCKS = [compute(STAGE, PLAN.block(i)[0], {}) for i in range(PLAN.blocks)]


def kept(directory: Path, notes: list[str] | None = None, fingerprint: str = "f") -> Checkpoints:
    return Checkpoints(directory, fingerprint, (notes if notes is not None else []).append)


def run(
    directory: Path, notes: list[str] | None = None, group_blocks: int = 2, stage: Toy = STAGE
) -> list[Any]:
    return run_campaign(
        PLAN, StageWork([stage]), executor=Serial(SerialSpec()), group_blocks=group_blocks,
        checkpoints=kept(directory, notes),
    )[0]  # fmt: skip


@pytest.fixture(scope="module")
def reference() -> list[Any]:
    return run_campaign(PLAN, StageWork([STAGE]), executor=Serial(SerialSpec()))[0]


def test_what_was_kept_comes_back(tmp_path: Path) -> None:
    directory = tmp_path / "work" / "verify"
    checkpoints = kept(directory)
    assert checkpoints.load() == {}
    checkpoints.save(2, BLOCKS[2:4])
    checkpoints.save(0, BLOCKS[:1])
    found = kept(directory).load()
    assert sorted(found) == [0, 2, 3]
    assert same([found[i] for i in (0, 2, 3)], [BLOCKS[i] for i in (0, 2, 3)])
    assert [found[i].seconds for i in (2, 3)] == [o.seconds for o in BLOCKS[2:4]]
    assert sorted(path.name for path in directory.iterdir()) == [
        "blocks-0000000-0000000.npz",
        "blocks-0000002-0000003.npz",
    ]


def test_files_that_overlap_hold_each_block_once(tmp_path: Path, reference: list[Any]) -> None:
    notes: list[str] = []
    checkpoints = kept(tmp_path, notes)
    checkpoints.load()
    for first, last in ((0, 3), (2, 5), (3, 4), (5, 8), (0, 1)):
        checkpoints.save(first, BLOCKS[first:last])
    assert same(list(dict(sorted(kept(tmp_path).load().items())).values()), reference)
    assert same(run(tmp_path, notes), reference)
    assert notes == []


def test_a_run_goes_on_from_any_of_its_files(tmp_path: Path, reference: list[Any]) -> None:
    """What is left of runs in groups of all sizes, files damaged or half written among them."""
    chance = random.Random(1)
    for trial in range(12):
        directory = tmp_path / str(trial)
        assert same(run(directory, group_blocks=chance.choice([1, 3, 5, 7])), reference)
        damaged = 0
        for path in sorted(directory.iterdir()):
            fate = chance.randrange(4)
            if fate == 0:
                path.unlink()
            elif fate == 1:
                data = bytearray(path.read_bytes())
                data[chance.randrange(len(data))] ^= 0x55
                path.write_bytes(data[: chance.randrange(len(data))] if trial % 2 else data)
                damaged += 1
        (directory / ".blocks-0000001-0000002.npz.0123abcd.part").write_bytes(b"half")
        notes: list[str] = []
        assert same(run(directory, notes, chance.choice([1, 2, 4, 8])), reference)
        # A change in what no reader looks at (a time stamp of the archive) is no damage.
        assert len(notes) <= damaged
        assert not list(directory.glob(".*"))
        assert same(run(directory, stage=Toy(dict.fromkeys(range(500), "raise"))), reference)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.999])
def test_a_torn_file_is_set_aside(tmp_path: Path, share: float, reference: list[Any]) -> None:
    run(tmp_path)
    torn = tmp_path / "blocks-0000002-0000003.npz"
    data = torn.read_bytes()
    torn.write_bytes(data[: int(share * len(data))])
    notes: list[str] = []
    assert sorted(kept(tmp_path, notes).load()) == [0, 1, 4, 5, 6, 7]
    assert torn.with_name(torn.name + ".set-aside").exists()
    assert len(notes) == 1
    assert notes[0].startswith(torn.name)
    assert notes[0].endswith("it was set aside and its blocks are computed again")
    assert same(run(tmp_path), reference)


@pytest.mark.parametrize(
    "error", [OSError(errno.EIO, "Input/output error"), OSError(errno.EMFILE, "x"), MemoryError()]
)
def test_a_file_that_cannot_be_read_just_now_stays(
    tmp_path: Path, error: Exception, monkeypatch: pytest.MonkeyPatch, reference: list[Any]
) -> None:
    run(tmp_path)
    before = sorted(tmp_path.iterdir())

    def failing(self: zipfile.ZipFile, name: Any, pwd: Any = None) -> bytes:
        raise error

    with monkeypatch.context() as patched:
        patched.setattr(zipfile.ZipFile, "read", failing)
        with pytest.raises(StageError, match=r"blocks-0000000-0000001\.npz"):
            kept(tmp_path).load()
    assert sorted(tmp_path.iterdir()) == before
    assert len(kept(tmp_path).load()) == 8
    assert same(run(tmp_path), reference)


def test_files_of_another_campaign_are_set_aside(tmp_path: Path) -> None:
    other = kept(tmp_path, fingerprint="other")
    other.save(0, BLOCKS[:2])
    save_product(tmp_path / "blocks-0000007-0000007.npz", BLOCKS[7])
    notes: list[str] = []
    assert kept(tmp_path, notes).load() == {}
    assert [note.partition(";")[0] for note in notes] == [
        "blocks-0000000-0000001.npz: belongs to a campaign of other inputs",
        "blocks-0000007-0000007.npz: holds a BlockOutcome",
    ]


def test_blocks_beyond_the_plan_are_not_taken(tmp_path: Path) -> None:
    run(tmp_path, group_blocks=8)
    found, _ = run_campaign(
        ToyPlan(100), StageWork([STAGE]), executor=Serial(SerialSpec()), checkpoints=kept(tmp_path)
    )
    assert len(found) == 2


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
def test_a_full_disk_costs_what_was_not_written(
    tmp_path: Path, number: int, monkeypatch: pytest.MonkeyPatch, reference: list[Any]
) -> None:
    calls = 0
    sync = os.fsync

    def failing(descriptor: int) -> None:
        nonlocal calls
        calls += 1
        if calls == 3:
            raise OSError(number, os.strerror(number))
        sync(descriptor)

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", failing)
        with pytest.raises(StageError) as caught:
            run(tmp_path, group_blocks=2)
    assert str(caught.value) == (
        f"{tmp_path / 'blocks-0000004-0000005.npz'} cannot be written: {os.strerror(number)}; the "
        "4 blocks finished before are kept: mend that and resume the run"
    )
    assert sorted(kept(tmp_path).load()) == [0, 1, 2, 3]
    assert len(list(tmp_path.iterdir())) == 2
    assert same(run(tmp_path), reference)


def test_a_place_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StageError, match=r"checkpoints in .*file/work cannot be used: Not a dir"):
        kept(tmp_path / "file" / "work").load()
