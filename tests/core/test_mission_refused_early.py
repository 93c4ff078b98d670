"""Faults planted in packaged missions: `check_mission` tells each at the line of its key.

All of them were told by the stage that met them, after the stages before it had run.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from hillsphere.base.paths import missions_directory
from hillsphere.base.problems import MissionError
from hillsphere.cli.endings import run
from hillsphere.mission import load_mission
from hillsphere.runs.mission_check import check_mission

TARGET = "target = { position_km = [20, 0, 0] }"
LIMITS = "limits = { position_error_km = 2, dv_m_s = 40 }"
LABEL = 'label = "unfiltered"'
REPEATED = 'repeat = "hover_unfiltered"'
COMPARED = 'needs = { campaigns = ["verify", "verify_unfiltered"] }'
FIRST_TEST = 'of = "largest_position_error", campaign = "K0", against = "KA"'
CHOSEN = ', worst = ["judged_worst_k0", "judged_worst_ka", "judged_worst_ka2", "judged_worst_ka3"]'

# mission, text → what takes its place, text of the line at which it is told, message
FAULTS = [
    ("phobos-hover", TARGET, "target = { position_km = [2, 0, 0] }", "target = { position_km = [2",
     "stage.hover.target: the flight has ended where it begins, by 'impact'"),
    ("phobos-hover", TARGET, f"{TARGET}\nstart = {{ position_km = [2, 0, 0] }}",
     "start = {", "stage.hover.start: the flight has ended where it begins, by 'impact'"),
    ("phobos-hover", LIMITS, "limits = { distance_max_km = 15 }", TARGET,
     "stage.hover.target: the flight has ended where it begins, by 'distance_max'"),
    ("phobos-hover", LIMITS, "limits = { distance_min_km = 25 }", TARGET,
     "stage.hover.target: the flight has ended where it begins, by 'distance_min'"),
    ("phobos-hover", TARGET, f"{TARGET}\nstart = {{ position_km = [25, 0, 0] }}", "start = {",
     "stage.hover.start: the flight has ended where it begins, by 'position_error'"),
    ("phobos-hover", "duration_min = 133", "duration_min = 1e10", "duration_min = 1e10",
     "stage.hover.duration_min: a flight of 6e+11 s has 1e+10 periods"),
    ("phobos-hover", LABEL, f'{LABEL}\nflight_inputs = {{ "plant.pull" = 1 }}', "flight_inputs",
     "stage.hover_unfiltered.flight_inputs: no input 'plant.pull'"),
    ("phobos-hover", LABEL, f'{LABEL}\nsees = ["x"]', 'law = "unfiltered"',
     "stage.hover_unfiltered.law: the law needs 6 rows of positions and velocities, got 1"),
    ("phobos-hover", REPEATED, f'{REPEATED}\ndraws_as = "other"', COMPARED,
     "stage.filters.needs.campaigns: campaigns 'verify' and 'verify_unfiltered' did not see the "
     "same draws"),
    ("phobos-hover", REPEATED, f'{REPEATED}\ndesign = "latin_hypercube"', COMPARED,
     "stage.filters.needs.campaigns: campaigns 'verify' and 'verify_unfiltered' have different "
     "designs"),
    ("phobos-landing", FIRST_TEST, FIRST_TEST.replace('"K0"', '"KX"'), "tests = [",
     "stage.table_1.tests: no campaign is called 'KX'"),
    ("phobos-landing", FIRST_TEST, FIRST_TEST.replace('"K0"', '"KA"'), "tests = [",
     "stage.table_1.tests: 'KA' and 'KA' name the same campaign"),
    ("phobos-landing", CHOSEN, "", "tests = [", "of = 'worst' needs campaigns with chosen cases"),
    ("phobos-landing", '"phobos-landing-table2.csv"', '"apophis-formation-table4.csv"',
     'reference = "apophis', "apophis-formation-table4.csv: no column 'campaign'"),
    ("bennu-formation", "position_m = [0, -2500, 600]", "position_m = [0, -2500]", "start = {",
     "start.position_m: 2 numbers, the plant has 3"),
    ("apophis-formation", '"apophis-formation-table4.csv"', '"phobos-landing-table2.csv"',
     'reference = "phobos', "phobos-landing-table2.csv: must have the columns case"),
    ("robust-control-demo", '"e = w_command - y"', '"e = w_command - q"', "[stage.column]",
     "stage.column: nothing makes the signal 'q[0]'"),
    ("robust-control-demo", 'outputs = ["z_input[1]"]', 'outputs = ["z_input[0]"]',
     "[stage.column_uncertain.blocks]",
     "stage.column_uncertain.blocks: signal 'z_input[0]' belongs to two blocks"),
    ("assisted-tracking", 'campaign = "verify", ages', 'campaign = "consistency", ages', "ages =",
     "stage.compare.needs.campaign: campaign 'consistency' repeats stage 'consistent'"),
    ("assisted-tracking", 'ages = "ages"', 'ages = "verify"', "ages =",
     "stage.compare.needs.ages: campaign 'verify' is not a sweep over a number"),
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory with the data of the packaged missions, in which changed ones are written."""
    there = tmp_path_factory.mktemp("missions")
    shutil.copytree(missions_directory() / "data", there / "data")
    return there


def planted(folder: Path, mission: str, old: str, new: str) -> Path:
    text = (missions_directory() / f"{mission}.toml").read_text("utf-8")
    assert old in text
    path = folder / f"{mission}.toml"
    path.write_text(text.replace(old, new, 1), "utf-8")
    return path


@pytest.mark.parametrize(("mission", "old", "new", "line", "message"), FAULTS)
def test_a_fault_is_told_at_its_line_before_anything_runs(
    mission: str, old: str, new: str, line: str, message: str, folder: Path
) -> None:
    path = planted(folder, mission, old, new)
    with pytest.raises(MissionError) as caught:
        check_mission(load_mission(path))
    lines = path.read_text("utf-8").splitlines()
    told = [p for p in caught.value.problems if message in str(p)]
    assert told, str(caught.value)
    assert told[0].line is not None
    assert line in lines[told[0].line - 1], str(told[0])


@pytest.mark.parametrize("command", ["validate", "run"])
def test_the_command_ends_with_code_2_and_writes_nothing(
    command: str,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    path = planted(folder, *FAULTS[0][:3])
    assert run([command, str(path)]) == 2
    assert FAULTS[0][4] in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
