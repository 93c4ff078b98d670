"""The largest deviation is one over the flight, not over samples."""

from __future__ import annotations

import numpy as np

from hillsphere_flight.between import hermite_points, largest_square, slope_points


def test_parabola_of_a_held_command_has_its_exact_vertex() -> None:
    # Thrown up at 2 m/s against 1 m/s² for 4 s: 2 m up after 2 s, and back with −2 m/s.
    r0, v0, h = np.zeros((1, 1)), np.full((1, 1), 2.0), np.full((1, 1), 4.0)
    points = hermite_points(r0, v0, r0, -v0, h)
    square = largest_square(points, np.zeros(1, dtype=np.int64), np.zeros(1))
    np.testing.assert_allclose(np.sqrt(square), 2.0, rtol=1e-9)
    speed = largest_square(
        slope_points(points, v0, -v0, h), np.zeros(1, dtype=np.int64), np.zeros(1)
    )
    np.testing.assert_allclose(np.sqrt(speed), 2.0, rtol=1e-12)


def test_oscillator_reaches_its_amplitude_between_sub_steps() -> None:
    # x = sin t over 0.7 to 2.3 in two steps of 0.8: the amplitude 1 lies between their ends, whose
    # largest is sin 1.5 = 0.9975. A cubic is off by at most h⁴/384 = 1.1e-3.
    t = np.array([0.7, 1.5, 2.3])
    x, v = np.sin(t), np.cos(t)
    points = hermite_points(x[None, :-1], v[None, :-1], x[None, 1:], v[None, 1:], np.diff(t))
    square = largest_square(points, np.zeros(2, dtype=np.int64), np.zeros(1))
    np.testing.assert_allclose(np.sqrt(square), 1.0, atol=0.8**4 / 384)
    assert np.sqrt(square)[0] > 0.999
