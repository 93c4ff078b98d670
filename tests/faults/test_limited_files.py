"""Runs whose files may not grow beyond a limit of the system: nothing that was kept is lost."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.faults.command_lines import CommandLines, digests

from hillsphere.products.product_codec import load_product

HOVER = Path(__file__).parent / "missions/hover.toml"
RUN = ("run", HOVER, "--no-cache", "--quiet", "--workers", 0, "--out")


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CommandLines]:
    with CommandLines(tmp_path_factory.mktemp("limited")) as commands:
        yield commands


@pytest.fixture(scope="module")
def undisturbed(commands: CommandLines) -> dict[str, str]:
    done = commands(*RUN, "whole", draws=False)
    assert done.code == 0, done.text
    return digests(commands.directory / "whole")


def limit_files(commands: CommandLines, undisturbed: dict[str, str], runs: int) -> Counter[int]:
    """Let files grow to a random size only, any file of the run; return how the runs ended."""
    chance = random.Random(20262)
    largest = max(p.stat().st_size for p in (commands.directory / "whole").iterdir())
    ends: Counter[int] = Counter()
    for number in range(runs):
        out = f"run-{number}"
        # As many small limits, at which the first file fails, as large ones.
        limit = int(largest ** chance.uniform(0.3, 1.0))
        done = commands(*RUN, out, files=limit, draws=False)
        assert done.code in (0, 1, 2), done.text
        # Where what it writes to is a file, its end may be missing.
        assert "Traceback" not in done.text
        assert done.lost == []
        ends[done.code] += 1
        place = commands.directory / out
        for path in place.rglob("*.npz"):
            load_product(path)
        assert not list(place.rglob("*.part"))
        if (place / "manifest.json").is_file():
            again = commands(
                "resume", out, "--mission", HOVER, "--quiet", "--workers", 0, draws=False
            )
            assert again.code == 0, again.text
            assert digests(place) == undisturbed
        else:
            assert not list(place.rglob("*.npz"))
    return ends


def test_files_that_may_not_grow(commands: CommandLines, undisturbed: dict[str, str]) -> None:
    ends = limit_files(commands, undisturbed, 2)
    assert ends[1] >= 1


@pytest.mark.slow
def test_files_that_may_not_grow_many_times(
    commands: CommandLines, undisturbed: dict[str, str]
) -> None:
    ends = limit_files(commands, undisturbed, 40)
    assert ends[1] >= 20
