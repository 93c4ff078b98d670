"""Units and constants of nature that more than one module uses, each with its source."""

from __future__ import annotations

from math import pi

__all__ = [
    "ARCSECOND_RAD",
    "AU_M",
    "DAY_S",
    "HOUR_S",
    "J2000_JD",
    "MINUTE_S",
    "MODIFIED_JD",
    "NOMINAL_SOLAR_GM_M3_S2",
    "SPEED_OF_LIGHT_M_S",
    "TT_MINUS_TAI_S",
    "WGS84_RADIUS_M",
]

MINUTE_S = 60.0
"""By definition, as the hour."""
HOUR_S = 3600.0
"""By definition."""
DAY_S = 86400.0
"""By definition; a day of UTC may have one second more (ITU-R TF.460-6)."""

ARCSECOND_RAD = pi / 648000.0
"""By definition."""

AU_M = 1.495978707e11
"""Astronomical unit, exact: IAU 2012 Resolution B2."""

SPEED_OF_LIGHT_M_S = 299792458.0
"""Exact: definition of the metre (SI brochure, 9th ed., 2019)."""

NOMINAL_SOLAR_GM_M3_S2 = 1.3271244e20
"""Exact by convention: IAU 2015 Resolution B3 (Prša et al. 2016, Astron. J. 152, 41)."""

WGS84_RADIUS_M = 6378137.0
"""Equatorial radius of the Earth's ellipsoid: NIMA TR8350.2, 3rd ed., 2000."""

J2000_JD = 2451545.0
"""Julian date of the epoch J2000, 2000 January 1, 12 h TT."""

MODIFIED_JD = 2400000.5
"""Julian date at which the modified Julian date begins."""

TT_MINUS_TAI_S = 32.184
"""Terrestrial time minus atomic time, by definition (IAU 1991 Recommendation IV)."""
