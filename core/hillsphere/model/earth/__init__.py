"""The rotating Earth: ground stations, orientation, and transformation of inertial states.

- `hillsphere.base.geodetic`: ellipsoids, stations, geodetic coordinates.
- `hillsphere.base.orientation`: UT1 and polar motion, from a table or constant.
- `hillsphere.model.earth.rotation`: rotation from the inertial frames ``teme`` and ``gcrs`` to the
  Earth.
- `hillsphere.model.earth.planet`: the body ``planet``, which combines ellipsoid and orientation.
- `hillsphere_plants.atmosphere`, `hillsphere_plants.sun_moon`: expressions for plants.
"""
