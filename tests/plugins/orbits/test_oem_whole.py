"""States of an ephemeris message parsed as a whole are those that the lines give, to the bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.core.mutations import damaged

from hillsphere.errors import InputError
from hillsphere.formats import oem_reading
from hillsphere.formats.oem import read_oem

HEAD = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2026-11-21T10:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = ONE
OBJECT_ID = 2024-999A
CENTER_NAME = EARTH
REF_FRAME = ICRF
TIME_SYSTEM = {scale}
START_TIME = 2016-12-31T23:59:57
STOP_TIME = 2017-01-01T00:00:20
META_STOP
"""
STATES = """2016-12-31T23:59:57.25 7000.123456789 -1.1 +0.3 .5 7. -0.1E-3
2016-12-31T23:59:58.125Z 7001.1 -1.2e0 0.3 0.51 7.0001 -1.1E-04

COMMENT on the way
2016-12-31T23:59:59.999999 7002.7 -1.3 0.3 0.52 7.0002 1.2E+1
2017-01-01T00:00:00 7003.9 -1.4 0.3 0.53 7.0003 -0
2017-01-01T00:00:01.1234567 7004.3 -1.5 0.3 0.54 7.0004 1e-300
"""


def _read(text: str) -> Any:
    try:
        segments = read_oem(text, "x.oem")
    except InputError as error:
        return str(error)
    return [(s.epoch, s.t_s.tolist(), s.x.tolist(), s.time_digits, s.passed_over) for s in segments]


@pytest.mark.parametrize("scale", ["UTC", "TDB", "TAI"])
def test_states_as_a_whole(scale: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The dates in UTC have a leap second between them."""
    text = HEAD.format(scale=scale) + STATES
    whole = _read(text)
    assert len(whole[0][1]) == 5
    assert whole[0][1][3] == pytest.approx(2.75 + (scale == "UTC"), abs=1e-9)
    assert whole[0][3] == 7
    called = []

    def refuse(*arguments: object) -> None:
        called.append(arguments)

    monkeypatch.setattr(oem_reading, "parse_states", refuse)
    assert _read(text) == whole
    assert len(called) == 1


def test_damaged_messages_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = (HEAD.format(scale="UTC") + STATES).encode()
    texts = [damaged(sound, seed).decode("utf-8", "replace") for seed in range(150)]
    leap = STATES.replace("2017-01-01T00:00:00 ", "2016-12-31T23:59:60.5 ")
    more = "2017-01-01T00:00:01 1 2 3 4 5 6\n"
    texts += [HEAD.format(scale="UTC") + states for states in (
        leap, STATES + more, STATES + more.replace("01 ", "30 ", 1), STATES + more[:-3] + "\n",
        STATES + more.replace("1 2", "nan 2"), STATES + more.replace("01-01", "02-30"),
        STATES + more.replace("01-01", "001"), STATES.replace("7002.7", "7_002.7"),
    )]  # fmt: skip
    # outside UTC no minute has a second 60
    texts.append(HEAD.format(scale="TDB") + leap)
    whole = [_read(text) for text in texts]
    monkeypatch.setattr(oem_reading, "parse_states", lambda *_arguments: None)
    lines = [_read(text) for text in texts]
    assert [seed for seed, (a, b) in enumerate(zip(whole, lines, strict=True)) if a != b] == []
    assert sum(isinstance(result, list) for result in lines) > 10
    assert np.isfinite([result[0][1][-1] for result in lines if isinstance(result, list)]).all()
