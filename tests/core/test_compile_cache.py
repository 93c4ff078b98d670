"""Compiled functions kept on the disk: same bits, never a wrong one, never a stranger's."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere.base.cached_files import drop_oldest
from hillsphere.dynamics import StepMap, system
from hillsphere.interfaces import Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, compile_cache, norm, sin, variables
from hillsphere.symbolic._heyoka import heyoka
from hillsphere.symbolic.compile_cache import kept_function

X, Y = variables("x", "y")
EQUATIONS = (X, Y, Y, -1.0 * sin(X))
OPTIONS: dict[str, Any] = {"compact": False}


class Kepler:
    """A point mass at the origin."""

    frame = "inertial"
    states = (*(Variable(n, 1) for n in "xyz"), *(Variable(f"v{n}", 1, -1) for n in "xyz"))
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", 1.0),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        pull = -1.0 * p["gm"] * norm(x[:3]) ** -3.0
        return (*x[3:], *(pull * c for c in x[:3]))

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> dict[str, Expr]:
        return {}


@pytest.fixture
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep entries in a directory of the test's own, however fast they were compiled."""
    place = tmp_path / "functions"
    monkeypatch.setattr(compile_cache, "_directory", lambda: place)
    monkeypatch.setattr(compile_cache, "WORTH_S", 0.0)
    return place


class Maker:
    """Compiles the sum of x and a number, and counts how often."""

    def __init__(self, number: float = 1.0) -> None:
        self.made, self.number = 0, number

    def __call__(self) -> Any:
        self.made += 1
        return heyoka.cfunc([X + self.number], vars=[X])


def value(function: Any) -> float:
    return float(function(np.array([[2.0]]))[0, 0])


def entry(directory: Path) -> Path:
    (path,) = directory.iterdir()
    return path


def test_a_function_is_compiled_once(directory: Path) -> None:
    make = Maker()
    assert value(kept_function(OPTIONS, EQUATIONS, make)) == 3.0
    assert value(kept_function(OPTIONS, EQUATIONS, make)) == 3.0
    assert make.made == 1


@pytest.mark.parametrize(
    ("options", "equations"),
    [
        ({"compact": True}, EQUATIONS),
        ({"compact": False, "states": 2}, EQUATIONS),
        (OPTIONS, EQUATIONS[:3]),
        (OPTIONS, (Y, X, *EQUATIONS[2:])),
        # one unit in the last place, in which a printed number need not differ
        (OPTIONS, (*EQUATIONS[:3], -np.nextafter(1.0, 2.0) * sin(X))),
    ],
)
def test_another_function_is_another_entry(
    directory: Path, options: dict[str, Any], equations: tuple[Expr, ...]
) -> None:
    first, other = Maker(1.0), Maker(5.0)
    kept_function(OPTIONS, EQUATIONS, first)
    assert value(kept_function(options, equations, other)) == 7.0
    assert other.made == 1


def test_another_compiler_or_source_is_another_entry(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept_function(OPTIONS, EQUATIONS, Maker())
    monkeypatch.setattr(compile_cache, "_maker", lambda: "another")
    make = Maker()
    kept_function(OPTIONS, EQUATIONS, make)
    assert make.made == 1
    assert len(list(directory.iterdir())) == 2


def test_long_expressions_differ_by_their_last_term(directory: Path) -> None:
    long = X
    for i in range(2000):
        long = sin(long + (i + 2.0) * Y)
    kept_function(OPTIONS, [long + 1.0 * Y], Maker())
    make = Maker()
    kept_function(OPTIONS, [long + 3.0 * Y], make)
    assert make.made == 1


@pytest.mark.parametrize("damage", ["flipped", "cut", "empty", "foreign"])
def test_a_damaged_entry_is_made_again(directory: Path, damage: str) -> None:
    kept_function(OPTIONS, EQUATIONS, Maker())
    path = entry(directory)
    content = bytearray(path.read_bytes())
    if damage == "flipped":
        content[len(content) // 2] ^= 1
    elif damage == "foreign":
        content = bytearray(pickle.dumps("what another program keeps"))
    path.write_bytes(content[: {"cut": len(content) // 2, "empty": 0}.get(damage, len(content))])
    make = Maker()
    assert value(kept_function(OPTIONS, EQUATIONS, make)) == 3.0
    assert make.made == 1
    assert value(kept_function(OPTIONS, EQUATIONS, make)) == 3.0
    assert make.made == 1


def test_a_renamed_entry_is_not_taken_for_another_function(directory: Path) -> None:
    kept_function(OPTIONS, EQUATIONS, Maker(1.0))
    one = entry(directory)
    kept_function({"compact": True}, EQUATIONS, Maker(5.0))
    (other,) = set(directory.iterdir()) - {one}
    os.replace(other, one)
    make = Maker(1.0)
    assert value(kept_function(OPTIONS, EQUATIONS, make)) == 3.0
    assert make.made == 1


def test_what_others_may_write_to_is_not_unpickled(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = os.umask(0)
    try:
        kept_function(OPTIONS, EQUATIONS, Maker())
    finally:
        os.umask(before)
    path = entry(directory)
    assert path.stat().st_mode & 0o777 == 0o600
    assert directory.stat().st_mode & 0o777 == 0o700

    def refuse(content: bytes) -> None:
        raise AssertionError("it was unpickled")

    path.chmod(0o620)
    with monkeypatch.context() as patch:
        patch.setattr(pickle, "loads", refuse)
        make = Maker()
        kept_function(OPTIONS, EQUATIONS, make)
        assert make.made == 1  # and it has taken the place of the entry
    assert path.stat().st_mode & 0o777 == 0o600

    stranger = os.geteuid() + 1
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: stranger)
        patch.setattr(pickle, "loads", refuse)
        kept_function(OPTIONS, EQUATIONS, make)
    assert make.made == 2


def test_it_is_off_where_the_compile_layer_keeps_nothing(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    was = heyoka.llvm_state.get_diskcache_enabled()
    heyoka.llvm_state.set_diskcache_enabled(False)
    try:
        kept_function(OPTIONS, EQUATIONS, Maker())
    finally:
        heyoka.llvm_state.set_diskcache_enabled(was)
    assert not directory.exists()


def test_a_place_that_cannot_be_written_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(compile_cache, "_directory", lambda: tmp_path / "file" / "functions")
    monkeypatch.setattr(compile_cache, "WORTH_S", 0.0)
    assert value(kept_function(OPTIONS, EQUATIONS, Maker())) == 3.0


def test_what_compiles_at_once_is_not_kept(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compile_cache, "WORTH_S", 1e3)
    kept_function(OPTIONS, EQUATIONS, Maker())
    assert not directory.exists()


def test_the_least_recently_used_go_first(directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept_function({"n": 0}, EQUATIONS, Maker())
    size = entry(directory).stat().st_size
    kept_function({"n": 1}, EQUATIONS, Maker())
    for age, path in enumerate(sorted(directory.iterdir(), key=lambda p: p.stat().st_mtime_ns)):
        os.utime(path, (1e9 + age, 1e9 + age))
    make = Maker()
    kept_function({"n": 0}, EQUATIONS, make)  # used: now the youngest
    monkeypatch.setattr(compile_cache, "MAX_BYTES", int(2.5 * size))
    kept_function({"n": 2}, EQUATIONS, Maker())
    assert len(list(directory.iterdir())) == 2
    kept_function({"n": 0}, EQUATIONS, make)
    assert make.made == 0
    kept_function({"n": 1}, EQUATIONS, make)
    assert make.made == 1


def test_files_of_other_kinds_are_left_alone(tmp_path: Path) -> None:
    for name in ("a.function", "b.txt"):
        (tmp_path / name).write_bytes(bytes(10))
    drop_oldest(tmp_path, (".function",), 0)
    assert [path.name for path in tmp_path.iterdir()] == ["b.txt"]


@pytest.mark.parametrize("stm", [False, True])
def test_a_kept_step_is_the_same_bits(
    directory: Path, stm: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    fresh = StepMap(system(Kepler(), normalised=True), method="rk6", stm=stm)
    with monkeypatch.context() as patch:

        def again(*args: object, **keys: object) -> None:
            raise AssertionError("it was compiled again")

        compile_cache._maker()
        patch.setattr(heyoka, "cfunc", again)
        kept = StepMap(system(Kepler(), normalised=True), method="rk6", stm=stm)
    x = np.random.default_rng(1).uniform(0.8, 1.2, (6, 13))
    h = np.linspace(1e-3, 1e-2, 13)
    assert np.array_equal(np.asarray(fresh.step(x, h)[0]), np.asarray(kept.step(x, h)[0]))
    if stm:
        assert np.array_equal(fresh.step(x, h)[1], kept.step(x, h)[1])
    assert kept.stepper.rows == fresh.stepper.rows == (42 if stm else 6)
    assert kept.stepper.needs_time == fresh.stepper.needs_time


def test_formulas_parameters_and_derivatives_have_entries_of_their_own(directory: Path) -> None:
    nominal, at_run_time = (system(Kepler(), run_time=names) for names in ((), ("gm",)))
    StepMap(nominal, method="rk6")
    StepMap(nominal, method="dop853")
    StepMap(nominal, method="rk6", stm=True)
    StepMap(nominal, method="rk6", compact=True)
    StepMap(at_run_time, method="rk6")
    StepMap(at_run_time, method="rk6", stm=True)
    StepMap(at_run_time, method="rk6", stm=True, parameters=("gm",))
    assert len(list(directory.iterdir())) == 7


PROCESS = """
import sys
from pathlib import Path
from hillsphere.symbolic import compile_cache
from hillsphere.symbolic._heyoka import heyoka
from hillsphere.symbolic import sin, variables
compile_cache._directory = lambda: Path(sys.argv[1])
compile_cache.WORTH_S = 0.0
x, y = variables("x", "y")
def make():
    print("made")
    return heyoka.cfunc([x + 1.0], vars=[x])
compile_cache.kept_function({"compact": False}, (x, y, y, -1.0 * sin(x)), make)
"""


def test_other_processes_find_it(directory: Path) -> None:
    kept_function(OPTIONS, EQUATIONS, Maker())
    command = [sys.executable, "-c", PROCESS, str(directory)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout == ""


def test_several_processes_may_keep_the_same_at_once(directory: Path) -> None:
    command = [sys.executable, "-c", PROCESS, str(directory)]
    all_at_once = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(3)]
    assert [process.wait(120) for process in all_at_once] == [0, 0, 0]
    for process in all_at_once:
        if process.stdout is not None:
            process.stdout.close()
    make = Maker()
    assert value(kept_function(OPTIONS, EQUATIONS, make)) == 3.0
    assert make.made == 0
    entry(directory)
