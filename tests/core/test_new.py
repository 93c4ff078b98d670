"""`hillsphere new`: what it writes is valid, installs and passes its own tests unedited."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest

from hillsphere.base.paths import missions_directory
from hillsphere.cli.endings import run
from hillsphere.cli.mission_copy import copy_mission
from hillsphere.cli.plugin_template import TEMPLATES, plugin_files
from hillsphere.mission import load_mission, packaged_missions
from hillsphere.plugins import default_registry
from hillsphere.runs.mission_check import check_mission

PACKAGED = [name for name, _ in packaged_missions()]


def call(*arguments: object) -> tuple[int, str, str]:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = run([str(argument) for argument in arguments])
    return int(code), out.getvalue(), err.getvalue()


# --- missions


@pytest.mark.parametrize("like", PACKAGED)
def test_copy_of_every_packaged_mission_is_valid(like: str, tmp_path: Path) -> None:
    assert call("new", "mission", "mine", "--like", like, "--folder", tmp_path)[0] == 0
    path = tmp_path / "mine.toml"
    copied, original = load_mission(path), load_mission(like)
    assert (copied.name, copied.profiles) == ("mine", original.profiles)
    assert copied.title != original.title
    for profile in (None, *copied.profiles):
        check_mission(load_mission(path, profile=profile))
    text = path.read_text("utf-8")
    assert "claim" not in copied.specs
    assert "{claim." not in text
    # the same stages with the same values, and data files that are found
    mine, theirs = copied.resolved(), original.resolved()
    for kind in mine.keys() - {"name", "title", "report"}:
        assert mine[kind] == theirs[kind], kind


def test_comments_and_layout_are_kept() -> None:
    text = (missions_directory() / "phobos-qso.toml").read_text("utf-8")
    copied = copy_mission(text, "mine", "phobos-qso").split("\n")
    assert 'name = "mine"' + " " * 29 + "# names the run directory" in copied
    assert "# --- Report " + "-" * 86 in copied
    assert not [line for line in copied if line.startswith("# --- Published claims")]
    kept = [line for line in text.split("\n") if line in copied]
    assert len(copied) - len(kept) <= 8  # what is changed, and the line at the head


def test_what_refers_to_claims_goes_with_them() -> None:
    text = """format = 1
name = "toy"
title = "A toy"
[requirement.both]
value = 1
# about the claim
[claim.first]
text = "x"

[claim.both]
text = "y"
[report]
answer = "All {requirement.both}. Also {claim.first.state}."
numbers = ["first", "both", "stage.metric"]  # shown
[[report.section]]
title = "Beside the paper"
text = "It says {claim.first}."
[profile.fast]
drop = ["claim.first", "stage.wide",
    "claim.*"]
claim.first.value = 2
[profile.other]
drop = ["claim.*"]
"""
    copied = copy_mission(text, "mine", "toy")
    assert tomllib.loads(copied) == {
        "format": 1, "name": "mine", "title": "A toy (changed from toy)",
        "requirement": {"both": {"value": 1}},
        "report": {
            "answer": "All {requirement.both}.", "numbers": ["both", "stage.metric"],
            "section": [{"title": "Beside the paper"}],
        },
        "profile": {"fast": {"drop": ["stage.wide"]}, "other": {}},
    }  # fmt: skip
    assert "about the claim" not in copied
    assert "# shown" in copied


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mission", "a/b", "--like", "phobos-qso"], "'a/b' cannot name a mission"),
        (["mission", "mine", "--like", "phobos-qos"], "did you mean 'phobos-qso'?"),
        (["mission", "taken", "--like", "phobos-qso"], "exists already"),
        (["plugin", "taken", "--kind", "stage"], "exists already"),
        (["plugin", "Mine", "--kind", "stage"], "'Mine' cannot name a plugin"),
        (["plugin", "../mine", "--kind", "stage"], "cannot name a plugin"),
        (["plugin", "class", "--kind", "stage"], "'class' cannot be one of its modules"),
        (["plugin", "hillsphere-specs", "--kind", "stage"], "cannot be one of its modules"),
        (["plugin", "json", "--kind", "stage"], "a package 'json' is installed"),
        (["plugin", "lidar", "--kind", "sensor"], "offers a sensor 'lidar'"),
        (["plugin", "mine", "--kind", "sensr"], "did you mean 'sensor'?"),
        (["plugin", "mine", "--kind", "executor"], "kinds with a template: gravity"),
    ],
)
def test_refused_with_one_line_and_nothing_written(
    arguments: list[str], message: str, tmp_path: Path
) -> None:
    (tmp_path / "taken.toml").write_text("mine")
    (tmp_path / "taken").mkdir()
    code, out, err = call("new", *arguments, "--folder", tmp_path)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["taken", "taken.toml"]
    assert (tmp_path / "taken.toml").read_text() == "mine"


def test_a_folder_that_cannot_be_made_is_one_message(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for arguments in (["mission", "m", "--like", "phobos-qso"], ["plugin", "p", "--kind", "stage"]):
        code, _, err = call("new", *arguments, "--folder", tmp_path / "file")
        assert (code, err.count("\n")) == (2, 1)
        assert "cannot be written" in err


# --- plugins


def test_the_page_on_commands_lists_every_template() -> None:
    page = (Path(__file__).parents[2] / "docs" / "commands.md").read_text("utf-8")
    for kind, summary in TEMPLATES.items():
        assert f"| `{kind}` | {summary} |" in page


def test_files_of_a_plugin() -> None:
    made = plugin_files("hillsphere-limb-x", "sensor", default_registry())
    assert "src/hillsphere_limb_x/limb_x.py" in made
    assert not any("$" in text for text in made.values())
    assert 'type="limb_x"' in made["src/hillsphere_limb_x/__init__.py"]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Interpreter of an environment in which a new plugin of every kind is installed."""
    folder = tmp_path_factory.mktemp("new")
    for kind in TEMPLATES:
        assert call("new", "plugin", f"try-{kind}-x", "--kind", kind, "--folder", folder)[0] == 0
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    # No network: everything else is taken from the environment that runs this test.
    inner = started(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))",
                    cwd=folder).strip()  # fmt: skip
    outer = sysconfig.get_path("purelib")
    Path(inner, "outer.pth").write_text(f"import site; site.addsitedir({outer!r})\n", "utf-8")
    sources = [folder / f"try-{kind}-x" for kind in TEMPLATES]
    started(python, "-m", "pip", "install", "--no-build-isolation", "--no-deps", "--no-index",
            "--disable-pip-version-check", "--root-user-action=ignore", *sources,
            cwd=folder)  # fmt: skip
    return python, folder


def started(*command: str | Path, cwd: Path) -> str:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST_", "COV_"))}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_new_plugins_are_listed(installed: tuple[Path, Path]) -> None:
    python, folder = installed
    listed = json.loads(started(python, "-m", "hillsphere", "plugins", "--json", cwd=folder))
    found = {(c["kind"], c["type"]) for c in listed["components"] if c["plugin"].startswith("try_")}
    assert found == {(kind, f"try_{kind}_x") for kind in TEMPLATES}
    assert listed["broken"] == {}


def test_tests_of_new_plugins_pass(installed: tuple[Path, Path]) -> None:
    python, folder = installed
    done = started(python, "-m", "pytest", "-q", "-p", "no:cacheprovider",
                   "--import-mode=importlib", *(f"try-{kind}-x/tests" for kind in TEMPLATES),
                   cwd=folder)  # fmt: skip
    assert " passed" in done


MISSION = """
format = 1
name = "try"
title = "New plugins in a mission"
seed = 1
[body.moon]
type = "moon"
name = "phobos"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9376
[gravity.mass]
type = "point_mass"
gm_m3_s2 = 7e5
[plant.hill]
type = "hill"
body = "moon"
gravity = "mass"
[plant.near]
type = "try_plant_x"
mean_motion_rad_s = 1.1e-3
[orbit_family.direct]
type = "try_orbit_family_x"
plant = "hill"
[guidance.quartic]
type = "try_guidance_x"
[estimator.kalman]
type = "try_estimator_x"
[sensor.distance]
type = "try_sensor_x"
[tracker.proportional]
type = "try_tracker_x"
[sensor.antenna]
type = "antenna"
station = "site"
latitude_deg = -2.18
longitude_deg = -44.26
height_m = 39
[stage.orbits]
type = "orbit_family"
family = "direct"
amplitudes_km = [2]
curve_members = 21
[stage.approach]
type = "reference_trajectories"
plant = "near"
guidance = "quartic"
[[stage.approach.descents]]
name = "in"
start = { position_km = [0, -2, 0.1] }
end_position_km = [0, -0.1, 0]
duration_min = 40
[stage.navigation]
type = "navigation"
plant = "near"
sensors = ["distance"]
estimator = "kalman"
start = { position_km = [1, 0, 0], velocity_m_s = [0, -2.2, 0] }
belief = { position_m = 20 }
interval_min = 5
duration_min = 60
[stage.tracking]
type = "assisted_tracking"
trackers = ["proportional"]
passes = [{ name = "one", sensor = "antenna", revolution = 2, outages_min = [1] }]
nominal_error = { node_sigma_deg = 0.3, mean_anomaly_sigma_deg = 0.3 }
[stage.tracking.satellite]
name = "SCD"
[stage.tracking.satellite.elements]
epoch = "1989-01-31T09:58:00"
semi_major_axis_km = 7180
eccentricity = 0.0436
inclination_deg = 23.82
node_deg = 240.14
perigee_deg = 15.47
mean_anomaly_deg = 225.43
"""


def test_new_plugins_run_in_a_mission(installed: tuple[Path, Path]) -> None:
    python, folder = installed
    (folder / "try.toml").write_text(MISSION, "utf-8")
    started(python, "-m", "hillsphere", "run", "./try.toml", "--out", "run", cwd=folder)
    summary = json.loads((folder / "run" / "summary.json").read_text("utf-8"))
    assert not summary["failures"]


def test_new_format_converts_ephemerides(installed: tuple[Path, Path]) -> None:
    python, folder = installed
    (folder / "one.oem").write_text(
        "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-11-21T00:00:00\nORIGINATOR = TEST\n"
        "META_START\nOBJECT_NAME = CRAFT\nOBJECT_ID = 1\n"
        "CENTER_NAME = MARS\nREF_FRAME = ICRF\nTIME_SYSTEM = TDB\n"
        "START_TIME = 2026-11-21T00:00:00\nSTOP_TIME = 2026-11-21T00:00:00\nMETA_STOP\n"
        "2026-11-21T00:00:00.000000 9000.5 0.0 0.0 0.0 2.125 0.0\n"
    )
    for source, target in (("one.oem", "one.try_format_x"), ("one.try_format_x", "two.oem")):
        started(python, "-m", "hillsphere", "convert", source, target, cwd=folder)
    last = (folder / "two.oem").read_text("utf-8").splitlines()[-1].split()
    assert [float(word) for word in last[1:]] == [9000.5, 0.0, 0.0, 0.0, 2.125, 0.0]


@pytest.mark.slow
def test_new_plugins_pass_mypy(installed: tuple[Path, Path]) -> None:
    pytest.importorskip("mypy")
    python, folder = installed
    for kind in TEMPLATES:
        place = folder / f"try-{kind}-x"
        started(python, "-m", "mypy", "--cache-dir", folder / "mypy", cwd=place)


def ruff() -> str:
    path = shutil.which("ruff") or str(Path(sys.executable).with_name("ruff"))
    if not Path(path).exists():
        pytest.skip("needs ruff")
    return path


def test_new_plugins_pass_ruff(tmp_path: Path) -> None:
    for kind in TEMPLATES:
        assert call("new", "plugin", f"limb-{kind}", "--kind", kind, "--folder", tmp_path)[0] == 0
        place = tmp_path / f"limb-{kind}"
        started(ruff(), "check", "--no-cache", ".", cwd=place)
        # the rules of this project, for the package; its tests need no docstrings
        ours = Path(__file__).parents[2] / "pyproject.toml"
        started(ruff(), "check", "--no-cache", "--config", ours, "src", cwd=place)
        started(ruff(), "format", "--no-cache", "--check", ".", cwd=place)
