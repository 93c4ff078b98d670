"""An asteroid and spacecraft around the Sun, against Kepler's motion."""

from __future__ import annotations

import numpy as np

from hillsphere import create
from hillsphere.base.constants import NOMINAL_SOLAR_GM_M3_S2 as GM
from hillsphere.dynamics import StepMap, Taylor, system
from hillsphere.model.ephemeris import kepler_step, states_of_elements
from hillsphere.testing.frames import frame

AU = 1.495978707e11
START = states_of_elements(
    np.array([[0.9224 * AU], [0.1912], [0.058], [3.57], [2.2], [0.4]]), GM
)[:, 0]  # fmt: skip


def test_bodies_move_on_ellipses() -> None:
    """Radiation pressure takes its part off the Sun's attraction."""
    plant = create(
        "plant", "heliocentric",
        bodies=[{"name": "asteroid"}, {"reflectivity": 0.2, "area_to_mass_m2_kg": 0.04}],
    )  # fmt: skip
    assert [v.name for v in plant.states[:7]] == ["x1", "y1", "z1", "vx1", "vy1", "vz1", "x2"]
    equations, duration = system(plant), 30 * 86400.0
    found = StepMap(equations).propagate(np.tile(START, 2), duration, 300)
    less = GM - 0.2 * 0.04 * 4.56e-6 * AU**2
    for part, gm in ((found[:6], GM), (found[6:], less)):
        want = kepler_step(START[:, None], duration, gm)[:, 0]
        np.testing.assert_allclose(part[:3], want[:3], rtol=0, atol=1e-2)
        np.testing.assert_allclose(part[3:], want[3:], rtol=0, atol=1e-9)
    assert np.linalg.norm(found[6:9] - found[:3]) > 1e5
    again = Taylor(equations).propagate(np.tile(START, 2), duration)
    np.testing.assert_allclose(again, found, rtol=1e-12)


def test_frame() -> None:
    assert frame("ecliptic").inertial
    assert "Sun" in frame("ecliptic").centre
