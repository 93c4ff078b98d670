"""Places of Sun and Moon."""

from __future__ import annotations

import erfa
import numpy as np

from hillsphere.dynamics import ArrayFunction
from hillsphere.symbolic import variable
from hillsphere_plants.sun_moon import moon_position, sun_position


def test_series_against_erfa() -> None:
    """ERFA's Earth (epv00) and Moon (moon98, after Meeus), over a century."""
    centuries = np.linspace(-0.5, 0.5, 500)
    place = variable("T")
    found = ArrayFunction((*sun_position(place), *moon_position(place)), (place,), ())(
        centuries[None]
    )
    days = centuries * 36525.0
    sun = -erfa.epv00(2451545.0, days)[0]["p"].T * 1.495978707e11
    moon = erfa.moon98(2451545.0, days)["p"].T * 1.495978707e11
    for ours, theirs, limit in ((found[:3], sun, 4e-4), (found[3:], moon, 2e-3)):
        assert np.abs(ours - theirs).max() < limit * np.linalg.norm(theirs, axis=0).max()
