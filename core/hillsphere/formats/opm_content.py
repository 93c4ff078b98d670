"""What an Orbit Parameter Message holds: one state, and what belongs to it.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 3 (OPM).
.. [2] R. R. Bate, D. D. Mueller, J. E. White (1971), Fundamentals of Astrodynamics, sections 2.5
   (state from elements) and 4.2 (Kepler's equation of the hyperbola).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import asinh, atan2, cos, pi, radians, sin, sqrt, tanh

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.time import Epoch

__all__ = ["Manoeuvre", "Opm", "OsculatingElements", "state_of_elements"]


@dataclass(frozen=True)
class Manoeuvre:
    """A manoeuvre of an Orbit Parameter Message.

    Parameters
    ----------
    epoch : Epoch
        Of ignition, in the time system of the message.
    duration_s : float
        Duration, 0 for an impulse.
    mass_change_kg : float
        Change of mass, 0 or negative.
    frame : str
        Frame of `dv`: a registered one, or one that moves with the object (``"RTN"``).
    dv : ndarray, shape (3,)
        Change of velocity, m/s.
    comments : tuple of str
        Lines of text.
    """

    epoch: Epoch
    duration_s: float
    mass_change_kg: float
    frame: str
    dv: Array
    comments: tuple[str, ...] = ()


@dataclass(frozen=True)
class OsculatingElements:
    """Osculating Keplerian elements; angles in degrees, whose digits are those of a message.

    Parameters
    ----------
    semi_major_axis_m : float
        Negative for a hyperbola.
    eccentricity : float
        Any but 1.
    inclination_deg, node_deg, pericentre_deg, anomaly_deg : float
        Inclination, right ascension of the ascending node, argument of the pericentre, anomaly.
    gm_m3_s2 : float, optional
        GM of the centre. None if a message read leniently leaves it out.
    mean : bool
        Whether the anomaly is the mean one, not the true one.
    """

    semi_major_axis_m: float
    eccentricity: float
    inclination_deg: float
    node_deg: float
    pericentre_deg: float
    anomaly_deg: float
    gm_m3_s2: float | None
    mean: bool = False


@dataclass(frozen=True)
class Opm:
    """An Orbit Parameter Message [1]_.

    Parameters
    ----------
    object_name, object_id, center_name : str
        Of the spacecraft, and of the origin, e.g. ``"MARS"``.
    frame : str
        Registered frame of the state.
    epoch : Epoch
        Of the state, in the time system of the message.
    x : ndarray, shape (6,)
        Position, m, and velocity, m/s.
    frame_epoch : Epoch, optional
        Epoch of the frame, where its definition leaves that open.
    elements : OsculatingElements, optional
        The same state as elements.
    mass_kg, solar_radiation_area_m2, solar_radiation_coefficient, drag_area_m2, drag_coefficient
        Of the spacecraft; None where the message is silent.
    covariance : ndarray, shape (6, 6), optional
        Of position (m) and velocity (m/s).
    covariance_frame : str
        Its frame; empty for that of the state.
    manoeuvres : tuple of Manoeuvre
        In the order of the message.
    user_defined : mapping of str to str
        Values by the name behind ``USER_DEFINED_``.
    comments : tuple of str
        All lines of comment but those of manoeuvres, in order.
    classification, message_id : str
        Of the header; empty if absent.
    originator, created : str
        Of the header that was read; a writer states its own.
    warnings : tuple of str
        What a reader noticed and did not refuse.
    """

    object_name: str
    object_id: str
    center_name: str
    frame: str
    epoch: Epoch
    x: Array
    frame_epoch: Epoch | None = None
    elements: OsculatingElements | None = None
    mass_kg: float | None = None
    solar_radiation_area_m2: float | None = None
    solar_radiation_coefficient: float | None = None
    drag_area_m2: float | None = None
    drag_coefficient: float | None = None
    covariance: Array | None = None
    covariance_frame: str = ""
    manoeuvres: tuple[Manoeuvre, ...] = ()
    user_defined: Mapping[str, str] = field(default_factory=dict)
    comments: tuple[str, ...] = ()
    classification: str = ""
    message_id: str = ""
    originator: str = field(default="", compare=False)
    created: str = field(default="", compare=False)
    warnings: tuple[str, ...] = field(default=(), compare=False)


def state_of_elements(elements: OsculatingElements, gm_m3_s2: float) -> Array:
    """Return the state (6,), m and m/s, of an ellipse or hyperbola.

    Parameters
    ----------
    elements : OsculatingElements
        Elements; an ellipse has a > 0 and e < 1, a hyperbola a < 0 and e > 1.
    gm_m3_s2 : float
        GM of the centre.
    """
    a, e = elements.semi_major_axis_m, elements.eccentricity
    true = radians(elements.anomaly_deg)
    if elements.mean:
        true = _true_anomaly(true, e)
    p = a * (1.0 - e * e)
    # perifocal axes: towards the pericentre, and 90° ahead of it; [2]_, equations 2.5-1 and 2.5-4
    r = p / (1.0 + e * cos(true))
    speed = sqrt(gm_m3_s2 / p)
    plane = np.array(
        [[r * cos(true), r * sin(true)], [-speed * sin(true), speed * (e + cos(true))]]
    )
    i, node, w = (
        radians(angle)
        for angle in (elements.inclination_deg, elements.node_deg, elements.pericentre_deg)
    )
    first = [cos(node) * cos(w) - sin(node) * sin(w) * cos(i),
             sin(node) * cos(w) + cos(node) * sin(w) * cos(i), sin(w) * sin(i)]  # fmt: skip
    second = [-cos(node) * sin(w) - sin(node) * cos(w) * cos(i),
              -sin(node) * sin(w) + cos(node) * cos(w) * cos(i), cos(w) * sin(i)]  # fmt: skip
    return np.concatenate(plane @ np.array([first, second]))


def _true_anomaly(mean: float, e: float) -> float:
    """Return the true anomaly by Kepler's equation, bracketed by its bounds on both sides."""
    # Every mission imports this module for its start states, few read elements of a message.
    from scipy.optimize import brentq

    if e < 1.0:
        # M = E − e sin E, so that |E − M| ≤ e
        mean = (mean + pi) % (2.0 * pi) - pi
        eccentric = brentq(lambda x: x - e * sin(x) - mean, mean - e - 1e-9, mean + e + 1e-9,
                           xtol=1e-15)  # fmt: skip
        return 2.0 * atan2(sqrt(1.0 + e) * sin(eccentric / 2.0),
                           sqrt(1.0 - e) * cos(eccentric / 2.0))  # fmt: skip
    # M = e sinh H − H, and sinh H ≥ H: (e − 1) sinh H ≤ M ≤ e sinh H for M ≥ 0
    low, high = asinh(abs(mean) / e), asinh(abs(mean) / (e - 1.0))
    h = brentq(lambda x: e * np.sinh(x) - x - abs(mean), low - 1e-9, high + 1e-9, xtol=1e-15)
    true = 2.0 * atan2(sqrt(e + 1.0) * tanh(h / 2.0), sqrt(e - 1.0))
    return true if mean >= 0.0 else -true
