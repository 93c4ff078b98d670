"""The commands that read orbit messages: their lenient reading, checksums, the age of elements."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hillsphere.cli.endings import run
from hillsphere.errors import InputError
from hillsphere.formats.oem import read_oem
from hillsphere.formats.opm import read_opm
from hillsphere_tracking.tle import read_tles

DATA = Path(__file__).parents[1] / "data"
ISS = """ISS (ZARYA)
1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
BAD_SUM = ISS.replace("9991\n", "9992\n")


def call(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    code = int(run(words))
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_messages_of_a_file_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    file = str(DATA / "ndm" / "valid" / "all-kinds.xml")
    code, out, err = call(capsys, "messages", file, "--json")
    assert (code, err) == (0, "")
    rows = json.loads(out)["messages"]
    assert [row["kind"] for row in rows] == ["CDM", "OPM", "OEM", "OEM", "OMM", "OCM", "TDM", "AEM"]
    assert rows[1]["content"] == "a state about MARS in ICRF"
    assert "4 states about MARS" in rows[2]["content"]
    assert rows[5]["content"] == "1 block of states"
    assert "are not read" in rows[0]["content"]
    broken = str(DATA / "opm" / "broken" / "no-originator.opm")
    code, out, err = call(capsys, "messages", broken)
    assert (code, out) == (2, "")
    assert "no-originator.opm:2: the header lacks ORIGINATOR" in err
    code, out, err = call(capsys, "messages", broken, "--lenient")
    assert code == 0
    assert "PROBE" in out
    assert "the header lacks ORIGINATOR" in err


def test_states_are_converted(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    source, target = DATA / "opm" / "valid" / "full.opm", tmp_path / "b.xml"
    assert call(capsys, "convert", str(source), str(target))[0] == 0
    first, second = (read_opm(path.read_text("utf-8")) for path in (source, target))
    np.testing.assert_array_equal(first.x, second.x)
    assert first.user_defined == second.user_defined
    oem = tmp_path / "c.oem"
    code, out, _ = call(capsys, "convert", str(DATA / "ocm" / "valid" / "full.ocm"), str(oem))
    assert code == 0
    assert read_oem(oem.read_text("utf-8"))[0].t_s[-1] == pytest.approx(60.0)
    for lost in ("covariances (1 blocks)", "manoeuvres (1 blocks)", "the block PHYS"):
        assert lost in out
    alias = str(DATA / "opm" / "broken" / "frame-alias.opm")
    code, _, err = call(capsys, "convert", alias, str(tmp_path / "d.xml"))
    assert code == 2
    code, _, err = call(capsys, "convert", alias, str(tmp_path / "d.xml"), "--lenient")
    assert code == 0
    assert "customary name of ICRF" in err


def test_a_wrong_checksum_is_refused_told_or_ignored() -> None:
    with pytest.raises(InputError, match="f:2: the checksum in column 69 is '2'"):
        read_tles(BAD_SUM, "f")
    (told,) = read_tles(BAD_SUM, "f", checksum="warn")
    assert told.warnings[0].startswith("f:2: the checksum in column 69 is '2'")
    (ignored,) = read_tles(BAD_SUM, "f", checksum="ignore")
    assert ignored.warnings == ()
    assert ignored == told
    for other in ("8067A", "51.6439"):  # other faults are refused all the same
        with pytest.raises(InputError):
            read_tles(BAD_SUM.replace(other, "x" * len(other), 1)[:-1] + "\n", "f")
    with pytest.raises(InputError, match="inclination"):
        read_tles(BAD_SUM.replace(" 51.6439", "951.6439"), "f", checksum="ignore")


def test_options_of_passes(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "iss.tle"
    file.write_text(BAD_SUM, "utf-8")
    words = ("passes", str(file), "--station", "48.08,11.28,580", "--days", "0.2")
    code, _, err = call(capsys, *words)
    assert code == 2
    assert "checksum" in err
    code, _, err = call(capsys, *words, "--checksum", "warn")
    assert code == 0
    assert "iss.tle:2: the checksum" in err
    code, _, err = call(capsys, *words, "--checksum", "ignore")
    assert (code, err) == (0, "")
    assert call(capsys, *words, "--checksum", "mend")[0] == 2
    file.write_text(ISS, "utf-8")
    # the epoch is 2019-12-09; the search ends 15.9 and 13.9 days after it
    code, _, err = call(capsys, *words, "--start", "2019-12-25T10:00:00")
    assert code == 0
    assert "up to 16 days away from the span, more than 14" in err
    assert call(capsys, *words, "--start", "2019-12-23T10:00:00")[2] == ""
    late = (*words, "--start", "2019-12-25T10:00:00", "--oldest", "20")
    assert call(capsys, *late)[2] == ""
    omm = tmp_path / "iss.omm"
    assert call(capsys, "convert", str(file), str(omm))[0] == 0
    text = omm.read_text("utf-8")
    omm.write_text(text.replace("OBJECT_ID", "COLOUR = red\nOBJECT_ID", 1), "utf-8")
    words = ("passes", str(omm), *words[2:])
    assert call(capsys, *words)[0] == 2
    code, _, err = call(capsys, *words, "--lenient")
    assert code == 0
    assert "has no keyword 'COLOUR'" in err
