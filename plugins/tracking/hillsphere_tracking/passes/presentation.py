"""Presentation of the stage ``passes``: tables, sky plots and a map."""

from __future__ import annotations

import re
import unicodedata

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import Chart, Metric, Presentation
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere.time import Epoch
from hillsphere_tracking.passes.figures import SKIES_PER_FIGURE, map_chart, sky_chart
from hillsphere_tracking.passes.products import SUN_IN_BEAM, PassList

__all__ = ["present_passes"]

_MOST_SKIES = 60
"""Passes that are drawn at most, five figures: drawing takes longer than finding them, and the
verdict says that some are left out."""


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
        "passes": tabulate("Passes", _pass_columns(product, start), notes),
        "visibility": tabulate("Visibility", _visibility_columns(product, start)),
    }
    if product.span_pass.size:
        tables["disturbances"] = tabulate(
            "The Sun in the beam, and blind sectors", _span_columns(product, start)
        )
    if product.eclipse_satellite.size:
        tables["eclipses"] = tabulate(
            "Eclipses of the satellites by the Earth", _eclipse_columns(product, start),
            ("Umbra of the ellipsoid WGS 84 without atmosphere, for a Sun of finite size.",),
        )  # fmt: skip
    return Presentation(
        metrics={f"passes{suffix}": Metric(int(product.rise_s.size))},
        tables={name + suffix: table for name, table in tables.items()},
        figures={
            name + suffix: figure
            for name, figure in _figures(product, start, f"passes{suffix}").items()
        },
        verdict=_verdict(product),
    )


def _figures(product: PassList, start: Epoch, table: str) -> dict[str, Chart]:
    figures = {"ground_track": map_chart(product)}
    shown = 0
    for s, station in enumerate(product.stations):
        own = np.flatnonzero(product.station == s)
        for page, first in enumerate(range(0, own.size, SKIES_PER_FIGURE)):
            chosen = own[first : first + SKIES_PER_FIGURE]
            if shown + chosen.size > _MOST_SKIES:
                break
            shown += chosen.size
            key = f"sky_{s + 1}_{_plain(station)}" + (f"_{page + 1}" if page else "")
            figures[key] = sky_chart(product, s, chosen, start, table)
    return figures


def _plain(name: str) -> str:
    """Return a name as lower-case letters without accents, digits and underscores."""
    letters = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9]+", "_", letters.lower()).strip("_")[:40] or "station"


def _pass_columns(product: PassList, start: Epoch) -> list[FilledColumn]:
    of = FieldColumns(product, "passes")
    cuts = [
        " and ".join(word for word, is_cut in (("start", begun), ("end", unfinished)) if is_cut)
        for begun, unfinished in zip(product.begun, product.unfinished, strict=True)
    ]
    passes = range(product.rise_s.size)
    return [
        *_satellite_columns(product, product.station, product.satellite),
        of("revolution"),
        text_column(
            "direction", np.where(product.ascending, "ascending", "descending"), "direction"
        ),
        text_column("rise", start.isot(product.rise_s, 1), "rise, UTC"),
        text_column("culmination", start.isot(product.culmination_s, 1), "highest, UTC"),
        text_column("set", start.isot(product.set_s, 1), "set, UTC"),
        column("duration_min", product.set_s - product.rise_s, "duration", 5, unit="min"),
        column("rise_azimuth_deg", product.azimuth_rad[0], "azimuth at rise", 5),
        of("highest_azimuth_rad", "culmination_azimuth_deg"),
        column("set_azimuth_deg", product.azimuth_rad[-1], "azimuth at set", 5),
        of("elevation_max_rad"),
        column("range_min_km", product.range_m.min(axis=0), "least range", 6),
        of("peak_azimuth_rate_rad_s", "azimuth_rate_max_deg_s"),
        of("keyhole"),
        of("sunlit_part"),
        column("sun_in_beam_s", [_length(product, k, sun=True) for k in passes], "Sun in beam", 5),
        column("blind_s", [_length(product, k, sun=False) for k in passes], "in blind sectors", 5),
        text_column("cut", cuts, "cut off"),
    ]


def _satellite_columns(
    product: PassList, station: Integers, satellite: Integers
) -> list[FilledColumn]:
    """Return the columns with the names of stations and satellites, by their indices."""
    return [
        text_column("station", [product.stations[s] for s in station], "station"),
        text_column("satellite", [product.satellites[n] for n in satellite], "satellite"),
    ]


def _length(product: PassList, k: int, *, sun: bool) -> float:
    """Return the total time (s) of the disturbances of a pass; overlaps count once."""
    own = (product.span_pass == k) & ((product.span_reason == SUN_IN_BEAM) == sun)
    total, until = 0.0, -np.inf
    for begin, end in sorted(product.span_s[:, own].T.tolist()):
        total += max(0.0, end - max(begin, until))
        until = max(until, end)
    return total


def _visibility_columns(product: PassList, start: Epoch) -> list[FilledColumn]:
    of = FieldColumns(product, "stations", "satellites")
    counts, seen_s, gaps_s = [], [], []
    for s, n in np.ndindex(product.visibility.shape):
        own = (product.station == s) & (product.satellite == n)
        rise, set_ = product.rise_s[own], product.set_s[own]
        counts.append(int(rise.size))
        seen_s.append(float(np.sum(set_ - rise)))
        gaps_s.append(_longest_gap(rise, set_, float(product.searched_s[n])))
    return [
        of("stations", "station"),
        of("satellites", "satellite"),
        of("visibility", "visible"),
        column("passes", counts, "passes"),
        column("seen_h", seen_s, "seen in all", 5),
        column("gap_max_h", gaps_s, "longest time unseen", 5),
        of("highest_rad", "elevation_max_deg"),
        text_column("highest", start.isot(product.highest_s.ravel(), 1), "highest, UTC"),
    ]


def _longest_gap(rise: Array, set_: Array, searched_s: float) -> float:
    edges = np.concatenate([[0.0], np.column_stack([rise, set_]).ravel(), [searched_s]])
    return float(np.max(np.diff(edges)[::2]))


def _span_columns(product: PassList, start: Epoch) -> list[FilledColumn]:
    begins_s, ends_s = product.span_s
    own = product.span_pass
    return [
        *_satellite_columns(product, product.station[own], product.satellite[own]),
        column("revolution", product.revolution[own], "revolution"),
        FieldColumns(product, "spans")("span_reason", "reason"),
        text_column("begins", start.isot(begins_s, 1), "begins, UTC"),
        text_column("ends", start.isot(ends_s, 1), "ends, UTC"),
        column("duration_s", ends_s - begins_s, "duration", 6),
    ]


def _eclipse_columns(product: PassList, start: Epoch) -> list[FilledColumn]:
    enters_s, leaves_s = product.eclipse_s
    satellites = [product.satellites[n] for n in product.eclipse_satellite]
    return [
        text_column("satellite", satellites, "satellite"),
        text_column("enters", start.isot(enters_s, 1), "enters the umbra, UTC"),
        text_column("leaves", start.isot(leaves_s, 1), "leaves it, UTC"),
        column("duration_min", leaves_s - enters_s, "duration", 5, unit="min"),
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
