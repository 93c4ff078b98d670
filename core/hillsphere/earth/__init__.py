"""The rotating Earth: stations on its ellipsoid, its orientation, and how inertial states see it.

- `hillsphere.earth.geodetic`: ellipsoids, stations, geodetic coordinates.
- `hillsphere.earth.orientation`: UT1 and polar motion, from a table or constant.
- `hillsphere.earth.rotation`: rotation from the inertial frames ``teme`` and ``gcrs`` to the Earth.
"""
