"""XML of CCSDS messages as a tree of elements, and cut into the messages of one file.

References
----------
.. [1] CCSDS 505.0-B-3, XML Specification for Navigation Data Messages, Blue Book, 2023.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from hillsphere.formats.ccsds_xml import XmlWalk, walk_xml

__all__ = ["XmlElement", "XmlPart", "read_tree", "split_children"]


@dataclass
class XmlElement:
    """An element of XML, with its place (``"file:line"``), its text and what it holds."""

    place: str
    name: str
    unit: str = ""
    attributes: dict[str, str] = field(default_factory=dict)
    text: str = ""
    children: list[XmlElement] = field(default_factory=list)


def read_tree(text: str, where: str) -> XmlElement:
    """Return the outermost element of a text, and within it all others.

    Raises
    ------
    InputError
        As for `walk_xml`.
    """
    above = XmlElement(f"{where}:1", "")
    within = [above]

    def start(place: str, name: str, attributes: dict[str, str]) -> None:
        element = XmlElement(place, name, attributes.get("units", ""), attributes)
        within[-1].children.append(element)
        within.append(element)

    def end(_: str, text: str) -> None:
        within.pop().text = text

    walk_xml(text, where, start, end)
    return above.children[0]  # a well-formed text has exactly one


class XmlPart(NamedTuple):
    """An element with its place, its name, its text, and the number of lines above it."""

    place: str
    name: str
    text: str
    above: int


def split_children(text: str, where: str) -> tuple[str, list[XmlPart]]:
    """Return the name of the outermost element, and the elements directly within it.

    Parameters
    ----------
    text : str
        The whole text.
    where : str
        Name of the file, used in places and error messages.

    Raises
    ------
    InputError
        As for `walk_xml`.
    """
    body = text.lstrip("\ufeff \t\r\n")
    above = text[: len(text) - len(body)].count("\n")
    data = body.encode("utf-8", "surrogatepass")
    names: list[str] = []
    began: list[tuple[str, int]] = []
    inner: list[str] = []
    root = ""
    parts: list[XmlPart] = []

    def start(place: str, name: str, _: dict[str, str]) -> None:
        nonlocal root
        root = root or name
        if len(names) == 1:
            began.append((place, walk.index))
            inner.clear()
        else:
            inner.append(name)
        names.append(name)

    def end(name: str, text: str) -> None:
        names.pop()
        if len(names) == 1:
            (place, first), stop = began[-1], walk.index
            # The walk stands before an end tag, which has no attributes, but behind a tag <x/>.
            if inner or text or not data[first:stop].endswith(b"/>"):
                stop = data.index(b">", stop) + 1
            piece = data[first:stop].decode("utf-8", "surrogatepass")
            parts.append(XmlPart(place, name, piece, int(place.rpartition(":")[2]) - 1))

    walk = XmlWalk(where, start, end, above)
    walk.feed(body, True)
    return root, parts
