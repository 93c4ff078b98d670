"""The mutation score: which faults are made, that a seed fixes them, and who survives."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

SOURCE = '''\
"""A module."""

FIRST = 3.0


def weigh(values: list[float], n: int = 1) -> float:
    """Return a mean of what is positive, times 1.5."""
    total = 0.0
    for value in values:
        if value > 0.0 and value < 9.0:
            total += 1.5 * value
    if n < 1:
        raise ValueError(f"n must be at least {n + 1}")
    return total / n - values[0]
'''


@pytest.fixture
def mutants(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("mutants")


def changes(mutants: ModuleType, source: str) -> set[tuple[str, str, str]]:
    return {(m.operator, m.before, m.after) for m in mutants.generate_mutants(source)}


def test_faults_of_every_kind(mutants: ModuleType) -> None:
    found = changes(mutants, SOURCE)
    guard = "if value > 0.0 and value < 9.0:"
    sum_ = "total += 1.5 * value"
    last = "return total / n - values[0]"
    assert {
        ("sign", last, "return total / n + values[0]"),
        ("factor", last, "return total * n - values[0]"),
        ("index", last, "return total / n - values[1]"),
        ("factor", sum_, "total += 3.0 * value"),
        ("assignment", sum_, "total = 1.5 * value"),
        ("assignment", sum_, "total -= 1.5 * value"),
        ("comparison", guard, "if value >= 0.0 and value < 9.0:"),
        ("comparison", guard, "if value > 0.0 and value > 9.0:"),
        ("and/or", guard, "if value > 0.0 or value < 9.0:"),
        ("guard", guard, "if not (value > 0.0 and value < 9.0):"),
        ("guard", "if n < 1:", "if False:"),
    } <= found
    # neither texts, nor annotations, nor what an error says, nor plain numbers at the top
    changed = {before for _, before, _ in found}
    assert not any("raise" in line or '"""' in line or "FIRST" in line for line in changed)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("y = -x", "y = x"),
        ("y = a.T @ b", "y = a @ b"),
        ("y = a.T @ b", "y = (b) @ (a.T)"),
        ("y = solve(a, b)", "y = solve(b, a)"),
        ("y = np.maximum(a, 0.5)", "y = np.minimum(a, 0.5)"),
        ("y = np.maximum(a, 0.5)", "y = np.maximum(a, 1.0)"),
        ("y = a.sum(axis=0)", "y = a.sum(axis=1)"),
        ("y = a[i - 1]", "y = a[i + 1]"),
        ("y = a[i - 1]", "y = a[i - 0]"),
        ("y = p & ~q", "y = p | ~q"),
        ("y = p & ~q", "y = p & q"),
        ("y = np.where(p, a, b)", "y = np.where(p, b, a)"),
        ("y = [a for a in b if a]", "y = [a for a in b if True]"),
        ("y = a if p is None else b", "y = a if p is not None else b"),
        ("y = x ** 2", "y = x ** 1"),
        ("y = x ** 2", "y = x * 2"),
        ("y = µ + 2.0 * é", "y = µ - 2.0 * é"),  # columns are counted in bytes
    ],
)
def test_a_fault(mutants: ModuleType, line: str, expected: str) -> None:
    found = {m.after for m in mutants.generate_mutants(f"def f():\n    {line}\n")}
    assert expected in found


def test_every_mutant_compiles_and_differs(mutants: ModuleType) -> None:
    made = mutants.generate_mutants(SOURCE)
    assert len({m.key for m in made}) == len(made)
    for one in made:
        assert ast.dump(ast.parse(one.source)) != ast.dump(ast.parse(SOURCE))


def test_a_seed_fixes_the_draw_wherever_the_lines_are(mutants: ModuleType) -> None:
    made = mutants.generate_mutants(SOURCE)
    drawn = [m.key for m in mutants.draw_mutants(made, 8, 1)]
    assert len(set(drawn)) == 8
    assert drawn == [m.key for m in mutants.draw_mutants(made[::-1], 8, 1)]
    moved = mutants.generate_mutants("import math\n\n\n" + SOURCE.replace("FIRST", "SECOND"))
    assert drawn == [m.key for m in mutants.draw_mutants(moved, 8, 1)]
    assert drawn != [m.key for m in mutants.draw_mutants(made, 8, 2)]
    assert drawn[:6] == [m.key for m in mutants.draw_mutants(made, 6, 1)]
    # every operator has its turn
    kinds = {m.operator for m in made}
    assert {m.operator for m in mutants.draw_mutants(made, 2 * len(kinds), 1)} == kinds


PLANTED = """\
def add(a: float, b: float) -> float:
    return a + b


def scale(a: float) -> float:
    return 2.0 * a


def grow(a: float) -> float:
    while a < 8.0:
        a += 1.0
    return a
"""
TESTS = """\
from planted import add, grow, scale


def test_add() -> None:
    assert add(1.0, 2.0) == 3.0


def test_scale() -> None:
    assert scale(0.0) == 0.0


def test_grow() -> None:
    assert grow(7.5) == 8.5
"""
TABLE = """\
[target.planted]
source = "planted.py"
tests = ["test_planted.py"]
"""
EQUIVALENT = """
[[equivalent]]
target = "planted"
function = "{function}"
before = "{before}"
after = "{after}"
reason = "it is said to be"
"""


def run(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(BENCHMARKS / "mutation.py"), "--table", str(folder / "t.toml")]
    return subprocess.run(
        [*command, *options], capture_output=True, text=True, timeout=240, check=False,
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(folder), "HOME": str(folder)},
    )  # fmt: skip


@pytest.fixture
def planted(tmp_path: Path) -> Path:
    (tmp_path / "planted.py").write_text(PLANTED)
    (tmp_path / "test_planted.py").write_text(TESTS)
    (tmp_path / "t.toml").write_text(TABLE)
    return tmp_path


def test_a_planted_survivor_is_told_and_an_equivalent_one_is_not(planted: Path) -> None:
    """The test of `scale` sees no factor, a = 8 exactly never comes, an endless loop is ended."""
    stay = {"function": "grow", "before": "while a < 8.0:", "after": "while a <= 8.0:"}
    wrong = {"function": "add", "before": "return a + b", "after": "return a - b"}
    table = TABLE + EQUIVALENT.format(**stay) + EQUIVALENT.format(**wrong)
    (planted / "t.toml").write_text(table)
    done = run(planted, "--count", "5", "--margin", "2", "--verbose")
    assert done.returncode == 1, done.stderr
    said = done.stdout
    told, _, summary = said.partition("planted   ")
    assert "- return 2.0 * a\n    + return 1.0 * a" in summary
    assert "killed (hung): " in told  # a -= 1.0
    assert "1 equivalent" in summary
    assert "listed as equivalent, but killed: planted.py:2 add [sign]" in summary
    assert "a <= 8.0" not in summary
    assert "below 85%" in done.stderr


def test_a_table_that_does_not_fit_is_refused(planted: Path) -> None:
    gone = {"function": "add", "before": "return a * b", "after": "return a / b"}
    (planted / "t.toml").write_text(TABLE + EQUIVALENT.format(**gone))
    done = run(planted)
    assert done.returncode == 2
    assert "not in planted.py any more: add: 'return a * b'" in done.stderr
    (planted / "t.toml").write_text(TABLE.replace("test_planted", "test_nowhere"))
    assert "test_nowhere.py is not a file" in run(planted).stderr
    (planted / "t.toml").write_text(TABLE)
    done = run(planted, "plantde")
    assert (done.returncode, done.stderr) == (
        2, "no target is called 'plantde'; there are planted\n"
    )  # fmt: skip


@pytest.mark.slow
def test_the_committed_table_fits_the_sources() -> None:
    """Every equivalent mutant is still one of its module, and every test file is there."""
    command = [sys.executable, str(BENCHMARKS / "mutation.py"), "--list", "--count", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
