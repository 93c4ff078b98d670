"""Orbit Comprehensive Messages from their blocks: what is read is checked, the rest kept as text.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 6 (OCM).
.. [2] SANA registry "Orbital Elements" (types of states and their units).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import isfinite, nan

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S
from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.time import Epoch
from hillsphere.formats.ccsds_entries import Entry, Leniency, order_entries, read_scaled
from hillsphere.formats.ccsds_values import (
    TRIANGLE,
    check_definite,
    check_moving_frame,
    check_text,
    check_word,
    read_epoch,
    read_frame,
    read_time_system,
)
from hillsphere.formats.ocm_content import (
    Ocm,
    OcmCovariances,
    OcmManoeuvres,
    OcmText,
    OcmTrajectory,
)
from hillsphere.formats.ocm_encodings import OcmBlock, OcmBlocks
from hillsphere.formats.ocm_keywords import (
    COMPOSITION,
    DETERMINATION,
    HEADER,
    METADATA,
    OF_COVARIANCES,
    OF_MANOEUVRES,
    OF_TRAJECTORIES,
    STATE_TYPES,
    UNITS_OF_STATES,
)
from hillsphere.formats.oem_encodings import Block
from hillsphere.formats.oem_reading import needs_epoch
from hillsphere.formats.opm_content import Manoeuvre

__all__ = ["ocm_of_blocks"]

_REQUIRED = {
    "TRAJ": ("CENTER_NAME", "TRAJ_REF_FRAME", "TRAJ_TYPE"),
    "COV": ("COV_REF_FRAME", "COV_TYPE", "COV_ORDERING"),
    "MAN": ("MAN_ID", "MAN_DEVICE_ID", "MAN_REF_FRAME", "DC_TYPE", "MAN_COMPOSITION"),
    "OD": ("OD_ID", "OD_METHOD", "OD_EPOCH"),
}
_KNOWN = {
    "TRAJ": OF_TRAJECTORIES, "COV": OF_COVARIANCES, "MAN": OF_MANOEUVRES, "OD": DETERMINATION,
}  # fmt: skip
_NAMES = {
    "TRAJ": "a block of states", "COV": "a block of covariances", "MAN": "a block of manoeuvres",
    "OD": "the block on orbit determination",
}  # fmt: skip
_ORDERINGS = ("LTM", "UTM", "FULL", "LTMWCC", "UTMWCC")
_LONGEST_S = 1e11
"""Seconds after EPOCH_TZERO at most, 3000 years: a larger number is no time of a flight."""
_KEPT = "it is kept as text"
_SYMMETRY = 1e-6
"""Relative difference of the two halves of a full matrix at most: writers of few digits round
both."""


def ocm_of_blocks(message: OcmBlocks, leniency: Leniency) -> Ocm:
    """Return a message.

    Raises
    ------
    InputError
        Naming the line and the keyword, at the first fault.
    """
    version, metadata = message.version, message.metadata
    if version.value != "3.0":
        raise InputError(
            f"{version.place}: CCSDS_OCM_VERS: version {version.value[:40]!r} is not read; "
            "expected 3.0"
        )
    assert metadata is not None  # `take_apart` refuses a message without
    header = order_entries(
        _plain(message.header), HEADER, HEADER[1:3], "the header", message.header.end, leniency,
        HEADER[1:3],
    )  # fmt: skip
    meta = order_entries(
        _plain(metadata), METADATA, ("TIME_SYSTEM", "EPOCH_TZERO"), "the metadata", metadata.end,
        leniency,
    )  # fmt: skip
    for entry in (*header.values(), *meta.values()):
        check_text(entry)
    if "CREATION_DATE" in header:
        read_epoch(header["CREATION_DATE"], "UTC")
    scale = read_time_system(meta["TIME_SYSTEM"])
    reading = _Reading(read_epoch(meta["EPOCH_TZERO"], scale), leniency)
    for block in message.data:
        reading.add(block)
    comments = [*_comments(message.header), *_comments(metadata), *reading.comments]
    return Ocm(
        metadata=_values(meta),
        epoch=reading.epoch,
        trajectories=tuple(reading.trajectories),
        covariances=tuple(reading.covariances),
        manoeuvres=tuple(reading.manoeuvres),
        orbit_determination=reading.determination,
        texts=tuple(reading.texts),
        header=_values(header),
        comments=tuple(comments),
        warnings=(*leniency.warnings, *reading.notes),
    )


def _plain(block: Block) -> list[Entry]:
    return [entry for entry in block.entries if entry.key != "COMMENT"]


def _comments(block: Block) -> tuple[str, ...]:
    return tuple(entry.value for entry in block.entries if entry.key == "COMMENT")


def _with_unit(entry: Entry) -> str:
    return f"{entry.value} [{entry.unit}]" if entry.unit else entry.value


def _values(entries: dict[str, Entry]) -> dict[str, str]:
    return {key: _with_unit(entry) for key, entry in entries.items()}


class _Reading:
    """Collector of the blocks of data."""

    def __init__(self, epoch: Epoch, leniency: Leniency) -> None:
        self.epoch, self._leniency = epoch, leniency
        # intervals of UTC and UT1 are counted in TAI
        self._base = epoch.to("TAI") if epoch.scale in ("UTC", "UT1") else epoch
        self.trajectories: list[OcmTrajectory] = []
        self.covariances: list[OcmCovariances] = []
        self.manoeuvres: list[OcmManoeuvres] = []
        self.determination: dict[str, str] = {}
        self.texts: list[OcmText] = []
        self.comments: list[str] = []
        self.notes: list[str] = []

    def add(self, block: OcmBlock) -> None:
        """Read a block, or keep it as text."""
        if block.kind not in _KNOWN:
            for entry in _plain(block.block):
                if not entry.value:
                    raise InputError(f"{entry.place}: {entry.key} has no value; expected one")
            self._keep(block, "such blocks are not read")
            return
        entries = order_entries(
            _plain(block.block), _KNOWN[block.kind], _REQUIRED[block.kind], _NAMES[block.kind],
            block.block.end, self._leniency,
        )  # fmt: skip
        for entry in entries.values():
            check_text(entry)
        for key in ("USEABLE_START_TIME", "USEABLE_STOP_TIME", "OD_EPOCH"):
            if key in entries:
                self._time(entries[key])
        if block.kind == "TRAJ":
            self._add_states(block, entries)
        elif block.kind == "COV":
            self._add_covariances(block, entries)
        elif block.kind == "MAN":
            self._add_manoeuvres(block, entries)
        else:
            self.determination = _values(entries)
            self.comments += _comments(block.block)

    def _keep(self, block: OcmBlock, reason: str) -> None:
        self.texts.append(
            OcmText(
                block.kind, block.block.place,
                tuple((entry.key, _with_unit(entry)) for entry in block.block.entries),
                tuple(row for _, row in block.rows), reason,
            )
        )  # fmt: skip
        if block.kind in _KNOWN:
            self.notes.append(f"{block.block.place}: the block {block.kind}: {reason}; {_KEPT}")

    def _time(self, entry: Entry) -> float:
        """Return seconds after the epoch: of a date, or as they stand."""
        if "T" in entry.value:
            return read_epoch(entry, self.epoch.scale).seconds_since(self._base)
        value = read_scaled(entry.value, 0)
        if not abs(value) <= _LONGEST_S:
            raise InputError(
                f"{entry.place}: {entry.key}: expected a time or seconds after EPOCH_TZERO, got "
                f"{entry.value[:40]!r}"
            )
        return value

    def _rows(
        self, block: OcmBlock, width: int, what: str
    ) -> tuple[Array, list[tuple[str, list[str]]]]:
        """Return times (K,), which rise, and the words of each row behind its time."""
        if not block.rows:
            raise InputError(f"{block.block.end}: the block {block.kind} has no {what}")
        times: list[float] = []
        words = []
        for place, row in block.rows:
            time, *rest = row.split() or [""]
            if len(rest) != width:
                raise InputError(
                    f"{place}: expected a time and {width} numbers ({what}), got "
                    f"{len(row.split())} words"
                )
            instant = self._time(Entry(place, "time", time))
            if times and instant <= times[-1]:
                raise InputError(
                    f"{place}: the time {time[:40]} is not after that of the row above; expected "
                    "times in rising order"
                )
            times.append(instant)
            words.append((place, rest))
        return np.array(times), words

    def _frame_epoch(self, entries: dict[str, Entry], key: str, frame: Entry) -> Epoch | None:
        if key in entries:
            return read_epoch(entries[key], self.epoch.scale)
        if needs_epoch(frame.value.upper()):
            raise InputError(f"{frame.place}: {frame.key}: {frame.value} needs a {key} after it")
        return None

    def _add_states(self, block: OcmBlock, entries: dict[str, Entry]) -> None:
        kind = entries["TRAJ_TYPE"]
        name = kind.value.upper()
        if name not in STATE_TYPES:
            hint = did_you_mean(name, STATE_TYPES, otherwise="known")
            self._leniency.tolerate(f"{kind.place}: TRAJ_TYPE: no type {kind.value[:40]!r}{hint}")
        averaging = entries.get("ORB_AVERAGING")
        osculating = averaging is None or averaging.value.upper() == "OSCULATING"
        if name not in UNITS_OF_STATES or (name == "KEPLERIAN" and not osculating):
            mean = "" if osculating or averaging is None else f" ({averaging.value[:40]})"
            self._keep(block, f"states of TRAJ_TYPE {name[:40]}{mean} are not read")
            return
        frame = read_frame(entries["TRAJ_REF_FRAME"], self._leniency)
        units = UNITS_OF_STATES[name]
        _check_units(entries.get("TRAJ_UNITS"), units)
        t_s, words = self._rows(block, len(units), f"{name} in {', '.join(units)}")
        x = np.array(
            [
                [_number(place, word, 3 * unit.startswith("km"))
                 for word, unit in zip(row, units, strict=True)]
                for place, row in words
            ]
        ).T  # fmt: skip
        elements = None
        if name == "KEPLERIAN":
            for (place, _), a, e in zip(words, x[0], x[1], strict=True):
                if not ((a > 0.0 and 0.0 <= e < 1.0) or (a < 0.0 and e > 1.0)):
                    raise InputError(
                        f"{place}: the semi-major axis must be positive with an eccentricity from "
                        f"0 to 1, or negative with one above 1, got {a / 1e3:.6g} km with {e:.6g}"
                    )
            elements = np.concatenate([x[:2], np.radians(x[2:])])
        useable = [
            self._time(entries[key])
            for key in ("USEABLE_START_TIME", "USEABLE_STOP_TIME")
            if key in entries
        ]
        if useable != sorted(useable):
            entry = entries["USEABLE_STOP_TIME"]
            raise InputError(f"{entry.place}: USEABLE_STOP_TIME is before USEABLE_START_TIME")
        self.trajectories.append(
            OcmTrajectory(
                metadata=_values(entries),
                center_name=entries["CENTER_NAME"].value,
                frame=frame,
                t_s=t_s,
                x=None if elements is not None else x[:6],
                accelerations_m_s2=x[6:] if name == "CARTPVA" else None,
                elements=elements,
                frame_epoch=self._frame_epoch(
                    entries, "TRAJ_FRAME_EPOCH", entries["TRAJ_REF_FRAME"]
                ),
                comments=_comments(block.block),
            )
        )

    def _add_covariances(self, block: OcmBlock, entries: dict[str, Entry]) -> None:
        kind, ordering = entries["COV_TYPE"], entries["COV_ORDERING"]
        check_word(ordering, _ORDERINGS.__contains__, _ORDERINGS, "order of elements")
        name, order = kind.value.upper(), ordering.value.upper()
        if name not in STATE_TYPES:
            hint = did_you_mean(name, STATE_TYPES, otherwise="known")
            self._leniency.tolerate(f"{kind.place}: COV_TYPE: no type {kind.value[:40]!r}{hint}")
        if name != "CARTPV" or order not in ("LTM", "UTM", "FULL"):
            self._keep(block, f"covariances of COV_TYPE {name[:40]}, {order}, are not read")
            return
        frame = entries["COV_REF_FRAME"]
        check_moving_frame(frame)
        _check_units(entries.get("COV_UNITS"), UNITS_OF_STATES["CARTPV"])
        width = 36 if order == "FULL" else 21
        t_s, words = self._rows(block, width, f"a covariance, {order}")
        matrices = np.empty((6, 6, t_s.size))
        for k, (place, row) in enumerate(words):
            matrices[:, :, k] = _matrix(place, row, order)
        self.covariances.append(
            OcmCovariances(
                _values(entries), frame.value.upper(), t_s, matrices,
                self._frame_epoch(entries, "COV_FRAME_EPOCH", frame), _comments(block.block),
            )
        )  # fmt: skip

    def _add_manoeuvres(self, block: OcmBlock, entries: dict[str, Entry]) -> None:
        composition = entries["MAN_COMPOSITION"]
        names = [word.strip().upper() for word in composition.value.split(",")]
        for name in names:
            if name not in COMPOSITION:
                hint = did_you_mean(name, COMPOSITION, otherwise="known")
                raise InputError(
                    f"{composition.place}: MAN_COMPOSITION has no word {name[:40]!r}{hint}"
                )
        if len(set(names)) < len(names) or not names[0].startswith("TIME_"):
            raise InputError(
                f"{composition.place}: MAN_COMPOSITION must begin with TIME_ABSOLUTE or "
                f"TIME_RELATIVE and name nothing twice, got {composition.value[:60]!r}"
            )
        duty = entries["DC_TYPE"]
        check_word(duty, _DUTIES.__contains__, _DUTIES, "duty cycle")
        lacking = [axis for axis in ("DV_X", "DV_Y", "DV_Z") if axis not in names]
        if lacking or duty.value.upper() != "CONTINUOUS":
            reason = (
                f"without {', '.join(lacking)}" if lacking else f"of DC_TYPE {duty.value.upper()}"
            )
            self._keep(block, f"manoeuvres {reason} are not read")
            return
        frame = entries["MAN_REF_FRAME"]
        check_moving_frame(frame, "frame of a manoeuvre")
        _check_units(entries.get("MAN_UNITS"), [COMPOSITION[name] for name in names])
        _, words = self._rows(block, len(names) - 1, ", ".join(names[1:]))
        manoeuvres, fields = [], []
        for (place, row), (_, text) in zip(words, block.rows, strict=True):
            values = dict(zip(names, [text.split()[0], *row], strict=True))
            manoeuvres.append(self._manoeuvre(place, values, frame.value.upper()))
            fields.append(values)
        if "MAN_DURA" not in names:
            self.notes.append(
                f"{composition.place}: MAN_COMPOSITION states no MAN_DURA; the manoeuvres are "
                "taken as impulses"
            )
        self.manoeuvres.append(
            OcmManoeuvres(
                _values(entries), tuple(manoeuvres), tuple(fields), _comments(block.block)
            )
        )

    def _manoeuvre(self, place: str, values: dict[str, str], frame: str) -> Manoeuvre:
        key = "TIME_ABSOLUTE" if "TIME_ABSOLUTE" in values else "TIME_RELATIVE"
        after = self._time(Entry(place, key, values[key]))
        if key == "TIME_ABSOLUTE":
            epoch = read_epoch(Entry(place, key, values[key]), self.epoch.scale)
        else:
            days = self._base.fraction + after / DAY_S
            epoch = Epoch(self._base.day, days, self._base.scale).to(self.epoch.scale)
        duration = _number(place, values.get("MAN_DURA", "0"), 0)
        mass = _number(place, values["DELTA_MASS"], 0) if "DELTA_MASS" in values else nan
        if duration < 0.0 or mass > 0.0:
            raise InputError(
                f"{place}: MAN_DURA must be at least 0 and DELTA_MASS at most 0, got "
                f"{values.get('MAN_DURA', '0')} and {values.get('DELTA_MASS', '0')}"
            )
        dv = np.array([_number(place, values[f"DV_{axis}"], 3) for axis in "XYZ"])
        return Manoeuvre(epoch, duration, mass, frame, dv)


_DUTIES = ("CONTINUOUS", "TIME", "TIME_AND_ANGLE")


def _number(place: str, word: str, power: int) -> float:
    value = read_scaled(word, power)
    if not isfinite(value):
        raise InputError(f"{place}: expected a finite number, got {word[:40]!r}")
    return value


def _check_units(entry: Entry | None, units: Sequence[str]) -> None:
    """Refuse a list of units that is not the one of the standard."""
    if entry is None:
        return
    # a list in brackets is taken for a unit where a value stands before it, else for the value
    text = entry.value if entry.value.startswith("[") else entry.unit or entry.value
    stated = [unit.strip().lower() for unit in re.sub(r"[\[\]]", "", text).split(",")]
    expected = [unit or "n/a" for unit in units]
    if [unit or "n/a" for unit in stated] != [unit.lower() for unit in expected]:
        raise InputError(
            f"{entry.place}: {entry.key} must be [{','.join(expected)}], got {text[:80]!r}"
        )


def _matrix(place: str, row: list[str], order: str) -> Array:
    """Return a covariance (6, 6), SI, from the words of a row."""
    lower = np.tril_indices(6)
    if order == "FULL":
        full = np.array([_number(place, word, 6) for word in row]).reshape(6, 6)
        uneven = abs(full - full.T) > _SYMMETRY * np.maximum(abs(full), abs(full.T))
        if np.any(uneven):
            i, j = np.argwhere(uneven)[0]
            raise InputError(
                f"{place}: the covariance must be symmetric; elements ({i + 1}, {j + 1}) and "
                f"({j + 1}, {i + 1}) are {row[6 * i + j]} and {row[6 * j + i]}"
            )
        words = [row[6 * i + j] for i, j in zip(*lower, strict=True)]
    elif order == "UTM":
        at = {pair: n for n, pair in enumerate(zip(*np.triu_indices(6), strict=True))}
        words = [row[at[j, i]] for i, j in zip(*lower, strict=True)]
    else:
        words = row
    matrix = np.zeros((6, 6))
    matrix[lower] = [_number(place, word, 6) for word in words]
    matrix += np.tril(matrix, -1).T
    entries = [Entry(place, key, word) for key, word in zip(TRIANGLE, words, strict=True)]
    check_definite(matrix, entries)
    return matrix
