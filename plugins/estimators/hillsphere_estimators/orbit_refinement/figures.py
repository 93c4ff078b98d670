"""Figures of the refinement of an asteroid's orbit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.base.constants import AU_M, DAY_S
from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.orbit_refinement.gains import geometries_with_tracking
from hillsphere_estimators.orbit_refinement.products import OrbitRefinement
from hillsphere_estimators.orbit_refinement.verdict import silences

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = ["draw_consistency", "draw_optical", "draw_tracked"]

_NAMES = ("blue", "vermillion", "green", "purple", "orange", "sky", "black")
_COLOURS = (*(PALETTE[name] for name in _NAMES), "#888888")
_MARKERS = "osD^v<>Pph*"


def draw_optical(figure: MatplotlibFigure, product: OrbitRefinement) -> None:
    """Draw the errors during the optical part, one line per geometry."""
    position, velocity = figure.subplots(2, 1, sharex=True)
    known = product.optical
    t = known.t_s / DAY_S
    for g in np.argsort(product.earth_distance_m):
        style: dict[str, Any] = {
            "color": _COLOURS[g % len(_COLOURS)], "marker": _MARKERS[g % len(_MARKERS)],
            "markevery": (int(g) % 5, 5), "markersize": 4,
        }  # fmt: skip
        label = f"{product.geometries[g]} ({product.earth_distance_m[g] / AU_M:.2f} au)"
        position.plot(t, np.median(known.position_m[:, g], axis=1) / 1e3, label=label, **style)
        velocity.plot(t, np.median(known.velocity_m_s[:, g], axis=1), **style)
        faint = {"color": style["color"], "linestyle": "--", "linewidth": 0.9}
        position.plot(t, _rms(known.position_sigma_m[:, g]) / 1e3, **faint)
        velocity.plot(t, _rms(known.velocity_sigma_m_s[:, g]), **faint)
    position.set_ylabel("error of position [km]")
    velocity.set_ylabel("error of velocity [m/s]")
    velocity.set_xlabel("since the first observation [d]")
    for axes in (position, velocity):
        axes.set_yscale("log")
    position.legend(
        loc="upper left", bbox_to_anchor=(1.01, 1.0), title="least distance\nof the Earth"
    )


def draw_tracked(figure: MatplotlibFigure, product: OrbitRefinement) -> None:
    """Draw the errors during tracking, for the nearest and the farthest geometry."""
    ends = [int(np.argmin(product.earth_distance_m)), int(np.argmax(product.earth_distance_m))]
    shown = list(dict.fromkeys(ends))
    grid = figure.subplots(2, len(shown), sharex=True, sharey="row", squeeze=False)
    for column, g in enumerate(shown):
        position, velocity = grid[:, column]
        first = product.tracked[0]
        t = (first.t_s - first.t_s[0]) / 3600.0
        _shade(position, velocity, t, first.rows[:, g])
        for a, (arm, known) in enumerate(zip(product.arms, product.tracked, strict=True)):
            colour = _COLOURS[a % len(_COLOURS)]
            for axes, error, sigma, unit in (
                (position, known.position_m, known.position_sigma_m, 1e-3),
                (velocity, known.velocity_m_s, known.velocity_sigma_m_s, 1.0),
            ):
                axes.plot(t, unit * _rms(sigma[:, g]), color=colour, linewidth=2.0, label=arm)
                axes.plot(t, unit * _rms(error[:, g]), color=colour, linewidth=0.7)
                axes.set_yscale("log")
            craft = product.craft_velocity_sigma_m_s[a][:, g]
            if craft.any():
                velocity.plot(t, _rms(craft), color=colour, linewidth=1.3, linestyle=":")
        away = product.earth_distance_m[g] / AU_M
        position.set_title(f"{product.geometries[g]} ({away:.2f} au from the Earth)")
        velocity.set_xlabel("since tracking began [h]")
        position.set_ylabel("position [km]")
        velocity.set_ylabel("velocity [m/s]")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 3))


def draw_consistency(figure: MatplotlibFigure, product: OrbitRefinement) -> None:
    """Draw the mean NEES of the asteroid's six states over time, one line per arm."""
    axes = figure.subplots()
    cases = product.settled.size
    low, high = chi_square_band(6, cases)
    worst = 0.0
    for a, (arm, known) in enumerate(zip(product.arms, product.tracked, strict=True)):
        some = geometries_with_tracking(product, a)
        if not some.size:
            continue
        t = (known.t_s - known.t_s[0]) / 3600.0
        mean = known.nees[:, some].reshape(len(t), -1).mean(axis=1)
        worst = max(worst, float(mean.max()))
        axes.plot(t, mean, color=_COLOURS[a % len(_COLOURS)], label=arm)
    axes.axhspan(low, high, color="#999999", alpha=0.3, label="99.9 % band")
    axes.set_yscale("log" if worst > 3.0 * high else "linear")
    axes.set_xlabel("since tracking began [h]")
    axes.set_ylabel("mean NEES of six states [-]")
    axes.legend(loc="best", fontsize=8)


def _shade(upper: Any, lower: Any, t: Array, rows: Array) -> None:
    """Shade the times at which fewer values are measured than at most."""
    for before, last in silences(rows):
        for axes in (upper, lower):
            axes.axvspan(t[before + 1], t[last], color="#bbbbbb", alpha=0.35, linewidth=0)


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=-1)))
