"""Figures of robustness: bounds of µ over frequency with their intervals, shares of blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE
from hillsphere_controllers.stages.mu_analysis.products import Analysed, MuAnalysis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_bounds", "draw_share_curves", "draw_shares", "with_share_curves"]

_DRAWN = 6
_COLUMNS = 4
_NAMED = 0.05
"""Share from which on a block is drawn by itself."""
_TITLES = {"robust_stability": "Robust stability", "robust_performance": "Robust performance"}


def draw_bounds(figure: Figure, product: MuAnalysis) -> None:
    """Draw both bounds of a few loops, one panel an analysis."""
    shown = [
        name
        for name in _TITLES
        if any(one.analysis == name and one.omega_rad_s.size for one in product.results)
    ]
    grid = figure.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
    colours = [colour for name, colour in PALETTE.items() if name != "yellow"]
    for axes, name in zip(grid, shown, strict=True):
        drawn = [one for one in product.results if one.analysis == name and one.omega_rad_s.size]
        drawn = drawn[:_DRAWN]
        for place, one in enumerate(drawn):
            _draw_loop(axes, one, colours[place % len(colours)], product.label(one.loop))
        axes.axhline(1.0, color="#777777", ls=":", lw=1.2)
        axes.set_title(_TITLES[name])
        axes.set_ylabel("µ")
        axes.legend(fontsize=8)
    grid[-1].set_xlabel("frequency (rad/s)")


def _draw_loop(axes: Axes, one: Analysed, colour: str, label: str) -> None:
    omega = one.omega_rad_s
    axes.semilogx(omega, one.curve_upper, color=colour, label=label)
    seen = one.curve_lower > 0.0
    axes.semilogx(omega[seen], one.curve_lower[seen], ".", color=colour, ms=2.5)
    low, high = float(omega[0]), float(omega[-1])
    for k, bound in enumerate(one.interval_bound):
        begin = max(float(one.interval_low_rad_s[k]), low)
        end = min(float(one.interval_high_rad_s[k]), high)
        if begin < end:
            axes.plot([begin, end], [bound, bound], "|-", color=colour, lw=3.0, alpha=0.35, ms=7)


def draw_shares(figure: Figure, product: MuAnalysis) -> None:
    """Draw the share of each block, one group of bars an analysis of a loop."""
    axes = figure.add_subplot()
    found = [one for one in product.results if one.shares.size][:_DRAWN]
    names = list(dict.fromkeys(name for one in found for name in one.blocks))
    colours = [colour for name, colour in PALETTE.items() if name != "yellow"]
    width = 0.8 / len(found)
    for place, one in enumerate(found):
        at = np.array([names.index(name) for name in one.blocks])
        axes.barh(
            at + (place - 0.5 * (len(found) - 1)) * width, one.shares, width,
            color=colours[place % len(colours)],
            label=f"{product.label(one.loop)}: {_TITLES[one.analysis].lower()}",
        )  # fmt: skip
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("share of the block in µ")
    axes.set_ylabel("block")
    axes.legend(fontsize=8)


def with_share_curves(product: MuAnalysis) -> list[Analysed]:
    """Return the analyses whose shares are known over frequency and are drawn."""
    return [one for one in product.results if one.curve_shares.size][:_COLUMNS]


def draw_share_curves(figure: Figure, product: MuAnalysis) -> None:
    """Draw bounds above the shares of the blocks over frequency, one column an analysis."""
    found = with_share_curves(product)
    grid = figure.subplots(2, len(found), squeeze=False, sharex=True, sharey="row")
    for column, one in enumerate(found):
        above, below = grid[:, column]
        omega = one.omega_rad_s
        above.semilogx(omega, one.curve_upper, color=PALETTE["blue"], label="µ, from above")
        above.semilogx(omega, one.curve_lower, color=PALETTE["sky"], ls="--", label="from below")
        if one.curve_nominal.size:
            above.semilogx(omega, one.curve_nominal, color=PALETTE["black"], label="nominal")
        above.axhline(1.0, color="#777777", ls=":", lw=1.2)
        title = product.label(one.loop)
        what = f"{_TITLES[one.analysis].lower()} {one.channel}".rstrip()
        above.set_title(f"{title}\n{what}", fontsize=9)
        _draw_shares_over(below, one)
        for axes, what in ((above, "µ, gain"), (below, "share of the block")):
            axes.set_xlabel("frequency (rad/s)")
            axes.set_ylabel(what)
        below.legend(fontsize=7)
    grid[0, 0].legend(fontsize=8)


def _draw_shares_over(axes: Axes, one: Analysed) -> None:
    colours = [colour for name, colour in PALETTE.items() if name not in ("yellow", "black")]
    largest = np.nanmax(one.curve_shares, axis=1, initial=0.0)
    named = [int(k) for k in np.argsort(-largest) if largest[k] >= _NAMED]
    for place, k in enumerate(named):
        style = ("-", "--", ":")[place // len(colours) % 3]
        axes.semilogx(
            one.omega_rad_s, one.curve_shares[k], style, color=colours[place % len(colours)],
            label=one.blocks[k].rpartition(".")[2],
        )  # fmt: skip
    rest = [k for k in range(len(one.blocks)) if k not in named]
    if rest:
        together = one.curve_shares[rest].sum(axis=0)
        axes.semilogx(one.omega_rad_s, together, color="#777777", label="others together")
