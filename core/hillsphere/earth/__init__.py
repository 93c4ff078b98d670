"""The rotating Earth: stations on its ellipsoid, its orientation, and how inertial states see it.

- `hillsphere.earth.geodetic`: ellipsoids, stations, geodetic coordinates.
- `hillsphere.earth.orientation`: UT1 and polar motion, from a table or constant.
- `hillsphere.earth.rotation`: rotation from the inertial frames ``teme`` and ``gcrs`` to the Earth.
- `hillsphere.earth.planet`: the body ``planet``, which brings ellipsoid and orientation together.
- `hillsphere.earth.atmosphere`, `hillsphere.earth.sun_moon`: expressions for plants.
"""
