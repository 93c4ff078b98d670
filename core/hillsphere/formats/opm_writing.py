"""Orbit Parameter Messages as text (KVN) and XML.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 3 (OPM) and 8 (XML).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from datetime import UTC, datetime
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch
from hillsphere.formats.ccsds_entries import write_scaled
from hillsphere.formats.ccsds_values import TRIANGLE
from hillsphere.formats.oem_encodings import STATE
from hillsphere.formats.opm_content import Opm
from hillsphere.formats.opm_encodings import BLOCKS, USER_DEFINED
from hillsphere.formats.opm_reading import UNITS

__all__ = ["epoch_text", "write_message"]

Pairs = list[tuple[str, str]]


def write_message(opm: Opm, originator: str, created: datetime | None, encoding: str) -> str:
    """Return a message, not yet read back; see `hillsphere.formats.opm.write_opm`."""
    _check(opm)
    blocks = list(_blocks(opm, originator, created))
    if encoding == "kvn":
        lines = ["CCSDS_OPM_VERS = 3.0"]
        for _, pairs in blocks:
            lines += [
                f"COMMENT {value}".rstrip() if key == "COMMENT" else f"{key} = {value}"
                for key, value in pairs
            ]
        return "\n".join(lines) + "\n"
    if encoding != "xml":
        raise InputError(f"encoding must be 'kvn' or 'xml', got {encoding!r}")
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<opm id="CCSDS_OPM_VERS" version="3.0">']
    for name, pairs in blocks:
        lines += {"metadata": ["<body>", "<segment>"], "stateVector": ["<data>"]}.get(name, [])
        lines += [f"<{name}>", *(_element(key, value) for key, value in pairs), f"</{name}>"]
    return "\n".join([*lines, "</data>", "</segment>", "</body>", "</opm>"]) + "\n"


def epoch_text(epoch: Epoch) -> str:
    """Return the shortest text, to the millisecond at least, that is read as the same instant.

    Nanoseconds are the last digits that are written.
    """
    texts = [epoch.isot(np.zeros(1), digits)[0] for digits in (3, 6, 9)]
    for text in texts:
        if Epoch.parse(text, epoch.scale) == epoch:
            return text
    return texts[-1]


def _element(key: str, value: str) -> str:
    if key.startswith(USER_DEFINED):
        name = quoteattr(key.removeprefix(USER_DEFINED))
        return f"<USER_DEFINED parameter={name}>{escape(value)}</USER_DEFINED>"
    unit = f' units="{UNITS[key]}"' if UNITS.get(key) else ""
    return f"<{key}{unit}>{escape(value)}</{key}>"


def _blocks(opm: Opm, originator: str, created: datetime | None) -> Iterator[tuple[str, Pairs]]:
    """Yield the blocks of a message, by their names in XML, with keywords and texts of values."""
    stamp = (created or datetime.now(UTC)).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    header = {
        "CLASSIFICATION": opm.classification, "CREATION_DATE": stamp, "ORIGINATOR": originator,
        "MESSAGE_ID": opm.message_id,
    }  # fmt: skip
    yield "header", [(key, value) for key, value in header.items() if value]
    scale = opm.epoch.scale
    metadata = {
        "OBJECT_NAME": opm.object_name, "OBJECT_ID": opm.object_id,
        "CENTER_NAME": opm.center_name, "REF_FRAME": opm.frame,
        "REF_FRAME_EPOCH": epoch_text(opm.frame_epoch.to(scale)) if opm.frame_epoch else "",
        "TIME_SYSTEM": scale,
    }  # fmt: skip
    comments = [("COMMENT", text) for text in opm.comments]
    yield "metadata", comments + [(k, v) for k, v in metadata.items() if v or k[:6] != "REF_FR"]
    state = [(key, write_scaled(v, 3)) for key, v in zip(STATE, opm.x, strict=True)]
    yield "stateVector", [("EPOCH", epoch_text(opm.epoch)), *state]
    if (one := opm.elements) is not None:
        values = (
            one.semi_major_axis_m, one.eccentricity, one.inclination_deg, one.node_deg,
            one.pericentre_deg, one.anomaly_deg, one.gm_m3_s2,
        )  # fmt: skip
        keys = [*BLOCKS["keplerianElements"][:5], "MEAN_ANOMALY" if one.mean else "TRUE_ANOMALY"]
        powers = {"SEMI_MAJOR_AXIS": 3, "GM": 9}
        yield (
            "keplerianElements",
            [
                (key, write_scaled(value, powers.get(key, 0)))
                for key, value in zip([*keys, "GM"], values, strict=True)
                if value is not None
            ],
        )
    craft = (
        opm.mass_kg, opm.solar_radiation_area_m2, opm.solar_radiation_coefficient,
        opm.drag_area_m2, opm.drag_coefficient,
    )  # fmt: skip
    pairs = [
        (key, write_scaled(value, 0))
        for key, value in zip(BLOCKS["spacecraftParameters"], craft, strict=True)
        if value is not None
    ]
    if pairs:
        yield "spacecraftParameters", pairs
    if opm.covariance is not None:
        frame = [("COV_REF_FRAME", opm.covariance_frame)] if opm.covariance_frame else []
        lower = opm.covariance[np.tril_indices(6)]
        pairs = [(key, write_scaled(v, 6)) for key, v in zip(TRIANGLE, lower, strict=True)]
        yield "covarianceMatrix", frame + pairs
    for burn in opm.manoeuvres:
        yield (
            "maneuverParameters",
            [
                *(("COMMENT", text) for text in burn.comments),
                ("MAN_EPOCH_IGNITION", epoch_text(burn.epoch.to(scale))),
                ("MAN_DURATION", write_scaled(burn.duration_s, 0)),
                ("MAN_DELTA_MASS", write_scaled(burn.mass_change_kg, 0)),
                ("MAN_REF_FRAME", burn.frame),
                *(
                    (f"MAN_DV_{axis}", write_scaled(v, 3))
                    for axis, v in enumerate(burn.dv, start=1)
                ),
            ],
        )
    if opm.user_defined:
        yield (
            "userDefinedParameters",
            [(USER_DEFINED + name, value) for name, value in opm.user_defined.items()],
        )


def _check(opm: Opm) -> None:
    """Refuse what has no text: wrong shapes, numbers that are not finite, lines in lines."""
    for what, array, shape in (
        ("x", opm.x, (6,)),
        ("covariance", opm.covariance, (6, 6)),
        *(("dv of a manoeuvre", burn.dv, (3,)) for burn in opm.manoeuvres),
    ):
        if array is None:
            continue
        if np.shape(array) != shape or not np.all(np.isfinite(array)):
            got = np.array2string(np.asarray(array), threshold=6)[:80]
            raise InputError(f"{what} must be finite numbers of shape {shape}, got {got}")
    if opm.covariance is not None and np.any(opm.covariance != opm.covariance.T):
        raise InputError("covariance must be symmetric")
    numbers: dict[str, object] = {
        one.name: getattr(opm, one.name) for one in fields(opm)
        if one.name in ("mass_kg", "solar_radiation_area_m2", "solar_radiation_coefficient",
                        "drag_area_m2", "drag_coefficient")
    }  # fmt: skip
    if opm.elements is not None:
        numbers |= {f"elements.{key}": value for key, value in vars(opm.elements).items()}
    for burn in opm.manoeuvres:
        numbers |= {"duration_s": burn.duration_s, "mass_change_kg": burn.mass_change_kg}
        _check_finite(numbers)
    _check_finite(numbers)
    texts = [
        opm.object_name, opm.object_id, opm.center_name, opm.frame, opm.covariance_frame,
        opm.classification, opm.message_id, *opm.comments,
        *opm.user_defined, *opm.user_defined.values(),
    ]  # fmt: skip
    for burn in opm.manoeuvres:
        texts += [burn.frame, *burn.comments]
    for text in texts:
        if not text.isprintable():
            raise InputError(f"texts of a message must be one line each, got {text[:40]!r}")


def _check_finite(numbers: Mapping[str, object]) -> None:
    for key, value in numbers.items():
        if value is not None and not np.isfinite(value):  # type: ignore[call-overload]
            raise InputError(f"{key} must be a finite number, got {value}")
