"""Figures of families of quasi-satellite orbits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE
from hillsphere.products import Bifurcations
from hillsphere_orbits.qso.products import QsoFamily

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_indices", "draw_orbits", "draw_periods", "draw_resonances"]

_PLANES = (("planar", PALETTE["blue"]), ("vertical", PALETTE["vermillion"]))


def _amplitudes(product: QsoFamily) -> Array:
    return np.asarray(product.curve.x0[0] / 1e3)


def _other_name(product: QsoFamily, compare: QsoFamily) -> str:
    return compare.name + (" (compared with)" if compare.name == product.name else "")


def draw_periods(figure: Figure, product: QsoFamily, compare: QsoFamily | None) -> None:
    """Draw the period against the amplitude."""
    axes = figure.add_subplot()
    axes.axhline(2.0 * np.pi * product.curve.time_s / HOUR_S, color="#666666", ls=":", lw=1.2,
                 label="orbital period of the moon")  # fmt: skip
    if compare is not None:
        axes.plot(_amplitudes(compare), compare.curve.period_s / HOUR_S, "--",
                  color=PALETTE["orange"], label=_other_name(product, compare))  # fmt: skip
    axes.plot(_amplitudes(product), product.curve.period_s / HOUR_S, color=PALETTE["blue"],
              label=product.name)  # fmt: skip
    members = product.members
    axes.plot(members.x0[0] / 1e3, members.period_s / HOUR_S, "o", color=PALETTE["black"],
              label="orbits asked for")  # fmt: skip
    axes.set_xlabel("x at the crossing of the x axis (km)")
    axes.set_ylabel("period (h)")
    axes.legend(loc="lower right")


def draw_indices(figure: Figure, product: QsoFamily, compare: QsoFamily | None) -> Any:
    """Draw both stability indices against the amplitude; returns the axes."""
    axes = figure.add_subplot()
    axes.axhspan(-2.0, 2.0, color="#f0f0f0", zorder=0)
    for row, (plane, colour) in enumerate(_PLANES):
        if compare is not None:
            axes.plot(_amplitudes(compare), compare.curve_indices[row], "--", color=colour, lw=1.1,
                      alpha=0.8, label=f"{plane}, {_other_name(product, compare)}")  # fmt: skip
        axes.plot(_amplitudes(product), product.curve_indices[row], color=colour,
                  label=f"{plane}, {product.name}")  # fmt: skip
    axes.set_xlabel("x at the crossing of the x axis (km)")
    axes.set_ylabel("stability index b = λ + 1/λ")
    finite = product.curve_indices[np.isfinite(product.curve_indices)]
    axes.set_ylim(max(-4.0, min(-2.3, float(finite.min()) - 0.2)),
                  min(4.0, max(2.3, float(finite.max()) + 0.2)))  # fmt: skip
    axes.legend(loc="lower right")
    return axes


def draw_resonances(
    figure: Figure, product: QsoFamily, compare: QsoFamily | None, bifurcations: Bifurcations
) -> None:
    """Draw the stability indices with the resonances marked."""
    axes = draw_indices(figure, product, compare)
    for plane, colour in _PLANES:
        chosen = [i for i, name in enumerate(bifurcations.plane) if name == plane]
        x, b = bifurcations.orbits.x0[0, chosen] / 1e3, bifurcations.index[chosen]
        axes.plot(x, b, "o", color=colour, markeredgecolor="white", ms=6, zorder=3)
        last_x, last_b = -np.inf, -np.inf
        reach = 0.028 * float(np.ptp(_amplitudes(product)))
        for k in np.argsort(x):
            # a label that would cover its neighbour's is left out; the table has them all
            if x[k] - last_x < reach and abs(b[k] - last_b) < 0.22:
                continue
            last_x, last_b = x[k], b[k]
            i = chosen[int(k)]
            # to the side on which the curve is lower, so that it does not cross the label
            falls = _slope(product, _PLANES.index((plane, colour)), x[k]) < 0.0
            resonance = f"{bifurcations.d[i]}:{bifurcations.n[i]}"
            axes.annotate(resonance, (x[k], b[k]), fontsize=8, color=colour,
                          xytext=(-6 if falls else 6, -9), textcoords="offset points",
                          ha="right" if falls else "left")  # fmt: skip


def _slope(product: QsoFamily, row: int, x_km: float) -> float:
    x = _amplitudes(product)[::-1]
    slope = np.gradient(product.curve_indices[row, ::-1], x)
    return float(np.interp(x_km, x, slope))


def draw_orbits(figure: Figure, product: QsoFamily) -> None:
    """Draw the members and the body to scale."""
    axes = figure.add_subplot()
    colours = [PALETTE[name] for name in ("blue", "vermillion", "green", "purple", "orange", "sky")]
    for i, label in enumerate(product.members.labels):
        x, y, _ = product.tracks_m[:, :, i] / 1e3
        axes.plot(x, y, color=colours[i % len(colours)], lw=1.3, label=label)
    if product.semi_axes_m:
        a, b, _ = np.array(product.semi_axes_m) / 1e3
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        c, s = np.cos(product.prime_meridian_rad), np.sin(product.prime_meridian_rad)
        u, v = a * np.cos(angle), b * np.sin(angle)
        name = product.body.capitalize() if product.body not in ("", "body") else "body"
        axes.fill(c * u - s * v, s * u + c * v, color="#777777", label=name)
    else:
        axes.plot([0.0], [0.0], "+", color=PALETTE["black"], label="centre of mass")
    reach = float(np.max(np.abs(product.tracks_m[0]))) / 1e3
    axes.annotate("", (-1.55 * reach, 0.0), (-1.1 * reach, 0.0),
                  arrowprops={"arrowstyle": "->", "color": "#444444"})  # fmt: skip
    axes.annotate("to the\nprimary", (-1.32 * reach, 0.0), xytext=(0, 4),
                  textcoords="offset points", fontsize=8, ha="center")  # fmt: skip
    axes.set_xlim(-1.6 * reach, 1.6 * reach)
    axes.set_aspect("equal")
    axes.set_xlabel("x, away from the primary (km)")
    axes.set_ylabel("y, along the orbital velocity (km)")
    axes.legend(loc="upper right", fontsize=8)
