"""The kernels that the stage ``ephemeris`` writes, and what it says of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.formats.oem import OemSegment
from hillsphere.interfaces import Plant
from hillsphere.model.frame_motion import frame_motion
from hillsphere.show.tables import FilledColumn, column, text_column
from hillsphere.time import J2000
from hillsphere_orbits.ephemeris.frame_kernel import TurningAxes, frame_kernel, turning_axes
from hillsphere_orbits.ephemeris.specs import EphemerisSpec
from hillsphere_orbits.ephemeris.spk_files import SpkKernel, spk_times, write_spk

__all__ = ["Kernels", "kernels_of"]

_PROMISED_M = 1e-3
"""Error between states, m, above which a kernel is said to be coarse."""
_CHECKED = 9
"""Times at which the rotation of a frame is compared with a uniform one."""


@dataclass(frozen=True)
class Kernels:
    """Files by name, and columns, notes and sentences about them."""

    files: dict[str, str | bytes]
    columns: list[FilledColumn]
    notes: list[str]
    verdict: tuple[str, ...]


def kernels_of(
    spec: EphemerisSpec,
    plant: Plant,
    centre: str,
    flown: Sequence[Sequence[OemSegment]],
    names: Sequence[str],
    about: str,
) -> Kernels:
    """Return an SPK kernel for each flight, and one frame kernel.

    Parameters
    ----------
    spec : EphemerisSpec
        Numbers and type.
    plant : Plant
        The plant of the flights, whose frame is defined if it turns uniformly.
    centre : str
        Name of the centre.
    flown : sequence of sequence of OemSegment
        The coasts of each flight, in inertial axes.
    names : sequence of str
        Names of the files without suffix.
    about : str
        Sentences on the states.

    Raises
    ------
    InputError
        See `write_spk`.
    """
    assert spec.spacecraft_id is not None
    codes = [spec.spacecraft_id - k for k in range(len(flown))]
    comments = [
        about,
        "States are geometric, in the inertial frame J2000 of SPICE (the axes of the ICRF), at "
        "times in TDB.",
        "A segment is a coast without a manoeuvre. Where two meet, at an impulse, the later one "
        "holds.",
    ]
    kernels = write_spk(
        flown, codes, centre=centre, centre_code=spec.body_id, kind=spec.spk_type, comments=comments
    )
    axes = _axes(plant, flown)
    frame = plant.frame
    told = [*comments]
    if axes is not None:
        told.append(
            f"The frame below is that of the equations of motion ({frame}): its pole is constant, "
            "and it turns uniformly."
        )
    told += [
        f"{name}.bsp: {one.code} ({one.name}) about {centre}, from {_date(one.begin_s)} to "
        f"{_date(one.end_s)} TDB."
        for name, one in zip(names, kernels, strict=True)
    ]
    bodies = [(one.name, one.code) for one in kernels]
    if not kernels[0].is_known:
        bodies.append((centre.upper(), kernels[0].centre_code))
    text = frame_kernel(
        "Spacecraft and frame of a flight.", told, bodies, kernels[0].centre_code, frame, axes
    )
    files: dict[str, str | bytes] = {
        f"{name}.bsp": one.content for name, one in zip(names, kernels, strict=True)
    }
    files["frames.tf"] = text
    between = np.array([one.deviation_m for one in kernels])
    columns = [
        column("spacecraft_id", [one.code for one in kernels], "NAIF number", 9),
        text_column("degrees", [_degrees(one) for one in kernels], "degree"),
        column("between_m", between, "error between states", 2, unit="m"),
    ]
    method = "Hermite's" if spec.spk_type == 13 else "Lagrange's"
    notes = [
        f"Segments of type {spec.spk_type}: {method} polynomials of the degree given. The error "
        "between states is estimated from states left out; it is blank where there are too few.",
        "frames.tf names the spacecraft"
        + (" and the centre" if not kernels[0].is_known else "")
        + (f", and defines the frame {frame}." if axes is not None else "."),
    ]
    single = sum(one.t_s.size < 2 for coasts in flown for one in coasts)
    if single:
        notes.append(f"{single} coasts of a single state are not in the kernels.")
    verdict = tuple(
        f"{name}.bsp: its states are so far apart that positions between them are off by some "
        f"{one.deviation_m:.2g} m; a smaller step_s (of orbits), or more samples of the flight, "
        "make it smaller."
        for name, one in zip(names, kernels, strict=True)
        if one.deviation_m > _PROMISED_M
    )
    return Kernels(files, columns, notes, verdict)


def _axes(plant: Plant, flown: Sequence[Sequence[OemSegment]]) -> TurningAxes | None:
    """Return the rotation of the plant's frame; None if it is not uniform, or none."""
    if any((v.length, v.time) not in ((1, 0), (1, -1)) for v in plant.states):
        return None  # an angle among the states turns the frame
    begin = min(float(one.t_s[0]) for coasts in flown for one in coasts)
    end = max(float(one.t_s[-1]) for coasts in flown for one in coasts)
    epoch = flown[0][0].epoch
    t_s = np.linspace(begin, end, _CHECKED)
    return turning_axes(frame_motion(plant, epoch, t_s, {}), spk_times(epoch, t_s)[0])


def _degrees(kernel: SpkKernel) -> str:
    return ", ".join(str(degree) for degree in dict.fromkeys(kernel.degrees))


def _date(seconds: float) -> str:
    return J2000.isot(np.array([seconds]), 6)[0]
