"""The two encodings of Orbit Parameter Messages, text (KVN) and XML, taken apart into blocks.

Both give the same blocks; what their keywords and values may be is checked in `opm_reading`.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 3 (OPM) and 8 (XML).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.formats.ccsds_entries import (
    KEYWORD_LINE,
    LINE_ENDS,
    VERSION_KEYWORD,
    Entry,
    Leniency,
    split_unit,
)
from hillsphere.formats.ccsds_tree import XmlElement, read_tree
from hillsphere.formats.oem_encodings import COVARIANCE, STATE, Block

__all__ = [
    "BLOCKS", "USER_DEFINED", "OpmBlocks", "children_of", "entry_of", "take_apart", "xml_parts",
]  # fmt: skip

USER_DEFINED = "USER_DEFINED_"
"""Beginning of the keywords whose meaning the parties of an exchange agree upon."""
BLOCKS = {
    "header": ("CLASSIFICATION", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID"),
    "metadata": (
        "OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "REF_FRAME_EPOCH", "TIME_SYSTEM",
    ),
    "stateVector": ("EPOCH", *STATE),
    "keplerianElements": (
        "SEMI_MAJOR_AXIS", "ECCENTRICITY", "INCLINATION", "RA_OF_ASC_NODE", "ARG_OF_PERICENTER",
        "TRUE_ANOMALY", "MEAN_ANOMALY", "GM",
    ),
    "spacecraftParameters": (
        "MASS", "SOLAR_RAD_AREA", "SOLAR_RAD_COEFF", "DRAG_AREA", "DRAG_COEFF",
    ),
    "covarianceMatrix": ("COV_REF_FRAME", *(key for row in COVARIANCE for key in row)),
    "maneuverParameters": (
        "MAN_EPOCH_IGNITION", "MAN_DURATION", "MAN_DELTA_MASS", "MAN_REF_FRAME",
        "MAN_DV_1", "MAN_DV_2", "MAN_DV_3",
    ),
    "userDefinedParameters": (),
}  # fmt: skip
"""Keywords of each block in order, and the blocks, by their names in XML, in order."""
_BLOCK_OF = {key: name for name, keys in BLOCKS.items() for key in keys}
_RANK = {name: number for number, name in enumerate(BLOCKS)}
_TEXTS = ("header", "metadata", "userDefinedParameters")
"""Blocks without numbers: brackets in their values are not those of a unit."""


@dataclass
class OpmBlocks:
    """A message: its version, and the blocks by their names in XML, each with its comments."""

    version: Entry
    blocks: dict[str, list[Block]] = field(default_factory=dict)
    end: str = ""


def take_apart(text: str, where: str, leniency: Leniency) -> OpmBlocks:
    """Return the blocks of a message in either encoding.

    Raises
    ------
    InputError
        If they do not follow each other as the standard prescribes; the message names the line.
    """
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        return _of_xml(text, where, leniency)
    return _of_kvn(text, where, leniency)


def _of_kvn(text: str, where: str, leniency: Leniency) -> OpmBlocks:
    message: OpmBlocks | None = None
    remarks: list[Entry] = []
    current, last, number = "header", "", 1
    for number, raw in enumerate(LINE_ENDS.split(text.removeprefix("\ufeff")), 1):
        line, place = raw.strip(), f"{where}:{number}"
        if not line:
            continue
        if line == "COMMENT" or line.startswith(("COMMENT ", "COMMENT\t")):
            remarks.append(Entry(place, "COMMENT", line[8:].strip()))
            continue
        match = KEYWORD_LINE.fullmatch(line)
        if message is None:
            if match is None or match[1] != "CCSDS_OPM_VERS":
                raise InputError(
                    f"{place}: not an orbit parameter message: expected CCSDS_OPM_VERS = 3.0, got "
                    f"{line[:40]!r}"
                )
            message = OpmBlocks(Entry(place, match[1], match[2]), end=place)
            continue
        if match is None:
            raise InputError(f"{place}: expected KEYWORD = value, got {line[:40]!r}")
        key, value, unit = match[1], match[2], ""
        if VERSION_KEYWORD.fullmatch(key):
            raise InputError(
                f"{place}: a second message begins here; a text holds one orbit parameter "
                "message: write each into its own file, or all as parts of an <ndm> in XML"
            )
        name = "userDefinedParameters" if key.startswith(USER_DEFINED) else _BLOCK_OF.get(key, "")
        if not name:
            hint = did_you_mean(key, _BLOCK_OF, otherwise="keywords")
            leniency.tolerate(
                f"{place}: an orbit parameter message has no keyword {key[:60]!r}{hint}"
            )
            continue
        if _RANK[name] < _RANK[current]:
            leniency.tolerate(f"{place}: {key} must stand before {last}")
        if name not in _TEXTS:
            value, unit = split_unit(value)
        blocks = message.blocks.setdefault(name, [])
        if not blocks or key == "MAN_EPOCH_IGNITION" or (
            name == "maneuverParameters" and current != name
        ):  # fmt: skip
            blocks.append(Block(place))
        blocks[-1].entries += [*remarks, Entry(place, key, value, unit)]
        blocks[-1].end = place
        remarks, current, last = [], name, key
        message.end = place
    place = f"{where}:{number}"
    if message is None:
        raise InputError(
            f"{place}: not an orbit parameter message: no CCSDS_OPM_VERS = 3.0 at its beginning"
        )
    if remarks:
        message.blocks.setdefault("header", [Block(place, place)])[-1].entries += remarks
    return message


def _of_xml(text: str, where: str, leniency: Leniency) -> OpmBlocks:
    (message,) = xml_parts(read_tree(text, where), "opm", "an orbit parameter message", 1)
    parts = children_of(message, ("header", "body"), ("header", "body"), leniency)
    body = parts["body"][0]
    segment = children_of(body, ("segment",), ("segment",), leniency)["segment"][0]
    inner = children_of(segment, ("metadata", "data"), ("metadata", "data"), leniency)
    result = OpmBlocks(
        Entry(message.place, "CCSDS_OPM_VERS", message.attributes.get("version", "")),
        end=message.place,
    )
    data = children_of(
        inner["data"][0], tuple(BLOCKS)[2:], ("stateVector",), leniency, ("maneuverParameters",)
    )
    for name, elements in {**parts, **inner, **data}.items():
        if name in BLOCKS:
            result.blocks[name] = [_leaves(element) for element in elements]
    for container in (message, body, segment, inner["data"][0]):
        remarks = [entry_of(one) for one in container.children if one.name == "COMMENT"]
        result.blocks["metadata"][0].entries += remarks
    return result


def xml_parts(root: XmlElement, name: str, what: str, most: int) -> list[XmlElement]:
    """Return the messages of a kind in XML: the outermost element, or all parts of an ``<ndm>``.

    Parameters
    ----------
    root : XmlElement
        The outermost element.
    name : str
        Of the element of a message.
    what : str
        Name of the message, used in error messages.
    most : int
        How many messages there may be.

    Raises
    ------
    InputError
        If there is none, another element, or more.
    """
    if root.name == name:
        return [root]
    if root.name != "ndm":
        hint = did_you_mean(root.name, ("ndm", name), otherwise="expected")
        raise InputError(f"{root.place}: {what} has no element {root.name[:60]!r}{hint}")
    parts = [one for one in root.children if one.name not in ("COMMENT", "MESSAGE_ID")]
    for part in parts:
        if part.name != name:
            raise InputError(
                f"{part.place}: <ndm> holds <{part.name[:60]}>, expected <{name}> only; "
                "`split_ndm` gives the parts of each kind"
            )
    if not parts:
        raise InputError(f"{root.place}: <ndm> holds no <{name}>")
    if len(parts) > most:
        raise InputError(
            f"{parts[most].place}: a second <{name}>; `split_ndm` gives the parts one by one"
        )
    return parts


def children_of(
    element: XmlElement,
    names: tuple[str, ...],
    required: tuple[str, ...],
    leniency: Leniency,
    many: tuple[str, ...] = (),
) -> dict[str, list[XmlElement]]:
    """Return the children of an element by name, if they are those it may have, in order.

    Parameters
    ----------
    element : XmlElement
        The element; comments in it are passed over.
    names, required, many : tuple of str
        Names of children in order, those that must be there, and those that may be repeated.
    leniency : Leniency
        Whether another order is tolerated.

    Raises
    ------
    InputError
        If a child is unknown, missing or repeated, or the element holds text.
    """
    _check_no_text(element)
    parts: dict[str, list[XmlElement]] = {}
    last = ""
    for child in element.children:
        if child.name == "COMMENT":
            continue
        if child.name not in names:
            hint = did_you_mean(child.name, names, otherwise="expected")
            raise InputError(
                f"{child.place}: <{element.name}> has no element {child.name[:60]!r}{hint}"
            )
        if child.name in parts and child.name not in many:
            raise InputError(f"{child.place}: a second <{child.name}>; keep one")
        if last and names.index(child.name) < names.index(last):
            leniency.tolerate(f"{child.place}: <{child.name}> must stand before <{last}>")
        parts.setdefault(child.name, []).append(child)
        last = child.name
    for name in required:
        if name not in parts:
            raise InputError(f"{element.place}: <{element.name}> lacks <{name}>")
    return parts


def _leaves(element: XmlElement) -> Block:
    _check_no_text(element)
    return Block(element.place, element.place, [entry_of(child) for child in element.children])


def entry_of(element: XmlElement) -> Entry:
    """Return the keyword, value and unit of an element; `InputError` if it holds elements."""
    if element.children:
        raise InputError(
            f"{element.place}: {element.name[:60]!r} must hold a value, not further elements"
        )
    key = element.name
    if key == "USER_DEFINED":
        key = f"{USER_DEFINED}{element.attributes.get('parameter', '')}"
    return Entry(element.place, key, element.text, element.unit)


def _check_no_text(element: XmlElement) -> None:
    if element.text:
        raise InputError(
            f"{element.place}: <{element.name}> holds elements, got the text {element.text[:40]!r}"
        )
