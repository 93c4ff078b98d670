"""Differences of numbers, angles and directions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hillsphere.interfaces import Array, Channel
from hillsphere_estimators.differences import across, layout_of

LAYOUT = layout_of(
    (
        (Channel("range", "m"), Channel("azimuth", "rad", "angle")),
        (Channel("direction", "", "direction"), Channel("elevation", "rad", "angle")),
    )
)


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=0))


def test_layout_knows_its_rows() -> None:
    assert LAYOUT.rows == 6
    assert LAYOUT.angles == (1, 5)
    assert LAYOUT.directions == (2,)
    assert LAYOUT.blocks == (slice(0, 2), slice(2, 6))
    np.testing.assert_array_equal(LAYOUT.real, [True, True, True, True, False, True])


@given(st.floats(-20.0, 20.0), st.floats(-3.1, 3.1))
def test_angles_differ_the_short_way_round(angle: float, off: float) -> None:
    a, b = np.zeros((6, 1)), np.zeros((6, 1))
    a[2:5], b[2:5] = unit(np.ones((3, 1))), unit(np.ones((3, 1)))
    a[1], b[1] = angle + off, angle + 2.0 * np.pi
    np.testing.assert_allclose(LAYOUT.difference(a, b)[1], off, rtol=0, atol=1e-13)


def test_small_differences_of_angles_keep_their_digits() -> None:
    b = np.zeros((6, 1))
    b[2:5] = unit(np.ones((3, 1)))
    a = b.copy()
    a[1] = 1e-12
    np.testing.assert_allclose(LAYOUT.difference(a, b)[1], 1e-12, rtol=1e-3)


def test_directions_differ_by_their_angle() -> None:
    random = np.random.default_rng(1)
    a, b = np.zeros((6, 500)), np.zeros((6, 500))
    b[2:5] = unit(random.normal(size=(3, 500)))
    b[2:5, :2] = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, -1.0]])
    a[2:5] = unit(random.normal(size=(3, 500)))
    a[2:5, 2] = b[2:5, 2]
    off = LAYOUT.difference(a, b)
    angle = np.arctan2(
        np.linalg.norm(np.cross(a[2:5], b[2:5], axis=0), axis=0), np.sum(a[2:5] * b[2:5], axis=0)
    )
    np.testing.assert_allclose(np.hypot(off[2], off[3]), angle, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(off[4], 0.0)
    # and lie to the side on which a is
    first, second = across(b[2:5])
    back = off[2] * first + off[3] * second
    assert (np.sum(back * a[2:5], axis=0)[3:] > 0.0).all()


def test_frames_across_are_right_handed() -> None:
    directions = unit(np.random.default_rng(2).normal(size=(3, 200)))
    directions[:, 0] = [0.0, 0.0, -1.0]
    first, second = across(directions)
    np.testing.assert_allclose(np.cross(first, second, axis=0), directions, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(first, axis=0), 1.0, rtol=1e-14)


def test_slopes_are_those_of_the_difference() -> None:
    """d/dx of direction(x), by the exact Jacobian (1 − uuᵀ)/|x| and by differences."""
    x = np.array([3.0, -4.0, 12.0])

    def seen(x: Array) -> Array:
        return np.array([0.0, 0.0, *(x / np.linalg.norm(x)), 0.0])[:, None]

    u = x / 13.0
    slopes = np.zeros((1, 6, 3))
    slopes[0, 2:5] = (np.eye(3) - np.outer(u, u)) / 13.0
    found = LAYOUT.tangent(slopes, seen(x))[0]
    for k in range(3):
        step = 1e-5 * np.eye(3)[k]
        off = LAYOUT.difference(seen(x + step), seen(x)) - LAYOUT.difference(
            seen(x - step), seen(x)
        )
        np.testing.assert_allclose(found[:, k], off[:, 0] / 2e-5, rtol=0, atol=1e-10)
