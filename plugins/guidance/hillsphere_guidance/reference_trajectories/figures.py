"""Figures of the reference trajectories."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE
from hillsphere_guidance.reference_trajectories.products import ReferenceTrajectories

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_descents", "draw_differences", "draw_over_time"]

_COLOURS = ("blue", "vermillion", "green", "purple", "orange", "sky", "black")
_LINES = ("-", "--", ":", "-.")
_MANY = 8
"""Entries above which a legend takes two columns, and twice as many above which it stops naming."""
_LEVEL, _ASIDE = 25.0, 65.0
"""Where the view is from, degrees: above, and from the line through most of the starts."""


def draw_descents(figure: Figure, product: ReferenceTrajectories) -> None:
    """Draw the paths over the body."""
    axes: Any = figure.add_subplot(projection="3d")
    r = product.flights.x[:3] / 1e3
    # behind the paths a solid body would hide what lies beyond it
    if product.surface_m is not None:
        axes.plot_surface(
            *(product.surface_m / 1e3), color="#bbbbbb", edgecolor="#999999", linewidth=0.2,
            alpha=0.35, rstride=2, cstride=2,
        )  # fmt: skip
    for i in range(len(product.flights.labels)):
        path = r[:, np.isfinite(r[:, :, i]).all(axis=0), i]
        style = _style(product, i)
        colour = style["color"]
        style["label"] += f" ({product.dv_m_s[i]:.2f} m/s)"
        axes.plot(*path, **style)
        axes.plot(*path[:, :1], "o", color=colour, markerfacecolor="white")
        axes.plot(*path[:, -1:], "v", color=colour)
    for name in "xyz":
        getattr(axes, f"set_{name}label")(f"{name} [km]", labelpad=8)
        axes.locator_params(axis=name, nbins=5)
    axes.set_aspect("equal")
    axes.view_init(_LEVEL, _along(r[:2, 0]) + _ASIDE)
    axes.legend(loc="upper left")


def draw_over_time(figure: Figure, product: ReferenceTrajectories) -> None:
    """Draw heights and sizes of the commands."""
    top, bottom = figure.subplots(2, 1, sharex=True)
    hours = product.flights.t_s / 3600.0
    size = 1e3 * np.linalg.norm(product.command, axis=0)
    known = bool(np.isfinite(product.height_m).any())
    x = product.flights.x[: len(product.command)]
    height = product.height_m if known else np.linalg.norm(x, axis=0)
    for i in range(len(product.flights.labels)):
        style = _style(product, i)
        top.plot(hours[:, i], height[:, i] / 1e3, **style)
        bottom.plot(hours[:, i], size[:, i], **style)
    top.set_ylabel("height [km]" if known else "distance [km]")
    bottom.set_ylabel("command [mm/s²]")
    bottom.set_xlabel("time [h]")
    top.legend(loc="upper right", ncols=1 + (len(product.flights.labels) > _MANY))


def draw_differences(figure: Figure, product: ReferenceTrajectories) -> None:
    """Draw how much other plants accelerate otherwise along the paths."""
    hours = product.flights.t_s / 3600.0
    axes: Any = figure.subplots(len(product.compared), 1, sharex=True, squeeze=False)[:, 0]
    for one, name, sizes in zip(axes, product.compared, product.difference_m_s2, strict=True):
        for i in range(len(product.flights.labels)):
            one.plot(hours[:, i], 1e3 * sizes[:, i], **_style(product, i))
        if np.nanmin(sizes) > 0.0:
            one.set_yscale("log")
        one.set_ylabel("difference [mm/s²]")
        one.set_title(name)
    axes[-1].set_xlabel("time [h]")
    axes[0].legend(loc="upper left", ncols=1 + (len(product.flights.labels) > _MANY))


def _style(product: ReferenceTrajectories, i: int) -> dict[str, Any]:
    """Return a colour for each descent, a line for each start; of very many few are named."""
    names = list(dict.fromkeys(product.descents))
    label, of = product.flights.labels[i], product.descents[i]
    start = product.descents[:i].count(of)
    return {
        "color": PALETTE[_COLOURS[names.index(of) % len(_COLOURS)]],
        "linestyle": _LINES[start % len(_LINES)],
        "label": label if i < 2 * _MANY else f"_{label}",
    }


def _along(starts: Array) -> float:
    """Return the azimuth of the line through the origin nearest to points (2, N), degrees."""
    way = np.linalg.svd(starts, full_matrices=False)[0][:, 0]
    return float(np.degrees(np.arctan2(way[1], way[0])))
