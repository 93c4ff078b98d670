"""Orbit mean-elements messages: what SGP4 cannot fly is refused."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere_tracking.omm import read_omms
from hillsphere_tracking.satellites import orbits_of

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
        (
            ("2007-064T10", "2007-366T10"),
            "EPOCH: the year 2007 has the days 001 to 365, got day 366",
        ),
        (("2007-064T10", "2007-064T25"), "EPOCH: .*bad hour"),
        (("EPOCH = 2007-064T10:34:41.4264\n", ""), "EPOCH is missing"),
        (("= 23581", "= 23x81"), "NORAD_CAT_ID must be a whole number"),
        (("GM = 398600.8", "GM = 1\nGM = 2"), "m:18: GM occurs twice"),
        (("GM = 398600.8", "what is this"), "m:17: expected KEYWORD = value"),
    ],
)
def test_faults_are_named(change: tuple[str, str], match: str) -> None:
    assert change[0] in KVN
    with pytest.raises(InputError, match=match):
        read_omms(KVN.replace(*change), "m")


@pytest.mark.parametrize(
    ("when", "day"),
    [("2007-001T00:00:00", "2007-01-01"), ("2007-365T12:00:00", "2007-12-31"),
     ("2008-366T12:00:00Z", "2008-12-31"), ("2008-060T00:00:00", "2008-02-29")],
)  # fmt: skip
def test_days_of_the_year(when: str, day: str) -> None:
    (message,) = read_omms(KVN.replace("2007-064T10:34:41.4264", when))
    assert message.epoch.isot(np.zeros(1))[0].startswith(day)


@pytest.mark.parametrize("when", ["2007-000", "2007-366", "2008-367", "2008-000", "2007-999"])
def test_days_that_the_year_does_not_have(when: str) -> None:
    with pytest.raises(
        InputError, match=rf"m:10 \(GOES 9\): EPOCH: the year {when[:4]} has the days"
    ):
        read_omms(KVN.replace("2007-064", when), "m")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (("INCLINATION =", "INCLINATON ="), "m:13: .* no keyword 'INCLINATON'; did you mean 'INCL"),
        (("GM =", "GRAVITY ="), "m:17: .* no keyword 'GRAVITY'"),
        (("3.0539 [deg]", "3.0539 [rad]"), r"m:13: INCLINATION must be in deg, got the unit 'rad'"),
        (("0.0005013", "0.0005013 [deg]"), "m:12: ECCENTRICITY must be in no unit"),
        (("= 0.0001", "= 0.000_1"), "BSTAR must be a finite number; got '0.000_1'"),
    ],
)
def test_keywords_and_units_of_the_standard(change: tuple[str, str], match: str) -> None:
    assert change[0] in KVN
    with pytest.raises(InputError, match=match):
        read_omms(KVN.replace(*change), "m")


def test_unknown_elements_of_xml_are_told_with_their_line() -> None:
    text = _xml(KVN.replace("COMMENT some words\n", "").replace("INCLINATION", "INCLINATON"))
    with pytest.raises(InputError, match=r"m:3: .* no keyword 'INCLINATON'; did you mean"):
        read_omms("\n" + text.replace("<INCLINATON", "\n<INCLINATON"), "m")
    with pytest.raises(InputError, match="m:1: 'MASS' must hold a value"):
        read_omms("<omm><MASS><GM>1</GM></MASS></omm>", "m")


def test_all_keywords_of_the_standard_are_known() -> None:
    """CCSDS 502.0-B-3, tables 4-1 to 4-3."""
    further = {
        "CCSDS_OMM_VERS": ["CLASSIFICATION = none"], "ORIGINATOR": ["MESSAGE_ID = A"],
        "REF_FRAME": ["REF_FRAME_EPOCH = 2000-01-01T00:00:00"],
        "GM": ["MASS = 1 [kg]", "SOLAR_RAD_AREA = 1 [m**2]", "SOLAR_RAD_COEFF = 1", "DRAG_AREA = 1",
               "DRAG_COEFF = 2"],
        "MEAN_MOTION_DDOT": ["COV_REF_FRAME = RTN", "CX_X = 1 [km**2]", "CY_DOT_X = 1",
                             "CZ_DOT_Z_DOT = 1", "USER_DEFINED_EARTH_MODEL = WGS-84"],
    }  # fmt: skip
    lines = [
        each for line in KVN.splitlines() for each in (line, *further.get(line.split()[0], ()))
    ]
    (message,) = read_omms("\n".join(lines))
    assert {"GM", "comments", "covariance"} <= set(message.passed_over)
    with pytest.raises(InputError, match="no keyword 'CX_Y'"):
        read_omms(KVN + "CX_Y = 1")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (
            ("OMM_VERS = 2.0", "OMM_VERS = 9.0"),
            r"m:1 .*OMM_VERS must be 2.0 or 3.0",
        ),
        (("CCSDS_OMM_VERS = 2.0\n", ""), "m:25: .* lacks CCSDS_OMM_VERS"),
        (("REF_FRAME = TEME\n", ""), "m:25: .* lacks REF_FRAME"),
        (("MEAN_ELEMENT_THEORY = SGP/SGP4\n", ""), "m:25: .* lacks MEAN_ELEMENT_THEORY"),
        (("REV_AT_EPOCH = 4316", "REV_AT_EPOCH ="), "m:23: REV_AT_EPOCH has no value"),
        (("EPHEMERIS_TYPE = 0", "EPHEMERIS_TYPE = 4"), r"m:19 .*got '4' \(SGP4-XP\)"),
    ],
)
def test_version_and_mandatory_keywords(change: tuple[str, str], match: str) -> None:
    """CCSDS 502.0-B-3, tables 4-1 to 4-3."""
    assert change[0] in KVN
    with pytest.raises(InputError, match=match):
        read_omms(KVN.replace(*change), "m")


def test_the_order_of_keywords_and_a_bare_header_are_tolerated() -> None:
    turned = KVN.replace("OBJECT_NAME = GOES 9\n", "").replace(
        "TIME_SYSTEM = UTC\n", "TIME_SYSTEM = UTC\nOBJECT_NAME = GOES 9\n"
    )
    bare = KVN.replace("ORIGINATOR = NOAA/USA\n", "")
    for text, match in (
        (turned, "m:8: OBJECT_NAME must stand before TIME_SYSTEM"),
        (bare, "m:25: .* lacks ORIGINATOR"),
        (_xml(turned.replace("COMMENT some words\n", "")), "m:1: OBJECT_NAME must stand before"),
    ):
        with pytest.raises(InputError, match=match):
            read_omms(text, "m")
        (message,) = read_omms(text, "m", lenient=True)
        assert message.fields == read_omms(KVN)[0].fields
        assert len(message.warnings) == 1
    empty = KVN.replace("2007-065T16:00:00", "").replace("NOAA/USA", "")
    assert read_omms(empty)[0] == read_omms(KVN)[0], "as CelesTrak's XML leaves them"


def test_comments_before_the_header() -> None:
    text = "\ufeff\nCOMMENT from somewhere\n\nCOMMENT GM = 3\n" + KVN
    assert read_omms(text) == read_omms(KVN)
    (orbit,) = orbits_of(text, "m")
    assert orbit.name == "GOES 9"
    assert len(read_omms(text + text[1:])) == 2


# Keys and forms of the answers of CelesTrak (gp.php?FORMAT=json, csv) and Space-Track (class gp).
CELESTRAK_JSON = """[{
    "OBJECT_NAME": "GOES 9", "OBJECT_ID": "1995-025A",
    "EPOCH": "2007-03-05T10:34:41.426400", "MEAN_MOTION": 1.00273272, "ECCENTRICITY": 0.0005013,
    "INCLINATION": 3.0539, "RA_OF_ASC_NODE": 81.7939, "ARG_OF_PERICENTER": 249.2363,
    "MEAN_ANOMALY": 150.1602, "EPHEMERIS_TYPE": 0, "CLASSIFICATION_TYPE": "U",
    "NORAD_CAT_ID": 23581, "ELEMENT_SET_NO": 925, "REV_AT_EPOCH": 4316, "BSTAR": 0.0001,
    "MEAN_MOTION_DOT": -1.13e-6, "MEAN_MOTION_DDOT": 0
}]"""
CELESTRAK_CSV = (
    "OBJECT_NAME,OBJECT_ID,EPOCH,MEAN_MOTION,ECCENTRICITY,INCLINATION,RA_OF_ASC_NODE,"
    "ARG_OF_PERICENTER,MEAN_ANOMALY,EPHEMERIS_TYPE,CLASSIFICATION_TYPE,NORAD_CAT_ID,"
    "ELEMENT_SET_NO,REV_AT_EPOCH,BSTAR,MEAN_MOTION_DOT,MEAN_MOTION_DDOT\r\n"
    "GOES 9,1995-025A,2007-03-05T10:34:41.426400,1.00273272,.0005013,3.0539,81.7939,249.2363,"
    "150.1602,0,U,23581,925,4316,.1E-3,-.113E-5,0\r\n"
)
SPACE_TRACK_JSON = """[{"CCSDS_OMM_VERS":"2.0","COMMENT":"GENERATED VIA SPACE-TRACK.ORG API",
"CREATION_DATE":"2007-03-05T16:00:00","ORIGINATOR":"18 SPCS","OBJECT_NAME":"GOES 9",
"OBJECT_ID":"1995-025A","CENTER_NAME":"EARTH","REF_FRAME":"TEME","TIME_SYSTEM":"UTC",
"MEAN_ELEMENT_THEORY":"SGP4","EPOCH":"2007-03-05T10:34:41.426400","MEAN_MOTION":"1.00273272",
"ECCENTRICITY":"0.00050130","INCLINATION":"3.0539","RA_OF_ASC_NODE":"81.7939",
"ARG_OF_PERICENTER":"249.2363","MEAN_ANOMALY":"150.1602","EPHEMERIS_TYPE":"0",
"CLASSIFICATION_TYPE":"U","NORAD_CAT_ID":"23581","ELEMENT_SET_NO":"925","REV_AT_EPOCH":"4316",
"BSTAR":"0.00010000000000","MEAN_MOTION_DOT":"-0.00000113","MEAN_MOTION_DDOT":"0.0000000000000",
"SEMIMAJOR_AXIS":"42164.7","PERIOD":"1436.076","APOAPSIS":"35807.7","PERIAPSIS":"35765.4",
"OBJECT_TYPE":"PAYLOAD","RCS_SIZE":"LARGE","COUNTRY_CODE":"US","LAUNCH_DATE":"1995-05-23",
"SITE":"AFETR","DECAY_DATE":null,"FILE":"1","GP_ID":"1","TLE_LINE0":"0 GOES 9",
"TLE_LINE1":"1 23581U","TLE_LINE2":"2 23581"}]"""

_PAIRS = [(key, value or "") for key, value in json.loads(SPACE_TRACK_JSON)[0].items()]
SPACE_TRACK_CSV = "\n".join(
    ",".join(f'"{text}"' for text in row) for row in zip(*_PAIRS, strict=True)
)


@pytest.mark.parametrize("text", [CELESTRAK_JSON, CELESTRAK_CSV, SPACE_TRACK_JSON, SPACE_TRACK_CSV],
                         ids=["gp_json", "gp_csv", "track_json", "track_csv"])  # fmt: skip
def test_elements_of_public_services(text: str) -> None:
    assert read_omms(text) == read_omms(KVN)
    (orbit,) = orbits_of("\ufeff" + text, "m")
    assert (orbit.name, orbit.catalogue_number) == ("GOES 9", "23581")
    (standard,) = orbits_of(KVN, "m")
    times = np.linspace(-1e5, 1e5, 5)
    assert np.array_equal(orbit.states(times), standard.states(times))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (CELESTRAK_JSON.replace("INCLINATION", "INCLINATON"),
         "m, message 1: .* no keyword 'INCLINATON'; did you mean 'INCLINATION'"),
        (CELESTRAK_JSON.replace("3.0539", "[3.0539]"), "message 1: INCLINATION must be a number"),
        (CELESTRAK_JSON.replace("3.0539", "NaN"), "m: not well-formed JSON: NaN is no number"),
        (CELESTRAK_JSON.replace("3.0539", "1e999"), "INCLINATION must be a finite number"),
        (CELESTRAK_JSON.replace("3.0539", "null"), "INCLINATION must be .* it is missing"),
        (CELESTRAK_JSON.replace('"BSTAR"', '"MEAN_MOTION"'), "MEAN_MOTION occurs twice"),
        (CELESTRAK_JSON[:-1], "m: not well-formed JSON"),
        ("[" * 100_000 + "{", "m"),
        ("[]", "no orbit mean-elements message"),
        ("[{}, 3]", "m, message 1: MEAN_MOTION|m, message 1: NORAD|m, message 1"),
        (CELESTRAK_CSV.replace("INCLINATION", "INCLINATON"), "m:2: .* no keyword 'INCLINATON'"),
        (CELESTRAK_CSV.replace(",4316", ""), "m:2: expected 17 columns, got 16"),
        (CELESTRAK_CSV.replace("BSTAR", "MEAN_MOTION"), "m:2: MEAN_MOTION occurs twice"),
        (CELESTRAK_CSV.replace("GOES 9,", 'GOES "9,').replace("1995", '"'), "m:"),
        ("\n\n" + CELESTRAK_CSV.replace("3.0539", "183.0539"), r"m:4 \(GOES 9\): INCLINATION must"),
    ],
)  # fmt: skip
def test_faults_of_json_and_csv_are_named(text: str, match: str) -> None:
    with pytest.raises(InputError, match=match):
        read_omms(text, "m")


def test_a_catalogue_number_of_nine_digits() -> None:
    (orbit,) = orbits_of(KVN.replace("= 23581", "= 799501234"), "m")
    assert orbit.catalogue_number == "799501234"


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
