"""Interpolated ephemerides against a circle, of which every derivative is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.formats.oem import OemSegment
from hillsphere.formats.oem_interpolation import interpolant_of, segment_at
from hillsphere.interfaces import Array
from hillsphere.time import Epoch

RADIUS_M, RATE = 7e6, 1e-3
STEP_S = 60.0


def circle(t_s: Array) -> Array:
    cos, sin, zero = np.cos(RATE * t_s), np.sin(RATE * t_s), np.zeros_like(t_s)
    speed = RADIUS_M * RATE
    return np.stack([RADIUS_M * cos, RADIUS_M * sin, zero, -speed * sin, speed * cos, zero])


def segment(states: int = 41, begin_s: float = 0.0) -> OemSegment:
    t_s = STEP_S * np.arange(float(states))
    epoch = Epoch(2461465.5, begin_s / 86400.0)
    return OemSegment("PROBE", "1", "EARTH", "ICRF", epoch, t_s, circle(begin_s + t_s))


TIMES = np.linspace(0.0, 40 * STEP_S, 997)


@pytest.mark.parametrize(
    ("method", "degree", "position_m", "velocity_m_s"),
    [("HERMITE", 3, 1.0, 5e-2), ("HERMITE", 7, 1e-7, 8e-9), ("LAGRANGE", 7, 7e-5, 7e-8),
     ("LAGRANGE", 9, 2e-7, 2e-10), ("HERMITE", 11, 2e-8, 6e-10)],
)  # fmt: skip
def test_a_circle(method: str, degree: int, position_m: float, velocity_m_s: float) -> None:
    interpolant = interpolant_of(segment(), method, degree)
    error = np.max(np.abs(interpolant(TIMES) - circle(TIMES)), axis=1)
    assert np.max(error[:3]) < position_m
    assert np.max(error[3:]) < velocity_m_s


@pytest.mark.parametrize("method", ["HERMITE", "LAGRANGE"])
def test_the_states_themselves_come_back(method: str) -> None:
    flown = segment()
    np.testing.assert_allclose(interpolant_of(flown, method)(flown.t_s), flown.x, atol=1e-8)


def test_the_choice_is_said() -> None:
    flown = segment()
    default = interpolant_of(flown)
    assert (default.method, default.degree, default.is_stated) == ("HERMITE", 7, False)
    assert str(default) == "Hermite interpolation of degree 7 (the default)"
    stated = interpolant_of(replace(flown, interpolation="LAGRANGE", interpolation_degree=5))
    assert str(stated) == "Lagrange interpolation of degree 5 (given with the states)"
    linear = interpolant_of(replace(flown, interpolation="LINEAR", interpolation_degree=1))
    middle = linear(0.5 * STEP_S)[:, 0]
    np.testing.assert_allclose(middle, 0.5 * (flown.x[:, 0] + flown.x[:, 1]), rtol=1e-14)
    assert interpolant_of(segment(2)).degree == 3
    assert interpolant_of(flown, "HERMITE", 6).degree == 7


def test_only_within_the_useable_span() -> None:
    flown = replace(segment(), useable_start_s=30.0, useable_stop_s=2000.0)
    interpolant = interpolant_of(flown)
    assert interpolant.span_s == (30.0, 2000.0)
    interpolant(np.array([30.0, 2000.0]))
    for outside in (29.9, 2000.1, np.nan):
        with pytest.raises(InputError, match=r"useable states from 30\.0 s to 2000\.0 s"):
            interpolant(outside)
    with pytest.raises(InputError, match="useable states"):  # there are no states before the first
        interpolant_of(replace(segment(), start_s=-60.0))(-1.0)


def test_never_across_segments() -> None:
    """A manoeuvre of 100 m/s lies between two segments: neither knows of the other's states."""
    first, second = segment(5), segment(5, 240.0)
    second.x[3] += 100.0
    at = Epoch(first.epoch.day, 240.0 / 86400.0)
    assert segment_at([first, second], at) is second
    assert segment_at([first, second], first.epoch) is first
    np.testing.assert_allclose(
        interpolant_of(first)(200.0)[:, 0], circle(np.array(200.0)), atol=1e-5
    )
    with pytest.raises(InputError, match="no segment of the ephemeris"):
        segment_at([first, second], Epoch(first.epoch.day, 0.5))


@pytest.mark.parametrize(
    ("changes", "keys", "said"),
    [({}, {"method": "SPLINE"}, "must be 'HERMITE' or 'LAGRANGE'"),
     ({}, {"method": "LAGRANGE", "degree": 41}, "needs at least 42 states"),
     ({}, {"degree": 0}, "degree: 0"),
     ({"interpolation": "PROPAGATE"}, {}, "propagated, not interpolated")],
)  # fmt: skip
def test_what_cannot_be_interpolated(
    changes: dict[str, str], keys: dict[str, object], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        interpolant_of(replace(segment(), **changes), **keys)  # type: ignore[arg-type]
