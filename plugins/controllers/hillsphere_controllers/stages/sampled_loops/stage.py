"""The stage ``sampled_loops``: stability and margins of linear loops at their sample rates."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hillsphere.base.matching import match_names
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere.products import ControlDesign
from hillsphere_controllers.analysis.sampled_loop import (
    SampledLoop,
    SampledMargins,
    first_unstable_period,
    sampled_margins,
)
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.lti import LinearLaw
from hillsphere_controllers.stages.sampled_loops.presentation import present_sampled_loops
from hillsphere_controllers.stages.sampled_loops.products import SampledLoops
from hillsphere_controllers.stages.sampled_loops.specs import SampledLoopsSpec
from hillsphere_controllers.stages.signals import find_signals

__all__ = ["SampledLoopsStage"]

_LOOKED = 120
"""Periods of the curve of the spectral radius, evenly spaced in their logarithm: sixty per
decade."""
_RANGE = 100.0
"""Longest over shortest period of that curve: two decades."""
_BEYOND = 10.0
"""Longest period of the curve relative to the longest that is analysed, so that the loss of
stability is usually in the figure."""
_SAME_TIME = 1e-9
"""Relative difference up to which two periods are the same: they may come from different products
of decimal numbers."""

At = Callable[[float], LtiSystem]
"""Controller in flight as a function of the period, from deviations to commands."""


class SampledLoopsStage:
    """Stability and margins of loops at their sample rates.

    Parameters
    ----------
    spec : SampledLoopsSpec
        Law, models and periods.

    Raises
    ------
    InputError
        If the law is not a linear one, or has a controller of its own that does not fit a period.
    """

    def __init__(self, spec: SampledLoopsSpec) -> None:
        self.spec = spec
        law = None if spec.law is None else spec.law.get()
        if law is not None and not isinstance(law, LinearLaw):
            raise InputError(
                "law: sampled_loops needs a linear law that gives its controller at any period, "
                f"such as one of type 'lti'; got {type(law).__name__}"
            )
        self._law: LinearLaw | None = law
        if law is not None and not spec.needs.controllers:
            _check_periods("law", law.at_period, spec.periods_s or (law.period_s,))

    def run(
        self, ctx: Context, models: LinearModels, controllers: tuple[ControlDesign, ...]
    ) -> SampledLoops:
        """Look at every loop.

        Parameters
        ----------
        ctx : Context
            Progress.
        models : LinearModels
            Plants.
        controllers : tuple of ControlDesign
            What the law flies; none if it has its own.

        Returns
        -------
        SampledLoops
            Margins at each period, and where stability is lost.

        Raises
        ------
        InputError
            If a name or a size does not fit.
        """
        spec = self.spec
        labels, plants = self._plants(models)
        flown = self._controllers_in_flight(controllers)
        periods = spec.periods_s or (() if self._law is None else (self._law.period_s,))
        longest = spec.longest_s or _BEYOND * max(periods)
        looked = np.geomspace(longest / _RANGE, longest, _LOOKED)
        for name, at in flown.items():
            _check_periods(name, at, periods)
        advance = ctx.track("sampled loops", len(flown) * (len(periods) * len(plants) + 1))
        margins: list[SampledMargins] = []
        for at in flown.values():
            for period in periods:
                controller = at(period)
                for plant in plants:
                    loop = SampledLoop(plant, controller, period, spec.delay_s)
                    margins.append(sampled_margins(loop))
                    advance(1)
        radius, lost = [], []
        for at in flown.values():
            if _is_fixed_to_period(
                at, max(periods)
            ):  # a controller in discrete time says nothing at another period
                radius.append([np.nan] * len(looked))
                lost.append(np.nan)
            else:
                radius.append([self._worst(plants, at, period) for period in looked.tolist()])
                ends = looked[0], looked[-1]
                lost.append(first_unstable_period(plants, at, *ends, delay_s=spec.delay_s))
            advance(1)
        shape = len(flown), len(periods), len(plants)

        def table(name: str) -> Array:
            values: Array = np.array([getattr(one, name) for one in margins], dtype=float)
            return np.ascontiguousarray(
                np.moveaxis(values.reshape(*shape, *values.shape[1:]), 3, 0)
                if values.ndim > 1
                else values.reshape(shape)
            )

        return SampledLoops(
            controllers=tuple(flown),
            models=labels,
            controls=plants[0].inputs or tuple(f"u[{i}]" for i in range(plants[0].shape[1])),
            period_s=np.array(periods),
            delay_s=spec.delay_s,
            spectral_radius=table("spectral_radius"),
            peak=table("peak"),
            peak_rad_s=table("peak_rad_s"),
            peaks=table("peaks"),
            gain_lower=table("gain_lower"),
            gain_upper=table("gain_upper"),
            looked_s=looked,
            radius=np.array(radius),
            lost_s=np.array(lost),
        )

    def present(
        self,
        product: SampledLoops,
        models: LinearModels,
        controllers: tuple[ControlDesign, ...],
    ) -> Presentation:
        """Show margins at each period, and the spectral radius over the period."""
        return present_sampled_loops(product)

    def _worst(self, plants: list[LtiSystem], at: At, period: float) -> float:
        controller, delay = at(period), min(self.spec.delay_s, period)
        loops = (SampledLoop(plant, controller, period, delay) for plant in plants)
        return max(float(loop.spectral_radius()) for loop in loops)

    def _plants(self, models: LinearModels) -> tuple[tuple[str, ...], list[LtiSystem]]:
        """Return names and plants, from the commands to the measurements."""
        spec = self.spec
        labels = models.labels
        if spec.models:
            labels = match_names(spec.models, models.labels, "models: needs.models", "model")
        plants = []
        for label in labels:
            whole = models.systems[models.labels.index(label)]
            p, m = whole.shape
            rows = list(range(p - models.measurements if models.measurements else 0, p))
            columns = list(range(m - models.controls if models.controls else 0, m))
            if spec.sees:
                rows = find_signals(whole.outputs, spec.sees, "sees")
            if spec.controls:
                columns = find_signals(whole.inputs, spec.controls, "controls")
            plants.append(
                LtiSystem(
                    whole.a, whole.b[:, columns], whole.c[rows], whole.d[np.ix_(rows, columns)],
                    whole.dt_s, tuple(whole.inputs[j] for j in columns) if whole.inputs else (),
                )
            )  # fmt: skip
        return labels, plants

    def _controllers_in_flight(self, controllers: tuple[ControlDesign, ...]) -> dict[str, At]:
        """Return the controllers in flight as functions of the period, by name."""
        law = self._law
        if not controllers:
            assert law is not None
            return {"law": law.at_period}
        names = [ref.name for ref in self.spec.needs.controllers]
        if len(set(names)) < len(names):
            names = [f"{name} {k}" for k, name in enumerate(names, 1)]
        return {
            name: _controller_at_period(law, design.controller)
            for name, design in zip(names, controllers, strict=True)
        }


def _controller_at_period(law: LinearLaw | None, controller: LtiSystem) -> At:
    if law is None:
        return lambda period: controller
    return lambda period: law.at_period(period, controller)


def _check_periods(name: str, at: At, periods: Sequence[float]) -> None:
    """Raise `InputError` unless a controller can be flown at all these periods."""
    for period in periods:
        try:
            made = at(period)
        except InputError as error:
            raise InputError(f"periods_s: {name} at {period:g} s: {error}") from error
        if made.dt_s is not None and abs(made.dt_s - period) > _SAME_TIME * period:
            raise InputError(
                f"periods_s: {name} is a controller in discrete time, of a period of "
                f"{made.dt_s:g} s; it is not defined at {period:g} s: name its own period alone"
            )


def _is_fixed_to_period(at: At, period: float) -> bool:
    """Return whether a controller is in discrete time, made for one period."""
    try:
        made = at(2.0 * period)
    except InputError:
        return True
    return made.dt_s is not None and abs(made.dt_s - 2.0 * period) > _SAME_TIME * period
