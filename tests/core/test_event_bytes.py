"""The outcome of a flight does not depend on its neighbours, nor on what was flown before."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.simulation import Cases, Flights, Limit, simulate

from .test_simulation_ends import CEILING, GRAVITY, Push, Shaft

ROOF = 0.9 * CEILING


def below_roof(t: Array, x: Array, cases: Integers) -> Array:
    return np.asarray((ROOF - x[0]) / CEILING)


STEEP = Limit("roof", below_roof, lipschitz=[1.0 / CEILING, 0.0])
"""Only its slope is bounded: an approach to e leaves some 1/√e pieces of a step undecided."""


def thrown(number: int, seed: int) -> tuple[Array, Array]:
    """Return throws whose tops are within 1 mm to 100 m of the roof, and their excess (m)."""
    rng = np.random.default_rng(seed)
    excess = rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(-3.0, 2.0, number)
    rise = rng.uniform(15.0, 30.0, number)
    return np.array([ROOF + excess - 0.5 * rise**2 / GRAVITY, rise]), excess


def fly_once(x0: Array) -> Flights:
    return simulate(Shaft(), Push(0.0, period_s=40.0), Cases(x0), 1, limits=[STEEP])


def test_a_block_of_close_approaches_decides_what_each_lane_decides_alone() -> None:
    x0, excess = thrown(64, 3)
    far = np.repeat([[500.0], [10.0]], 63, axis=1)
    together = fly_once(x0)
    assert np.array_equal(np.array(together.status) == "constraint", excess > 0.0)
    assert "unresolved" not in together.status
    for lane in range(0, 64, 4):
        for other in (x0[:, [lane]], np.concatenate([x0[:, [lane]], far], axis=1)):
            flights = fly_once(other)
            assert flights.status[0] == together.status[lane]
            assert flights.time_s[0] == together.time_s[lane]
            assert (flights.x[:, 0] == together.x[:, lane]).all()
