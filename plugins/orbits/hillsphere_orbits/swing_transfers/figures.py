"""Figures of transfers through swing orbits; one panel per leg."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE
from hillsphere_orbits.swing_transfers.products import SwingTransfers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_along", "draw_fronts", "draw_tangency", "draw_transfers", "figure_size"]

_COLUMNS = 2
"""Panels beside one another: more would be too narrow to read in a report."""


def figure_size(legs: int, height: float) -> tuple[float, float]:
    """Return the size, inches, of a figure with so many panels of a height."""
    rows = -(-legs // _COLUMNS)
    return (9.0 if legs > 1 else 7.0, height * max(rows, 1))


def _panels(figure: Figure, product: SwingTransfers) -> list[Axes]:
    legs = len(product.legs)
    columns = min(legs, _COLUMNS)
    grid: Any = figure.subplots(-(-legs // columns), columns, squeeze=False)
    axes: list[Axes] = list(grid.ravel())
    for unused in axes[legs:]:
        unused.set_axis_off()
    for one, name in zip(axes, product.legs, strict=False):
        one.set_title(name, fontsize=10)
    return axes[:legs]


def _nothing(axes: Axes, why: str) -> None:
    axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", fontsize=8,
              wrap=True)  # fmt: skip


def draw_transfers(figure: Figure, product: SwingTransfers) -> None:
    """Draw the cheapest transfer of every leg with its two orbits and the body."""
    body = product.body.capitalize() if product.body not in ("", "body") else "body"
    for leg, axes in enumerate(_panels(figure, product)):
        for number, colour, what in (
            (product.departure[leg], PALETTE["blue"], "departure orbit"),
            (product.arrival[leg], PALETTE["green"], "arrival orbit"),
        ):
            axes.plot(*product.orbit_tracks_m[:, :, number] / 1e3, color=colour, lw=1.4,
                      label=what)  # fmt: skip
        if product.semi_axes_m:
            a, b, _ = np.array(product.semi_axes_m) / 1e3
            t = np.linspace(0.0, 2.0 * np.pi, 181)
            c, s = np.cos(product.prime_meridian_rad), np.sin(product.prime_meridian_rad)
            u, v = a * np.cos(t), b * np.sin(t)
            axes.fill(c * u - s * v, s * u + c * v, color="#777777", label=body)
        tracks = np.flatnonzero(product.track_leg == leg)
        if tracks.size:
            x, y = product.tracks_m[:, :, tracks[0]] / 1e3
            axes.plot(x, y, color=PALETTE["vermillion"], lw=1.0, label="transfer")
            axes.plot(x[0], y[0], "o", color=PALETTE["black"], ms=5, label="first impulse")
            axes.plot(x[-1], y[-1], "s", color=PALETTE["black"], ms=5, label="second impulse")
        axes.set_aspect("equal")
        axes.set_xlabel("x, away from the primary (km)")
        axes.set_ylabel("y (km)")
    # one legend for all panels: the orbits fill them
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3, fontsize=8)


def _shades(product: SwingTransfers) -> list[Any]:
    """Return one colour per family, by revolutions per d."""
    from matplotlib import colormaps

    ratio = np.array(product.n) / np.array(product.d) if product.n else np.zeros(0)
    low, high = (ratio.min(), ratio.max()) if ratio.size else (0.0, 1.0)
    return list(colormaps["viridis"](0.9 * (ratio - low) / max(high - low, 1e-9)))


def draw_along(figure: Figure, product: SwingTransfers) -> None:
    """Draw the cost of the members against their integral."""
    shades = _shades(product)
    for leg, axes in enumerate(_panels(figure, product)):
        own = product.member_leg == leg
        least = np.flatnonzero(product.least.leg == leg)
        for f in np.unique(product.member_family[own]):
            mine = np.flatnonzero(own & (product.member_family == f))
            # families are drawn in pieces: some members in between do not connect
            parts = np.split(mine, np.flatnonzero(np.diff(product.member_position[mine]) > 1) + 1)
            for part in parts:
                axes.plot(product.member_integral[part], product.member_dv_m_s[part], lw=0.9,
                          color=shades[f], marker="." if part.size == 1 else "")  # fmt: skip
        if least.size:
            c, dv = product.least.integral[least], product.least.total_m_s[least]
            axes.scatter(c, dv, s=16, zorder=3, edgecolors="white", linewidths=0.5,
                         c=[shades[f] for f in product.least.family[least]],
                         label="least of a family")  # fmt: skip
            k = int(np.argmin(dv))
            name = product.families[product.least.family[least[k]]]
            axes.plot(c[k], dv[k], "*", color=PALETTE["vermillion"], ms=13, zorder=4,
                      label=f"least of all: {name}")  # fmt: skip
            top = 2.5 * float(dv[k]) + 0.2 * float(np.max(dv))
            axes.set_ylim(0.0, top)
            ends = product.orbit_integral[[product.departure[leg], product.arrival[leg]]]
            seen = product.member_integral[own & (product.member_dv_m_s < top)]
            shown = np.concatenate([seen, c[dv < top], ends])
            margin = 0.05 * float(np.ptp(shown))
            axes.set_xlim(float(shown.min()) - margin, float(shown.max()) + margin)
        else:
            _nothing(axes, product.status[leg])
        for number in (product.departure[leg], product.arrival[leg]):
            axes.axvline(product.orbit_integral[number], color="#666666", ls="--", lw=1.0)
        axes.set_xlabel("Jacobi constant of the swing orbit")
        axes.set_ylabel("ΔV (m/s)")
        if least.size:
            axes.legend(loc="best", fontsize=7)
    if product.n:
        _ratio_bar(figure, product)


def _ratio_bar(figure: Figure, product: SwingTransfers) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    ratio = np.array(product.n) / np.array(product.d)
    if ratio.min() == ratio.max():
        return
    from matplotlib import colormaps

    part = LinearSegmentedColormap.from_list(
        "part", colormaps["viridis"](np.linspace(0.0, 0.9, 64))
    )
    bar = ScalarMappable(Normalize(float(ratio.min()), float(ratio.max())), part)
    figure.colorbar(bar, ax=figure.axes, label="n/d of the family", fraction=0.03, pad=0.02)


def draw_fronts(figure: Figure, product: SwingTransfers) -> None:
    """Draw cost against time."""
    for leg, axes in enumerate(_panels(figure, product)):
        on = np.flatnonzero(product.front.leg == leg)
        least = np.flatnonzero(product.least.leg == leg)
        if not on.size:
            _nothing(axes, product.status[leg])
        else:
            days, dv = product.front.tof_s[on] / DAY_S, product.front.total_m_s[on]
            axes.step(days, dv, where="post", color=PALETTE["blue"], lw=1.0)
            axes.plot(days, dv, "o", color=PALETTE["blue"], ms=4, label="Pareto front")
            axes.plot(product.least.tof_s[least] / DAY_S, product.least.total_m_s[least], "x",
                      color=PALETTE["vermillion"], ms=5, label="least of a family")  # fmt: skip
            axes.axhline(product.bound_m_s[leg], color="#666666", ls=":", lw=1.0,
                         label="bound by energy")  # fmt: skip
            dear = 1.1 * float(np.max(dv))
            cheap = least[product.least.total_m_s[least] < dear]
            late = max(float(np.max(days)), float(np.max(product.least.tof_s[cheap])) / DAY_S)
            margin = 0.05 * (late - float(np.min(days))) + 1e-3 * late
            axes.set_xlim(float(np.min(days)) - margin, late + margin)
            axes.set_ylim(0.0, dear)
            axes.legend(loc="upper right", fontsize=7)
        axes.set_xlabel("time of flight (d)")
        axes.set_ylabel("ΔV (m/s)")


def draw_tangency(figure: Figure, product: SwingTransfers) -> None:
    """Draw cost against the angle at which orbits meet, coloured by the integral."""
    values: Array = product.member_integral
    low, high = (values.min(), values.max()) if values.size else (0.0, 1.0)
    drawn = None
    for leg, axes in enumerate(_panels(figure, product)):
        own = product.member_leg == leg
        if not own.any():
            _nothing(axes, product.status[leg])
        else:
            drawn = axes.scatter(
                np.degrees(product.member_angle_rad[own]), product.member_dv_m_s[own], s=9,
                c=values[own], vmin=low, vmax=high, cmap="viridis", label="members",
            )  # fmt: skip
            rho = product.rank[leg, 0, 0]
            if np.isfinite(rho):
                axes.text(0.03, 0.95, f"ρ = {rho:.2f}", transform=axes.transAxes, va="top")
        axes.set_xlabel("mean angle between the orbits (deg)")
        axes.set_ylabel("ΔV (m/s)")
    if drawn is not None:
        figure.colorbar(drawn, ax=figure.axes, label="Jacobi constant", fraction=0.03, pad=0.02)
