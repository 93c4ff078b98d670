"""Figures of robustness: bounds of µ over frequency with their intervals, shares of blocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE
from hillsphere_controllers.stages.mu_analysis.products import Analysed, MuAnalysis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_bounds", "draw_share_curves", "draw_shares", "select_share_curves"]

_DRAWN = 6
"""Analyses drawn at most; more curves could not be told apart."""
_COLUMNS = 4
"""Analyses side by side in the figure of shares at most; narrower panels cannot be read."""
_NAMED = 0.05
"""Share from which on a block is drawn by itself."""
_TITLES = {"robust_stability": "Robust stability", "robust_performance": "Robust performance"}


def draw_bounds(figure: Figure, product: MuAnalysis) -> None:
    """Draw both bounds of a few loops, one panel an analysis."""
    shown = [
        name
        for name in _TITLES
        if any(one.analysis == name and one.omega_rad_s.size for one in product.worst)
    ]
    grid = figure.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
    colours = [colour for name, colour in PALETTE.items() if name != "yellow"]
    for axes, name in zip(grid, shown, strict=True):
        drawn = [one for one in product.worst if one.analysis == name and one.omega_rad_s.size]
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
    _draw_intervals(axes, one, colour)


def _draw_intervals(axes: Axes, one: Analysed, colour: str) -> None:
    """Draw the bounds that hold on whole intervals as bars."""
    low, high = float(one.omega_rad_s[0]), float(one.omega_rad_s[-1])
    for k, bound in enumerate(one.interval_bound):
        begin = max(float(one.interval_low_rad_s[k]), low)
        end = min(float(one.interval_high_rad_s[k]), high)
        if begin < end:
            axes.plot([begin, end], [bound, bound], "|-", color=colour, lw=3.0, alpha=0.35, ms=7)


def draw_shares(figure: Figure, product: MuAnalysis) -> None:
    """Draw the share of each block, one group of bars an analysis of a loop."""
    axes = figure.add_subplot()
    analysed = [one for one in product.worst if one.shares.size][:_DRAWN]
    names = list(dict.fromkeys(name for one in analysed for name in one.blocks))
    colours = [colour for name, colour in PALETTE.items() if name != "yellow"]
    width = 0.8 / len(analysed)
    for place, one in enumerate(analysed):
        at = np.array([names.index(name) for name in one.blocks])
        axes.barh(
            at + (place - 0.5 * (len(analysed) - 1)) * width, one.shares, width,
            color=colours[place % len(colours)],
            label=f"{product.label(one.loop)}: {_TITLES[one.analysis].lower()}",
        )  # fmt: skip
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("share of the block in µ")
    axes.set_ylabel("block")
    axes.legend(fontsize=8)


def select_share_curves(
    columns: Sequence[tuple[MuAnalysis, Analysed]],
) -> list[tuple[MuAnalysis, Analysed]]:
    """Return the analyses whose shares are known over frequency and are drawn."""
    return [column for column in columns if column[1].curve_shares.size][:_COLUMNS]


def draw_share_curves(figure: Figure, columns: Sequence[tuple[MuAnalysis, Analysed]]) -> None:
    """Draw bounds above the shares of the blocks over frequency, one column an analysis."""
    from matplotlib.ticker import LogLocator, NullFormatter

    grid = figure.subplots(2, len(columns), squeeze=False, sharex="col", sharey="row")
    named = _select_blocks([one for _, one in columns])
    for column, (product, one) in enumerate(columns):
        above, below = grid[:, column]
        omega = one.omega_rad_s
        above.semilogx(omega, one.curve_upper, color=PALETTE["blue"], label="µ, from above")
        above.semilogx(omega, one.curve_lower, color=PALETTE["sky"], ls="--", label="from below")
        if one.curve_nominal.size:
            above.semilogx(omega, one.curve_nominal, color=PALETTE["black"], label="nominal")
        _draw_intervals(above, one, PALETTE["blue"])
        above.axhline(1.0, color="#777777", ls=":", lw=1.2)
        kind = f"{_TITLES[one.analysis].lower()} {one.channel}".rstrip()
        controller, _, rest = product.label(one.loop).partition(", ")
        above.set_title(f"{controller}\n{rest}\n{kind}", fontsize=9)
        _draw_shares_over(below, one, named)
        for axes, what in ((above, "µ, gain"), (below, "share of the block")):
            axes.set_xlabel("frequency (rad/s)")
            axes.set_ylabel(what)
        below.xaxis.set_major_locator(LogLocator(numticks=6))
        below.xaxis.set_minor_locator(LogLocator(numticks=40))
        below.xaxis.set_minor_formatter(NullFormatter())
        below.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    grid[0, 0].legend(fontsize=8)


def _select_blocks(analysed: Sequence[Analysed]) -> dict[str, int]:
    """Return the blocks that are drawn by themselves, the weightiest first, with their places."""
    largest: dict[str, float] = {}
    for one in analysed:
        most = np.nanmax(one.curve_shares, axis=1, initial=0.0).tolist()
        for name, value in zip(one.blocks, most, strict=True):
            largest[name] = max(largest.get(name, 0.0), value)
    kept = sorted((name for name in largest if largest[name] >= _NAMED), key=lambda n: -largest[n])
    return {name: place for place, name in enumerate(kept)}


def _draw_shares_over(axes: Axes, one: Analysed, named: dict[str, int]) -> None:
    """Draw the shares of one column; a block has the same line in all of them."""
    colours = [colour for name, colour in PALETTE.items() if name not in ("yellow", "black")]
    for k in sorted((k for k, b in enumerate(one.blocks) if b in named),
                    key=lambda k: named[one.blocks[k]]):  # fmt: skip
        if np.nanmax(one.curve_shares[k], initial=0.0) < _NAMED:
            continue
        place = named[one.blocks[k]]
        style = ("-", "--", ":")[place // len(colours) % 3]
        axes.semilogx(
            one.omega_rad_s, one.curve_shares[k], style, color=colours[place % len(colours)],
            label=one.blocks[k].rpartition(".")[2],
        )  # fmt: skip
    rest = [k for k in range(len(one.blocks))
            if np.nanmax(one.curve_shares[k], initial=0.0) < _NAMED]  # fmt: skip
    if rest:
        together = one.curve_shares[rest].sum(axis=0)
        axes.semilogx(one.omega_rad_s, together, color="#777777", label="others together")
