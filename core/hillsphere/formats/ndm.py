"""Navigation Data Messages of several kinds in one file, each read by its reader.

References
----------
.. [1] CCSDS 505.0-B-3, XML Specification for Navigation Data Messages, Blue Book, 2023.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from hillsphere.formats.ndm_parts import NdmPart, split_ndm
from hillsphere.formats.ocm import read_ocm
from hillsphere.formats.oem import read_oem
from hillsphere.formats.opm import read_opm
from hillsphere.formats.tdm import read_tdm

__all__ = ["NdmMessage", "NdmPart", "read_ndm", "split_ndm"]

_READERS: dict[str, Callable[..., Any]] = {
    "opm": read_opm,
    "oem": read_oem,
    "ocm": read_ocm,
    "tdm": read_tdm,
}


@dataclass(frozen=True)
class NdmMessage:
    """One message of a file.

    Parameters
    ----------
    kind : str
        ``"opm"``, ``"oem"``, …
    place : str
        File and line where it begins.
    content : object
        What its reader returns: an `Opm`, a list of `OemSegment`, …; None if it has no reader.
    reason : str
        Why it was not read, else empty.
    warnings : tuple of str
        What a reader noticed and did not refuse.
    """

    kind: str
    place: str
    content: Any
    reason: str = ""
    warnings: tuple[str, ...] = ()


def read_ndm(
    text: str,
    where: str = "NDM",
    *,
    lenient: bool = False,
    readers: Mapping[str, Callable[..., Any]] | None = None,
) -> list[NdmMessage]:
    """Read all messages of a file, each with the line numbers of the file.

    Parameters
    ----------
    text : str
        An ``<ndm>`` in XML, or a single message in either encoding.
    where : str
        Name of the file, used in error messages.
    lenient : bool
        Whether harmless departures from the standard become warnings of the messages.
    readers : mapping of str to callable, optional
        Further readers by kind, called as ``read(text, where, lenient=…)``:
        `hillsphere_tracking.omm.read_omms` reads ``"omm"``.

    Returns
    -------
    list of NdmMessage
        In the order of the file. A kind without a reader (attitude, conjunction and re-entry
        messages) has no content, and a reason.

    Raises
    ------
    InputError
        As for `split_ndm`, and as the readers raise.
    """
    known = {**_READERS, **(readers or {})}
    messages = []
    for part in split_ndm(text, where):
        if read := known.get(part.kind):
            heard: list[str] = []
            further = {"warn": heard.append} if part.kind == "tdm" else {}
            content = read(part.text, where, lenient=lenient, **further)
            for one in content if isinstance(content, list | tuple) else [content]:
                heard += getattr(one, "warnings", ())
            told = tuple(dict.fromkeys(heard))
            messages.append(NdmMessage(part.kind, part.place, content, warnings=told))
        else:
            reason = f"messages of the kind {part.kind.upper()} are not read"
            if part.kind == "omm":
                reason += " here; `hillsphere passes` and `hillsphere convert` read them"
            messages.append(NdmMessage(part.kind, part.place, None, reason))
    return messages
