"""Pictures of figures: with a run that is asked for them, and of a finished run."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import NoReturn

import pytest
from tests.core.wave_missions import WAVES, waves_mission

from hillsphere.cli.endings import run
from hillsphere.errors import StageError
from hillsphere.plugins import default_registry
from hillsphere.runs.run_figures import draw_figures
from hillsphere.show.charts import Chart
from hillsphere.show.drawing import Drawing, draw
from hillsphere.show.plotly_renderer import plotly_figure
from hillsphere.show.presentation import AnyFigure

SWEEP = """
[stage.{name}]
type = "sweep"
repeat = "wave"
over = {{ "stage.wave.height" = {heights} }}
lines = ["height"]
"""
MISSION = (
    waves_mission(10)
    + SWEEP.format(name="few", heights=[0, 1])
    + SWEEP.format(name="more-waves", heights=[0, 1, 2])
)
AGAIN = ("--mission", "waves.toml")
FEW = (
    "sweep_lines", "campaign_histograms", "campaign_distributions", "campaign_convergence",
    "sweep_metrics",
)  # fmt: skip
"""Figures of the first sweep, in order."""
MORE = tuple(f"{name}_more_waves" for name in FEW)
"""Those of the second one, which calls them the same."""
STALLED = """
import time
import hillsphere.runs.run_figures
from hillsphere.cli.endings import main

drawn = hillsphere.runs.run_figures.draw

def stall(figure, png):
    if len(calls) == 1:
        print("second figure", flush=True)
        time.sleep(60)
    calls.append(figure)
    return drawn(figure, png=png)

calls = []
hillsphere.runs.run_figures.draw = stall
main()
"""
"""The command line, which waits at the second figure."""


class Place:
    """A directory with ``waves.toml``, in which commands are run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        (path / "waves.toml").write_text(MISSION, "utf-8")

    def __call__(self, *arguments: str) -> tuple[int, str, str]:
        """Run a command; return its exit code, stdout and stderr."""
        out, err = StringIO(), StringIO()
        with chdir(self.path), redirect_stdout(out), redirect_stderr(err):
            code = run(arguments)
        return int(code), out.getvalue(), err.getvalue()

    def files(self, directory: str = "out") -> dict[str, str]:
        """Return the digest of every file of a run, by its name there."""
        return {
            path.relative_to(self.path / directory).as_posix(): _digest(path)
            for path in (self.path / directory).rglob("*")
            if path.is_file()
        }

    def pictures(self, directory: str = "out") -> dict[str, str]:
        """Return those of the pictures."""
        files = self.files(directory).items()
        return {name: d for name, d in files if name.endswith((".png", ".svg"))}


def lines(names: tuple[str, ...]) -> str:
    """Return what is printed of these figures."""
    return "".join(f"out/figures/{name}.{end}\n" for name in names for end in ("svg", "png"))


def pictures(names: tuple[str, ...]) -> set[str]:
    """Return the files of pictures of these figures."""
    return {f"figures/{name}.{end}" for name in names for end in ("svg", "png")}


FIRST = {f"figures/{FEW[0]}.svg"}
"""Picture of a run's first figure, which every run draws."""


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """Place with a finished run ``out``, and ``asked`` that was to write PNG files."""
    place = Place(tmp_path_factory.mktemp("ran"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HILLSPHERE_CACHE", str(place.path / "cache"))
        patch.syspath_prepend(str(WAVES))
        default_registry.cache_clear()
        common = ("run", "waves.toml", "--workers", "0", "--out")
        assert place(*common, "out")[0] == 0
        assert place(*common, "asked", "--figures")[0] == 0
        yield place
    default_registry.cache_clear()


@pytest.fixture(scope="module")
def pictures_drawn() -> dict[tuple[str, bool], Drawing]:
    """Pictures by what they show and whether they are PNG too."""
    return {}


@pytest.fixture
def drawn_once(
    pictures_drawn: dict[tuple[str, bool], Drawing], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Draw each figure once for all tests that ask which pictures there are, not how they look.

    A figure with other data is another one.
    """

    def draw_once(figure: AnyFigure, *, png: bool) -> Drawing:
        assert isinstance(figure, Chart)
        key = json.dumps(plotly_figure(figure)), png
        if key not in pictures_drawn:
            pictures_drawn[key] = draw(figure, png=png)
        return pictures_drawn[key]

    for module in ("pipeline", "run_figures"):
        monkeypatch.setattr(f"hillsphere.runs.{module}.draw", draw_once)


@pytest.fixture
def place(ran: Place, tmp_path: Path) -> Place:
    """Place of a test's own, with a copy of the finished run."""
    shutil.copytree(ran.path / "out", tmp_path / "out")
    return Place(tmp_path)


def test_pictures_are_drawn_by_a_run_that_is_asked_for_them(ran: Place) -> None:
    plain, asked = ran.files("out"), ran.files("asked")
    assert set(ran.pictures("out")) == FIRST
    assert set(asked) - set(plain) == pictures(FEW + MORE) - FIRST
    for name in FEW + MORE:
        assert plain[f"figures/{name}.json"] == asked[f"figures/{name}.json"]
        data = (ran.path / f"asked/figures/{name}.png").read_bytes()
        assert data.startswith(b"\x89PNG")


def test_a_finished_run_draws_the_files_of_a_run_that_was_asked(ran: Place, place: Place) -> None:
    before = place.files()
    assert place("figures", "out", *AGAIN) == (0, lines(FEW + MORE), "")
    assert place.pictures() == ran.pictures("asked")
    assert before.items() <= place.files().items()
    assert set(place.files()) == set(before) | pictures(FEW + MORE)


@pytest.mark.usefixtures("drawn_once")
@pytest.mark.parametrize(
    ("name", "drawn"),
    [("sweep_lines", FEW[:1]), (MORE[0], MORE[:1]), ("few", FEW), ("more-waves", MORE)],
)
def test_one_figure_or_those_of_a_stage(
    ran: Place, place: Place, name: str, drawn: tuple[str, ...]
) -> None:
    assert place("figures", "out", name, *AGAIN) == (0, lines(drawn), "")
    expected = ran.pictures("asked")
    assert place.pictures() == {each: expected[each] for each in FIRST | pictures(drawn)}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sweep_line", "has no figure or stage 'sweep_line'; did you mean 'sweep_lines'?"),
        ("more_waves", "has no figure or stage 'more_waves'; did you mean 'more-waves'?"),
        ("../many", "has no figure or stage '../many'; did you mean 'many'?"),
        (
            "qqq",
            "has no figure or stage 'qqq'; it has: "
            + ", ".join([*sorted(FEW + MORE), "wave", "many", "few", "more-waves"]),
        ),
        ("wave", "has no figures of 'wave'"),
    ],
)
def test_a_wrong_name_is_refused(place: Place, name: str, message: str) -> None:
    before = place.files()
    assert place("figures", "out", name, *AGAIN) == (2, "", f"run 'out' {message}\n")
    assert place.files() == before


def test_what_a_run_directory_names_must_be_given(place: Place) -> None:
    code, out, err = place("figures", "out", "few")
    assert (code, out) == (2, "")
    named = json.loads((place.path / "out/resume.json").read_text("utf-8"))["mission"]
    assert err.endswith(f"\n  hillsphere figures out few --mission {named}\n")


def test_a_changed_mission_is_refused(place: Place) -> None:
    (place.path / "waves.toml").write_text(MISSION.replace("[0, 1]", "[0, 2]"), "utf-8")
    code, out, err = place("figures", "out", *AGAIN)
    assert (code, out) == (2, "")
    assert "facts that its results depend on have changed" in err
    assert set(place.pictures()) == FIRST


@pytest.mark.usefixtures("drawn_once")
def test_a_damaged_product_is_refused(place: Place) -> None:
    (place.path / "out/more-waves.npz").write_bytes(b"something else")
    code, out, err = place("figures", "out", "more-waves", *AGAIN)
    assert (code, out) == (2, "")
    assert err.startswith("out/more-waves.npz: is not the file that the run wrote")
    assert set(place.pictures()) == FIRST
    # The other one is not needed for what is sound.
    assert place("figures", "out", "sweep_lines", *AGAIN)[0] == 0


@pytest.mark.usefixtures("drawn_once")
def test_a_run_that_is_not_finished_is_to_be_resumed(ran: Place, place: Place) -> None:
    path = place.path / "out/manifest.json"
    manifest = json.loads(path.read_text("utf-8"))
    path.write_text(json.dumps({**manifest, "state": "interrupted"}), "utf-8")
    code, out, err = place("figures", "out", *AGAIN)
    assert (code, out) == (2, "")
    assert err.startswith("run 'out' is not finished (its state is 'interrupted')")
    assert err.endswith(" --figures\n")
    assert place("resume", "out", "--figures", *AGAIN, "--workers", "0")[0] == 0
    assert place.pictures() == ran.pictures("asked")


@pytest.mark.usefixtures("drawn_once")
def test_a_finished_run_is_resumed_for_its_figures(ran: Place, place: Place) -> None:
    before = place.files()
    code, out, err = place("resume", "out", "--figures", *AGAIN)
    assert (code, err) == (0, "")
    assert out.startswith("waves: this run is finished; 10 figures were drawn\n")
    assert place.pictures() == ran.pictures("asked")
    assert before.items() <= place.files().items()


@pytest.mark.usefixtures("drawn_once")
def test_a_resumed_run_remembers_what_it_was_asked_for(ran: Place, tmp_path: Path) -> None:
    place = Place(tmp_path)
    shutil.copytree(ran.path / "asked", tmp_path / "out")
    shutil.rmtree(tmp_path / "out/figures")
    path = tmp_path / "out/manifest.json"
    manifest = json.loads(path.read_text("utf-8"))
    path.write_text(json.dumps({**manifest, "state": "interrupted"}), "utf-8")
    assert place("resume", "out", *AGAIN, "--workers", "0")[0] == 0
    assert place.pictures() == ran.pictures("asked")


@pytest.mark.usefixtures("drawn_once")
def test_an_interrupted_drawing_leaves_whole_files(ran: Place, place: Place) -> None:
    def at_a_terminal() -> None:
        for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(each, signal.SIG_DFL)

    path = [str(WAVES), *filter(None, [os.environ.get("PYTHONPATH")])]
    process = subprocess.Popen(
        [sys.executable, "-c", STALLED, "figures", "out", *AGAIN], cwd=place.path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path)}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, preexec_fn=at_a_terminal,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "second figure\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, err) == (130, "interrupted\n")
    expected = ran.pictures("asked")
    assert place.pictures() == {name: expected[name] for name in pictures(FEW[:1])}
    assert place("figures", "out", "few", *AGAIN)[0] == 0
    assert place.pictures() == {name: expected[name] for name in pictures(FEW)}


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_leaves_no_half_file(
    place: Place, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    def full(*_: object) -> NoReturn:
        raise OSError(28, "No space left on device")

    before = place.files()
    with monkeypatch.context() as patched:
        patched.setattr(f"os.{call}", full)
        code, out, err = place("figures", "out", *AGAIN)
    assert (code, out) == (1, "")
    assert err.startswith("figures/sweep_lines.svg cannot be written to 'out': No space left")
    assert place.files() == before
    assert place("figures", "out", "sweep_lines", *AGAIN)[0] == 0


@pytest.mark.usefixtures("drawn_once")
def test_what_a_killed_drawing_left_is_removed(place: Place) -> None:
    part = place.path / "out/figures/.sweep_lines.png.0123abcd.part"
    part.write_bytes(b"\x89PN")
    assert place("figures", "out", "sweep_lines", *AGAIN)[0] == 0
    assert not part.exists()


def test_a_run_without_figures(ran: Place, tmp_path: Path) -> None:
    place = Place(tmp_path)
    sets = [
        word for name in ("few", "more-waves") for word in ("--set", f"stage.{name}.figures=false")
    ]
    assert place("run", "waves.toml", *sets, "--workers", "0", "--out", "out", "--figures")[0] == 0
    assert place("figures", "out", *AGAIN) == (0, "run 'out' has no figures\n", "")
    assert not place.pictures()


@pytest.mark.parametrize(
    ("patched", "message"),
    [
        ("run_figures.draw", "figure 'sweep_lines' cannot be drawn: ValueError: no ink"),
        ("stored_results.check_presentation", "stage 'wave' cannot be shown: ValueError: no ink"),
    ],
)
def test_what_a_plugin_raises_is_told_in_one_sentence(
    place: Place, monkeypatch: pytest.MonkeyPatch, patched: str, message: str
) -> None:
    def fail(*_: object, **__: object) -> NoReturn:
        raise ValueError("no\nink")

    monkeypatch.setattr(f"hillsphere.runs.{patched}", fail)
    with chdir(place.path), pytest.raises(StageError) as told:
        draw_figures("out", mission="waves.toml")
    assert str(told.value) == message
    assert set(place.pictures()) == FIRST
