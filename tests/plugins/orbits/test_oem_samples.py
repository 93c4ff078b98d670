"""Sample orbit ephemeris messages, written after CCSDS 502.0-B-3: sound ones and broken ones."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere.formats.ccsds_times import plain_seconds, read_ccsds_time
from hillsphere.formats.oem import OemSegment, read_oem, write_oem

SAMPLES = Path(__file__).parent / "data" / "oem"
VALID = sorted((SAMPLES / "valid").iterdir())
BROKEN = [row.split(" | ") for row in (SAMPLES / "broken.txt").read_text("utf-8").splitlines()[1:]]
PLAIN = np.array(
    [
        [9376.5e3, -1.5e3, 0.25e3, 1.0, 2138.0, -500.0],
        [9376.4e3, 126.8e3, -29.7e3, -41.0, 2137.5, -499.9],
        [9372.7e3, 255.0e3, -59.7e3, -82.9, 2136.5, -499.7],
        [9366.5e3, 383.1e3, -89.6e3, -124.8, 2134.9, -499.3],
    ]
).T
"""The states of all samples, m and m/s, but for a digit or two."""
HALF = np.zeros((6, 6))
HALF[:3, :3] = [[1e6, 0.5e6, 0], [0.5e6, 1e6, 0], [0, 0, 1e6]]
HALF[3:, 3:] = np.eye(3)
RTN = np.diag([400.0, 900.0, 100.0, 1e-4, 1e-4, 4e-4])
RTN[0, 1] = RTN[1, 0] = 100.0


def sample(name: str) -> str:
    return (SAMPLES / "valid" / name).read_bytes().decode("utf-8")


def one(name: str) -> OemSegment:
    return read_oem(sample(name), name)[0]


def assert_same(first: OemSegment, second: OemSegment) -> None:
    """Compare all that two segments hold, to the last bit."""
    for entry in fields(OemSegment):
        a, b = getattr(first, entry.name), getattr(second, entry.name)
        if entry.name == "covariances":
            assert [(c.t_s, c.ref_frame) for c in a] == [(c.t_s, c.ref_frame) for c in b]
            for c, d in zip(a, b, strict=True):
                np.testing.assert_array_equal(c.matrix, d.matrix)
        elif isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b)
        elif entry.name != "passed_over":
            assert a == b, entry.name


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.name)
def test_a_sound_message_is_read_and_comes_back(path: Path) -> None:
    segments = read_oem(sample(path.name), path.name)
    first = segments[0]
    assert (first.object_name, first.object_id) == ("PROBE", "2026-001A")
    np.testing.assert_allclose(first.t_s, [0, 60, 120, 180], rtol=0, atol=0.2)
    np.testing.assert_allclose(first.x, PLAIN, rtol=1e-4)
    for encoding in ("kvn", "xml"):
        again = read_oem(write_oem(segments, encoding=encoding))
        for written, got in zip(segments, again, strict=True):
            assert_same(written, got)


def test_what_the_samples_state() -> None:
    np.testing.assert_array_equal(one("plain.oem").x, PLAIN)
    assert_same(one("plain.oem"), one("plain.xml"))
    np.testing.assert_array_equal(
        one("accelerations.oem").accelerations_m_s2, np.array([[-0.4, 1e-3, -2.5e-3]] * 4).T
    )
    useable = one("useable.oem")
    assert (useable.useable_start_s, useable.useable_stop_s) == pytest.approx((30.0, 150.0))
    hermite, lagrange = one("hermite.oem"), one("lagrange.oem")
    assert (hermite.interpolation, hermite.interpolation_degree) == ("HERMITE", 7)
    assert (lagrange.interpolation, lagrange.interpolation_degree) == ("LAGRANGE", 3)
    first, second = one("two-covariances.oem").covariances
    assert (first.ref_frame, second.ref_frame) == ("RTN", "")
    assert (first.t_s, second.t_s) == pytest.approx((60.0, 120.0))
    np.testing.assert_allclose(first.matrix, RTN, rtol=1e-15)
    np.testing.assert_array_equal(second.matrix, HALF)
    assert [len(read_oem(sample(name))) for name in ("plain.oem", "two-segments.oem")] == [1, 2]
    epoch = one("frame-epoch.oem").ref_frame_epoch
    assert epoch is not None
    assert epoch.isot(np.zeros(1), 0) == ["2027-01-01T00:00:00"]
    assert (one("itrf.oem").ref_frame, one("itrf.oem").epoch.scale) == ("ITRF2000", "UTC")
    assert one("comments.oem").passed_over == ("comments",)
    assert one("version-3.oem").passed_over == ("CLASSIFICATION", "MESSAGE_ID")
    digits = one("exact-digits.oem")
    assert digits.x[0, 0] == 9376123.456789012
    assert digits.time_digits == 9


@pytest.mark.parametrize("scale", ["UTC", "TDB", "GPS", "UT1"])
def test_times_read_at_once_are_those_read_one_by_one(scale: str) -> None:
    """A date by the day of the year is read for itself, and so are all others of its segment."""
    texts = ["2016-12-31T23:59:59.123456789", "2017-01-01T00:00:00Z", "2017-02-28T12:34:56.7"]
    each = [read_ccsds_time(text, scale) for text in texts]
    base = each[0].to("TAI") if scale in ("UTC", "UT1") else each[0]
    seconds = plain_seconds(texts, base, scale)
    if scale == "UT1":
        assert seconds is None
    else:
        np.testing.assert_array_equal(seconds, [one.seconds_since(base) for one in each])
    for odd in ("2017-001T00:00:00", "2017-02-29T00:00:00", "2016-12-31T23:59:60", "", "2017"):
        assert plain_seconds([*texts, odd], base, scale) is None


def test_every_broken_sample_is_in_the_table() -> None:
    assert sorted(name for name, _, _ in BROKEN) == sorted(
        path.name for path in (SAMPLES / "broken").iterdir()
    )


@pytest.mark.parametrize(("name", "line", "words"), BROKEN, ids=[row[0] for row in BROKEN])
def test_a_broken_message_is_refused_at_its_line(name: str, line: str, words: str) -> None:
    text = (SAMPLES / "broken" / name).read_bytes().decode("utf-8")
    with pytest.raises(InputError) as caught:
        read_oem(text, name)
    message = str(caught.value)
    assert words in message
    assert "\n" not in message
    # 0: the fault is what the message lacks at its end
    assert re.match(rf"{re.escape(name)}:{line if line != '0' else r'[0-9]+'}: ", message)


def test_the_example_covariance_of_the_standard_is_accepted() -> None:
    """CCSDS 502.0-B, figure 5-3: a covariance of eight digits."""
    rows = """3.3313494e-04
4.6189273e-04 6.7824216e-04
-3.0700078e-04 -4.2212341e-04 3.2319319e-04
-3.3493650e-07 -4.6860842e-07 2.4849495e-07 4.2960228e-10
-2.2118325e-07 -2.8641868e-07 1.7980986e-07 2.6088992e-10 1.7675147e-10
-3.0413460e-07 -4.9894969e-07 3.5403109e-07 1.8692631e-10 1.0088625e-10 6.2244443e-10"""
    text = re.sub(r"(?s)4e-4\n.*4e-10", rows, sample("covariance.oem"))
    (covariance,) = read_oem(text)[0].covariances
    assert covariance.matrix[0, 0] == 333.13494


_WORDS = st.sampled_from(
    ["NaN", "=", "META_STOP", "COVARIANCE_STOP", "COMMENT", "1e999", "-", "<X>", "</data>", "\0",
     "2027-03-01T00:00:60", "9" * 400, "é", "\u2028", "<oem/>", "EPOCH = 2027-03-01T00:00:00"]
)  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(
    path=st.sampled_from([*VALID, *(SAMPLES / "broken" / row[0] for row in BROKEN)]),
    edits=st.lists(
        st.tuples(
            st.floats(0.0, 1.0), st.integers(0, 40), st.one_of(_WORDS, st.text(max_size=4))
        ),
        max_size=4,
    ),
)  # fmt: skip
def test_a_mutated_message_is_read_or_refused(
    path: Path, edits: list[tuple[float, int, str]]
) -> None:
    text = path.read_bytes().decode("utf-8")
    for at, cut, inserted in edits:
        begin = int(at * len(text))
        text = text[:begin] + inserted + text[begin + cut :]
    segments: list[OemSegment] = []
    message = ""
    try:
        segments = read_oem(text, "m")
    except InputError as error:
        message = str(error)
    assert segments or re.match(r"m:\d+: ", message)
    assert len(message) < 2000
    for segment in segments:
        assert np.all(np.diff(segment.t_s) > 0.0)
        assert np.all(np.isfinite(segment.x))
