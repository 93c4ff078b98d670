"""What is kept in a cache is run: a cache that others may have written to is not used."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hillsphere.base.private_cache import cache_fault, private_cache, trusted_cache

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps access by itself")

needs_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away"
)
STRANGER = 12345


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    place = tmp_path / "above" / "cache"
    assert cache_fault(place) == ""  # what is missing is made
    (place / "compiled").mkdir(mode=0o700)
    (place / "compiled" / "cache.db").write_bytes(b"SQLite format 3\0")
    (place / "compiled" / "cache.db").chmod(0o644)
    return place


def test_it_is_made_for_this_user_alone(cache: Path) -> None:
    assert cache.stat().st_mode & 0o777 == 0o700
    assert cache.parent.stat().st_mode & 0o777 == 0o700
    assert cache_fault(cache) == ""


@pytest.mark.parametrize("name", [".", "..", "compiled", "compiled/cache.db"])
@pytest.mark.parametrize("mode", [0o020, 0o002])
def test_what_others_may_write_to_is_not_trusted(cache: Path, name: str, mode: int) -> None:
    place = cache / name
    place.chmod(place.stat().st_mode | mode)
    assert "others may write to" in cache_fault(cache)


def test_a_sticky_directory_above_is_trusted_but_not_as_the_cache(cache: Path) -> None:
    """As /tmp: nobody can replace what is ours in it, but anybody can add to it."""
    cache.parent.chmod(0o1777)
    assert cache_fault(cache) == ""
    assert cache_fault(cache.parent) == f"others may write to {cache.parent}"


@needs_root
@pytest.mark.parametrize("name", [".", "..", "compiled", "compiled/cache.db"])
def test_what_belongs_to_another_user_is_not_trusted(cache: Path, name: str) -> None:
    os.chown(cache / name, STRANGER, -1)
    assert "belongs to another user" in cache_fault(cache)


@needs_root
def test_a_name_that_another_user_has_taken_in_a_sticky_directory(tmp_path: Path) -> None:
    tmp_path.chmod(0o1777)
    (tmp_path / "cache").mkdir(mode=0o755)
    os.chown(tmp_path / "cache", STRANGER, -1)
    assert cache_fault(tmp_path / "cache") == f"{tmp_path}/cache belongs to another user"
    (tmp_path / "link").symlink_to("/root")
    os.chown(tmp_path / "link", STRANGER, -1, follow_symlinks=False)
    assert cache_fault(tmp_path / "link") == f"{tmp_path}/link belongs to another user"


def test_links_are_followed_and_what_they_lead_to_is_judged(cache: Path, tmp_path: Path) -> None:
    (tmp_path / "safe").symlink_to("above/cache")
    assert cache_fault(tmp_path / "safe") == ""
    loose = tmp_path / "loose"
    loose.mkdir()
    loose.chmod(0o777)
    cache.rename(loose / "cache")
    cache.symlink_to("../loose/cache")
    assert cache_fault(cache) == f"others may write to {loose}"
    (tmp_path / "circle").symlink_to("circle")
    assert cache_fault(tmp_path / "circle").endswith("is part of a loop of symbolic links")


def test_a_link_within_is_not_trusted(cache: Path) -> None:
    (cache / "compiled" / "cache.db").unlink()
    (cache / "compiled" / "cache.db").symlink_to(cache.parent / "elsewhere.db")
    assert cache_fault(cache).endswith("cache.db is neither a file nor a directory")


def test_a_private_cache_takes_its_place_and_is_said_once(
    cache: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("HILLSPHERE_CACHE", str(cache))
    cache.chmod(0o777)
    with caplog.at_level(logging.WARNING, "hillsphere"):
        place = trusted_cache(cache)
    assert place.stat().st_mode & 0o777 == 0o700
    assert list(place.iterdir()) == []
    assert os.environ["HILLSPHERE_CACHE"] == str(place)  # for the processes that follow
    (line,) = [record.getMessage() for record in caplog.records]
    assert "\n" not in line
    assert line.startswith(f"the cache {cache} is not used")
    assert f"others may write to {cache}" in line
    assert trusted_cache(place) == place


def test_there_may_be_no_place_for_it(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    from hillsphere.errors import InputError

    monkeypatch.setattr("hillsphere.base.private_cache.cache_fault", lambda place: "somebody's")
    with pytest.raises(InputError, match="there is no place for a private cache"):
        private_cache(cache, "somebody's")


PROGRAM = """
import os
from hillsphere.symbolic._heyoka import heyoka
x = heyoka.make_vars("x")
heyoka.cfunc([x + heyoka.sin(x)], vars=[x])
state = heyoka.llvm_state
print(state.get_diskcache_path(), state.get_diskcache_enabled())
"""


@pytest.mark.parametrize("variable", ["HILLSPHERE_CACHE", "HEYOKA_CACHE_DIR"])
def test_the_compile_layer_never_opens_a_database_of_others(
    tmp_path: Path, cache: Path, variable: str
) -> None:
    """A foreign ``cache.db`` was loaded, and its machine code run, whoever it belonged to."""
    directory = cache if variable == "HILLSPHERE_CACHE" else cache / "compiled"
    database = cache / "compiled" / "cache.db"
    database.chmod(0o666)
    before = database.stat()
    kept = {k: v for k, v in os.environ.items() if k not in ("HILLSPHERE_CACHE",
            "HEYOKA_CACHE_DIR")}  # fmt: skip
    kept[variable] = str(directory)
    if variable == "HEYOKA_CACHE_DIR":
        kept["HILLSPHERE_CACHE"] = str(tmp_path / "other")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=kept, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    used, enabled = done.stdout.split()
    assert enabled == "True"
    assert not Path(used).is_relative_to(cache)
    assert not Path(used).exists()  # it lasts as long as the process
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"the cache {directory} is not used")
    after = database.stat()
    assert (after.st_size, after.st_mtime_ns) == (before.st_size, before.st_mtime_ns)
    assert [path.name for path in database.parent.iterdir()] == ["cache.db"]
