"""Product of the stage ``mu_analysis``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Annotated

from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere.products.fields import Label, Shape

__all__ = ["Analysed", "MuAnalysis"]


@dataclass(frozen=True)
class Analysed:
    """One analysis of one loop."""

    loop: int
    """Number of the loop."""
    analysis: str
    """``"robust_stability"``, ``"robust_performance"`` or ``"worst_case_gain"``."""
    channel: str
    """Outputs whose performance it is, where each counts by itself; empty otherwise."""
    upper: float
    """Certified upper bound of µ or of the gain over all frequencies."""
    lower: float
    """Lower bound over all frequencies, reached by `delta`."""
    peak: float
    """Largest bound found at one frequency, from above or by `delta`."""
    peak_rad_s: float
    """Frequency of that bound."""
    frequency_rad_s: float
    """Where the lower bound is reached."""
    parts: int
    """Parts of the ranges of real parameters on which the bound that was asked for is proved, if
    they were divided."""
    parts_left: int
    """Parts on which it is not proved. If none is left, the upper bound is that one; otherwise, as
    with no parts at all, the intervals prove it."""
    lower_channel: str
    """Outputs of the lower bound and of its perturbation; those of `channel`, unless it is the
    worst of several channels."""
    grid_peak: float
    """Largest upper bound at the frequencies of what is published, without the cover; NaN without
    them, and for the worst-case gain."""
    interval_low_rad_s: Annotated[Array, Shape("intervals")]
    """Lower ends of intervals that cover all frequencies."""
    interval_high_rad_s: Annotated[Array, Shape("intervals")]
    """Upper ends of these intervals."""
    interval_at_rad_s: Annotated[Array, Shape("intervals")]
    """Frequencies at which the scalings of each interval were found."""
    interval_bound: Annotated[Array, Shape("intervals")]
    """Bound that these scalings prove on the whole interval, for the whole ranges of all
    parameters."""
    omega_rad_s: Annotated[Array, Shape("frequencies")]
    """Single frequencies, for figures; none for the worst-case gain."""
    curve_lower: Annotated[Array, Shape("frequencies")]
    """Lower bounds there."""
    curve_upper: Annotated[Array, Shape("frequencies")]
    """Upper bounds there."""
    curve_nominal: Array
    """Largest gain of the nominal loop there; only of robust performance."""
    curve_shares: Array
    """Shares of the blocks there, NaN where µ is zero; (0, 0) if not computed."""
    blocks: Annotated[tuple[str, ...], Shape("blocks")]
    """Names of the blocks, performance last where it is one."""
    shares: Array
    """Relative change of µ's upper bound at its peak with the size of each block; they sum to one.
    For purely real blocks they are those with the largest of the complex parts. None if not
    computed."""
    names: Annotated[tuple[str, ...], Shape("parameters")]
    """Names of the real parameters."""
    units: Annotated[tuple[str, ...], Shape("parameters")]
    """Units of the real parameters."""
    values: Annotated[Array, Shape("parameters")]
    """Values of the parameters in the worst case, in their units; NaN where a normalised value
    belongs to no value of the parameter."""
    normalised: Annotated[Array, Shape("parameters")]
    """The same between −1 and 1 within the bounds."""
    delta: LtiSystem | None
    """The worst case as a stable system; None where the lower bound is zero."""
    pole_re: float
    """Real part of the pole of the loop closed with it, on the border of stability; NaN for the
    worst-case gain."""
    pole_im: float
    """Imaginary part of that pole."""
    singular: float
    """Smallest singular value of I − M Δ there, which is zero but for rounding; NaN likewise."""
    complex_parts: Annotated[Array, Shape("parts_tried")]
    """Sizes of complex parts that are added to a purely real uncertainty."""
    complex_upper: Annotated[Array, Shape("parts_tried")]
    """Upper bound of its µ with them."""
    complex_lower: Annotated[Array, Shape("parts_tried")]
    """Lower bound of its µ with them."""


@dataclass(frozen=True)
class MuAnalysis:
    """Analyses of L loops, each of a controller and an uncertain model."""

    controllers: Annotated[tuple[str, ...], Shape("controllers"), Label("controller")]
    """Names of the controllers."""
    models: Annotated[tuple[str, ...], Shape("models"), Label("uncertain model")]
    """Names of the uncertain models."""
    controller: Annotated[Integers, Shape("loops")]
    """Index of each loop's controller."""
    model: Annotated[Integers, Shape("loops")]
    """Index of each loop's uncertain model."""
    nominal: Annotated[Array, Shape("loops")]
    """H∞ norm of the nominal loop from its disturbances to its weighted signals, the largest of
    those that count by themselves; infinite if it is not stable: then it is not analysed. Zero if
    it has none."""
    nominal_grid: Annotated[Array, Shape("loops")]
    """Largest gain of the nominal loop at the frequencies of what is published; NaN without
    them."""
    results: tuple[Analysed, ...]
    """Loop by loop, analysis by analysis, channel by channel. Where a model has blocks that cover
    what its approximation left out, upper bounds hold with them; lower bounds, worst cases and
    shares are those of the approximation."""
    without_cover: tuple[Analysed, ...]
    """The same of the models without such blocks, whose upper bounds do not hold for what was left
    out; none if no model has any."""
    size: float
    """Size of the uncertainty in the worst-case gain."""
    gap: float
    """Relative gap between the certified bound and the bounds at single frequencies, as
    declared."""
    uncertain: str
    """Name of the uncertain models."""

    @property
    def worst(self) -> tuple[Analysed, ...]:
        """One result for each loop and analysis: the larger of each bound over the channels."""
        return _worst_of_channels(self.results)

    @property
    def worst_without_cover(self) -> tuple[Analysed, ...]:
        """The same without the blocks that cover what was left out; none if no model has any."""
        return _worst_of_channels(self.without_cover)

    def label(self, loop: int) -> str:
        """Return a name of a loop: its controller and its uncertain model."""
        controller = self.controllers[int(self.controller[loop])]
        model = self.models[int(self.model[loop])]
        several = "" if len(self.models) == 1 else f", {model}"
        return f"{controller}, {self.uncertain}{several}"


def _worst_of_channels(results: tuple[Analysed, ...]) -> tuple[Analysed, ...]:
    made: list[Analysed] = []
    for one in results:
        last = made[-1] if made else None
        if last is None or (last.loop, last.analysis) != (one.loop, one.analysis):
            made.append(one)
        else:
            made[-1] = _worst(last, one)
    return tuple(made)


def _worst(one: Analysed, other: Analysed) -> Analysed:
    """Return the larger bounds of two channels of a loop, each with its certificate."""
    above = max(one, other, key=attrgetter("upper"))
    below = max(one, other, key=attrgetter("lower"))
    return replace(
        above, peak=max(one.peak, other.peak), lower=below.lower,
        frequency_rad_s=below.frequency_rad_s,
        lower_channel=below.lower_channel, names=below.names,
        units=below.units, values=below.values, normalised=below.normalised, delta=below.delta,
        pole_re=below.pole_re, pole_im=below.pole_im, singular=below.singular,
    )  # fmt: skip
