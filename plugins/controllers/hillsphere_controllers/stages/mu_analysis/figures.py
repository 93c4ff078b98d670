"""Figures of robustness: bounds of µ over frequency with their intervals, shares of blocks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Bars,
    Chart,
    Curve,
    Dash,
    Mark,
    Panel,
    Points,
    Rule,
    Segments,
)
from hillsphere_controllers.stages.mu_analysis.products import Analysed, MuAnalysis

__all__ = ["bound_chart", "select_share_curves", "share_chart", "share_curve_chart"]

_DRAWN = 6
"""Analyses drawn at most; more curves could not be told apart."""
_COLUMNS = 4
"""Analyses side by side in the figure of shares at most; narrower panels cannot be read."""
_NAMED = 0.05
"""Share from which on a block is drawn by itself."""
_SAME_FREQUENCY = 0.05
"""Ends of curves that differ by less, relative, look the same in a figure."""
_TITLES = {"robust_stability": "Robust stability", "robust_performance": "Robust performance"}
_FREQUENCY = Axis("frequency", "rad/s", scale="log")
_DASHES: tuple[Dash, ...] = ("solid", "dashed", "dotted")
_BLOCK_COLOURS = tuple(name for name in LINE_COLOURS if name != "black")


def bound_chart(product: MuAnalysis, table: str) -> Chart:
    """Return both bounds of a few loops, one panel an analysis; the rows of `table` are loops."""
    panels = []
    for name, title in _TITLES.items():
        drawn = [one for one in product.worst if one.analysis == name and one.omega_rad_s.size]
        marks: list[Mark] = []
        for one, colour in zip(drawn[:_DRAWN], LINE_COLOURS, strict=False):
            omega, positive = one.omega_rad_s, one.curve_lower > 0.0
            marks += [
                Curve(omega, one.curve_upper, _loop_label(product, one), colour, rows=one.loop),
                *_curve_without_cover(product, one, "", colour),
                Points(
                    omega[positive], one.curve_lower[positive], "", colour, "dot", rows=one.loop
                ),
                _intervals(one, colour),
            ]
        if marks:
            panels.append(Panel(_FREQUENCY, Axis("µ"), [*marks, Rule("y", 1.0)], title))
    return Chart(
        "Bounds of µ over frequency",
        panels,
        "Upper bounds (solid) and lower bounds (dots) at single frequencies; the bars above are "
        "intervals on each of which one pair of scalings proves the bound at its height: together "
        "they cover all frequencies."
        + (" Dashed: upper bounds without the cover." if product.without_cover else ""),
        share_x=True,
        shared_legend=len(panels) > 1,
        size_in=(7.4, 0.8 + 3.2 * len(panels)),
        table=table,
    )


def _loop_label(product: MuAnalysis, one: Analysed) -> str:
    """Return the name of an analysis' loop in words."""
    return product.label(one.loop).replace("_", " ")


def _block_label(name: str) -> str:
    """Return the name of a block without the table of its parameter, in words."""
    return name.rpartition(".")[2].replace("_", " ")


def _intervals(one: Analysed, colour: str) -> Segments:
    """Return the bounds that hold on whole intervals as bars."""
    begin = np.maximum(one.interval_low_rad_s, one.omega_rad_s[0])
    end = np.minimum(one.interval_high_rad_s, one.omega_rad_s[-1])
    is_seen = begin < end
    return Segments(
        one.interval_bound[is_seen], begin[is_seen], end[is_seen], "x", "", colour, 3.0, 0.35,
        has_caps=True,
    )  # fmt: skip


def _curve_without_cover(
    product: MuAnalysis, one: Analysed, label: str, colour: str
) -> list[Curve]:
    """Return the upper bound of the truncated model of an analysis; none without a cover."""
    own = (one.loop, one.analysis, one.channel)
    return [
        Curve(bare.omega_rad_s, bare.curve_upper, label, colour, "dashed")
        for bare in product.without_cover
        if (bare.loop, bare.analysis, bare.channel) == own
    ]


def share_chart(product: MuAnalysis, table: str) -> Chart:
    """Return the share of each block, one group of bars an analysis of a loop.

    The rows of `table` are the blocks of one analysis after the other.
    """
    analyses = [one for one in product.worst if one.shares.size]
    ends = list(accumulate(one.shares.size for one in analyses))
    drawn = analyses[:_DRAWN]
    names = list(dict.fromkeys(name for one in drawn for name in one.blocks))
    width = 0.8 / len(drawn)
    bars = [
        Bars(
            [names.index(name) + (k - 0.5 * (len(drawn) - 1)) * width for name in one.blocks],
            one.shares, "x", width=width, rows=range(end - one.shares.size, end),
            label=f"{_loop_label(product, one)}: {_TITLES[one.analysis].lower()}",
        )
        for k, (one, end) in enumerate(zip(drawn, ends, strict=False))
    ]  # fmt: skip
    blocks = Axis("block", ticks=list(enumerate(map(_block_label, names))), is_reversed=True)
    return Chart(
        "Shares of the blocks in µ",
        [Panel(Axis("share of the block in µ"), blocks, bars)],
        "Relative change of the upper bound at its peak with the size of each block.",
        table=table,
    )


def select_share_curves(
    columns: Sequence[tuple[MuAnalysis, Analysed]],
) -> list[tuple[MuAnalysis, Analysed]]:
    """Return the analyses whose shares are known over frequency and are drawn."""
    return [column for column in columns if column[1].curve_shares.size][:_COLUMNS]


def share_curve_chart(columns: Sequence[tuple[MuAnalysis, Analysed]]) -> Chart:
    """Return bounds above the shares of the blocks over frequency, one column an analysis."""
    named = _select_blocks([one for _, one in columns])
    return Chart(
        "µ and shares of the blocks over frequency",
        [
            *(_bound_panel(product, one) for product, one in columns),
            *(_share_panel(one, named) for _, one in columns),
        ],
        "Above: bounds of µ, the gain of the nominal loop, and as bars the intervals on each of "
        "which one pair of scalings proves the bound; below: relative change of the upper bound "
        "with the size of each block. Blocks that never reach 5 % are together."
        + (
            " The cover is the block for what the truncation of the models left out; shares and "
            "lower bounds are those without it."
            if any(product.without_cover for product, _ in columns)
            else ""
        )
        + _frequencies_differ(columns),
        columns=len(columns),
        share_x=True,
        share_y=True,
        shared_legend=True,
        size_in=(1.6 + 3.2 * len(columns), 7.0),
    )


def _frequencies_differ(columns: Sequence[tuple[MuAnalysis, Analysed]]) -> str:
    """Return a sentence on the columns' frequency ranges, empty if they are the same."""
    spans = [(float(one.omega_rad_s[0]), float(one.omega_rad_s[-1])) for _, one in columns]
    if all(max(ends) <= (1.0 + _SAME_FREQUENCY) * min(ends) for ends in zip(*spans, strict=True)):
        return ""
    told = "; ".join(
        f"{_loop_label(product, one)}: {low:.2g} to {high:.2g} rad/s"
        for (product, one), (low, high) in zip(columns, spans, strict=True)
    )
    return f" The columns span different frequencies: {told}."


def _bound_panel(product: MuAnalysis, one: Analysed) -> Panel:
    omega = one.omega_rad_s
    marks: list[Mark] = [
        Curve(omega, one.curve_upper, "µ, from above", "blue"),
        Curve(omega, one.curve_lower, "µ, from below", "sky", "dashed"),
    ]
    if one.curve_nominal.size:
        marks.append(Curve(omega, one.curve_nominal, "nominal gain", "black"))
    marks += _curve_without_cover(product, one, "µ without the cover, from above", "orange")
    marks += [_intervals(one, "blue"), Rule("y", 1.0)]
    controller, _, rest = _loop_label(product, one).partition(", ")
    kind = f"{_TITLES[one.analysis].lower()} {one.channel.replace('_', ' ')}".rstrip()
    return Panel(_FREQUENCY, Axis("µ, gain"), marks, f"{controller}\n{rest}\n{kind}")


def _select_blocks(analyses: Sequence[Analysed]) -> dict[str, int]:
    """Return the blocks that are drawn by themselves, the weightiest first, with their places."""
    largest: dict[str, float] = {}
    for one in analyses:
        for name, value in zip(one.blocks, _largest_shares(one), strict=True):
            largest[name] = max(largest.get(name, 0.0), value)
    kept = sorted((name for name in largest if largest[name] >= _NAMED), key=lambda n: -largest[n])
    return {name: place for place, name in enumerate(kept)}


def _largest_shares(one: Analysed) -> list[float]:
    return list(map(float, np.nanmax(one.curve_shares, axis=1, initial=0.0)))


def _share_panel(one: Analysed, named: dict[str, int]) -> Panel:
    """Return the shares of one column; a block has the same line in all of them."""
    marks, rest = [], []
    for name, share, largest in zip(
        one.blocks, one.curve_shares, _largest_shares(one), strict=True
    ):
        if largest < _NAMED:
            rest.append(share)
            continue
        turn, place = divmod(named[name], len(_BLOCK_COLOURS))
        marks.append(
            Curve(one.omega_rad_s, share, _block_label(name), _BLOCK_COLOURS[place],
                  _DASHES[turn % len(_DASHES)])
        )  # fmt: skip
    if rest:
        marks.append(Curve(one.omega_rad_s, np.sum(rest, axis=0), "others together", "grey"))
    return Panel(_FREQUENCY, Axis("share of the block"), marks)
