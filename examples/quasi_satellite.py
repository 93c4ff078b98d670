"""A quasi-satellite orbit of Phobos, its state transition matrix, and a mission run twice.

Run it with ``python examples/quasi_satellite.py``. It passes ``mypy --strict``.
"""

from __future__ import annotations

import numpy as np

import hillsphere as hs


def main() -> None:
    """Fly an orbit for a day, and compare two missions."""
    gravity = hs.create("gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], density_g_cm3=1.86)
    phobos = hs.create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377)
    plant = hs.create("plant", "hill", body=phobos, gravity=gravity)

    motion = hs.Motion(plant)
    start = np.array([60e3, 0.0, 0.0, 0.0, -27.77885785965, 0.0])  # the orbit through x = 60 km
    day = motion.propagate(start, duration_s=86400.0)
    end, phi = motion.stm(start, 7.340865207 * 3600.0)
    print(f"after a day {np.linalg.norm(day[-1][:3]) / 1e3:.1f} km from Phobos")
    print(f"after a period {np.linalg.norm((end - start)[:3]):.3f} m from the start")
    print(f"volume kept: {np.linalg.det(phi):.9f}")

    mission = hs.Mission.load("phobos-qso", set={"stage.family.x_amplitudes_km": [60]})
    for density in (1.8, 1.9):
        result = hs.run(mission, set={"gravity.ellipsoid.density_g_cm3": density})
        period = result.tables["table_1"].rows[0]["period_h"]
        print(f"density {density} g/cm³: period {period} h; {result}")


if __name__ == "__main__":
    main()
