"""What was measured along a signal's path, and the values that a model expects.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, sections 3.3 and 3.5.
.. [2] Moyer, T. D., Formulation for Observed and Computed Values of Deep Space Network Data Types
   for Navigation, JPL, 2000, sections 13.3 and 13.5.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from hillsphere.base.constants import SPEED_OF_LIGHT_M_S
from hillsphere.interfaces import Array, Channel
from hillsphere_estimators.orbit_fit.light_time import Node, Path, Signal, follow_signal
from hillsphere_estimators.orbit_fit.sight import HORIZON, aberrate, line_angles
from hillsphere_estimators.orbit_fit.surroundings import Surroundings
from hillsphere_estimators.orbit_fit.uplink import Transmission

__all__ = ["Aberration", "Kind", "Observable", "expected_values"]

Kind: TypeAlias = Literal["angles", "range", "range_rate", "frequency"]
Aberration: TypeAlias = Literal["none", "observer", "stars", "instantaneous"]

_UNITS: Mapping[Kind, str] = {
    "angles": "rad", "range": "m", "range_rate": "m/s", "frequency": "Hz",
}  # fmt: skip
INTEGRATION = {"END": -0.5, "MIDDLE": 0.0, "START": 0.5}
"""Middle of the interval less the time tag, in intervals ([1]_, section 3.5.2.8.2)."""


@dataclass(frozen=True)
class Observable:
    """One quantity along one path; both angles of a direction are one observable.

    Parameters
    ----------
    kind : str
        ``"angles"``, ``"range"``, ``"range_rate"`` or ``"frequency"``.
    path : tuple of str
        Participants in the order of the signal; the first sends, the last receives.
    angle_type : str
        AZEL, XEYN, XSYE or RADEC.
    frame : str
        Of right ascension and declination.
    tagged : {"receive", "transmit"}
        To what the time tags refer.
    interval_s : float
        Integration interval; 0 for an instantaneous value.
    middle : float
        Middle of the interval less the time tag, in intervals.
    receive_delays_s, transmit_delays_s : tuple of float
        Of each participant of the path.
    share : float
        Part of the round trip that a range or its rate counts: 1, or ½ for half of it.
    modulus_m : float
        Ambiguity of the range; 0 for none.
    turnaround : float
        Ratio of the transponder.
    """

    kind: Kind
    path: tuple[str, ...]
    angle_type: str = ""
    frame: str = ""
    tagged: str = "receive"
    interval_s: float = 0.0
    middle: float = 0.0
    receive_delays_s: tuple[float, ...] = ()
    transmit_delays_s: tuple[float, ...] = ()
    share: float = 1.0
    modulus_m: float = 0.0
    turnaround: float = 1.0

    @property
    def receiver(self) -> str:
        """The participant that measures."""
        return self.path[-1]

    @property
    def travelled(self) -> tuple[str, ...]:
        """The part of the path that counts: of angles the last leg, but where the sender tags."""
        if self.kind == "angles" and self.tagged == "receive":
            return self.path[-2:]
        return self.path

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rows, for tables."""
        if self.kind == "angles":
            return {
                "AZEL": ("azimuth", "elevation"), "XEYN": ("X (east)", "Y (north)"),
                "XSYE": ("X (south)", "Y (east)"), "RADEC": ("right ascension", "declination"),
            }[self.angle_type]  # fmt: skip
        text = {"range": "range", "range_rate": "range rate", "frequency": "received frequency"}
        return (text[self.kind],)

    @property
    def label(self) -> str:
        """The path, for tables."""
        return " → ".join(self.path)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Rows of a set of measurements."""
        kind: Literal["angle", "linear"] = "angle" if self.kind == "angles" else "linear"
        unit = _UNITS[self.kind]
        return tuple(Channel(f"{self.label}: {name}", unit, kind) for name in self.names)


def expected_values(
    observable: Observable,
    states: Callable[[str], Path],
    surroundings: Surroundings,
    t_s: Array,
    aberration: Aberration,
    transmission: Transmission | None,
    near: bool = True,
) -> Array:
    r"""Return the error-free values of an observable.

    With T the time from the transmitter's to the receiver's electronics, a range is c T times the
    share; its rate c Ṫ, or over an interval Δ the difference of two ranges over Δ. A received
    frequency counts the cycles that were sent: with the turnaround ratio M and the mean
    :math:`\bar f` of the frequency during the transmission, which takes Δ less the change of T,

    .. math:: f_R = M \bar f\, (1 - \Delta T/\Delta) .

    It is returned, and must be compared, less M times the first transmitted frequency.

    Parameters
    ----------
    observable : Observable
        What is measured.
    states : callable
        Name of a participant → its inertial states (6, N) at times after the tags.
    surroundings : Surroundings
        Axes of angles.
    t_s : ndarray, shape (N,)
        Time tags.
    aberration : {"none", "observer", "stars", "instantaneous"}
        Of directions: none; by the observer's velocity; of directions that were measured against
        stars, see `Surroundings.celestial`; or neither aberration nor light time.
    transmission : Transmission or None
        Of the frequency; its times count as `t_s`.
    near : bool
        Whether the signal keeps near the plant's centre, see `Surroundings.is_near`.

    Returns
    -------
    ndarray, shape (r, N)
        Two angles, rad, or one row in m, m/s or Hz.
    """
    o = observable
    count = len(o.path)
    receive, transmit = (
        delays or (0.0,) * count for delays in (o.receive_delays_s, o.transmit_delays_s)
    )
    nodes = [Node(states(name), r, s) for name, r, s in zip(o.path, receive, transmit, strict=True)]
    zero = np.zeros(len(t_s))
    if o.kind == "angles" and aberration == "instantaneous":
        line = nodes[-2].states(zero)[:3] - nodes[-1].states(zero)[:3]
        return line_angles(_along_axes(o, line, surroundings, t_s, None, near), o.angle_type)
    if o.kind == "angles":
        signal = follow_signal(nodes[-len(o.travelled) :], zero, o.tagged)
        return _angles(o, signal, surroundings, t_s, aberration, near)
    if not o.interval_s:
        signal = follow_signal(nodes, zero, o.tagged)
        if o.kind == "range":
            return o.share * SPEED_OF_LIGHT_M_S * signal.elapsed_s[None]
        if o.kind == "range_rate":
            return o.share * SPEED_OF_LIGHT_M_S * signal.slowing[None]
        assert transmission is not None
        transmission.check(t_s + signal.sent_s)
        off, slowing = transmission.offset(t_s + signal.sent_s), signal.slowing
    else:
        begin, end = (
            follow_signal(nodes, zero + (o.middle + side) * o.interval_s, o.tagged)
            for side in (-0.5, 0.5)
        )
        grown = end.elapsed_s - begin.elapsed_s
        if o.kind == "range_rate":
            return o.share * SPEED_OF_LIGHT_M_S * grown[None] / o.interval_s
        assert transmission is not None
        transmission.check(t_s + begin.sent_s)
        off = transmission.mean_offset(t_s + begin.sent_s, t_s + end.sent_s)
        slowing = grown / (end.received_s - begin.received_s)
    reference = transmission.reference_hz
    return np.asarray(o.turnaround * (off * (1.0 - slowing) - reference * slowing)[None])


def _angles(
    observable: Observable,
    signal: Signal,
    surroundings: Surroundings,
    t_s: Array,
    aberration: Aberration,
    near: bool,
) -> Array:
    """Return the angles (2, N) of the last leg, rad."""
    line, there = signal.line_m, t_s + signal.at_antenna_s
    if aberration == "observer":
        line = aberrate(line, signal.receiver[3:])
    light = signal.light_time_s if aberration == "stars" else None
    along = _along_axes(observable, line, surroundings, there, light, near)
    return line_angles(along, observable.angle_type)


def _along_axes(
    observable: Observable,
    line: Array,
    surroundings: Surroundings,
    t_s: Array,
    light_time_s: Array | None,
    near: bool,
) -> Array:
    """Return inertial lines (3, N) along the axes in which an observable's angles count."""
    if observable.angle_type in HORIZON:
        return surroundings.horizon(observable.receiver, line, t_s)
    return surroundings.celestial(observable.frame, line, t_s, light_time_s, near)
