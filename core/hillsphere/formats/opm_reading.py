"""Orbit Parameter Messages from their blocks, with every keyword and value checked.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 3 (OPM).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from math import inf

import numpy as np

from hillsphere.base.errors import InputError
from hillsphere.formats.ccsds_entries import Entry, Leniency, order_entries
from hillsphere.formats.ccsds_values import (
    TRIANGLE,
    check_moving_frame,
    check_text,
    read_epoch,
    read_frame,
    read_number,
    read_time_system,
    read_triangle,
)
from hillsphere.formats.oem_encodings import STATE, Block
from hillsphere.formats.oem_reading import UNITS as _OF_STATES
from hillsphere.formats.oem_reading import VERSIONS, needs_epoch
from hillsphere.formats.opm_content import Manoeuvre, Opm, OsculatingElements, state_of_elements
from hillsphere.formats.opm_encodings import BLOCKS, USER_DEFINED, OpmBlocks

__all__ = ["UNITS", "opm_of_blocks"]

UNITS = {
    **_OF_STATES,
    "SEMI_MAJOR_AXIS": "km", "ECCENTRICITY": "", "INCLINATION": "deg", "RA_OF_ASC_NODE": "deg",
    "ARG_OF_PERICENTER": "deg", "TRUE_ANOMALY": "deg", "MEAN_ANOMALY": "deg", "GM": "km**3/s**2",
    "MASS": "kg", "SOLAR_RAD_AREA": "m**2", "SOLAR_RAD_COEFF": "", "DRAG_AREA": "m**2",
    "DRAG_COEFF": "", "MAN_DURATION": "s", "MAN_DELTA_MASS": "kg",
    "MAN_DV_1": "km/s", "MAN_DV_2": "km/s", "MAN_DV_3": "km/s",
}  # fmt: skip
"""The unit of each number."""
_POWERS = {"SEMI_MAJOR_AXIS": 3, "GM": 9, "MAN_DV_1": 3, "MAN_DV_2": 3, "MAN_DV_3": 3}
"""Powers of ten that turn units with km into SI."""
_RANGES = {
    "INCLINATION": (0.0, 180.0), "RA_OF_ASC_NODE": (-360.0, 360.0),
    "ARG_OF_PERICENTER": (-360.0, 360.0), "TRUE_ANOMALY": (-360.0, 360.0),
    "ECCENTRICITY": (0.0, inf), "GM": (0.0, inf),
    **dict.fromkeys(BLOCKS["spacecraftParameters"], (0.0, inf)),
    "MAN_DURATION": (0.0, inf), "MAN_DELTA_MASS": (-inf, 0.0),
}  # fmt: skip
"""Bounds of numbers, those of the standard and of its schema."""
_NAMES = {
    "header": "the header", "metadata": "the metadata", "stateVector": "the state",
    "keplerianElements": "a set of elements", "spacecraftParameters": "the spacecraft's block",
    "covarianceMatrix": "a covariance", "maneuverParameters": "a manoeuvre",
    "userDefinedParameters": "the block of user-defined parameters",
}  # fmt: skip
_REQUIRED = {
    "header": ("CREATION_DATE", "ORIGINATOR"),
    "metadata": ("OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM"),
    "stateVector": BLOCKS["stateVector"],
    "keplerianElements": (*BLOCKS["keplerianElements"][:5], "GM"),
    "covarianceMatrix": TRIANGLE,
    "maneuverParameters": BLOCKS["maneuverParameters"],
}
_DISPENSABLE = ("CREATION_DATE", "ORIGINATOR", "GM")
_USER_NAME = re.compile(r"[A-Za-z0-9_]+", re.ASCII)
_SAFETY = 2.0
"""Factor on the first-order bound of the effect of rounding, for its higher orders."""


def opm_of_blocks(message: OpmBlocks, leniency: Leniency) -> Opm:
    """Return a message.

    Raises
    ------
    InputError
        Naming the line and the keyword, at the first fault.
    """
    version = message.version
    if version.value not in VERSIONS:
        raise InputError(
            f"{version.place}: CCSDS_OPM_VERS: version {version.value[:40]!r} is not read; "
            f"expected {', '.join(VERSIONS)}"
        )
    header = _block(message, "header", leniency)
    meta = _block(message, "metadata", leniency)
    for entry in (*header.values(), *meta.values()):
        check_text(entry)
    if "CREATION_DATE" in header:
        read_epoch(header["CREATION_DATE"], "UTC")
    frame = read_frame(meta["REF_FRAME"], leniency)
    if needs_epoch(frame) and "REF_FRAME_EPOCH" not in meta:
        entry = meta["REF_FRAME"]
        raise InputError(
            f"{entry.place}: REF_FRAME: {entry.value} needs a REF_FRAME_EPOCH after it"
        )
    scale = read_time_system(meta["TIME_SYSTEM"])
    state = _block(message, "stateVector", leniency)
    x = np.array([read_number(state[key], UNITS[key], 3) for key in STATE])
    craft = _numbers(_block(message, "spacecraftParameters", leniency))
    covariance, covariance_frame = None, ""
    if "covarianceMatrix" in message.blocks:
        entries = _block(message, "covarianceMatrix", leniency)
        covariance, covariance_frame = read_triangle(entries, UNITS), _moving_frame(entries)
    elements = None
    notes: list[str] = []
    if "keplerianElements" in message.blocks:
        entries = _block(message, "keplerianElements", leniency)
        elements = _elements(entries)
        if note := _difference(elements, entries, x, state):
            notes.append(note)
    frame_epoch = meta.get("REF_FRAME_EPOCH")
    return Opm(
        object_name=meta["OBJECT_NAME"].value,
        object_id=meta["OBJECT_ID"].value,
        center_name=meta["CENTER_NAME"].value,
        frame=frame,
        epoch=read_epoch(state["EPOCH"], scale),
        x=x,
        frame_epoch=frame_epoch and read_epoch(frame_epoch, scale),
        elements=elements,
        mass_kg=craft.get("MASS"),
        solar_radiation_area_m2=craft.get("SOLAR_RAD_AREA"),
        solar_radiation_coefficient=craft.get("SOLAR_RAD_COEFF"),
        drag_area_m2=craft.get("DRAG_AREA"),
        drag_coefficient=craft.get("DRAG_COEFF"),
        covariance=covariance,
        covariance_frame=covariance_frame,
        manoeuvres=tuple(
            _manoeuvre(block, scale, leniency)
            for block in message.blocks.get("maneuverParameters", ())
        ),
        user_defined=_user_defined(message),
        comments=tuple(
            entry.value
            for name in BLOCKS
            if name != "maneuverParameters"
            for block in message.blocks.get(name, ())
            for entry in block.entries
            if entry.key == "COMMENT"
        ),
        classification=_value(header, "CLASSIFICATION"),
        message_id=_value(header, "MESSAGE_ID"),
        originator=_value(header, "ORIGINATOR"),
        created=_value(header, "CREATION_DATE"),
        warnings=(*leniency.warnings, *notes),
    )


def _block(message: OpmBlocks, name: str, leniency: Leniency) -> dict[str, Entry]:
    """Return the entries of a block that occurs once at most; none if it may be absent and is."""
    blocks = message.blocks.get(name)
    if blocks is None:
        if name == "spacecraftParameters":
            return {}
        blocks = [Block(message.end, message.end)]
    return _order_block(blocks[0], name, leniency)


def _order_block(block: Block, name: str, leniency: Leniency) -> dict[str, Entry]:
    entries = [entry for entry in block.entries if entry.key != "COMMENT"]
    return order_entries(
        entries, BLOCKS[name], _REQUIRED.get(name, ()), _NAMES[name], block.end, leniency,
        _DISPENSABLE,
    )  # fmt: skip


def _value(entries: Mapping[str, Entry], key: str) -> str:
    return entries[key].value if key in entries else ""


def _numbers(entries: Mapping[str, Entry]) -> dict[str, float]:
    """Return the numbers among entries, in SI or degrees, each within its bounds."""
    numbers = {}
    for key, entry in entries.items():
        if key not in UNITS:
            continue
        value = read_number(entry, UNITS[key], _POWERS.get(key, 0))
        low, high = _RANGES.get(key, (-inf, inf))
        if not low <= value <= high:
            raise InputError(
                f"{entry.place}: {key} must be {_words(low, high)}, got {entry.value[:40]}"
            )
        numbers[key] = value
    return numbers


def _words(low: float, high: float) -> str:
    if high == inf:
        return f"at least {low:g}"
    return f"at most {high:g}" if low == -inf else f"between {low:g} and {high:g}"


def _moving_frame(entries: Mapping[str, Entry], key: str = "COV_REF_FRAME") -> str:
    """Return the frame of a covariance or a manoeuvre, which may move with the object."""
    if key not in entries:
        return ""
    is_covariance = key == "COV_REF_FRAME"
    check_moving_frame(
        entries[key], "covariance frame" if is_covariance else "frame of a manoeuvre"
    )
    return entries[key].value.upper()


def _elements(entries: Mapping[str, Entry]) -> OsculatingElements:
    anomalies = [key for key in ("TRUE_ANOMALY", "MEAN_ANOMALY") if key in entries]
    axis = entries["SEMI_MAJOR_AXIS"]
    if len(anomalies) != 1:
        place = entries[anomalies[1]].place if anomalies else axis.place
        raise InputError(
            f"{place}: a set of elements has TRUE_ANOMALY or MEAN_ANOMALY, got "
            f"{'both' if anomalies else 'none'}"
        )
    numbers = _numbers(entries)
    a, e = numbers["SEMI_MAJOR_AXIS"], numbers["ECCENTRICITY"]
    if not ((a > 0.0 and e < 1.0) or (a < 0.0 and e > 1.0)):
        raise InputError(
            f"{axis.place}: SEMI_MAJOR_AXIS must be positive with ECCENTRICITY < 1, or negative "
            f"with ECCENTRICITY > 1, got {axis.value[:40]} with {entries['ECCENTRICITY'].value}"
        )
    gm = numbers.get("GM")
    if gm == 0.0:
        raise InputError(f"{entries['GM'].place}: GM must be above 0, got 0")
    anomaly = numbers[anomalies[0]]
    if e > 1.0 and anomalies == ["TRUE_ANOMALY"] and 1.0 + e * np.cos(np.radians(anomaly)) <= 0.0:
        entry = entries["TRUE_ANOMALY"]
        raise InputError(
            f"{entry.place}: TRUE_ANOMALY {entry.value[:40]} is beyond the asymptotes of the "
            f"hyperbola, ±{np.degrees(np.arccos(-1.0 / e)):.6g} deg"
        )
    return OsculatingElements(
        a, e, numbers["INCLINATION"], numbers["RA_OF_ASC_NODE"], numbers["ARG_OF_PERICENTER"],
        anomaly, gm, anomalies == ["MEAN_ANOMALY"],
    )  # fmt: skip


_FIELDS = {
    "SEMI_MAJOR_AXIS": "semi_major_axis_m", "ECCENTRICITY": "eccentricity",
    "INCLINATION": "inclination_deg", "RA_OF_ASC_NODE": "node_deg",
    "ARG_OF_PERICENTER": "pericentre_deg", "TRUE_ANOMALY": "anomaly_deg",
    "MEAN_ANOMALY": "anomaly_deg", "GM": "gm_m3_s2",
}  # fmt: skip


def _difference(
    elements: OsculatingElements,
    entries: Mapping[str, Entry],
    x: np.ndarray,
    state: Mapping[str, Entry],
) -> str:
    """Return a note if elements are not those of a state; empty if they are, or GM is unknown.

    Half a unit of the last digit of each number bounds what rounding may do: to first order the
    state of the elements moves by the sum of the moves of each.
    """
    if elements.gm_m3_s2 is None:
        return ""

    def state_of(changed: OsculatingElements) -> np.ndarray:
        return state_of_elements(changed, changed.gm_m3_s2 or 0.0)

    with np.errstate(all="ignore"):
        try:
            own = state_of(elements)
            bound = np.array([_half_digit(state[key], 3) for key in STATE])
            for key, name in _FIELDS.items():
                if key in entries:
                    value = getattr(elements, name)
                    half = _half_digit(entries[key], _POWERS.get(key, 0))
                    if key == "ECCENTRICITY":
                        half = min(half, 0.5 * abs(1.0 - value))
                    # downwards for e stays on the same side of 1 for an ellipse
                    step = -half if value < 1.0 and key == "ECCENTRICITY" else half
                    if key == "ECCENTRICITY" and value < half:
                        step = half
                    bound += abs(state_of(replace(elements, **{name: value + step})) - own)
        except (ValueError, OverflowError, RuntimeError, ZeroDivisionError):
            own = np.full(6, np.nan)
            bound = np.zeros(6)
        off = np.linalg.norm((x - own).reshape(2, 3), axis=1)
        allowed = _SAFETY * np.linalg.norm(bound.reshape(2, 3), axis=1)
        # what double precision itself leaves
        allowed += 1e-12 * np.linalg.norm(x.reshape(2, 3), axis=1)
    place = entries["SEMI_MAJOR_AXIS"].place
    if np.all(off <= allowed):
        return ""
    if not np.all(np.isfinite(off)):
        return (
            f"{place}: the elements have no finite state that could be compared; the state counts"
        )
    return (
        f"{place}: the elements differ from the state by {off[0] / 1e3:.6g} km and "
        f"{off[1] / 1e3:.6g} km/s, their digits explain {allowed[0] / 1e3:.2g} km and "
        f"{allowed[1] / 1e3:.2g} km/s; the state counts"
    )


def _half_digit(entry: Entry, power: int) -> float:
    """Return half a unit of the last digit that a number states, times a power of ten."""
    exponent = Decimal(entry.value).as_tuple().exponent
    assert isinstance(exponent, int)  # a finite number, as it has been read before
    return 0.5 * float(f"1e{min(max(exponent + power, -300), 300)}")


def _manoeuvre(block: Block, scale: str, leniency: Leniency) -> Manoeuvre:
    entries = _order_block(block, "maneuverParameters", leniency)
    numbers = _numbers(entries)
    return Manoeuvre(
        read_epoch(entries["MAN_EPOCH_IGNITION"], scale),
        numbers["MAN_DURATION"],
        numbers["MAN_DELTA_MASS"],
        _moving_frame(entries, "MAN_REF_FRAME"),
        np.array([numbers[f"MAN_DV_{axis}"] for axis in (1, 2, 3)]),
        tuple(entry.value for entry in block.entries if entry.key == "COMMENT"),
    )


def _user_defined(message: OpmBlocks) -> dict[str, str]:
    values: dict[str, str] = {}
    for block in message.blocks.get("userDefinedParameters", ()):
        for entry in block.entries:
            if entry.key == "COMMENT":
                continue
            name = entry.key.removeprefix(USER_DEFINED)
            if not (entry.key.startswith(USER_DEFINED) and _USER_NAME.fullmatch(name)):
                raise InputError(
                    f"{entry.place}: expected {USER_DEFINED} and a name of letters, digits and "
                    f"'_', got {entry.key[:60]!r}"
                )
            if name in values:
                raise InputError(f"{entry.place}: {entry.key} occurs twice; keep one")
            if not entry.value:
                raise InputError(f"{entry.place}: {entry.key} has no value; expected one after it")
            check_text(entry)
            values[name] = entry.value
    return values
