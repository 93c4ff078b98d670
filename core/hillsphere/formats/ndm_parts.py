"""Navigation Data Messages in one file: an ``<ndm>`` in XML and the messages within it.

References
----------
.. [1] CCSDS 505.0-B-3, XML Specification for Navigation Data Messages, Blue Book, 2023.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.formats.ccsds_entries import LINE_ENDS
from hillsphere.formats.ccsds_tree import split_children

__all__ = ["KINDS", "NdmPart", "parts_of_kind", "split_ndm"]

KINDS = ("acm", "aem", "apm", "cdm", "ocm", "oem", "omm", "opm", "rdm", "tdm")
"""Kinds of messages that an ``<ndm>`` may hold."""
_BEGINS = re.compile(r"(?:\s|<\?.*?\?>|<!--.*?-->)*<(?:[\w.-]+:)?([\w.-]+)", re.DOTALL)
_VERSION = re.compile(r"\s*CCSDS_([A-Z]{3})_VERS\s*=", re.ASCII)
_REPEATABLE = ("omm",)
"""Kinds whose readers take several messages of one text in KVN."""


@dataclass(frozen=True)
class NdmPart:
    """One message of a file.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    place : str
        File and line where it begins.
    piece : str
        The message alone.
    above : int
        Number of lines of the file above it.
    """

    kind: str
    place: str
    piece: str
    above: int = 0

    @property
    def text(self) -> str:
        """The message behind as many empty lines as its line number in the file needs.

        It is made when it is asked for: the empty lines of all messages of a large file together
        would take its size times their number.
        """
        return "\n" * self.above + self.piece


def split_ndm(text: str, where: str = "NDM") -> list[NdmPart]:
    """Return the messages of a text: those of an ``<ndm>``, or the only one.

    Parameters
    ----------
    text : str
        XML, or one message as text (KVN).
    where : str
        Name of the file, used in places and error messages.

    Returns
    -------
    list of NdmPart
        In the order of the file.

    Raises
    ------
    InputError
        If the XML is not well-formed, holds no or another element, or a text of another kind than
        OMM has several messages.
    """
    if not text.lstrip("\ufeff \t\r\n").startswith("<"):
        return [_kvn_part(text, where)]
    root, children = split_children(text, where)
    if root != "ndm":
        if root not in KINDS:
            hint = did_you_mean(root, ("ndm", *KINDS), otherwise="expected")
            raise InputError(f"{where}:1: no navigation data message: <{root[:60]}>{hint}")
        return [NdmPart(root, f"{where}:1", text)]
    parts = []
    for child in children:
        if child.name in ("COMMENT", "MESSAGE_ID"):
            continue
        if child.name not in KINDS:
            hint = did_you_mean(child.name, KINDS, otherwise="expected")
            raise InputError(f"{child.place}: <ndm> has no element {child.name[:60]!r}{hint}")
        parts.append(NdmPart(child.name, child.place, child.text, child.above))
    if not parts:
        raise InputError(f"{where}:1: <ndm> holds no message")
    return parts


def _kvn_part(text: str, where: str) -> NdmPart:
    first: NdmPart | None = None
    for number, line in enumerate(LINE_ENDS.split(text.removeprefix("\ufeff")), 1):
        match = _VERSION.match(line)
        if match is None:
            continue
        kind, place = match[1].lower(), f"{where}:{number}"
        if first is None:
            first = NdmPart(kind, place, text)
        elif kind != first.kind or kind not in _REPEATABLE:
            raise InputError(
                f"{place}: a second message begins here, after the one at {first.place}; write "
                "each into its own file, or all as parts of an <ndm> in XML"
            )
    if first is None or first.kind not in KINDS:
        raise InputError(
            f"{where}:1: no navigation data message: expected CCSDS_OPM_VERS = 3.0 or the like, or "
            "<ndm>"
        )
    return first


def parts_of_kind(text: str, where: str, kind: str) -> Iterator[str]:
    """Return the texts of an ``<ndm>`` of one kind; any other text as it is.

    Raises
    ------
    InputError
        If an ``<ndm>`` holds another kind, or nothing.
    """
    begins = _BEGINS.match(text[:4096].lstrip("\ufeff"))
    if begins is None or begins[1] != "ndm":
        return iter([text])
    parts = split_ndm(text, where)
    for part in parts:
        if part.kind != kind:
            raise InputError(
                f"{part.place}: <ndm> holds <{part.kind}>, expected <{kind}> only; `split_ndm` "
                "gives the parts of each kind"
            )
    return (part.text for part in parts)
