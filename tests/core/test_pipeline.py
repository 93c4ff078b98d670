"""Missions of small stages, defined here, run from end to end."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import numpy as np
import pytest

from hillsphere.errors import InputError, Interrupted, PluginError, StageError
from hillsphere.interfaces import Array, Context
from hillsphere.mission import Mission, load_mission
from hillsphere.plugins import Component, Registry, hookimpl
from hillsphere.presentation import Column, Figure, Metric, Presentation, Printed, Table
from hillsphere.products import load_product
from hillsphere.runs.pipeline import RunResult, run_mission
from hillsphere.runs.stage_cache import StageCache, StageKeys, plain_spec
from hillsphere.spec import DataPath, Ref, Spec, StageSpec, data_path, need, option, reference

HERE = __name__


@dataclass(frozen=True)
class Numbers:
    values: Array


@dataclass(frozen=True)
class OtherNumbers(Numbers):
    name: str = "derived"


@dataclass(frozen=True)
class Word:
    text: str


class OffsetSpec(Spec):
    """A component that a stage refers to."""

    value: float = option("added to every number", default=0.0)
    table: DataPath | None = data_path("numbers to add", default=None)


class Offset:
    def __init__(self, spec: OffsetSpec) -> None:
        if spec.value < -100:
            raise InputError("value: must be ≥ -100 in this world; raise it")
        self.value = spec.value
        if spec.table is not None:
            self.value += sum(map(float, Path(spec.table).read_text().split()))


class MakeSpec(StageSpec):
    """Makes numbers."""

    produces = f"{HERE}:Numbers"
    count: int = option("how many", default=3, ge=1)
    offset: Ref | None = reference("gravity", "added", default=None)
    act: str = option("what to do besides", default="")


class Make:
    """Makes numbers; `act` names something in ACTS to do while running or presenting."""

    ran: ClassVar[list[int]] = []

    def __init__(self, spec: MakeSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context) -> Any:
        self.ran.append(self.spec.count)
        if self.spec.act in ACTS:
            changed = ACTS[self.spec.act](ctx)
            if changed is not None:
                return changed
        offset = self.spec.offset.get().value if self.spec.offset else 0.0
        return Numbers(ctx.rng("noise").normal(size=self.spec.count) + offset)

    def present(self, product: Numbers) -> Any:
        if self.spec.act in SHOWS:
            return SHOWS[self.spec.act]
        return shown(product.values)


def shown(values: Array) -> Presentation:
    def draw(figure: Any) -> None:
        axes = figure.add_subplot()
        axes.plot(values)
        axes.set_xlabel("index [-]")

    return Presentation(
        metrics={"mean": Metric(float(values.mean()), "m"), "nothing": Metric(np.float64("nan"))},
        tables={
            "rows": Table(
                "Numbers",
                [Column("i", "-"), Column("v_m", "m"), Column("v_m_paper", "m")],
                [{"i": i, "v_m": v, "v_m_paper": Printed("0.10")} for i, v in enumerate(values)],
            )
        },
        figures={"line": Figure("Line", draw)},
        verdict=["Numbers <were> made."],
    )


class DoubleNeeds(Spec):
    """What Double takes."""

    numbers: Ref = need(f"{HERE}:Numbers", "to be doubled")
    more: Ref | None = need(f"{HERE}:Numbers", "to be added", default=None)


class DoubleSpec(StageSpec):
    """Doubles."""

    produces = f"{HERE}:Numbers"
    needs: DoubleNeeds


class Double:
    def __init__(self, spec: DoubleSpec) -> None:
        del spec

    def run(self, ctx: Context, numbers: Numbers, more: Numbers | None) -> Numbers:
        return Numbers(2 * numbers.values + (more.values if more else 0.0))

    def present(self, product: Numbers, numbers: Numbers, more: Numbers | None) -> Presentation:
        factor = float(product.values[0] / numbers.values[0])
        return replace(shown(product.values), metrics={"factor": Metric(factor)})


class WordNeeds(Spec):
    """What Speak takes."""

    word: Ref = need(f"{HERE}:Word", "to be said")


class SpeakSpec(StageSpec):
    """Needs what nobody here yields, or declares no product."""

    needs: WordNeeds


def raising(error: BaseException) -> Callable[[Context], NoReturn]:
    def act(ctx: Context) -> NoReturn:
        ctx.info("about to fail")
        raise error

    return act


def stop_from_a_thread(ctx: Context) -> None:
    """Work in a thread that learns of the signal through `advance`."""
    told: list[bool] = []

    def work() -> None:
        advance = ctx.track("work", 10)
        stopping.wait(10)
        try:
            advance(1)
        except Interrupted:
            told.append(True)

    stopping = threading.Event()
    worker = threading.Thread(target=work)
    worker.start()
    try:
        signal.raise_signal(signal.SIGTERM)
    finally:
        stopping.set()
        worker.join()
        assert told == [True]


def advance(ctx: Context) -> None:
    step = ctx.track("counting [bold]", 3)
    for _ in range(3):
        step(1)


ACTS: dict[str, Callable[[Context], Any]] = {
    "fail": raising(ValueError("the sky\nfell")),
    "fail plainly": raising(StageError("no orbit at x0_km = 1; ask for more")),
    "leave": raising(SystemExit(3)),
    "interrupt": raising(KeyboardInterrupt()),
    "thread": stop_from_a_thread,
    "wrong": lambda ctx: Word("wrong"),
    "derived": lambda ctx: OtherNumbers(np.ones(2)),
    "unstorable": lambda ctx: Numbers([1.0]),  # type: ignore[arg-type]
    "advance": advance,
}


def cannot_draw(figure: Any) -> None:
    raise ZeroDivisionError("nothing to draw")


SHOWS: dict[str, Any] = {
    "show nothing": None,
    "show badly": Presentation(
        tables={"T x": Table("T", [Column("a")], [{"a": 1, "b": 2}, {"a": []}])}  # type: ignore[dict-item]
    ),
    "draw badly": Presentation(figures={"bad": Figure("Bad", cannot_draw)}),
}


class Plugin:
    @hookimpl
    def hillsphere_components(self) -> Iterator[Component]:
        yield Component("gravity", "offset", f"{HERE}:Offset", f"{HERE}:OffsetSpec", "")
        for name in ("Make", "Double"):
            path = f"{HERE}:{name}"
            yield Component("stage", name.lower(), path, path + "Spec", "")
        yield Component("stage", "speak", f"{HERE}:Double", f"{HERE}:SpeakSpec", "")


HEAD = 'format = 1\nname = "small"\ntitle = "A <small> mission"\nseed = 5\n'
CHAIN = """
[stage.twice]
type = "double"
needs = { numbers = "first", more = "alone" }
[stage.first]
type = "make"
offset = "one"
[stage.alone]
type = "make"
[gravity.one]
type = "offset"
value = 1.0
"""
PLAIN = re.sub('type = "(make|double)"', r"\g<0>\nfigures = false", CHAIN)
"""The same without figures, which take longer to draw than all else."""


@pytest.fixture(autouse=True)
def _own_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    Make.ran.clear()


def mission(text: str = CHAIN, **options: Any) -> Mission:
    registry = Registry()
    registry.add_plugin("small", Plugin(), "hillsphere-small 1.0")
    assert registry.broken == {}
    Path("small.toml").write_text(HEAD + text, encoding="utf-8")
    return load_mission("./small.toml", registry=registry, **options)


def files(result: RunResult) -> set[str]:
    root = result.directory
    return {p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()}


def read(result: RunResult, name: str) -> Any:
    return json.loads((result.directory / name).read_text(encoding="utf-8"))


def test_a_chain_runs_in_order_and_leaves_everything(tmp_path: Path) -> None:
    result = run_mission(mission(), out="out")
    assert result.ok
    assert result.state == "success"
    assert result.failures == ()
    first, alone = result.product("first"), result.product("alone")
    np.testing.assert_array_equal(result.product("twice").values, 2 * first.values + alone.values)
    assert files(result) == {
        "manifest.json", "summary.json", "report.html", "log.txt", "resume.json",
        "first.npz", "alone.npz", "twice.npz",
        *(f"tables/rows{end}.csv" for end in ("", "_alone", "_twice")),
        *(f"figures/line{end}.svg" for end in ("", "_alone", "_twice")),
    }  # fmt: skip
    loaded = load_product(result.directory / "twice.npz")
    np.testing.assert_array_equal(loaded.values, result.product("twice").values)

    summary = read(result, "summary.json")
    assert list(summary) == [
        "schema", "mission", "verdict", "requirements", "claims", "metrics", "tables", "failures",
    ]  # fmt: skip
    assert summary["verdict"] == {
        "state": "success",
        "text": "every stage finished; the mission states no requirement",
        "notes": ["Numbers <were> made."],
    }
    assert summary["metrics"]["nothing"] == {"value": None, "unit": "-"}
    assert summary["metrics"]["mean"] == {"value": first.values.mean(), "unit": "m"}
    rows = summary["tables"]["rows"]
    assert rows["columns"][1] == {"name": "v_m", "unit": "m", "label": "", "digits": 8}
    assert rows["rows"][2] == {"i": 2, "v_m": first.values[2], "v_m_paper": 0.1}

    csv = (result.directory / "tables/rows.csv").read_text().splitlines()
    assert csv[:2] == ["i,v_m,v_m_paper", f"0,{float(first.values[0])!r},0.10"]


def test_figures_that_are_not_wanted_are_not_drawn() -> None:
    text = '[stage.first]\ntype = "make"\nact = "draw badly"\nfigures = {}\n'
    assert [f.stage for f in run_mission(mission(text.format("true"))).failures] == ["first"]
    result = run_mission(mission(text.format("false")), out="out")
    assert result.ok
    assert "first.npz" in files(result)
    assert not [name for name in files(result) if name.startswith("figures/")]


def test_png_is_drawn_only_where_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def unwanted(*_: object) -> NoReturn:
        raise AssertionError("nobody has asked for a PNG")

    monkeypatch.setattr("hillsphere.show.drawing._save_png", unwanted)
    text = '[stage.alone]\ntype = "make"\n'
    assert run_mission(mission(text), out="plain").ok
    assert not run_mission(mission(text), out="asked", figures=True).ok


def test_the_png_of_a_large_figure_is_in_the_report_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hillsphere.show.drawing.MAX_SVG_BYTES", 10)
    result = run_mission(mission('[stage.alone]\ntype = "make"\n'), out="out")
    assert result.ok
    assert {name for name in files(result) if "figures/" in name} == {"figures/line.svg"}
    assert "data:image/png;base64," in (result.directory / "report.html").read_text("utf-8")


def test_manifest_says_what_was_run_and_nothing_of_the_host(tmp_path: Path) -> None:
    Path("table.txt").write_text("1 2\n")
    text = CHAIN + 'table = "table.txt"\n'
    result = run_mission(
        mission(text, sets=["stage.first.count=4", "stage.alone.count=4"]), out="out"
    )
    manifest = read(result, "manifest.json")
    assert manifest["state"] == "finished"
    assert manifest["seed"] == 5
    assert manifest["started_utc"] <= manifest["finished_utc"]
    assert manifest["mission"]["stage"]["first"]["count"] == 4
    assert manifest["mission"]["gravity"]["one"] == {
        "type": "offset", "value": 1.0, "table": "table.txt",
    }  # fmt: skip
    assert manifest["inputs"] == {
        "gravity.one.table": {"file": "table.txt", "sha256": sha256(b"1 2\n").hexdigest()}
    }
    command = "hillsphere run small.toml --set stage.first.count=4 --set stage.alone.count=4"
    assert manifest["command"] == command
    assert manifest["versions"]["plugins"] == {"small": "hillsphere-small 1.0"}
    assert manifest["versions"]["packages"]["numpy"] == np.__version__
    assert manifest["platform"]["cpu_features"]
    stage = manifest["stages"]["twice"]
    assert (stage["type"], stage["state"], stage["cached"]) == ("double", "done", False)
    assert len(stage["key"]) == 64
    assert str(tmp_path) not in (result.directory / "manifest.json").read_text()


def test_run_directories_have_names_of_their_own() -> None:
    one, two = (run_mission(mission(PLAIN), use_cache=False) for _ in range(2))
    assert one.directory != two.directory
    assert one.directory.parent == Path("runs")
    mission_name, stamp, token = one.directory.name.split("-")
    assert mission_name == "small"
    assert len(stamp) == len("20260102T030405Z")
    assert len(bytes.fromhex(token)) == 4


@pytest.mark.parametrize("what", ["full", "file", "dangling"])
def test_output_directory_is_refused_before_any_work(what: str) -> None:
    if what == "full":
        Path("out").mkdir()
        Path("out/old.txt").touch()
    elif what == "file":
        Path("out").touch()
    else:
        Path("out").symlink_to("nowhere")
    with pytest.raises(InputError, match=r"^output directory 'out' is"):
        run_mission(mission(), out="out")
    assert Make.ran == []


@pytest.mark.parametrize("out", ["small.toml/out", "nul\0"])
def test_output_directory_that_cannot_be_made(out: str) -> None:
    with pytest.raises(InputError, match=r"run directory .* cannot be used.*--out"):
        run_mission(mission(), out=out)
    assert Make.ran == []


def test_empty_directory_is_accepted() -> None:
    Path("out").mkdir()
    assert run_mission(mission(PLAIN), out=Path("out")).directory == Path("out")


def test_random_numbers_depend_on_seed_stage_and_stream_only() -> None:
    product = run_mission(mission(PLAIN), out="a", use_cache=False).product("alone").values
    again = run_mission(mission(PLAIN.replace("value = 1.0", "")), out="b").product("alone").values
    np.testing.assert_array_equal(product, again)
    # first differs from alone by its offset only if both drew the same numbers
    first = run_mission(mission(PLAIN), out="c").product("first").values
    assert not np.allclose(first - 1.0, product)
    other = run_mission(mission(PLAIN, sets=["seed=6"]), out="d").product("alone").values
    assert not np.allclose(other, product)


def test_failure_takes_only_what_needs_it() -> None:
    result = run_mission(mission(sets=["stage.first.act=fail"]), out="out")
    assert not result.ok
    assert result.state == "failed"
    assert [(f.stage, f.state, f.error, f.message) for f in result.failures] == [
        ("first", "failed", "ValueError", "ValueError: the sky fell"),
        ("twice", "not run", "", "it needs first"),
    ]
    assert set(result.products) == {"alone"}
    with pytest.raises(StageError, match=r"stage 'first' failed: ValueError: the sky fell"):
        result.product("first")
    with pytest.raises(StageError, match=r"stage 'twice' was not run: it needs first"):
        result.product("twice")
    with pytest.raises(InputError, match="no stage 'second'"):
        result.product("second")
    summary = read(result, "summary.json")
    assert summary["verdict"]["state"] == "failed"
    assert [f["stage"] for f in summary["failures"]] == ["first", "twice"]
    assert read(result, "manifest.json")["state"] == "failed"
    log = (result.directory / "log.txt").read_text()
    assert "about to fail" in log
    assert "Traceback (most recent call last)" in log
    assert "Traceback" not in (result.directory / "report.html").read_text()


@pytest.mark.parametrize(
    ("act", "error", "message"),
    [
        ("fail plainly", "StageError", "no orbit at x0_km = 1; ask for more"),
        ("leave", "SystemExit", "SystemExit: 3"),
        ("wrong", "StageError", "must yield a Numbers, but yielded a Word"),
        ("unstorable", "InputError", "values: a list cannot be stored"),
        ("show nothing", "StageError", "must return a Presentation, got a NoneType"),
        ("show badly", "StageError", "'T x': an identifier is"),
        ("show badly", "StageError", "no column is called ['b']"),
        ("show badly", "StageError", "a is a list"),
        ("draw badly", "StageError", "figure 'bad' cannot be drawn: ZeroDivisionError: nothing"),
    ],
)
def test_every_way_to_fail_is_told(act: str, error: str, message: str) -> None:
    text = f'[stage.one]\ntype = "make"\nact = "{act}"\n'
    (failure,) = run_mission(mission(text), out="out").failures
    assert failure.error == error
    assert message in failure.message


def test_product_stands_when_only_its_presentation_failed() -> None:
    result = run_mission(mission(sets=["stage.first.act=draw badly"]), out="out")
    assert [f.stage for f in result.failures] == ["first"]
    assert set(result.products) == {"first", "alone", "twice"}


def test_a_derived_product_serves_where_its_base_is_needed() -> None:
    text = CHAIN.replace('needs = { numbers = "first", more = "alone" }',
                         'needs = { numbers = "first" }')  # fmt: skip
    result = run_mission(mission(text, sets=["stage.first.act=derived"]), out="out")
    np.testing.assert_array_equal(result.product("twice").values, [2.0, 2.0])


def test_types_are_checked_before_anything_runs() -> None:
    loaded = mission()
    # As a mission made in Python could be: the file loader refuses it by itself.
    wrong = SpeakSpec.model_validate({"needs": {"word": "first"}})
    specs = {**loaded.specs, "stage": {**loaded.specs["stage"], "twice": wrong}}
    with pytest.raises(PluginError, match="declares no product"):
        run_mission(replace(loaded, specs=specs), out="out")

    class Speaks(SpeakSpec):
        """Yields something, but needs what it cannot get."""

        produces = f"{HERE}:Word"

    specs["stage"]["twice"] = Speaks.model_validate({"needs": {"word": "first"}})  # type: ignore[index]
    with pytest.raises(
        InputError, match=r"stage\.twice\.needs\.word: needs a Word, but stage 'first' yields a Num"
    ):
        run_mission(replace(loaded, specs=specs), out="out")
    for path, message in [(f"{HERE}:Nothing", "cannot be imported"), ("os:path", "not a class")]:
        Speaks.produces = path
        with pytest.raises(PluginError, match=message):
            run_mission(replace(loaded, specs=specs), out="out")
    assert Make.ran == []
    assert not Path("out").exists()


def test_components_are_made_before_anything_runs() -> None:
    with pytest.raises(InputError, match=r"gravity\.one\.value: must be"):
        run_mission(mission(sets=["gravity.one.value=-101"]), out="out")
    assert Make.ran == []
    assert not Path("out").exists()


@pytest.mark.parametrize("act", ["interrupt", "thread"])
def test_interruption_keeps_what_is_finished(act: str) -> None:
    before = [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)]
    text = CHAIN.replace("[stage.twice]", '[stage.zero]\ntype = "make"\n[stage.twice]')
    with pytest.raises(Interrupted, match=r"finished stages: zero, first; results .* in out"):
        run_mission(mission(text, sets=[f"stage.alone.act={act}"]), out="out")
    assert [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)] == before
    manifest = json.loads(Path("out/manifest.json").read_text())
    assert manifest["state"] == "interrupted"
    assert {name: s["state"] for name, s in manifest["stages"].items()} == {
        "zero": "done", "first": "done", "alone": "interrupted", "twice": "not run",
    }  # fmt: skip
    assert json.loads(Path("out/summary.json").read_text())["verdict"]["state"] == "interrupted"
    assert load_product("out/first.npz").values.shape == (3,)
    assert Path("out/report.html").exists()
    assert not Path("out/alone.npz").exists()


def test_a_run_in_a_thread_leaves_signals_alone() -> None:
    results = []
    loaded = mission()
    thread = threading.Thread(target=lambda: results.append(run_mission(loaded, out="out")))
    thread.start()
    thread.join()
    assert results[0].ok


def test_full_disk_fails_the_stage_and_tears_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    true_replace = os.replace

    def full(source: Any, target: Any) -> None:
        if str(target).endswith("first.npz"):
            raise OSError(errno.ENOSPC, "No space left on device")
        true_replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    result = run_mission(mission(PLAIN), out="out", use_cache=False)
    assert result.failures[0].message.startswith(
        "first.npz cannot be written to 'out': No space left on device; free space"
    )
    assert set(result.products) == {"alone"}
    assert not [name for name in files(result) if "first" in name]


def test_disk_that_stays_full_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StageError, match=r"resume\.json cannot be written.*No space left"):
        run_mission(mission(), out="out")
    assert [p.name for p in Path("out").iterdir()] == ["log.txt"]


# --- cache


def cached(result: RunResult) -> dict[str, bool]:
    return {name: s["cached"] for name, s in read(result, "manifest.json")["stages"].items()}


def test_unchanged_stages_come_from_the_cache_and_are_equal() -> None:
    one = run_mission(mission(), out="a")
    two = run_mission(mission(), out="b")
    assert cached(one) == dict.fromkeys(("first", "alone", "twice"), False)
    assert cached(two) == dict.fromkeys(("first", "alone", "twice"), True)
    assert len(Make.ran) == 2
    for name in ("first.npz", "tables/rows.csv", "summary.json", "figures/line.svg"):
        assert (one.directory / name).read_bytes() == (two.directory / name).read_bytes(), name


def test_no_cache_neither_reads_nor_writes(tmp_path: Path) -> None:
    run_mission(mission(PLAIN), out="a", use_cache=False)
    assert not (tmp_path / "cache" / "stages").exists()
    run_mission(mission(PLAIN), out="b")
    entries = {p: p.stat().st_mtime_ns for p in (tmp_path / "cache" / "stages").iterdir()}
    result = run_mission(mission(PLAIN), out="c", use_cache=False)
    assert not any(cached(result).values())
    assert {p: p.stat().st_mtime_ns for p in entries} == entries


def keys(text: str = CHAIN, **options: Any) -> dict[str, str | None]:
    loaded = mission(text, **options)
    made = StageKeys(loaded)
    return {name: made.of(name) for name in loaded.order()}


def test_a_key_depends_on_all_that_the_result_depends_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = keys()
    assert keys() == base
    assert len(set(base.values())) == 3

    def changed(new: dict[str, str | None]) -> set[str]:
        return {name for name in base if new[name] != base[name]}

    assert changed(keys(sets=["stage.first.count=9"])) == {"first", "twice"}
    assert changed(keys(sets=["stage.alone.count=9"])) == {"alone", "twice"}
    assert changed(keys(sets=["gravity.one.value=1.5"])) == {"first", "twice"}
    assert changed(keys(sets=["seed=6"])) == set(base)
    assert changed(keys(sets=["title=Other"])) == set()
    Path("table.txt").write_text("1")
    with_file = keys(CHAIN + 'table = "table.txt"\n')
    assert changed(with_file) == {"first", "twice"}
    Path("table.txt").write_text("2")
    assert keys(CHAIN + 'table = "table.txt"\n')["first"] != with_file["first"]
    monkeypatch.setattr("hillsphere.runs.stage_cache.environment", lambda: {"packages": "others"})
    assert changed(keys()) == set(base)


def test_a_key_depends_on_the_source_of_the_plugin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "small_plugin"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "helper.py").write_text("X = 1\n")
    (package / "offset.py").write_text(
        "class Offset:\n    value = 1.0\n    def __init__(self, spec): pass\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))

    def key() -> str | None:
        loaded = mission()
        record = loaded.components["gravity"]["one"]
        other = replace(
            record, component=replace(record.component, target="small_plugin.offset:Offset")
        )
        parts = {**loaded.components, "gravity": {"one": other}}
        return StageKeys(replace(loaded, components=parts)).of("first")

    base = key()
    assert base is not None
    assert key() == base
    (package / "__pycache__").mkdir(exist_ok=True)
    (package / "__pycache__" / "x.pyc").write_bytes(b"1")
    assert key() == base
    (package / "helper.py").write_text("X = 2\n")
    assert key() not in (base, None)


def test_code_that_is_in_no_file_is_not_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(sys.modules[HERE], "__file__")
    assert keys() == dict.fromkeys(("first", "alone", "twice"))
    result = run_mission(mission(PLAIN), out="out")
    assert result.ok
    assert not any(cached(result).values())


@pytest.mark.parametrize("damage", ["torn", "foreign"])
def test_damaged_entry_is_computed_again(tmp_path: Path, damage: str) -> None:
    one = run_mission(mission(PLAIN), out="a")
    key = read(one, "manifest.json")["stages"]["first"]["key"]
    entry = tmp_path / "cache" / "stages" / f"{key}.npz"
    whole = entry.read_bytes()
    if damage == "torn":
        entry.write_bytes(whole[: len(whole) // 2])
    else:
        from hillsphere.products import save_product

        save_product(entry, Word("not numbers"))
    two = run_mission(mission(PLAIN), out="b")
    assert cached(two) == {"first": False, "alone": True, "twice": True}
    assert "damaged and computed again" in (two.directory / "log.txt").read_text()
    assert entry.read_bytes() == whole


def test_cache_that_cannot_be_written_is_no_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "not-a-directory").touch()
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "not-a-directory"))
    result = run_mission(mission(PLAIN), out="out")
    assert result.ok
    assert "could not be kept in the cache" in (result.directory / "log.txt").read_text()


def test_cache_drops_what_was_not_used_for_longest(tmp_path: Path) -> None:
    cache = StageCache(tmp_path / "c", max_bytes=3500)
    for age, key in [(300, "old"), (200, "used"), (100, "new")]:
        cache.save(key, Numbers(np.zeros(100)))
        moment = os.stat(tmp_path).st_mtime - age
        os.utime(tmp_path / "c" / f"{key}.npz", (moment, moment))
    (tmp_path / "c" / "other.txt").write_text("kept")
    assert cache.load("used", Numbers) is not None
    assert cache.load("old2", Numbers) is None
    cache.save("newest", Numbers(np.zeros(100)))
    left = {p.stem for p in (tmp_path / "c").iterdir()}
    assert "old" not in left
    assert {"used", "newest", "other"} <= left


def test_plain_spec_holds_references_and_digests(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_bytes(b"abc")
    spec = OffsetSpec(value=2.0, table=str(tmp_path / "t.txt"))
    assert plain_spec(spec) == {
        "value": 2.0,
        # FIPS 180-4, example of SHA-256 of "abc"
        "table": {
            "file": "t.txt",
            "sha256": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        },
    }
    made = MakeSpec.model_validate({"offset": "one"})
    assert plain_spec(made) == {"figures": True, "count": 3, "offset": "one", "act": ""}
    with pytest.raises(InputError, match=r"none\.txt: cannot be read"):
        plain_spec(OffsetSpec(table="none.txt"))


def test_a_killed_run_leaves_no_torn_file(tmp_path: Path) -> None:
    """SIGKILL while a large product is written: the directory holds no file of that name."""
    code = (
        "import os, signal, numpy as np\n"
        "from hillsphere.base import atomic\n"
        "from hillsphere.products import Bifurcations\n"
        "from pathlib import Path\n"
        "with atomic.replacing(Path('big.npz')) as stream:\n"
        "    stream.write(b'0' * 1000); stream.flush(); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False)
    assert done.returncode == -signal.SIGKILL
    assert not (tmp_path / "big.npz").exists()
    assert len(list(tmp_path.glob(".big.npz.*.part"))) == 1
