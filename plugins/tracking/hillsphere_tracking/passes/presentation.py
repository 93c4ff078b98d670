"""Presentation of the stage ``passes``: tables, sky plots and a map."""

from __future__ import annotations

import re
import unicodedata
from functools import partial

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere.time import Epoch
from hillsphere_tracking.passes.figures import SKIES_PER_FIGURE, draw_map, draw_skies
from hillsphere_tracking.passes.products import SUN_IN_BEAM, PassList

__all__ = ["present_passes"]

_MOST_SKIES = 60
"""Passes that are drawn at most, five figures: drawing takes longer than finding them, and the
verdict says that some are left out."""
_PASSES = (
    Column("station", "", "station"),
    Column("satellite", "", "satellite"),
    Column("revolution", "-", "revolution"),
    Column("direction", "", "direction"),
    Column("rise", "", "rise, UTC"),
    Column("culmination", "", "highest, UTC"),
    Column("set", "", "set, UTC"),
    Column("duration_min", "min", "duration", 5),
    Column("rise_azimuth_deg", "deg", "azimuth at rise", 5),
    Column("culmination_azimuth_deg", "deg", "azimuth when highest", 5),
    Column("set_azimuth_deg", "deg", "azimuth at set", 5),
    Column("elevation_max_deg", "deg", "highest elevation", 5),
    Column("range_min_km", "km", "least range", 6),
    Column("azimuth_rate_max_deg_s", "deg/s", "fastest azimuth", 4),
    Column("keyhole", "", "through the keyhole"),
    Column("sunlit_part", "-", "part in sunlight", 4),
    Column("sun_in_beam_s", "s", "Sun in beam", 5),
    Column("blind_s", "s", "in blind sectors", 5),
    Column("cut", "", "cut off"),
)
_VISIBILITY = (
    Column("station", "", "station"),
    Column("satellite", "", "satellite"),
    Column("visible", "", "visible"),
    Column("passes", "-", "passes"),
    Column("seen_h", "h", "seen in all", 5),
    Column("gap_max_h", "h", "longest time unseen", 5),
    Column("elevation_max_deg", "deg", "highest elevation", 5),
    Column("highest", "", "highest, UTC"),
)
_SPANS = (
    Column("station", "", "station"),
    Column("satellite", "", "satellite"),
    Column("revolution", "-", "revolution"),
    Column("reason", "", "what disturbs"),
    Column("begins", "", "begins, UTC"),
    Column("ends", "", "ends, UTC"),
    Column("duration_s", "s", "duration", 6),
)
_ECLIPSES = (
    Column("satellite", "", "satellite"),
    Column("enters", "", "enters the umbra, UTC"),
    Column("leaves", "", "leaves it, UTC"),
    Column("duration_min", "min", "duration", 5),
)


def present_passes(product: PassList, start: Epoch, label: str) -> Presentation:
    """Return tables, figures and verdict of passes.

    Parameters
    ----------
    product : PassList
        The passes.
    start : Epoch
        Origin of the product's times.
    label : str
        Suffix of all names.

    Returns
    -------
    Presentation
        Presentation with times in UTC to 0.1 s.
    """
    suffix = f"_{label}" if label else ""
    kind = "apparent" if product.refracted else "geometric"
    notes = (
        f"Elevations are {kind}; azimuth is measured from north eastwards. A pass lasts while the "
        "satellite is above the station's horizon mask.",
        "Revolution 1 begins at the start of the search, revolution 2 at the first ascending node.",
    )
    tables = {
        "passes": Table("Passes", _PASSES, _pass_rows(product, start), notes),
        "visibility": Table("Visibility", _VISIBILITY, _visibility_rows(product, start)),
    }
    if product.span_pass.size:
        tables["disturbances"] = Table(
            "The Sun in the beam, and blind sectors", _SPANS, _span_rows(product, start)
        )
    if product.eclipse_satellite.size:
        tables["eclipses"] = Table(
            "Eclipses of the satellites by the Earth", _ECLIPSES, _eclipse_rows(product, start),
            ("Umbra of the ellipsoid WGS 84 without atmosphere, for a Sun of finite size.",),
        )  # fmt: skip
    return Presentation(
        metrics={f"passes{suffix}": Metric(int(product.rise_s.size))},
        tables={name + suffix: table for name, table in tables.items()},
        figures={name + suffix: figure for name, figure in _figures(product, start).items()},
        verdict=_verdict(product),
    )


def _figures(product: PassList, start: Epoch) -> dict[str, Figure]:
    figures = {
        "ground_track": Figure(
            "Ground tracks and passes",
            partial(draw_map, product=product),
            "Thin lines: subsatellite points, for one day at most. Thick lines: the satellite is "
            "above a station's horizon mask. Triangles: stations.",
            size_in=(8.5, 4.8),
        )
    }
    shown = 0
    for s, station in enumerate(product.stations):
        own = np.flatnonzero(product.station == s)
        for page, first in enumerate(range(0, own.size, SKIES_PER_FIGURE)):
            chosen = own[first : first + SKIES_PER_FIGURE]
            if shown + chosen.size > _MOST_SKIES:
                break
            shown += chosen.size
            key = f"sky_{s + 1}_{_plain(station)}" + (f"_{page + 1}" if page else "")
            columns, rows = min(3, chosen.size), -(-chosen.size // 3)
            figures[key] = Figure(
                f"Passes in the sky of {station}",
                partial(draw_skies, product=product, chosen=chosen, start=start),
                "North is up and east to the right, as on a map; the rim is the horizon. Dot: "
                "rise. Square: set. Disc: Sun, if it is up. Grey: below the horizon mask. Yellow: "
                "in a blind sector, or with the Sun in the beam.",
                size_in=(0.6 + 2.9 * columns, 0.4 + 3.2 * rows),
            )
    return figures


def _plain(name: str) -> str:
    """Return a name as lower-case letters without accents, digits and underscores."""
    letters = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9]+", "_", letters.lower()).strip("_")[:40] or "station"


def _pass_rows(product: PassList, start: Epoch) -> list[dict[str, Cell]]:
    rise, top, set_ = (start.isot(t, 1) for t in
                       (product.rise_s, product.culmination_s, product.set_s))  # fmt: skip
    ends = np.degrees(product.azimuth_rad[[0, -1]])
    rows: list[dict[str, Cell]] = []
    for k in range(product.rise_s.size):
        cut = [word for word, is_cut in
               (("start", product.begun[k]), ("end", product.unfinished[k])) if is_cut]  # fmt: skip
        rows.append(
            {
                "station": product.stations[product.station[k]],
                "satellite": product.satellites[product.satellite[k]],
                "revolution": int(product.revolution[k]),
                "direction": "ascending" if product.ascending[k] else "descending",
                "rise": rise[k],
                "culmination": top[k],
                "set": set_[k],
                "duration_min": float(product.set_s[k] - product.rise_s[k]) / 60.0,
                "rise_azimuth_deg": float(ends[0, k]),
                "culmination_azimuth_deg": float(np.degrees(product.highest_azimuth_rad[k])),
                "set_azimuth_deg": float(ends[1, k]),
                "elevation_max_deg": float(np.degrees(product.elevation_max_rad[k])),
                "range_min_km": float(product.range_m[:, k].min()) / 1e3,
                "azimuth_rate_max_deg_s": float(np.degrees(product.peak_azimuth_rate_rad_s[k])),
                "keyhole": bool(product.keyhole[k]),
                "sunlit_part": float(product.sunlit_part[k]),
                "sun_in_beam_s": _length(product, k, sun=True),
                "blind_s": _length(product, k, sun=False),
                "cut": " and ".join(cut),
            }
        )
    return rows


def _length(product: PassList, k: int, *, sun: bool) -> float:
    """Return the total time (s) of the disturbances of a pass; overlaps count once."""
    own = (product.span_pass == k) & ((product.span_reason == SUN_IN_BEAM) == sun)
    total, until = 0.0, -np.inf
    for begin, end in sorted(product.span_s[:, own].T.tolist()):
        total += max(0.0, end - max(begin, until))
        until = max(until, end)
    return total


def _visibility_rows(product: PassList, start: Epoch) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for s, station in enumerate(product.stations):
        for n, satellite in enumerate(product.satellites):
            own = (product.station == s) & (product.satellite == n)
            rise, set_ = product.rise_s[own], product.set_s[own]
            rows.append(
                {
                    "station": station,
                    "satellite": satellite,
                    "visible": str(product.visibility[s, n]),
                    "passes": int(rise.size),
                    "seen_h": float(np.sum(set_ - rise)) / 3600.0,
                    "gap_max_h": _longest_gap(rise, set_, product.searched_s[n]) / 3600.0,
                    "elevation_max_deg": float(np.degrees(product.highest_rad[s, n])),
                    "highest": start.isot(product.highest_s[s : s + 1, n], 1)[0],
                }
            )
    return rows


def _longest_gap(rise: Array, set_: Array, searched_s: float) -> float:
    edges = np.concatenate([[0.0], np.column_stack([rise, set_]).ravel(), [searched_s]])
    return float(np.max(np.diff(edges)[::2]))


def _span_rows(product: PassList, start: Epoch) -> list[dict[str, Cell]]:
    begins, ends = (start.isot(t, 1) for t in product.span_s)
    return [
        {
            "station": product.stations[product.station[k]],
            "satellite": product.satellites[product.satellite[k]],
            "revolution": int(product.revolution[k]),
            "reason": str(product.span_reason[q]),
            "begins": begins[q],
            "ends": ends[q],
            "duration_s": float(product.span_s[1, q] - product.span_s[0, q]),
        }
        for q, k in enumerate(product.span_pass)
    ]


def _eclipse_rows(product: PassList, start: Epoch) -> list[dict[str, Cell]]:
    enters, leaves = (start.isot(t, 1) for t in product.eclipse_s)
    return [
        {
            "satellite": product.satellites[n],
            "enters": enters[q],
            "leaves": leaves[q],
            "duration_min": float(product.eclipse_s[1, q] - product.eclipse_s[0, q]) / 60.0,
        }
        for q, n in enumerate(product.eclipse_satellite)
    ]


def _verdict(product: PassList) -> list[str]:
    count = product.rise_s.size
    days = float(product.searched_s.max()) / 86400.0
    said = [
        f"{count} pass{'' if count == 1 else 'es'} in {days:.4g} day{'' if days == 1.0 else 's'} "
        f"from {product.start} UTC."
    ]
    for s, station in enumerate(product.stations):
        for n, satellite in enumerate(product.satellites):
            if product.visibility[s, n] == "never":
                top = np.degrees(product.highest_rad[s, n])
                said.append(
                    f"{satellite} never rises at {station}: its highest elevation is {top:.4g}°."
                )
            elif product.visibility[s, n] == "always":
                said.append(f"{satellite} is always visible from {station}.")
    said += [
        f"Satellite {name!r} {reason}; the search for its passes ends there."
        for name, reason in zip(product.satellites, product.end_reasons, strict=True)
        if reason
    ]
    through = int(np.count_nonzero(product.keyhole))
    if through:
        said.append(f"{through} of {count} passes go through the keyhole of a mount.")
    if count > _MOST_SKIES:
        said.append(f"Sky plots are drawn for {_MOST_SKIES} passes at most.")
    return [*said, *product.warnings]
