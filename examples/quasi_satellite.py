"""A quasi-satellite orbit of Phobos, its state transition matrix, and a mission run three times.

Run it with ``python examples/quasi_satellite.py``. It passes ``mypy --strict``.
"""

from __future__ import annotations

import numpy as np

import hillsphere as hs


def main() -> None:
    """Fly an orbit for a day, and compare two missions."""
    mission = hs.Mission.load("phobos-qso", set={"stage.family.x_amplitudes_km": [60]})
    result = hs.run(mission)
    orbit = result.products["family"].members

    motion = hs.Motion(result.build("plant", "hill"))  # the equations of which it is an orbit
    start = orbit.x0[:, 0]
    day = motion.propagate(start, duration_s=86400.0)
    end, phi = motion.stm(start, orbit.period_s[0])
    print(f"after a day {np.linalg.norm(day[-1][:3]) / 1e3:.1f} km from Phobos")
    print(f"after a period {np.linalg.norm((end - start)[:3]):.6f} m from the start")
    print(f"volume kept: {np.linalg.det(phi):.9f}")

    for density in (1.8, 1.9):
        result = hs.run(mission, set={"gravity.ellipsoid.density_g_cm3": density})
        period = result.tables["table_1"].rows[0]["period_h"]
        print(f"density {density} g/cm³: period {period} h; {result}")


if __name__ == "__main__":
    main()
