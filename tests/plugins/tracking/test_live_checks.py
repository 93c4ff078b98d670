"""Outputs of ``hillsphere track`` that are no files are refused before the pass, and stay."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hillsphere.errors import InputError
from hillsphere_tracking.live.checks import check_writable
from hillsphere_tracking.memory import read_memory, write_memory
from hillsphere_tracking.pointing.pass_log import read_pass_log

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")


@pytest.mark.parametrize("option", ["--log", "--memory"])
def test_a_device_or_fifo_is_refused_and_stays(tmp_path: Path, option: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    for name, what in (("pipe", "FIFO"), ("link", "device"), ("/dev/null", "device")):
        with pytest.raises(InputError) as told:
            check_writable(option, tmp_path / name)
        assert str(told.value) == (
            f"{option}: {tmp_path / name} cannot be written: it is a {what}, not a regular file; "
            "name a file"
        )
    assert (tmp_path / "pipe").is_fifo()
    assert Path("/dev/null").is_char_device()


def test_a_link_is_followed_and_stays(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there/memory.json")
    check_writable("--memory", tmp_path / "link")
    write_memory(tmp_path / "link", {})
    assert (tmp_path / "link").is_symlink()
    assert read_memory(tmp_path / "there" / "memory.json") == {}


def test_a_memory_that_is_a_fifo_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="it is a FIFO"):
        read_memory(tmp_path / "pipe")


def test_a_pass_log_with_an_endless_cell_is_told(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"utc,{'x' * 200_000}\n")
    with pytest.raises(
        InputError, match="not the CSV table of a pass log: field larger than field limit"
    ):
        read_pass_log(path)
