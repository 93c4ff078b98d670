"""Sample tracking data messages, written after CCSDS 503.0-B-2: sound ones and broken ones."""

from __future__ import annotations

import re
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.formats.ccsds_entries import Leniency
from hillsphere.formats.tdm import TdmSegment, read_tdm, write_tdm
from hillsphere.formats.tdm_reading import TdmRecord, records_and_faults

SAMPLES = Path(__file__).parents[1] / "data" / "tdm"
VALID = sorted((SAMPLES / "valid").iterdir())
BROKEN = [row.split(" | ") for row in (SAMPLES / "broken.txt").read_text("utf-8").splitlines()[1:]]
TOLERATED = {
    *("azimuth-360.tdm", "comment-above.tdm", "comment-in-data.tdm", "correction-unclear.tdm"),
    "data-types.tdm",
    *("frequency-number.tdm", "header-order.tdm", "keyword.xml", "metadata-order.tdm"),
    *("metadata-order.xml", "no-creation-date.tdm", "no-data-stop.tdm", "no-degree.tdm"),
    *("no-frame.tdm", "no-originator.tdm", "no-path.tdm", "participant-six.tdm"),
    *("path-blanks.tdm", "same-time.tdm", "units-superfluous.xml", "unknown-header.tdm"),
    "elevation.tdm",
    *("unknown-keyword.tdm", "unknown-metadata.tdm", "z-of-tai.tdm"),
}
"""Broken messages that a lenient reader reads."""


def sample(name: str, kind: str = "valid") -> str:
    return (SAMPLES / kind / name).read_bytes().decode("utf-8")


def one(name: str) -> TdmSegment:
    return read_tdm(sample(name), name)[0]


def assert_same(first: TdmSegment, second: TdmSegment) -> None:
    """Compare all that two segments hold, to the last bit."""
    assert replace(first.meta, fields={}) == replace(second.meta, fields={})
    assert first.epoch == second.epoch
    assert first.comments == second.comments
    assert first.series.keys() == second.series.keys()
    for key, series in first.series.items():
        np.testing.assert_array_equal(series.t_s, second.series[key].t_s)
        np.testing.assert_array_equal(series.values, second.series[key].values)
    for key, digits in first.counts.items():
        np.testing.assert_array_equal(digits, second.counts[key])


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.name)
def test_a_sound_message_is_read_and_comes_back(path: Path) -> None:
    segments = read_tdm(sample(path.name), path.name)
    for encoding in ("kvn", "xml"):
        again = read_tdm(write_tdm(segments, encoding=encoding))
        for written, got in zip(segments, again, strict=True):
            assert_same(written, got)


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.name)
def test_record_by_record_is_the_same(path: Path) -> None:
    text = sample(path.name)
    records = list(records_and_faults(text.splitlines(keepends=True)))
    assert all(isinstance(record, TdmRecord) for record in records)
    whole = read_tdm(text)
    for key in {key for segment in whole for key in segment.series}:
        values = [series.values for s in whole if (series := s.series.get(key)) is not None]
        each = [r.value for r in records if isinstance(r, TdmRecord) and r.keyword == key]
        np.testing.assert_array_equal(np.concatenate(values), each)


def test_what_the_samples_state() -> None:
    azel = one("angles-azel.tdm")
    np.testing.assert_allclose(np.degrees(azel.azimuth_rad), [359.5, 0.25, 1.75], rtol=1e-15)
    np.testing.assert_allclose(azel.t_s, [0.0, 1.0, 2.5], rtol=0.0, atol=1e-10)
    assert_same(azel, one("angles-azel.xml"))
    assert one("range-km.tdm").series["RANGE"].values.tolist() == [1500123.456789, 1501100, 1502100]
    units = one("range-units.tdm")
    assert (units.meta.range_units, units.meta.range_modulus) == ("RU", 2.6e7)
    assert units.meta.transmit_delays_s == {1: 7.7e-5, 2: 0.0}
    ranges = one("range-and-correction.tdm")
    assert ranges.corrected("RANGE").values.tolist() == [1499250.0, 1500250.0, 1501250.0]
    ramp = one("doppler-two-way-ramped.tdm").meta
    assert (ramp.turnaround, ramp.integration_interval_s) == ((880, 749), 60.0)
    weather = one("media-and-weather.tdm").series
    assert weather["PRESSURE"].values[2] == 101325.0
    assert weather["RHUMIDITY"].values[0] == 0.12
    assert one("ionosphere.tdm").series["STEC"].values[0] == 23.1e16
    assert one("differenced-doppler.tdm").meta.path_2 == (1, 2, 3)
    degraded = read_tdm(sample("degraded.tdm"))
    assert [s.meta.data_quality for s in degraded] == ["", "DEGRADED"]
    # 19 s between GPS time and TAI, 37 s between UTC and TAI in 2026
    assert one("gps-time.tdm").epoch.seconds_since(azel.epoch) == pytest.approx(-18.0, abs=1e-4)
    # a leap second at the end of 2016
    assert one("leap-second.tdm").series["RANGE"].t_s == pytest.approx([0, 1.5, 2], abs=1e-9)
    assert [s.meta.participants[1] for s in read_tdm(sample("combined.xml"))] == ["SCD1", "SCD2"]


def test_phase_counts_keep_their_digits() -> None:
    high, low = one("phase-counts.tdm").exact_counts("TRANSMIT_PHASE_CT_1")
    exact = Decimal("7175173390790546885.123456789012")
    assert abs(exact - Decimal(high[2]) - Decimal(low[2])) < Decimal("1e-12")
    assert Decimal(high[2]) != exact


def test_every_broken_sample_is_in_the_table() -> None:
    names = sorted(name for name, _, _ in BROKEN)
    assert names == sorted(path.name for path in (SAMPLES / "broken").iterdir())
    assert set(names) > TOLERATED


@pytest.mark.parametrize(("name", "line", "words"), BROKEN, ids=[row[0] for row in BROKEN])
def test_a_broken_message_is_refused_at_its_line(name: str, line: str, words: str) -> None:
    text = sample(name, "broken")
    with pytest.raises(InputError) as caught:
        read_tdm(text, name)
    message = str(caught.value)
    assert words in message
    # 0: the fault is what the message lacks at its end
    assert re.match(rf"{re.escape(name)}:{line if line != '0' else r'[0-9]+'}: ", message)
    said: list[str] = []
    if name in TOLERATED:
        assert read_tdm(text, name, lenient=True, warn=said.append)
        assert len(said) == 1
    else:
        with pytest.raises(InputError):
            read_tdm(text, name, lenient=True, warn=said.append)


def test_leniency_tells_of_a_kind_once() -> None:
    leniency = Leniency(strict=False, warn=len)
    for line in range(3):
        leniency.tolerate(f"f:{line}: unknown", "kind")
    assert leniency.warnings == ["f:0: unknown"]
    with pytest.raises(InputError, match="f:1: wrong"):
        Leniency().tolerate("f:1: wrong")
