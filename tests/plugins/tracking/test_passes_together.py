"""Passes of many satellites over many stations: as one by one, and as looking every second."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sgp4.api import WGS72, Satrec

from hillsphere.base.geodetic import Station
from hillsphere.errors import InputError, PropagationError
from hillsphere.time import Epoch
from hillsphere_tracking.ground_track import EarthTrack
from hillsphere_tracking.passes.masks import HorizonMask
from hillsphere_tracking.passes.passes import find_all_passes, find_passes
from hillsphere_tracking.passes.track_set import TrackSet
from hillsphere_tracking.sgp4_near_earth import (
    COMPILED_FROM,
    elements_of,
    is_certain_to_last,
    propagate_near_earth,
)
from hillsphere_tracking.sgp4_orbit import Sgp4Orbit
from hillsphere_tracking.topocentric import angles

STATIONS = [
    Station("equator", np.radians(-2.18), np.radians(-44.26), 39.0),
    Station("north", np.radians(78.2), np.radians(15.4), 500.0),
    Station("hills", np.radians(48.1), np.radians(11.28), 580.0),
]
MASKS = [
    HorizonMask((np.radians(65.0),)),
    HorizonMask((np.radians(5.0),)),
    HorizonMask((0.1, 0.3, 0.05, 0.2), (0.2, 1.5, 3.0, 5.0)),
]


def random_sets(count: int, per_day: tuple[float, float] = (6.6, 16.4)) -> list[Any]:
    """Return initialised element sets of random orbits with drag from little to much."""
    random = np.random.default_rng(11)
    found: list[Any] = []
    while len(found) < count:
        one = Satrec()
        one.sgp4init(
            WGS72, "i", len(found) + 1, 25544.0,
            10.0 ** random.uniform(-6.0, -2.5), 0.0, 0.0, 10.0 ** random.uniform(-5.0, -0.4),
            random.uniform(0.0, 6.28), np.radians(random.uniform(0.0, 179.0)),
            random.uniform(0.0, 6.28), random.uniform(*per_day) * 2.0 * np.pi / 1440.0,
            random.uniform(0.0, 6.28),
        )  # fmt: skip
        perigee_km = (one.a * (1.0 - one.ecco) - 1.0) * one.radiusearthkm
        if perigee_km > 140.0 and one.sgp4_tsince(0.0)[0] == 0:
            found.append(one)
    return found


def tracks_of(sets: list[Any], days: float) -> list[EarthTrack]:
    """Return the tracks of element sets over some days from their epoch."""
    found = []
    for one in sets:
        epoch = Epoch(one.jdsatepoch, one.jdsatepochF, "UTC")
        found.append(EarthTrack(Sgp4Orbit(str(one.satnum), epoch, one), epoch, days * 86400.0))
    return found


def test_the_compiled_theory_agrees_with_the_package() -> None:
    """The package solves Kepler's equation to 1e-12 rad, which is 1e-12 a; codes are equal."""
    minutes = np.linspace(-1440.0, 20160.0, 25)
    bad = 0
    for one in [*random_sets(90), *random_sets(60, (15.5, 16.4))]:
        elements = elements_of(one)
        if elements is None:
            assert one.method == "d"
            continue
        code, x = propagate_near_earth(elements[:, None], 60.0 * minutes)
        for k, t in enumerate(minutes):
            known, r, v = one.sgp4_tsince(float(t))
            assert code[k] == known
            bad += known != 0
            if known == 0:
                size = 1.2e-12 * one.a * one.radiusearthkm * (1.0 + one.ecco) + 1e-9
                assert np.abs(1e-3 * x[:3, k] - r).max() <= size
                assert np.abs(1e-3 * x[3:, k] - v).max() <= 1e-3 * size
    assert bad > 20  # decays are among them


def test_an_orbit_that_certainly_lasts_has_no_error() -> None:
    """Where the bound says "certain", SGP4 has no error at 2001 times, forward or backward."""
    week, certain, sound = 10080.0, 0, 0
    minutes = np.linspace(-week, week, 2001)
    for one in random_sets(150):
        code, _, _ = one.sgp4_array(
            np.full(2001, one.jdsatepoch), one.jdsatepochF + minutes / 1440.0
        )
        lasts = is_certain_to_last(one, week)
        assert not (lasts and code.any())
        certain += lasts
        sound += not code.any() and one.method == "n"
    assert 0.9 * sound < certain <= sound
    assert not is_certain_to_last(random_sets(1)[0], np.nan)


def test_deep_space_is_left_to_the_package() -> None:
    one = random_sets(1, (2.0, 2.01))[0]
    assert elements_of(one) is None
    assert not is_certain_to_last(one, 1.0)


def test_together_is_as_one_by_one() -> None:
    """Low orbits, which are compiled together, and two in deep space, which are not."""
    sets = [*random_sets(12, (13.5, 15.2)), *random_sets(2, (2.0, 3.0))]
    tracks = tracks_of(sets, 2.0)
    assert sum(track.times_s.size for track in tracks) >= COMPILED_FROM
    assert max(track.times_s.size for track in tracks) < COMPILED_FROM
    together = find_all_passes(STATIONS, tracks, MASKS)
    count = 0
    for station, mask, row in zip(STATIONS, MASKS, together, strict=True):
        for track, found in zip(tracks, row, strict=True):
            alone = find_passes(station, track, mask)
            count += alone.rise_s.size
            for name in ("rise_s", "culmination_s", "set_s"):
                one, other = getattr(found, name), getattr(alone, name)
                np.testing.assert_allclose(one, other, rtol=0, atol=1e-5)
            assert (found.begun == alone.begun).all()
            assert (found.unfinished == alone.unfinished).all()
            assert found.highest_s == pytest.approx(alone.highest_s, abs=1e-4)
            assert found.highest_rad == pytest.approx(alone.highest_rad, abs=1e-9)
            assert found.searched_s == alone.searched_s == track.end_s
    assert count > 150


def test_steps_that_are_left_out_hide_no_pass() -> None:
    """Short passes above 65°, and any above a mask, against looking every two seconds."""
    tracks = tracks_of(random_sets(6, (12.0, 16.0)), 1.0)
    together = find_all_passes(STATIONS, tracks, MASKS)
    for station, mask, row in zip(STATIONS, MASKS, together, strict=True):
        for track, found in zip(tracks, row, strict=True):
            t_s = np.arange(1.0, track.end_s, 2.0)
            azimuth, elevation, _ = angles(station, track.states(t_s)[:3])
            inside = np.zeros(t_s.size, dtype=bool)
            for rise, set_ in zip(found.rise_s, found.set_s, strict=True):
                inside |= (t_s > rise) & (t_s < set_)
            clear = np.abs(elevation - mask.at(azimuth)) > 1e-7
            assert (inside == (elevation > mask.at(azimuth)))[clear].all()


def test_refusals() -> None:
    tracks = tracks_of(random_sets(2, (14.0, 15.0)), 0.1)
    with pytest.raises(InputError, match="at least one station"):
        find_all_passes([], tracks)
    with pytest.raises(InputError, match="at least one track"):
        find_all_passes(STATIONS, [])
    with pytest.raises(InputError, match="masks: expected 3, one a station, got 1"):
        find_all_passes(STATIONS, tracks, MASKS[:1])
    later = EarthTrack(tracks[1].orbit, tracks[1].start.after(60.0), 3600.0)
    with pytest.raises(InputError, match="same start"):
        find_all_passes(STATIONS, [tracks[0], later])


def test_a_time_after_a_decay_names_the_satellite() -> None:
    """The compiled theory's error becomes that of the orbit."""
    falling = next(one for one in random_sets(60, (16.0, 16.4)) if one.sgp4_tsince(20160.0)[0])
    track = tracks_of([falling], 0.1)[0]
    many = TrackSet([track] * (1 + COMPILED_FROM // track.times_s.size))
    with pytest.raises(PropagationError, match=f"satellite '{falling.satnum}' has"):
        many.states(np.zeros(1, dtype=np.int64), np.array([14.0 * 86400.0]))
