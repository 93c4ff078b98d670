"""Product of the stage ``mu_analysis``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter

from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem

__all__ = ["Analysed", "MuAnalysis"]


@dataclass(frozen=True)
class Analysed:
    """One analysis of one loop.

    Parameters
    ----------
    loop : int
        Number of the loop.
    analysis : {"robust_stability", "robust_performance", "worst_case_gain"}
        Which one.
    channel : str
        Outputs whose performance it is, where each counts by itself; empty otherwise.
    upper, lower : float
        Bounds, over all frequencies, of µ or of the gain: the upper one certified, the lower one
        reached by `delta`.
    peak, peak_rad_s : float
        Largest bound found at one frequency, from above or by `delta`, and that frequency.
    frequency_rad_s : float
        Where the lower bound is reached.
    parts, parts_left : int
        Parts of the ranges of real parameters on which the bound that was asked for is proved, if
        they were divided, and on which it is not. The upper bound is that one if none is left;
        otherwise, as with no parts at all, the intervals prove it.
    lower_channel : str
        Outputs of the lower bound and of its perturbation; those of `channel`, unless it is the
        worst of several channels.
    grid_peak : float
        Largest upper bound at the frequencies of what is published; NaN without them, and for the
        worst-case gain.
    interval_low_rad_s, interval_high_rad_s, interval_at_rad_s, interval_bound : ndarray, shape (I,)
        Intervals that cover all frequencies; where the scalings of each were found, and what they
        prove on the whole of it, for the whole ranges of all parameters.
    omega_rad_s, curve_lower, curve_upper : ndarray, shape (K,)
        Bounds at single frequencies, for figures; none for the worst-case gain.
    curve_nominal : ndarray, shape (K,)
        Largest gain of the nominal loop there; only of robust performance.
    curve_shares : ndarray, shape (k, K)
        Shares of the blocks there, NaN where µ is zero; (0, 0) if not computed.
    blocks : tuple of str
        Names of the blocks, performance last where it is one.
    shares : ndarray, shape (k,)
        Relative change of µ's upper bound at its peak with the size of each block; they sum to
        one. For purely real blocks they are those with the largest of the complex parts. None if
        not computed.
    names, units : tuple of str
        Of the real parameters.
    values, normalised : ndarray, shape (r,)
        Theirs in the worst case, in their units and between −1 and 1 within the bounds; NaN where a
        normalised value belongs to no value of the parameter.
    delta : LtiSystem or None
        The worst case as a stable system; None where the lower bound is zero.
    pole_re, pole_im : float
        Pole of the loop closed with it, on the border of stability; NaN for the worst-case gain.
    singular : float
        Smallest singular value of I − M Δ there, which is zero but for rounding; NaN likewise.
    complex_parts, complex_upper, complex_lower : ndarray, shape (c,)
        Bounds of a purely real µ with complex parts of these sizes.
    """

    loop: int
    analysis: str
    channel: str
    upper: float
    lower: float
    peak: float
    peak_rad_s: float
    frequency_rad_s: float
    parts: int
    parts_left: int
    lower_channel: str
    grid_peak: float
    interval_low_rad_s: Array
    interval_high_rad_s: Array
    interval_at_rad_s: Array
    interval_bound: Array
    omega_rad_s: Array
    curve_lower: Array
    curve_upper: Array
    curve_nominal: Array
    curve_shares: Array
    blocks: tuple[str, ...]
    shares: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    normalised: Array
    delta: LtiSystem | None
    pole_re: float
    pole_im: float
    singular: float
    complex_parts: Array
    complex_upper: Array
    complex_lower: Array


@dataclass(frozen=True)
class MuAnalysis:
    """Analyses of L loops, each of a controller and an uncertain model.

    Parameters
    ----------
    controllers, models : tuple of str
        Their names.
    controller, model : ndarray of int, shape (L,)
        Of each loop.
    nominal : ndarray, shape (L,)
        H∞ norm of the nominal loop from its disturbances to its weighted signals, the largest of
        those that count by themselves; infinite if it is not stable: then it is not analysed. Zero
        if it has none.
    nominal_grid : ndarray, shape (L,)
        Largest gain of the nominal loop at the frequencies of what is published; NaN without them.
    results : tuple of Analysed
        Loop by loop, analysis by analysis, channel by channel.
    size : float
        Of the uncertainty in the worst-case gain.
    gap : float
        As declared.
    uncertain : str
        Name of the uncertain models.
    """

    controllers: tuple[str, ...]
    models: tuple[str, ...]
    controller: Integers
    model: Integers
    nominal: Array
    nominal_grid: Array
    results: tuple[Analysed, ...]
    size: float
    gap: float
    uncertain: str

    @property
    def worst(self) -> tuple[Analysed, ...]:
        """One result for each loop and analysis: the larger of each bound over the channels."""
        made: list[Analysed] = []
        for one in self.results:
            last = made[-1] if made else None
            if last is None or (last.loop, last.analysis) != (one.loop, one.analysis):
                made.append(one)
            else:
                made[-1] = _worst(last, one)
        return tuple(made)

    def label(self, loop: int) -> str:
        """Return a name of a loop: its controller, and what is uncertain."""
        controller = self.controllers[int(self.controller[loop])]
        model = self.models[int(self.model[loop])]
        several = "" if len(self.models) == 1 else f", {model}"
        return f"{controller}, {self.uncertain}{several}"


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
