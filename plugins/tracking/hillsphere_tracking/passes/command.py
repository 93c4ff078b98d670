"""The command ``hillsphere passes``: passes of a satellite over a station, without a mission."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import degrees, radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hillsphere.cli.output import write, write_json, write_table
from hillsphere.cli.streams import say
from hillsphere.errors import InputError

if TYPE_CHECKING:
    from hillsphere.time import Epoch
    from hillsphere_tracking.passes.products import PassList

__all__ = ["app"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)

_COLUMNS = ("station", "satellite", "rise (UTC)", "highest (UTC)", "set (UTC)", "elevation (°)",
            "azimuths: rise (°)", "highest (°)", "set (°)")  # fmt: skip
_KEY = re.compile(r"(?:stage 'passes': )?([a-z_]+)(?:\[(\d+)\])?(?:\.([a-z_]+)(?:\[0\])?)?(?=: )")
"""Beginning of a message about a key of the stage."""
_OPTIONS = {"duration_d": "--days", "start": "--start", "oldest_elements_d": "--oldest",
            "stations.mask": "--mask", "satellites.checksum": "--checksum"}  # fmt: skip
"""Options by the keys that they set."""


@app.command()
def passes(
    elements: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Satellites: elements (TLE or CCSDS OMM), or an ephemeris (CCSDS OEM, or SPK of "
            "SPICE).",
        ),
    ],
    station: Annotated[
        list[str],
        typer.Option(
            metavar="NAME|LAT,LON[,HEIGHT_M]",
            help="Geodetic latitude and east longitude, degrees, and height above the ellipsoid, "
            "m; or a station of --mission. May be given several times.",
        ),
    ],
    mission: Annotated[
        str, typer.Option(metavar="MISSION", help="Mission whose stations can be named.")
    ] = "",
    satellite: Annotated[
        str, typer.Option(metavar="NAME", help="One satellite of the file; by default all.")
    ] = "",
    kernel: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="With an SPK kernel: a further kernel, of the bodies between (SPK), or of names "
            "and frames (text). May be given several times.",
        ),
    ] = None,
    start: Annotated[
        str,
        typer.Option(metavar="DATE", help="Beginning, UTC; by default the epoch of the elements."),
    ] = "",
    days: Annotated[float, typer.Option(help="Length of the search, days.")] = 1.0,
    mask: Annotated[
        float | None,
        typer.Option(
            help="Elevation of rise and set, degrees; by default that of the mission's station, "
            "else 0."
        ),
    ] = None,
    refraction: Annotated[
        bool, typer.Option("--refraction", help="Elevations are apparent (with refraction).")
    ] = False,
    lenient: Annotated[
        bool,
        typer.Option(
            "--lenient",
            help="Harmless departures from the CCSDS standard are warnings.",
        ),
    ] = False,
    checksum: Annotated[
        str,
        typer.Option(
            metavar="refuse|warn|ignore", help="What a wrong checksum of a two-line element set is."
        ),
    ] = "refuse",
    oldest: Annotated[
        float | None,
        typer.Option(
            metavar="DAYS", help="Age of elements from which a warning is given; default: 14."
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")] = False,
) -> None:
    """List the passes of a satellite over ground stations, as the stage 'passes' finds them."""
    from hillsphere import create

    stations = [_station(text, mission, mask) for text in station]
    one: dict[str, Any] = {"file": str(elements), "lenient": lenient, "checksum": checksum}
    if satellite:
        one["name"] = satellite
    if kernel:
        one["kernels"] = list(map(str, kernel))
    try:
        stage: Any = create(
            "stage", "passes", satellites=[one], stations=stations, duration_d=days, start=start,
            refraction=refraction, **({} if oldest is None else {"oldest_elements_d": oldest}),
        )  # fmt: skip
    except InputError as error:
        lines = str(error).split("\n")
        raise InputError("\n".join(_in_options(line, station) for line in lines)) from error
    product = stage.run(_Silent())
    rows = _rows(product, stage.start)
    masks = {one.name: list(map(degrees, one.mask_elevation_rad)) for one in stage.spec.stations}
    if json:
        write_json(
            {
                "start_utc": product.start, "refracted": product.refracted,
                "masks_deg": masks, "passes": rows,
            }
        )  # fmt: skip
    elif rows:
        write_table(map(_cells, rows), header=_COLUMNS)
    else:
        highest = degrees(float(product.highest_rad.max()))
        write(f"no pass in {days:g} days; highest elevation {highest:.1f}°")
    if not json and mask is None:
        for text in station:
            if any(masks.get(text, ())):
                write(
                    f"{text}: above the elevation mask of the mission's station, "
                    f"{_extent(masks[text])}; --mask sets another"
                )
    for warning in product.warnings:
        say(warning)


def _in_options(message: str, stations: list[str]) -> str:
    """Return a message about a key of the stage as one about the option that set it."""
    told = _KEY.match(message)
    if told is None:
        return message
    key, number, part = told.groups()
    rest = message[told.end() :]
    if key == "stations" and number and not (part or "").startswith("mask"):
        within = f": {part.split('_')[0]}" if part else ""
        return f"--station {stations[int(number)][:60]!r}{within}{rest}"
    option = _OPTIONS.get(f"{key}.{(part or '').split('_')[0]}", _OPTIONS.get(key))
    return f"{option}{rest}" if option else message


def _extent(mask_deg: list[float]) -> str:
    low, high = min(mask_deg), max(mask_deg)
    return f"{low:.3g}°" if low == high else f"{low:.3g}° to {high:.3g}°, by azimuth"


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    rise = f"before {row['rise_utc']}" if row["begun"] else row["rise_utc"]
    set_ = f"after {row['set_utc']}" if row["unfinished"] else row["set_utc"]
    azimuths = [f"{row[f'{moment}_azimuth_deg']:.0f}" for moment in ("rise", "highest", "set")]
    return (row["station"], row["satellite"], rise, row["highest_utc"], set_,
            f"{row['elevation_deg']:.1f}", *azimuths)  # fmt: skip


def _station(text: str, mission: str, mask: float | None) -> Any:
    """Return the Spec of a station, or its keys, from the text of an option."""
    masked = {} if mask is None else {"mask_elevation_deg": [mask], "mask_azimuth_deg": [0.0]}
    parts = text.split(",")
    if len(parts) in (2, 3):
        try:
            latitude, longitude, *height = map(float, parts)
        except ValueError:
            raise InputError(
                f"--station {text[:60]!r}: expected a name or LAT,LON[,HEIGHT_M], such as "
                "48.08,11.28,580"
            ) from None
        return {
            "name": text, "latitude_deg": latitude, "longitude_deg": longitude,
            "height_m": height[0] if height else 0.0, **masked,
        }  # fmt: skip
    found = _named_station(text, mission)
    return found.model_copy(update=_in_si(mask)) if masked else found


def _named_station(name: str, mission: str) -> Any:
    from hillsphere.base.problems import did_you_mean
    from hillsphere.mission import load_mission
    from hillsphere_tracking.live.setup import specs_within
    from hillsphere_tracking.satellite_specs import StationSpec

    if not mission:
        raise InputError(
            f"--station {name[:60]!r}: give LAT,LON[,HEIGHT_M], or --mission with a mission that "
            "has a station of this name, such as assisted-tracking"
        )
    stations = {spec.name: spec for spec in specs_within(load_mission(mission), StationSpec)}
    if name not in stations:
        hint = did_you_mean(name, stations, otherwise="it has") or "; it has none"
        raise InputError(f"--station: mission {mission!r} has no station {name[:60]!r}{hint}")
    return stations[name]


def _in_si(mask: float | None) -> dict[str, tuple[float, ...]]:
    """Return a mask of one elevation as the fields of a Spec."""
    if mask is None or not abs(mask) < 90.0:
        raise InputError(f"--mask must lie between -90° and 90°, got {mask}")
    return {"mask_elevation_rad": (radians(mask),), "mask_azimuth_rad": (0.0,)}


def _rows(product: PassList, start: Epoch) -> list[dict[str, Any]]:
    """Return the passes of all stations in the order of their rise."""
    import numpy as np

    times = {
        key: start.isot(getattr(product, f"{key}_s"), 0) for key in ("rise", "culmination", "set")
    }
    azimuth = np.degrees(product.azimuth_rad)
    return [
        {
            "station": product.stations[int(product.station[i])],
            "satellite": product.satellites[int(product.satellite[i])],
            "rise_utc": times["rise"][i],
            "highest_utc": times["culmination"][i],
            "set_utc": times["set"][i],
            "elevation_deg": float(np.degrees(product.elevation_max_rad[i])),
            "rise_azimuth_deg": float(azimuth[0, i]),
            "highest_azimuth_deg": float(np.degrees(product.highest_azimuth_rad[i])),
            "set_azimuth_deg": float(azimuth[-1, i]),
            "duration_s": float(product.set_s[i] - product.rise_s[i]),
            "begun": bool(product.begun[i]),
            "unfinished": bool(product.unfinished[i]),
        }
        for i in np.argsort(product.rise_s, kind="stable")
    ]


class _Silent:
    """The part of a stage's context that `PassesStage.run` uses, without progress and log."""

    def track(self, description: str, total: int | None = None) -> Callable[[int], None]:
        """Return a function that shows nothing."""
        return lambda done: None

    def info(self, message: str) -> None:
        """Drop a line of the log."""
