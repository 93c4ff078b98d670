"""Passes: none missed, however short; the geometry of the assisted-tracking paper's Table 1."""

from __future__ import annotations

from functools import cache
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hillsphere.base.geodetic import Station
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.ground_track import EarthTrack
from hillsphere_tracking.mean_elements import EARTH_FIELD
from hillsphere_tracking.passes.masks import BlindSector, HorizonMask
from hillsphere_tracking.passes.passes import (
    Air,
    Passes,
    blind_spans,
    eclipses,
    find_passes,
    peak_azimuth_rates,
    sun_in_beam,
)
from hillsphere_tracking.passes.search import positive_spans, sample_curve
from hillsphere_tracking.satellites import MeanElementsOrbit, orbits_of
from hillsphere_tracking.sun import shadow_margin, sun_earth_fixed
from hillsphere_tracking.topocentric import angles, apparent_elevation, rates

Booleans: TypeAlias = NDArray[np.bool_]

EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
DAY = 86400.0
ALCANTARA = Station("Alcântara", np.radians(-2.18), np.radians(-44.26), 39.0)
CUIABA = Station("Cuiabá", np.radians(-15.53), np.radians(-56.07), 277.0)
NORTH = Station("Svalbard", np.radians(78.23), np.radians(15.39), 450.0)


def _over(station: Station, path: EarthTrack, mask: HorizonMask, t_s: Array) -> Array:
    azimuth, height, _ = angles(station, path.states(t_s)[:3])
    return height - mask.at(azimuth)


@cache
def track(
    a_km: float, e: float, i: float, node: float = 0.0, perigee: float = 0.0, m: float = 0.0,
    days: float = 1.0,
) -> EarthTrack:  # fmt: skip
    elements = np.array([a_km * 1e3, e, *np.radians([i, node, perigee, m])])
    return EarthTrack(MeanElementsOrbit("one", EPOCH, elements, EARTH_FIELD), EPOCH, days * DAY)


def paper() -> EarthTrack:
    return track(7180.0, 0.0436, 23.82, 240.14, 15.47, 350.56)


def looked_up(station: Station, path: EarthTrack, step_s: float) -> tuple[Array, Array, Array]:
    t_s = np.arange(0.0, path.end_s, step_s)
    azimuth, elevation, _ = angles(station, path.states(t_s)[:3])
    return t_s, azimuth, elevation


def elevation(station: Station, path: EarthTrack, t_s: Array) -> Array:
    return angles(station, path.states(t_s)[:3])[1]


# Kuga and Carrara (1990), Table 1: station, revolution, duration, highest elevation. The longitude
# of Cuiabá that gives its pass 9 is 55.07° W, not 56.07° W; the two rows of pass 8 follow from
# neither the printed epoch nor elements.
@pytest.mark.parametrize(
    ("station", "revolution", "ascending", "duration_s", "highest_deg"),
    [
        (ALCANTARA, 2, True, 450.0, 15.9),
        (ALCANTARA, 6, False, 587.0, 12.3),
        (ALCANTARA, 7, False, 925.0, 36.8),
        (Station("C", CUIABA.latitude_rad, np.radians(-55.07), 277.0), 9, False, 1018.0, 60.4),
    ],
    ids=["ALC2", "ALC6", "ALC7", "CUI9"],
)
def test_kuga_carrara_table1(
    station: Station, revolution: int, ascending: bool, duration_s: float, highest_deg: float
) -> None:
    path = paper()
    found = find_passes(station, path, HorizonMask((np.radians(5.0),)))
    numbers = 1 + np.searchsorted(path.node_times(), found.culmination_s)
    (k,) = np.flatnonzero(numbers == revolution)
    assert found.set_s[k] - found.rise_s[k] == pytest.approx(duration_s, abs=4.0)
    top = np.degrees(elevation(station, path, found.culmination_s[k : k + 1]))[0]
    assert top == pytest.approx(highest_deg, abs=0.3)
    assert (path.states(found.culmination_s[k : k + 1])[5, 0] > 0.0) == ascending


@settings(max_examples=40, deadline=None)
@given(
    perigee_km=st.one_of(st.floats(6550.0, 8000.0), st.floats(6550.0, 42164.0)),
    e=st.one_of(st.just(0.0), st.floats(0.0, 0.75)),
    i=st.one_of(st.sampled_from([0.0, 63.4349, 180.0]), st.floats(0.0, 180.0)),
    angle=st.floats(0.0, 360.0),
    latitude=st.floats(-90.0, 90.0),
    mask_deg=st.floats(-1.0, 80.0),
    walls=st.lists(st.floats(-8.0, 8.0), max_size=6),
)
def test_every_pass_is_found(
    perigee_km: float, e: float, i: float, angle: float, latitude: float, mask_deg: float,
    walls: list[float],
) -> None:  # fmt: skip
    """Against the elevation every five seconds, and the definition of rise, set and culmination."""
    path = track(perigee_km / (1.0 - e), e, i, angle, 2.0 * angle % 360.0, 0.0, 0.5)
    station = Station("s", np.radians(latitude), 0.3, 0.0)
    heights = np.radians(mask_deg + np.array([0.0, *walls]))
    around = HorizonMask(
        tuple(heights.tolist()), tuple((6.28 * np.arange(heights.size) / heights.size).tolist())
    )
    found = find_passes(station, path, around)
    t_s, azimuth, height = looked_up(station, path, 5.0)
    mask = around.at(azimuth)
    inside = np.zeros(t_s.size, dtype=bool)
    for rise, set_ in zip(found.rise_s, found.set_s, strict=True):
        inside |= (t_s >= rise) & (t_s <= set_)
    clear = np.abs(height - mask) > 1e-6
    assert np.array_equal(inside[clear], (height > mask)[clear])
    for times, cut in ((found.rise_s, found.begun), (found.set_s, found.unfinished)):
        edges = times[~cut]
        away = np.array([_over(station, path, around, edges + dt) for dt in (-2e-6, 2e-6)])
        # the mask is met within 2e-6 s, and where nothing moves, to rounding
        assert ((away[0] * away[1] <= 0.0) | (np.abs(away).min(axis=0) < 1e-9)).all()
    for rise, top, set_ in zip(found.rise_s, found.culmination_s, found.set_s, strict=True):
        nearby = elevation(station, path, np.linspace(rise, set_, 200))
        assert nearby.max() <= elevation(station, path, np.array([top]))[0] + 1e-9


@pytest.mark.parametrize("e", [0.0, 0.0436, 0.7])
@pytest.mark.parametrize("i", [23.82, 98.0, 63.4])
def test_grazing_passes_are_found_down_to_fractions_of_a_second(e: float, i: float) -> None:
    """With the mask a hair below the top of a pass it is found, a hair above it nothing is."""
    path = track(6900.0 / (1.0 - e), e, i, 40.0, 270.0, 0.0, 2.0)
    open_sky = find_passes(CUIABA, path)
    whole = ~(open_sky.begun | open_sky.unfinished)
    tops = open_sky.culmination_s[whole]
    heights = elevation(CUIABA, path, tops)
    assert tops.size >= 2
    for top, height in zip(tops, heights, strict=True):
        grazing = find_passes(CUIABA, path, HorizonMask((height - 1e-9,)))
        here = np.abs(grazing.culmination_s - top) < 1.0
        assert here.sum() == 1
        length = (grazing.set_s - grazing.rise_s)[here][0]
        assert 0.0 < length < 2.0
        above = find_passes(CUIABA, path, HorizonMask((height + 1e-9,)))
        assert not (np.abs(above.culmination_s - top) < 1.0).any()


def test_a_mask_by_azimuth_against_looking_every_second() -> None:
    mask = HorizonMask(
        tuple(np.radians([5.0, 10.0, 3.0, 30.0, 30.0, 8.0])),
        tuple(np.radians([20.0, 60.0, 120.0, 121.0, 200.0, 300.0])),
    )
    for path in (paper(), track(6900.0, 0.001, 98.0, 10.0)):
        found = find_passes(CUIABA, path, mask)
        t_s, azimuth, height = looked_up(CUIABA, path, 1.0)
        up = height > mask.at(azimuth)
        change = np.flatnonzero(up[1:] != up[:-1])
        edges = np.column_stack([found.rise_s, found.set_s]).ravel()
        edges = edges[(edges > 0.0) & (edges < path.end_s)]
        assert edges.size == change.size >= 4
        assert ((edges >= t_s[change]) & (edges <= t_s[change + 1])).all()
        x = path.states(edges)
        azimuth, height, _ = angles(CUIABA, x[:3])
        np.testing.assert_allclose(height, mask.at(azimuth), rtol=0, atol=1e-7)


def test_a_satellite_grazing_over_a_notch_is_seen() -> None:
    """A wall all around but for a notch two degrees wide below the culmination."""
    path = paper()
    (k,) = np.flatnonzero(np.abs(find_passes(ALCANTARA, path).culmination_s - 38832.0) < 60.0)
    top = find_passes(ALCANTARA, path).culmination_s[k : k + 1]
    azimuth, height, _ = angles(ALCANTARA, path.states(top)[:3])
    a = float(azimuth[0])
    mask = HorizonMask(
        (1.5, 1.5, float(height[0]) - 0.01, float(height[0]) - 0.01, 1.5),
        (0.0, a - 0.02, a - 0.015, a + 0.015, a + 0.02),
    )
    found = find_passes(ALCANTARA, path, mask)
    assert found.rise_s.size == 1
    assert abs(found.culmination_s[0] - top[0]) < 1.0
    assert found.set_s[0] - found.rise_s[0] < 10.0


def test_geostationary_and_molniya_are_classified() -> None:
    geo = "\n".join(
        (
            "1 28626U 05008A   06176.46683397 -.00000205  00000-0  10000-3 0  2190",
            "2 28626   0.0019 286.9433 0000335  13.7918  55.6504  1.00270176  4891",
        )
    )
    (orbit,) = orbits_of(geo, "tle")
    path = EarthTrack(orbit, orbit.epoch, DAY)
    # XM-3 stood at 85° W
    seen = {
        station.name: find_passes(station, path)
        for station in (ALCANTARA, NORTH, Station("Perth", np.radians(-32.0), np.radians(116.0)))
    }
    assert seen["Alcântara"].visibility == "always"
    assert seen["Svalbard"].visibility == "never"
    assert seen["Perth"].visibility == "never"
    assert -90.0 < np.degrees(seen["Perth"].highest_rad) < -40.0
    assert seen["Alcântara"].rise_s[0] == 0.0
    assert seen["Alcântara"].set_s[0] == DAY
    molniya = track(26600.0, 0.72, 63.4, 100.0, 270.0, 180.0)
    high = find_passes(NORTH, molniya, HorizonMask((np.radians(10.0),)))
    assert high.visibility == "passes"
    # eleven of twelve hours are spent over the north
    assert np.sum(high.set_s - high.rise_s) > 0.8 * DAY
    assert find_passes(Station("S", np.radians(-89.0), 0.0), molniya).rise_s.size == 2


def test_a_satellite_that_never_rises_says_how_high_it_came() -> None:
    path = track(6900.0, 0.0, 20.0)
    never = find_passes(NORTH, path)
    assert (never.visibility, never.rise_s.size) == ("never", 0)
    _, _, height = looked_up(NORTH, path, 1.0)
    assert never.highest_rad == pytest.approx(height.max(), abs=1e-6)


def test_a_decayed_satellite_is_searched_until_its_end() -> None:
    falling = "\n".join(
        (
            "1 29141U 85108AA  06170.26783845  .99999999  00000-0  13519-0 0   718",
            "2 29141  82.4288 273.4882 0015848 277.2124  83.9133 15.93343074  6828",
        )
    )
    (orbit,) = orbits_of(falling, "tle")
    path = EarthTrack(orbit, orbit.epoch, DAY)
    assert path.end_s == pytest.approx(25357.0, abs=30.0)
    assert "has decayed" in path.end_reason
    found = find_passes(NORTH, path)
    assert found.rise_s.size > 2
    assert found.searched_s == path.end_s
    late = Epoch.parse("2006-06-25", "UTC")
    with pytest.raises(PropagationError, match="has decayed"):
        EarthTrack(orbit, late, DAY)
    with pytest.raises(InputError, match="positive"):
        EarthTrack(orbit, orbit.epoch, 0.0)


def test_refraction_lengthens_passes() -> None:
    path = paper()
    plain, air = find_passes(ALCANTARA, path), find_passes(ALCANTARA, path, air=Air())
    seen = apparent_elevation(elevation(ALCANTARA, path, air.rise_s[1:]))
    np.testing.assert_allclose(seen, 0.0, rtol=0, atol=1e-7)
    assert (air.rise_s[1:] < plain.rise_s[1:] - 5.0).all()
    assert (air.set_s[:-1] > plain.set_s[:-1] + 5.0).all()


def test_azimuth_rates_of_high_passes() -> None:
    """Published for orbits like the paper's: 2.3°/s at 81.3°, growing as the cotangent."""
    path = paper()
    found = find_passes(ALCANTARA, path, HorizonMask((np.radians(5.0),)))
    peak = np.degrees(peak_azimuth_rates(ALCANTARA, path, found))
    top = np.degrees(elevation(ALCANTARA, path, found.culmination_s))
    (eighth,) = np.flatnonzero(np.abs(top - 81.3) < 0.1)
    assert peak[eighth] == pytest.approx(2.3, abs=0.1)
    for k in range(top.size):
        t_s = np.arange(found.rise_s[k], found.set_s[k], 0.5)
        fastest = np.abs(rates(ALCANTARA, path.states(t_s))[3]).max()
        assert np.radians(peak[k]) >= fastest * (1.0 - 1e-9)
        assert np.radians(peak[k]) <= fastest * 1.02


def _boolean(t_s: Array, spans: Array) -> Booleans:
    inside = np.zeros(t_s.size, dtype=bool)
    for begin, end in spans.T:
        inside |= (t_s > begin) & (t_s < end)
    return inside


def _agree(found: Booleans, seen: Booleans) -> None:
    assert np.count_nonzero(found != seen) == 0


@pytest.mark.parametrize("air", [None, Air()], ids=["geometric", "apparent"])
def test_blind_sectors_against_looking_every_second(air: Air | None) -> None:
    path = paper()
    found = find_passes(CUIABA, path)
    sectors = (
        BlindSector((np.radians(300.0), np.radians(40.0)), (0.0, np.radians(30.0))),
        BlindSector((np.radians(80.0), np.radians(120.0))),
        BlindSector((0.0, 2.0 * np.pi), (np.radians(20.0), np.radians(40.0))),
    )
    met = 0
    for sector in sectors:
        for rise, set_ in zip(found.rise_s, found.set_s, strict=True):
            t_s = np.arange(rise + 0.5, set_, 1.0)
            azimuth, height, _ = angles(CUIABA, path.states(t_s)[:3])
            seen = height if air is None else apparent_elevation(height)
            spans = blind_spans(CUIABA, path, sector, rise, set_, air)
            met += spans.shape[1]
            _agree(_boolean(t_s, spans), sector.contains(azimuth, seen))
    assert met > 15


def test_the_sun_in_the_beam_against_looking_every_second() -> None:
    # over the places where it is noon, and the Sun is near the zenith of Cuiabá
    path = track(6900.0, 0.001, 98.0, 313.0, 0.0, 0.0, 3.0)
    found = find_passes(CUIABA, path)
    met = 0
    for rise, set_ in zip(found.rise_s, found.set_s, strict=True):
        t_s = np.arange(rise + 0.5, set_, 1.0)
        sight = path.states(t_s)[:3] - CUIABA.ecef_m[:, None]
        sun = sun_earth_fixed(EPOCH, t_s)
        cosine = np.sum(sight * sun, axis=0) / (
            np.linalg.norm(sight, axis=0) * np.linalg.norm(sun, axis=0)
        )
        up = np.degrees(angles(CUIABA, sun)[1]) > -0.833
        spans = sun_in_beam(CUIABA, path, np.radians(40.0), rise, set_)
        met += spans.shape[1]
        _agree(_boolean(t_s, spans), (cosine > np.cos(np.radians(40.0))) & up)
    assert met >= 2


def test_eclipses_against_looking_every_second() -> None:
    path = paper()
    t_s = np.arange(0.5, path.end_s, 1.0)
    margin = shadow_margin(path.states(t_s)[:3], sun_earth_fixed(EPOCH, t_s))
    found = eclipses(path)
    assert 12 <= found.shape[1] <= 16
    _agree(_boolean(t_s, found), margin > 0.0)


def test_a_function_that_wiggles_between_samples() -> None:
    """Humps far narrower than the first samples, as long as slopes tell of them."""

    def humps(t_s: Array) -> tuple[Array, Array]:
        return np.sin(t_s) - 0.999, np.cos(t_s)

    t_s = np.linspace(0.0, 100.0, 100)
    found = positive_spans(humps, sample_curve(humps, t_s))
    assert found.shape == (2, 16)
    half = np.arccos(0.999)
    centres = 0.5 * np.pi + 2.0 * np.pi * np.arange(16)
    np.testing.assert_allclose(found[0], centres - half, rtol=0, atol=1e-7)
    np.testing.assert_allclose(found[1], centres + half, rtol=0, atol=1e-7)


def test_masks_and_sectors_that_are_none() -> None:
    with pytest.raises(InputError, match="as many azimuths as elevations, got 2 and 1"):
        HorizonMask((0.1,), (0.0, 1.0))
    with pytest.raises(InputError, match="must rise"):
        HorizonMask((0.1, 0.1), (1.0, 0.0))
    with pytest.raises(InputError, match="between"):
        HorizonMask((2.0,))
    with pytest.raises(InputError, match="hill: its higher elevation"):
        BlindSector((0.0, 1.0), (0.2, 0.1), "hill")


def test_a_mask_wraps_around_north() -> None:
    mask = HorizonMask((0.1, 0.3), (1.0, 6.0))
    width = 2.0 * np.pi - 5.0
    azimuth = np.array([1.0, 3.5, 6.0, 6.2, 0.5])
    expected = [0.1, 0.2, 0.3, 0.3 - 0.2 * 0.2 / width, 0.1 + 0.2 * 0.5 / width]
    np.testing.assert_allclose(mask.at(azimuth), expected, rtol=0, atol=1e-14)
    sector = BlindSector((6.0, 0.5))
    assert sector.contains(np.array([6.1, 0.2, 0.6, 5.9]), np.zeros(4)).tolist() == [
        True, True, False, False,
    ]  # fmt: skip


def test_visibility_needs_the_whole_search() -> None:
    one = np.array([True])
    cut = Passes(np.zeros(1), np.zeros(1), np.ones(1), one, ~one, 0.0, 1.0, 2.0)
    assert cut.visibility == "passes"
