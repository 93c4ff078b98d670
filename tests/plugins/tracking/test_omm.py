"""Orbit mean-elements messages: what SGP4 cannot fly is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere_tracking.omm import read_omms

# CCSDS 502.0-B, the example of an OMM with TLE-related data
KVN = """CCSDS_OMM_VERS = 2.0
CREATION_DATE = 2007-065T16:00:00
ORIGINATOR = NOAA/USA
OBJECT_NAME = GOES 9
OBJECT_ID = 1995-025A
CENTER_NAME = EARTH
REF_FRAME = TEME
TIME_SYSTEM = UTC
MEAN_ELEMENT_THEORY = SGP/SGP4
EPOCH = 2007-064T10:34:41.4264
MEAN_MOTION = 1.00273272 [rev/day]
ECCENTRICITY = 0.0005013
INCLINATION = 3.0539 [deg]
RA_OF_ASC_NODE = 81.7939
ARG_OF_PERICENTER = 249.2363
MEAN_ANOMALY = 150.1602
GM = 398600.8
COMMENT some words
EPHEMERIS_TYPE = 0
CLASSIFICATION_TYPE = U
NORAD_CAT_ID = 23581
ELEMENT_SET_NO = 0925
REV_AT_EPOCH = 4316
BSTAR = 0.0001
MEAN_MOTION_DOT = -0.00000113
MEAN_MOTION_DDOT = 0.0
"""


def _xml(fields: str) -> str:
    leaves = re.sub(r"(\w+) = (.*?)(?: \[.*\])?\n", r"<\1>\2</\1>", fields)
    return f"<ndm xmlns='urn:x'><omm><body>{leaves}</body></omm></ndm>"


def test_the_standards_example() -> None:
    (message,) = read_omms(KVN)
    assert message.name == "GOES 9"
    assert message.epoch.isot(np.zeros(1), 4) == ["2007-03-05T10:34:41.4264"]
    assert float(message.fields["MEAN_MOTION"]) == 1.00273272
    assert message.fields["NORAD_CAT_ID"] == "23581"


def test_several_messages_in_one_file() -> None:
    assert len(read_omms(KVN + "\n" + KVN)) == 2
    plain = KVN.replace("COMMENT some words\n", "").replace("NOAA/USA", "NOAA")
    one = _xml(plain)
    (message,) = read_omms("\ufeff" + one)
    assert message == read_omms(KVN)[0]
    inner = one[one.index("<omm>") : one.index("</ndm>")]
    assert len(read_omms(f"<ndm>{inner}{inner}</ndm>")) == 2


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (("REF_FRAME = TEME", "REF_FRAME = EME2000"), "REF_FRAME must be TEME .*'EME2000'"),
        (("SGP/SGP4", "SGP4-XP"), "MEAN_ELEMENT_THEORY must be SGP4"),
        (("TIME_SYSTEM = UTC", "TIME_SYSTEM = GPS"), "TIME_SYSTEM must be UTC"),
        (("CENTER_NAME = EARTH", "CENTER_NAME = MARS"), "CENTER_NAME must be EARTH"),
        (("EPHEMERIS_TYPE = 0", "EPHEMERIS_TYPE = 4"), "EPHEMERIS_TYPE must be 0 or 2"),
        (("BSTAR = 0.0001\n", ""), r"m:1 \(GOES 9\): BSTAR must be .* it is missing"),
        (("BSTAR = 0.0001", "BSTAR = nan"), "BSTAR must be a finite number; got 'nan'"),
        (("0.0005013", "1.5"), "ECCENTRICITY must be between 0 and 1, got 1.5"),
        (("1.00273272", "0"), "MEAN_MOTION must be between"),
        (("3.0539", "181"), "INCLINATION must be between 0 and 180"),
        (("2007-064T10", "2007-366T10"), "EPOCH: .*day of the year"),
        (("2007-064T10", "2007-064T25"), "EPOCH: .*bad hour"),
        (("EPOCH = 2007-064T10:34:41.4264\n", ""), "EPOCH is missing"),
        (("= 23581", "= 23x81"), "NORAD_CAT_ID must be a whole number"),
        (("GM = 398600.8", "GM = 1\nGM = 2"), "m:18: GM stands twice"),
        (("GM = 398600.8", "what is this"), "m:17: expected KEYWORD = value"),
    ],
)
def test_faults_are_named(change: tuple[str, str], match: str) -> None:
    assert change[0] in KVN
    with pytest.raises(InputError, match=match):
        read_omms(KVN.replace(*change), "m")


def test_xml_that_is_none() -> None:
    with pytest.raises(InputError, match="not well-formed"):
        read_omms("<ndm><omm></ndm>")
    with pytest.raises(InputError, match="no orbit mean-elements message"):
        read_omms("<ndm></ndm>")
    with pytest.raises(InputError, match="must not contain a DOCTYPE"):
        read_omms("<!DOCTYPE a [<!ENTITY b 'c'>]><ndm>&b;</ndm>")


@given(st.text(max_size=200))
def test_any_text_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        read_omms(text)
