"""Runs that ended early and are taken up again; and those that must not be."""

from __future__ import annotations

import errno
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import hillsphere.base.environment
from hillsphere.base.regular_files import open_regular
from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import SerialSpec
from hillsphere.errors import InputError, Interrupted, StageError, UnknownComponentError
from hillsphere.interfaces import Array, Context
from hillsphere.mission import Mission, load_mission
from hillsphere.plugins import Component, Registry, hookimpl
from hillsphere.presentation import Metric, Presentation
from hillsphere.products.product_codec import save_product
from hillsphere.runs.pipeline import RunResult, resume_run, run_mission
from hillsphere.runs.run_differences import differences
from hillsphere.runs.store import RunDirectory
from hillsphere.spec import DataPath, Ref, Spec, StageSpec, data_path, need, option

HERE = __name__
SMALL = "./small.toml"


@dataclass(frozen=True)
class Numbers:
    values: Array


class MakeNeeds(Spec):
    """What Make takes."""

    numbers: Ref | None = need(f"{HERE}:Numbers", "to be added", default=None)


class MakeSpec(StageSpec):
    """Makes numbers."""

    produces = f"{HERE}:Numbers"
    needs: MakeNeeds = option("what is added", default=MakeNeeds())
    count: int = option("how many", default=3, ge=1)
    list_: tuple[float, ...] = option("more of them", default=())
    table: DataPath | None = data_path("numbers to add", default=None)


class Make:
    """Makes numbers; what `acts` holds for this many is done while running, `shows` presenting."""

    ran: ClassVar[list[int]] = []
    acts: ClassVar[dict[int, Callable[[Context], None]]] = {}
    shows: ClassVar[dict[int, Callable[[], None]]] = {}

    def __init__(self, spec: MakeSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context, numbers: Numbers | None) -> Numbers:
        self.ran.append(self.spec.count)
        if act := self.acts.get(self.spec.count):
            act(ctx)
        drawn = ctx.rng().normal(size=self.spec.count)
        return Numbers(drawn + (numbers.values.sum() if numbers else 0.0))

    def present(self, product: Numbers, numbers: Numbers | None) -> Presentation:
        if show := self.shows.get(self.spec.count):
            show()
        return Presentation(metrics={"sum": Metric(float(product.values.sum()), "m")})


class Plugin:
    @hookimpl
    def hillsphere_components(self) -> Iterator[Component]:
        yield Component("stage", "make", f"{HERE}:Make", f"{HERE}:MakeSpec", "")


HEAD = 'format = 1\nname = "small"\ntitle = "Small"\nseed = 5\n'
CHAIN = """
[stage.one]
type = "make"
count = 1
table = "table.txt"
[stage.two]
type = "make"
count = 2
needs = { numbers = "one" }
[stage.three]
type = "make"
count = 3
list_ = [1, 2]
needs = { numbers = "two" }
"""


@pytest.fixture(autouse=True)
def _own_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    Path("table.txt").write_text("1 2\n")
    yield
    Make.ran.clear()
    Make.acts.clear()
    Make.shows.clear()


@pytest.fixture
def registry() -> Registry:
    from hillsphere.plugins import builtin as components

    made = Registry()
    made.add_plugin("hillsphere", components, "hillsphere 0")
    made.add_plugin("small", Plugin(), "hillsphere-small 1.0")
    assert made.broken == {}
    return made


def mission(registry: Registry, text: str = CHAIN, head: str = HEAD, **options: Any) -> Mission:
    Path("small.toml").write_text(head + text, encoding="utf-8")
    return load_mission("./small.toml", registry=registry, **options)


def interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


def fail(*_: Any) -> None:
    raise StageError("the disk is full")


def interrupted(registry: Registry, out: str = "out", **options: Any) -> None:
    """Leave a run whose second of three stages was interrupted."""
    Make.acts[2] = interrupt
    loaded = mission(registry, **options)
    with pytest.raises(Interrupted):
        run_mission(loaded, out=out, use_cache=False)
    Make.acts.clear()
    Make.ran.clear()


def manifest(run: str = "out") -> Any:
    return json.loads(Path(run, "manifest.json").read_text("utf-8"))


def states(run: str = "out") -> dict[str, str]:
    return {name: stage["state"] for name, stage in manifest(run)["stages"].items()}


def same(one: RunResult, two: RunResult) -> None:
    assert one.state == two.state
    assert set(one.products) == set(two.products)
    for name, product in one.products.items():
        np.testing.assert_array_equal(product.values, two.products[name].values)
        paths = [result.directory / f"{name}.npz" for result in (one, two)]
        assert paths[0].read_bytes() == paths[1].read_bytes()
    summaries = [(result.directory / "summary.json").read_bytes() for result in (one, two)]
    assert summaries[0] == summaries[1]


def test_an_interrupted_run_goes_on_where_it_was(registry: Registry) -> None:
    interrupted(registry)
    assert states() == {"one": "done", "two": "interrupted", "three": "not run"}
    resumed = resume_run("out", mission=SMALL, registry=registry)
    assert Make.ran == [2, 3]
    assert resumed.ok
    assert states() == dict.fromkeys(("one", "two", "three"), "done")
    found = manifest()
    assert found["state"] == "finished"
    assert len(found["resumed_utc"]) == 1
    assert found["started_utc"] <= found["resumed_utc"][0] <= found["finished_utc"]
    assert "one: taken from the earlier part of this run" in Path("out/log.txt").read_text()
    same(resumed, run_mission(mission(registry), out="whole", use_cache=False))


def test_what_an_interruption_says(registry: Registry) -> None:
    Make.acts[2] = interrupt
    loaded = mission(registry)
    with pytest.raises(Interrupted) as told:
        run_mission(loaded, out="a run", use_cache=False)
    assert str(told.value) == (
        "interrupted; finished stages: one; results so far are in a run; continue with: "
        f"hillsphere resume 'a run' --mission {loaded.path}"
    )
    summary = json.loads(Path("a run/summary.json").read_text())
    assert [(f["stage"], f["state"]) for f in summary["failures"]] == [
        ("two", "interrupted"), ("three", "not run"),
    ]  # fmt: skip


def test_interrupted_again_and_again(registry: Registry) -> None:
    interrupted(registry)
    for act in (2, 3, 3):
        Make.acts = {act: interrupt}
        with pytest.raises(Interrupted, match="hillsphere resume out"):
            resume_run("out", mission=SMALL, registry=registry)
    Make.acts.clear()
    resumed = resume_run("out", mission=SMALL, registry=registry)
    assert Make.ran == [2, 2, 3, 3, 3]
    assert len(manifest()["resumed_utc"]) == 4
    same(resumed, run_mission(mission(registry), out="whole", use_cache=False))


def test_an_interruption_of_what_was_finished_loses_nothing(registry: Registry) -> None:
    interrupted(registry)
    Make.shows[1] = interrupt
    with pytest.raises(Interrupted, match="finished stages: none;"):
        resume_run("out", mission=SMALL, registry=registry)
    Make.shows.clear()
    assert resume_run("out", mission=SMALL, registry=registry).ok
    assert Make.ran == [2, 3]


def test_an_interrupted_presentation_is_repeated(registry: Registry) -> None:
    """A stage whose results are not complete in the summary does not count as done."""
    Make.shows[2] = interrupt
    with pytest.raises(Interrupted, match="finished stages: one;"):
        run_mission(mission(registry), out="out", use_cache=False)
    assert states() == {"one": "done", "two": "interrupted", "three": "not run"}
    summary = json.loads(Path("out/summary.json").read_text())
    assert set(summary["metrics"]) == {"sum"}  # of stage one
    assert summary["failures"][0]["stage"] == "two"
    assert "its product is stored" in summary["failures"][0]["message"]
    assert "its product is stored" in Path("out/report.html").read_text()
    Make.shows.clear()
    Make.ran.clear()
    resumed = resume_run("out", mission=SMALL, registry=registry)
    assert Make.ran == [3]
    assert states() == dict.fromkeys(("one", "two", "three"), "done")
    same(resumed, run_mission(mission(registry), out="whole", use_cache=False))


def test_a_resumed_run_interrupted_before_all_is_presented(registry: Registry) -> None:
    """Stages that the earlier part had finished are not done while their results are missing."""
    run_mission(mission(registry), out="out", use_cache=False)
    Make.shows[2] = interrupt
    with pytest.raises(Interrupted, match="finished stages: one;"):
        resume_run("out", mission=SMALL, registry=registry)
    assert states() == {"one": "done", "two": "interrupted", "three": "interrupted"}
    Make.shows.clear()
    Make.ran.clear()
    assert resume_run("out", mission=SMALL, registry=registry).ok
    assert Make.ran == []


def test_a_failed_stage_is_run_again(registry: Registry) -> None:
    Make.acts[2] = fail
    assert run_mission(mission(registry), out="out", use_cache=False).state == "failed"
    Make.acts.clear()
    Make.ran.clear()
    assert resume_run("out", mission=SMALL, registry=registry).ok
    assert Make.ran == [2, 3]


def test_a_product_that_could_not_be_shown_is_not_computed_again(registry: Registry) -> None:
    Make.shows[2] = fail
    assert run_mission(mission(registry), out="out", use_cache=False).state == "failed"
    assert states()["two"] == "failed"
    Make.shows.clear()
    Make.ran.clear()
    assert resume_run("out", mission=SMALL, registry=registry).ok
    assert Make.ran == []


def test_a_finished_run_is_only_shown_again(registry: Registry) -> None:
    first = run_mission(mission(registry), out="out", use_cache=False)
    before = Path("out/summary.json").read_bytes()
    Make.ran.clear()
    same(first, resume_run("out", mission=SMALL, registry=registry))
    assert Make.ran == []
    assert Path("out/summary.json").read_bytes() == before


@pytest.mark.parametrize("damage", ["torn", "foreign", "gone"])
def test_a_damaged_product_is_computed_again(registry: Registry, damage: str) -> None:
    interrupted(registry)
    path = Path("out/one.npz")
    whole = path.read_bytes()
    if damage == "torn":
        path.write_bytes(whole[:100])
    elif damage == "foreign":
        save_product(path, Numbers(np.zeros(1)))
    else:
        path.unlink()
    assert resume_run("out", mission=SMALL, registry=registry).ok
    assert Make.ran == [1, 2, 3]
    assert path.read_bytes() == whole
    assert "its product is damaged and computed again" in Path("out/log.txt").read_text()


@pytest.mark.parametrize("where", ["digest", "read"])
def test_a_product_that_cannot_be_read_just_now_stays(
    registry: Registry, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted(registry)
    whole = Path("out/one.npz").read_bytes()
    opened = open_regular

    def failing(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.name == "one.npz":
            raise OSError(errno.EIO, "Input/output error")
        return opened(path, *arguments, **options)

    def unread(self: zipfile.ZipFile, *arguments: Any) -> bytes:
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patched:
        if where == "digest":
            patched.setattr("hillsphere.base.cached_files.open_regular", failing)
        else:
            patched.setattr(zipfile.ZipFile, "read", unread)
        result = resume_run("out", mission=SMALL, registry=registry)
    assert not result.ok
    assert "one.npz: cannot be read: Input/output error" in Path("out/log.txt").read_text()
    assert Path("out/one.npz").read_bytes() == whole
    assert resume_run("out", mission=SMALL, registry=registry).ok
    assert Make.ran == [2, 3]


def test_cache_profile_and_settings_are_as_they_were(registry: Registry, tmp_path: Path) -> None:
    text = CHAIN + "[profile.more]\nstage.three.count = 4\n"
    interrupted(registry, text=text, profile="more", sets=("stage.one.count=5",))
    assert resume_run("out", mission=SMALL, registry=registry).product("three").values.shape == (4,)
    assert Make.ran == [2, 4]
    assert not (tmp_path / "cache" / "stages").exists()


def test_only_what_is_local_names_this_machine(registry: Registry, tmp_path: Path) -> None:
    interrupted(registry)
    resume_run("out", mission=SMALL, registry=registry)
    for path in Path("out").iterdir():
        named = str(tmp_path).encode() in path.read_bytes()
        assert named == (path.name == "resume.json"), path
    assert json.loads(Path("out/resume.json").read_text()) == {
        "schema": 1,
        "mission": str(tmp_path / "small.toml"),
        "allow_path": False,
        "cache": False,
        "executor": {"type": "serial"},
        "figures": False,
        "plugin_files": {},
    }


def test_files_elsewhere_may_be_read_again(registry: Registry, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    other = tmp_path / "elsewhere" / "t.txt"
    other.write_text("1\n")
    (tmp_path / "here").mkdir()
    place = tmp_path / "here" / "small.toml"
    place.write_text(HEAD + CHAIN.replace("table.txt", str(other)))
    Make.acts[2] = interrupt
    with pytest.raises(Interrupted):
        run_mission(load_mission(place, registry=registry, allow_path=True), out="out")
    Make.acts.clear()
    assert json.loads(Path("out/resume.json").read_text())["allow_path"] is True
    with pytest.raises(InputError, match=r"hillsphere resume out --mission \S+ --allow-path$"):
        resume_run("out", mission=place, registry=registry)
    assert resume_run("out", mission=place, allow_path=True, registry=registry).ok


# --- what has changed


def refused(registry: Registry, *lines: str) -> None:
    """Check that the run is not continued, and the lines that say why."""
    before = {path: path.read_bytes() for path in Path("out").iterdir() if path.is_file()}
    with pytest.raises(InputError) as told:
        resume_run("out", mission=SMALL, registry=registry)
    first, *found, last = str(told.value).splitlines()
    assert first == (
        "run 'out' cannot be continued: facts that its results depend on have changed "
        "(then -> now):"
    )
    assert last.startswith("undo that, or begin a new run: hillsphere run small.toml")
    assert len(found) == len(lines)
    for line, expected in zip(found, lines, strict=True):
        assert re.fullmatch(f"  {expected}", line), line
    assert Make.ran == []
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("count = 3", "count = 4", r"stage\.three\.count: 3 -> 4"),
        ("[1, 2]", "[1, 7]", r"stage\.three\.list_\[1\]: 2\.0 -> 7\.0"),
        ("[1, 2]", "[1]", r"stage\.three\.list_: \[1\.0, 2\.0\] -> \[1\.0\]"),
        ('needs = { numbers = "two" }', "", r'stage\.three\.needs\.numbers: "two" -> none'),
        ("seed = 5", "seed = 6", "seed: 5 -> 6"),
        (
            "[stage.two]", '[stage.new]\ntype = "make"\n[stage.two]',
            r'stage\.new: none -> \{"type": "make".*',
        ),
    ],
)  # fmt: skip
def test_a_changed_mission_is_refused(registry: Registry, old: str, new: str, line: str) -> None:
    interrupted(registry)
    Path("small.toml").write_text((HEAD + CHAIN).replace(old, new))
    refused(registry, line)


def test_a_changed_title_is_none_of_the_results(registry: Registry) -> None:
    interrupted(registry)
    head = HEAD.replace('"Small"', '"Still small"') + 'description = "More words."\n'
    Path("small.toml").write_text(head.replace('"small"', '"other"') + CHAIN)
    assert resume_run("out", mission=SMALL, registry=registry).ok
    assert Make.ran == [2, 3]


def test_a_changed_input_file_is_refused(registry: Registry) -> None:
    interrupted(registry)
    Path("table.txt").write_text("1 3\n")
    digests = "[0-9a-f]{12} -> [0-9a-f]{12}"
    refused(registry, rf"stage\.one\.table \(content of table\.txt\): {digests}")


def test_all_differences_are_shown(registry: Registry) -> None:
    interrupted(registry)
    text = (HEAD + CHAIN).replace("seed = 5", "seed = 6").replace("count = 3", "count = 4")
    Path("small.toml").write_text(text)
    Path("table.txt").write_text("")
    refused(registry, "seed: .*", r"stage\.three\.count: .*", r"stage\.one\.table .*")


def test_very_many_differences_are_counted(registry: Registry) -> None:
    interrupted(registry, text=CHAIN.replace("[1, 2]", str(list(range(50)))))
    Path("small.toml").write_text(HEAD + CHAIN.replace("[1, 2]", str([9.5] * 50)))
    refused(registry, *[r"stage\.three\.list_.*"] * 20, "and 30 more")


def changed_environment(monkeypatch: pytest.MonkeyPatch, **facts: Any) -> None:
    true = hillsphere.base.environment.environment()
    for module in ("run_record", "stage_cache"):
        monkeypatch.setattr(f"hillsphere.runs.{module}.environment", lambda: {**true, **facts})


def test_other_versions_and_processors_are_refused(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted(registry)
    true = hillsphere.base.environment.package_versions()
    monkeypatch.setattr(
        "hillsphere.runs.run_record.package_versions",
        lambda: {**true, "numpy": "9.9", "matplotlib": "9.9"},  # of the two one matters
    )
    features = hillsphere.base.environment.environment()["cpu_features"]
    changed_environment(
        monkeypatch, python="4.0.0", machine="abacus", cpu_features=[*features[1:], "BEADS"],
        c_library="glibc 1.9", kernels={"OPENBLAS_CORETYPE": "Prescott"},
    )  # fmt: skip
    registry._offers["stage", "make"] = [
        replace(registry.get("stage", "make"), distribution="hillsphere-small 1.1")
    ]
    refused(
        registry,
        r"version of python: \"3\.\d+\.\d+\" -> \"4\.0\.0\"",
        r"version of numpy: .* -> \"9\.9\"",
        r"version of small: \"hillsphere-small 1\.0\" -> \"hillsphere-small 1\.1\"",
        r"machine: \w+ -> abacus",
        r"c_library: .* -> glibc 1\.9",
        r"variable OPENBLAS_CORETYPE: .* -> \"Prescott\"",
        f"CPU features that only one has: {re.escape(features[0])} -> BEADS",
    )


def test_changed_code_is_refused(
    registry: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "code" / "small_code"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "stage.py").write_text(f"from {HERE} import Make\n")
    monkeypatch.syspath_prepend(str(tmp_path / "code"))
    record = registry.get("stage", "make")
    component = replace(record.component, target="small_code.stage:Make")
    registry._offers["stage", "make"] = [replace(record, component=component)]
    monkeypatch.setitem(sys.modules, "small_code.stage", sys.modules[HERE])
    interrupted(registry)
    assert "small_code" in manifest()["sources"]
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "x.pyc").write_bytes(b"1")
    (package / "table.csv").write_text("1\n")
    refused(registry, "source files of small_code: [0-9a-f]{12} -> [0-9a-f]{12}")


def test_code_in_no_file_is_refused(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(sys.modules[HERE], "__file__")
    interrupted(registry)
    text = "depends on code in no file, which may be another one now"
    refused(registry, *(rf"stage\.{name}: {text}" for name in ("one", "two", "three")))


def test_a_key_that_changed_for_no_known_reason_is_a_difference(registry: Registry) -> None:
    interrupted(registry)
    then = manifest()
    now = json.loads(json.dumps(then))
    assert differences(then, now) == []
    now["stages"]["one"]["key"] = "0" * 64
    (line,) = differences(then, now)
    assert re.fullmatch(r"stage\.one: key [0-9a-f]{12} -> 0{12}", line)


# --- what cannot be resumed


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "'r' is no run directory: there is no such directory"),
        (lambda path: path.touch(), "'r' is no run directory: it is a file"),
        (lambda path: path.mkdir(), "'r' is no run directory: it holds no manifest.json"),
        (
            lambda path: RunDirectory.create(path, "small", hillsphere_time()),
            "it holds no manifest.json; the run ended before it kept anything",
        ),
    ],
)
def test_what_is_no_run(registry: Registry, make: Callable[[Path], None], message: str) -> None:
    make(Path("r"))
    with pytest.raises(InputError, match=re.escape(message)):
        resume_run("r", registry=registry)


def hillsphere_time() -> Any:
    from datetime import UTC, datetime

    return datetime.now(UTC)


def test_a_name_that_is_no_path(registry: Registry) -> None:
    with pytest.raises(InputError, match="is no run directory: "):
        resume_run("a\0b", registry=registry)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("manifest.json", "{", "out/manifest.json: is damaged: "),
        ("manifest.json", "[]", "out/manifest.json: is not the file that a run writes"),
        ("resume.json", "{}", "out/resume.json: is not the file that a run writes"),
        ("resume.json", None, "out/resume.json: cannot be read: No such file or directory"),
        ("manifest.json", "schema", "out/manifest.json: written in format 2; this version reads 1"),
        ("manifest.json", "started", "manifest.json: 'noon' is no time"),
    ],
)
def test_damaged_records_are_told(
    registry: Registry, file: str, text: str | None, message: str
) -> None:
    interrupted(registry)
    path = Path("out", file)
    content = json.loads(path.read_text())
    if text == "schema":
        path.write_text(json.dumps({**content, "schema": 2}))
    elif text == "started":
        path.write_text(json.dumps({**content, "started_utc": "noon"}))
    elif text is None:
        path.unlink()
    else:
        path.write_text(text)
    with pytest.raises(InputError, match=re.escape(message)):
        resume_run("out", mission=SMALL, registry=registry)


def test_a_mission_that_was_moved(registry: Registry, tmp_path: Path) -> None:
    interrupted(registry)
    (tmp_path / "moved").mkdir()
    new = Path("small.toml").rename(tmp_path / "moved" / "small.toml")
    Path("table.txt").rename(tmp_path / "moved" / "table.txt")
    with pytest.raises(InputError, match=r"^\./small\.toml: no such file"):
        resume_run("out", mission=SMALL, registry=registry)
    assert resume_run("out", mission=new, registry=registry).ok


def test_a_mission_that_is_not_sound_any_more(registry: Registry) -> None:
    interrupted(registry)
    Path("small.toml").write_text(HEAD + CHAIN + "counts = 3\n")
    with pytest.raises(InputError, match=r"small\.toml:19: stage\.three\.counts: "):
        resume_run("out", mission=SMALL, registry=registry)


def test_a_run_that_moved_is_resumed_where_it_is(registry: Registry) -> None:
    interrupted(registry)
    Path("out").rename("new")
    assert resume_run("new", mission=SMALL, registry=registry).directory == Path("new")


def test_a_run_that_goes_on_is_left_alone(registry: Registry) -> None:
    interrupted(registry)
    code = (
        "import sys\nfrom pathlib import Path\nfrom hillsphere.runs.store import RunDirectory\n"
        "with RunDirectory(Path('out')).locked():\n    print('locked', flush=True)\n"
        "    sys.stdin.read()\n"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"
        with pytest.raises(InputError, match="run 'out' is still going on in another process"):
            resume_run("out", mission=SMALL, registry=registry)
        other.kill()
        other.wait()
        # The lock went with the process.
        assert resume_run("out", mission=SMALL, registry=registry).ok


def test_a_running_run_holds_the_lock(registry: Registry) -> None:
    told = []

    def look(ctx: Context) -> None:
        with pytest.raises(InputError, match="still going on") as error:
            resume_run("out", mission=SMALL, registry=registry)
        told.append(error)

    Make.acts[2] = look
    assert run_mission(mission(registry), out="out").ok
    assert told


# --- what a stage is given


def test_a_workspace_lasts_until_the_product_is_stored(registry: Registry) -> None:
    left: list[str] = []

    def work(ctx: Context) -> None:
        place = ctx.workspace()
        assert place.is_dir()
        left.extend(path.read_text() for path in place.iterdir())
        (place / "part.txt").write_text(f"part {len(left)}")
        if len(left) < 2:
            raise KeyboardInterrupt

    Make.acts[2] = work
    loaded = mission(registry)
    with pytest.raises(Interrupted):
        run_mission(loaded, out="out", use_cache=False)
    assert Path("out/work/two/part.txt").is_file()
    with pytest.raises(Interrupted):
        resume_run("out", mission=SMALL, registry=registry)
    assert left == ["part 0"]

    def shown() -> None:
        assert not Path("out/work").exists()
        assert manifest()["stages"]["two"]["product"]

    Make.shows[2] = shown
    assert resume_run("out", mission=SMALL, registry=registry).ok
    assert left == ["part 0", "part 1"]
    assert not Path("out/work").exists()


def test_a_workspace_that_cannot_be_made(registry: Registry) -> None:
    def work(ctx: Context) -> None:
        Path("out/work").touch()
        ctx.workspace()

    Make.acts[2] = work
    failure, _ = run_mission(mission(registry), out="out").failures
    assert failure.message.startswith("work/two cannot be written to 'out': ")


@pytest.mark.parametrize("use_cache", [True, False])
def test_the_fingerprint_is_the_key(registry: Registry, use_cache: bool) -> None:
    seen: list[str] = []
    Make.acts[2] = lambda ctx: seen.append(ctx.fingerprint)
    run_mission(mission(registry), out="out", use_cache=use_cache)
    assert seen == [manifest()["stages"]["two"]["key"]]
    assert len(seen[0]) == 64


def test_without_a_key_no_fingerprint_is_like_another(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(sys.modules[HERE], "__file__")
    seen: list[str] = []
    Make.acts[2] = lambda ctx: seen.append(ctx.fingerprint)
    for out in ("a", "b"):
        run_mission(mission(registry), out=out)
    assert len(set(seen)) == 2
    assert all(re.fullmatch("[0-9a-f]{64}", text) for text in seen)


def test_the_executor_is_serial_unless_another_is_given(registry: Registry) -> None:
    seen: list[Any] = []
    Make.acts[2] = lambda ctx: seen.append(ctx.executor)
    own = Serial(SerialSpec())
    choices: list[Any] = ["serial", "pool", {"type": "pool", "workers": 3}, own]
    for number, choice in enumerate(choices):
        run_mission(mission(registry), out=f"{number}", executor=choice, use_cache=False)
    run_mission(mission(registry), out="out", use_cache=False)
    assert [type(executor) for executor in seen] == [Serial, Pool, Pool, Serial, Serial]
    assert seen[2].spec.workers == 3
    assert seen[3] is own
    kept = [json.loads(Path(run, "resume.json").read_text())["executor"] for run in "0123"]
    assert kept == [{"type": "serial"}, {"type": "pool"}, {"type": "pool", "workers": 3}, None]


def test_a_resumed_run_has_the_executor_that_it_had(registry: Registry) -> None:
    seen: list[Any] = []

    def look(ctx: Context) -> None:
        seen.append(ctx.executor)
        raise KeyboardInterrupt

    Make.acts[2] = look
    loaded = mission(registry)
    with pytest.raises(Interrupted):
        run_mission(loaded, out="out", executor={"type": "pool", "workers": 3})
    for choice in (None, {"type": "pool", "workers": 2}, None, Serial(SerialSpec()), None):
        with pytest.raises(Interrupted):
            resume_run("out", mission=SMALL, executor=choice, registry=registry)
    workers = [getattr(executor.spec, "workers", "serial") for executor in seen]
    assert workers == [3, 3, 2, 2, "serial", "serial"]


@pytest.mark.parametrize(
    ("choice", "error", "message"),
    [
        ("pol", UnknownComponentError, "no executor of type 'pol'; did you mean 'pool'?"),
        ({"type": "pool", "workers": 0}, InputError, "executor 'pool': workers: must be ≥ 1"),
        ({"type": "serial", "workers": 2}, InputError, "executor 'serial': workers: "),
        ({"workers": 2}, InputError, "the table of an executor needs a type, got {'workers': 2}"),
        (3, InputError, "an executor has a method crew, got an int"),
    ],
)
def test_an_executor_is_refused_before_anything_runs(
    registry: Registry, choice: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=re.escape(message)):
        run_mission(mission(registry), out="out", executor=choice)
    assert Make.ran == []
    assert not Path("out").exists()
