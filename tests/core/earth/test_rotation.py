"""Turning of the Earth in the inertial frames."""

from __future__ import annotations

import erfa
import numpy as np
import pytest

from hillsphere.base.orientation import ConstantOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import (
    ROTATION_RATES_RAD_S,
    InertialFrame,
    celestial_to_intermediate,
    earth_angle,
    earth_fixed,
    to_earth_fixed,
    to_inertial,
)
from hillsphere.time import Epoch

EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
SHIFTED = ConstantOrientation(-0.17258, 1e-6, 2e-6)
FRAMES: tuple[InertialFrame, ...] = ("teme", "gcrs")


def _applied(matrices: Array, x: Array) -> Array:
    return np.asarray(np.einsum("ijn,jn->in", matrices, x))


def test_sidereal_time_at_the_epoch_of_kuga_and_carrara() -> None:
    """Greenwich mean sidereal time (1982) of 1989-01-31 09:58:00 with UT1 := UTC.

    By the polynomial of Aoki et al., A&A 105, 359, 1982, evaluated by hand: 280.10106735° at JD
    2447557.915277778, which is rounded by 1e-5 s.
    """
    degrees = np.degrees(earth_angle("teme", EPOCH, np.zeros(1)))
    assert degrees == pytest.approx(280.10106735, abs=1e-7)


def test_vallado_teme_to_itrf() -> None:
    """Vallado et al., AIAA 2006-6753, appendix C: TEME to ITRF of 2004-04-06 07:51:28.386009 UTC.

    UT1 − UTC −0.4399619 s, x −0.140682″, y 0.333309″. Printed to 0.1 mm, but computed there with
    the Julian date in one double, that is to 40 µs or 3e-9 rad; and with the rate of the Earth
    rotation angle, less the day's excess, where ours is that of GMST: 9e-12 rad/s.
    """
    epoch = Epoch.parse("2004-04-06T07:51:28.386009", "UTC")
    x = 1e3 * np.array(
        [5094.18016210, 6127.64465950, 6380.34453270, -4.746131487, 0.785818041, 5.531931288]
    )
    orientation = ConstantOrientation(-0.4399619, -0.140682 * erfa.DAS2R, 0.333309 * erfa.DAS2R)
    found = to_earth_fixed("teme", x[:, None], epoch, np.zeros(1), orientation)[:, 0] / 1e3
    assert np.allclose(found[:3], [-1033.4793830, 7901.2952754, 6380.3565958], rtol=0, atol=2.5e-5)
    assert np.allclose(found[3:], [-3.225636520, -2.872451450, 5.531924446], rtol=0, atol=1.2e-7)


def test_gcrs_is_turned_as_by_erfa() -> None:
    t = np.linspace(0.0, 5.0 * 86400.0, 41)
    tt, utc = EPOCH.to("TT"), EPOCH
    found = earth_fixed("gcrs", EPOCH, t, SHIFTED)
    expected = erfa.c2t06a(
        tt.day, tt.fraction + t / 86400.0,
        utc.day, utc.fraction + (t - 0.17258) / 86400.0,
        1e-6, 2e-6,
    )  # fmt: skip
    assert np.allclose(np.moveaxis(found, -1, 0), expected, rtol=0, atol=2e-12)


def test_precession_and_nutation_do_not_depend_on_what_else_is_asked_for() -> None:
    t = np.random.default_rng(0).uniform(-40.0 * 86400.0, 40.0 * 86400.0, 50)
    tt = EPOCH.to("TT")
    together = celestial_to_intermediate(EPOCH, t)
    alone = np.stack(
        [celestial_to_intermediate(EPOCH, t[k : k + 1])[..., 0] for k in range(50)], -1
    )
    assert np.array_equal(together, alone)
    exact = erfa.c2i06a(tt.day, tt.fraction + t / 86400.0)
    assert np.allclose(np.moveaxis(together, -1, 0), exact, rtol=0, atol=1e-12)


@pytest.mark.parametrize("frame", FRAMES)
def test_matrices_are_rotations_and_states_come_back(frame: InertialFrame) -> None:
    t = np.linspace(0.0, 86400.0, 25)
    turn = earth_fixed(frame, EPOCH, t, SHIFTED)
    identity = np.einsum("ikn,jkn->ijn", turn, turn)
    assert np.allclose(identity, np.eye(3)[..., None], rtol=0, atol=1e-14)
    x = np.random.default_rng(1).normal(size=(6, t.size))
    fixed = to_earth_fixed(frame, x, EPOCH, t, SHIFTED)
    assert np.allclose(fixed[:3], _applied(turn, x[:3]), rtol=0, atol=1e-14)
    assert np.allclose(to_inertial(frame, fixed, EPOCH, t, SHIFTED), x, rtol=0, atol=1e-13)


@pytest.mark.parametrize("frame", FRAMES)
def test_velocity_is_the_rate_of_the_earth_fixed_position(frame: InertialFrame) -> None:
    """Central differences of a straight flight; the axis' own motion is neglected (3e-5 m/s)."""
    t, h = np.linspace(0.0, 6000.0, 20), 1.0
    place, speed = np.array([7e6, 1e6, 2e6])[:, None], np.array([-1e3, 7e3, 2e3])[:, None]

    def fixed(s: Array) -> Array:
        return _applied(earth_fixed(frame, EPOCH, s, SHIFTED), place + speed * (s - t))

    states = np.concatenate([np.repeat(place, t.size, 1), np.repeat(speed, t.size, 1)])
    found = to_earth_fixed(frame, states, EPOCH, t, SHIFTED)[3:]
    differences = (fixed(t + h) - fixed(t - h)) / (2.0 * h)
    assert np.allclose(found, differences, rtol=0, atol=1e-4)


@pytest.mark.parametrize("frame", FRAMES)
def test_the_rate_is_that_of_the_angle(frame: InertialFrame) -> None:
    turned = np.diff(earth_angle(frame, EPOCH, np.array([0.0, 10000.0])))[0]
    assert turned / 1e4 == pytest.approx(ROTATION_RATES_RAD_S[frame], rel=1e-11)


def test_ut1_turns_the_earth() -> None:
    """15.04″ for each second."""
    now = np.zeros(1)
    later = ConstantOrientation(0.5)
    more = np.degrees(earth_angle("teme", EPOCH, now, later) - earth_angle("teme", EPOCH, now))
    assert more == pytest.approx(0.5 * 360.0 / 86164.0905, abs=1e-9)


def test_other_frames_and_shapes_are_refused() -> None:
    with pytest.raises(InputError, match="no inertial frame 'j2000'; known: teme, gcrs"):
        earth_fixed("j2000", EPOCH, np.zeros(1))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"must be \(6, 2\), one a time, got \(6, 1\)"):
        to_earth_fixed("teme", np.zeros((6, 1)), EPOCH, np.zeros(2))
