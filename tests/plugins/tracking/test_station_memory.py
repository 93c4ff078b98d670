"""What a station keeps of its biases between passes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere.time import Epoch
from hillsphere_tracking.memory import (
    Calibration,
    RandomWalk,
    age_calibration,
    combine_calibrations,
    read_memory,
    remember,
    write_memory,
)

DEGREE = np.pi / 180.0
EPOCH = Epoch.parse("2027-06-01T12:45:00", "UTC")
LATER = Epoch.parse("2027-06-05T12:45:00", "UTC")
UNIT = np.array([DEGREE, DEGREE, 1.0])


def _calibration(seed: int = 0, passes: int = 3) -> Calibration:
    random = np.random.default_rng(seed)
    root = random.normal(size=(3, 3)) * np.array([0.02, 0.01, 0.1])[:, None] * UNIT[:, None]
    return Calibration(EPOCH, random.normal(size=3) * UNIT * 0.05, root @ root.T, passes)


@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_a_memory_comes_back(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    path = tmp_path_factory.mktemp("memory") / "stations.json"
    kept = {"Alcântara": _calibration(seed), "Cuiabá": _calibration(seed + 1, 7)}
    write_memory(path, kept)
    back = read_memory(path)
    assert sorted(back) == sorted(kept)
    for name, calibration in kept.items():
        scale = np.sqrt(np.diag(calibration.covariance))
        np.testing.assert_allclose(back[name].mean, calibration.mean, rtol=1e-14)
        np.testing.assert_allclose(
            back[name].covariance, calibration.covariance, rtol=0, atol=1e-13 * np.max(scale) ** 2
        )
        assert back[name].passes == calibration.passes
        assert back[name].epoch.seconds_since(EPOCH) == pytest.approx(0.0, abs=1e-6)


def test_a_person_can_read_it(tmp_path: Path) -> None:
    path = tmp_path / "stations.json"
    sigma = np.array([0.01, 0.02, 0.1]) * UNIT
    mean = np.array([0.05, -0.02, 0.3]) * UNIT
    remember(path, "Alcântara", Calibration(EPOCH, mean, np.diag(sigma**2), 3))
    entry = json.loads(path.read_text(encoding="utf-8"))["stations"]["Alcântara"]
    assert entry["utc"] == "2027-06-01T12:45:00.000000"
    assert entry["azimuth_bias_deg"]["value"] == pytest.approx(0.05)
    assert entry["elevation_bias_deg"]["sigma"] == pytest.approx(0.02)
    assert entry["time_offset_s"] == {"value": pytest.approx(0.3), "sigma": pytest.approx(0.1)}
    assert "Alcântara" in path.read_text(encoding="utf-8")


def test_a_missing_memory_is_empty_and_others_are_left(tmp_path: Path) -> None:
    path = tmp_path / "stations.json"
    assert dict(read_memory(path)) == {}
    remember(path, "A", _calibration(1))
    remember(path, "B", _calibration(2))
    before = read_memory(path)["A"].mean.tolist()
    remember(path, "B", _calibration(3))
    assert sorted(read_memory(path)) == ["A", "B"]
    assert read_memory(path)["A"].mean.tolist() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["stations.json"]


def test_forgetting_is_a_random_walk() -> None:
    calibration = _calibration()
    walk = RandomWalk(0.003 * DEGREE, 0.05)
    old = age_calibration(calibration, LATER, walk)
    grown = np.diag(old.covariance - calibration.covariance)
    # four days: twice the daily deviation
    np.testing.assert_allclose(np.sqrt(grown), [0.006 * DEGREE, 0.006 * DEGREE, 0.1], rtol=1e-9)
    assert old.mean.tolist() == calibration.mean.tolist()
    # in two steps as in one
    middle = age_calibration(calibration, Epoch.parse("2027-06-02T00:00:00", "UTC"), walk)
    np.testing.assert_allclose(
        age_calibration(middle, LATER, walk).covariance, old.covariance, rtol=1e-9, atol=1e-16
    )


def test_combining_is_the_weighted_mean() -> None:
    one, two = _calibration(4), _calibration(5, 1)
    found = combine_calibrations(one, two)
    # information form, in units in which all is near one
    weight = [np.linalg.inv(c.covariance / np.outer(UNIT, UNIT)) for c in (one, two)]
    covariance = np.linalg.inv(weight[0] + weight[1])
    mean = covariance @ (weight[0] @ (one.mean / UNIT) + weight[1] @ (two.mean / UNIT))
    np.testing.assert_allclose(found.mean / UNIT, mean, rtol=1e-6)
    np.testing.assert_allclose(found.covariance / np.outer(UNIT, UNIT), covariance, rtol=1e-6)
    assert found.passes == 4


def test_learning_over_passes_converges() -> None:
    """Thirty passes, each with an estimate of its own, of biases that wander: consistent."""
    random = np.random.default_rng(8)
    walk = RandomWalk(0.002 * DEGREE, 0.01)
    noise = np.array([0.02, 0.02, 0.1]) * UNIT
    squares = []
    for _ in range(60):
        truth = random.normal(size=3) * 0.1 * UNIT
        known = Calibration(EPOCH, np.zeros(3), np.diag((0.1 * UNIT) ** 2), 0)
        for day in range(1, 31):
            now = Epoch(EPOCH.day + day, EPOCH.fraction, "UTC")
            truth = truth + random.normal(size=3) * np.array([0.002, 0.002, 0.01]) * UNIT
            seen = Calibration(now, truth + random.normal(size=3) * noise, np.diag(noise**2), 1)
            known = combine_calibrations(age_calibration(known, now, walk), seen)
        error = (known.mean - truth) / UNIT
        covariance = known.covariance / np.outer(UNIT, UNIT)
        squares.append(error @ np.linalg.solve(covariance, error))
        assert known.passes == 30
        assert np.all(np.sqrt(np.diag(known.covariance)) < 0.5 * noise)
    # normalised errors squared have mean 3, deviation √6 of a single one
    assert np.mean(squares) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / 60.0))


def _good() -> dict[str, Any]:
    return {
        "format": "hillsphere station memory",
        "version": 1,
        "stations": {
            "A": {
                "utc": "2027-06-01T12:45:00",
                "passes": 3,
                "azimuth_bias_deg": {"value": 0.05, "sigma": 0.01},
                "elevation_bias_deg": {"value": -0.02, "sigma": 0.01},
                "time_offset_s": {"value": 0.1, "sigma": 0.02},
                "correlation": {
                    "azimuth_elevation": 0.0,
                    "azimuth_time": 0.1,
                    "elevation_time": 0.0,
                },
            }
        },
    }


def _changed(*path: str, value: Any = None) -> str:
    data = _good()
    at = data
    for key in path[:-1]:
        at = at[key]
    if value is None:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return json.dumps(data)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "damaged"),
        (json.dumps(_good())[:200], "damaged"),
        ("[1, 2]", "does not say"),
        (_changed("format", value="shopping"), "does not say"),
        (_changed("version", value=2), "version 2; this program reads version 1"),
        (_changed("stations", value=[1]), "no stations"),
        (_changed("stations", "A", value=3), "station 'A'"),
        (_changed("stations", "A", "time_offset_s"), "'time_offset_s' is missing"),
        (_changed("stations", "A", "passes", value="many"), "passes must be a whole number"),
        (_changed("stations", "A", "passes", value=-1), "-1 passes"),
        (_changed("stations", "A", "utc", value="soon"), "expected a time"),
        (_changed("stations", "A", "utc", value=5), "utc must be a time"),
        (_changed("stations", "A", "azimuth_bias_deg", "value", value="0"), "finite number"),
        (_changed("stations", "A", "azimuth_bias_deg", "sigma", value=-1.0), "sigma must be"),
        (_changed("stations", "A", "correlation", "azimuth_time", value=1.5), "positive"),
        (json.dumps(_good()).replace("0.05", "NaN"), "not a JSON number"),
        (json.dumps(_good()).replace("0.05", "1e999"), "finite number"),
    ],
)
def test_a_damaged_memory_says_so_and_is_not_overwritten(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "stations.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_memory(path)
    assert str(path) in str(caught.value)
    with pytest.raises(InputError):
        remember(path, "B", _calibration())
    assert path.read_text() == text


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "stations.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="move it away"):
        read_memory(path)


def test_the_example_is_read(tmp_path: Path) -> None:
    path = tmp_path / "stations.json"
    path.write_text(json.dumps(_good()))
    found = read_memory(path)["A"]
    np.testing.assert_allclose(found.mean / UNIT, [0.05, -0.02, 0.1], rtol=1e-12)
    assert found.covariance[0, 2] == pytest.approx(0.1 * 0.01 * DEGREE * 0.02)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"mean": np.zeros(2)}, "mean"),
        ({"mean": np.full(3, np.nan)}, "finite"),
        ({"covariance": -np.eye(3)}, "positive"),
        ({"passes": -1}, "-1 passes"),
    ],
)
def test_calibrations_that_cannot_be(keys: dict[str, Any], message: str) -> None:
    good: dict[str, Any] = {
        "epoch": EPOCH, "mean": np.zeros(3), "covariance": np.eye(3), "passes": 1,
    }  # fmt: skip
    with pytest.raises(InputError, match=message):
        Calibration(**{**good, **keys})


def test_walks_that_cannot_be() -> None:
    with pytest.raises(InputError, match="random walk"):
        RandomWalk(-1.0, 0.0)
