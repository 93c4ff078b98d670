"""XML of CCSDS messages: a walk over its elements that expands no entity.

References
----------
.. [1] CCSDS 505.0-B-3, XML Specification for Navigation Data Messages, Blue Book, 2023.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias
from xml.parsers import expat

from hillsphere.base.errors import InputError

__all__ = ["XmlElement", "XmlWalk", "read_tree", "walk_xml"]

Start: TypeAlias = Callable[[str, str, dict[str, str]], object]
End: TypeAlias = Callable[[str, str], object]


class XmlWalk:
    """Walk over the elements of a text while it arrives.

    Parameters
    ----------
    where : str
        Name of the file, used in places and error messages.
    start : callable
        Called at each start tag with its place (``"file:line"``), name and attributes.
    end : callable
        Called at each end tag with its name and the text directly within the element, stripped.
        Prefixes of names, which schemas may give, are left out.
    above : int
        Number of lines above the text.
    """

    def __init__(self, where: str, start: Start, end: End, above: int = 0) -> None:
        self._where, self._above = where, above
        self._parser = parser = expat.ParserCreate("utf-8")
        within: list[list[str]] = [[]]

        def at_start(name: str, attributes: dict[str, str]) -> None:
            within.append([])
            start(self.place, name.rpartition(":")[2], attributes)

        def at_end(name: str) -> None:
            end(name.rpartition(":")[2], "".join(within.pop()).strip())

        def refuse(*_: object) -> None:
            # Entities could make a small file huge; no message of these standards needs them.
            raise InputError(f"{self.place}: a message must not contain a DOCTYPE; remove it")

        parser.StartElementHandler = at_start
        parser.EndElementHandler = at_end
        parser.CharacterDataHandler = lambda piece: within[-1].append(piece)
        parser.StartDoctypeDeclHandler = refuse

    @property
    def place(self) -> str:
        """Where the walk is, as ``"file:line"``."""
        return f"{self._where}:{self._parser.CurrentLineNumber + self._above}"

    def feed(self, text: str, is_last: bool = False) -> None:
        """Walk on over a piece of the text.

        Raises
        ------
        InputError
            If the text is not well-formed or has a DOCTYPE; the message names the line.
        """
        try:
            self._parser.Parse(text.encode("utf-8", "surrogatepass"), is_last)
        except expat.ExpatError as error:
            raise InputError(
                f"{self._where}:{error.lineno + self._above}: not well-formed XML: "
                f"{expat.errors.messages[error.code]}"
            ) from error


def walk_xml(text: str, where: str, start: Start, end: End) -> None:
    """Walk over the elements of a text, whatever encoding it declares.

    Parameters
    ----------
    text : str
        The decoded text, perhaps with a byte order mark and empty lines above it.
    where, start, end
        As for `XmlWalk`.

    Raises
    ------
    InputError
        If the text is not well-formed or has a DOCTYPE; the message names the line.
    """
    body = text.lstrip("\ufeff \t\r\n")
    above = text[: len(text) - len(body)].count("\n")
    XmlWalk(where, start, end, above).feed(body, True)


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
