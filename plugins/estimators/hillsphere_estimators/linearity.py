"""Curvature of a filter's run, and the first update or motion that is too curved; `remainders`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.chi_square_tests import Check
from hillsphere_estimators.remainders import (
    CURVED,
    UpdateCurvature,
    motion_curvature,
    update_curvature,
)
from hillsphere_estimators.smoother import link

__all__ = [
    "NonlinearUpdate",
    "RunCurvature",
    "measure_curvatures",
]


@dataclass(frozen=True)
class NonlinearUpdate:
    """The first update, or the first motion, that is too curved for a linear filter.

    Parameters
    ----------
    index : int
        Its set of measurements, from 0.
    time_s : float
        Its time, s, in the first case to which it happens.
    channel : str
        Name of the measured channel with the largest curvature; "motion" for the motion that ends
        at this time.
    row : int
        Row of the measurements; −1 for motion.
    size : float
        Largest root mean square remainder over the belief before it, in standard deviations of the
        noise; for motion of the predicted belief.
    ratio : float
        Variance of the innovation by sigma points over that by linearisation; 1 for motion.
    shift : float
        Mean of the remainder, in standard deviations of the innovation or of the predicted belief.
    cases : int
        Number of cases that are as curved at this update.
    """

    index: int
    time_s: float
    channel: str
    row: int
    size: float
    ratio: float
    shift: float
    cases: int

    def __str__(self) -> str:
        if self.row < 0:
            return (
                f"the motion to t = {self.time_s:g} s departs from its linearisation by "
                f"{self.size:.3g} standard deviations of the predicted states (limit {CURVED:g})"
            )
        return (
            f"the update at t = {self.time_s:g} s with {self.channel}: curvature over the belief "
            f"is {self.size:.3g} standard deviations of the noise (limit {CURVED:g})"
        )


@dataclass(frozen=True)
class RunCurvature:
    """Curvature of K updates of a run of N cases, and of the motion to each.

    Parameters
    ----------
    updates : list of UpdateCurvature
        K of them.
    motions : ndarray, shape (K, N)
        Root mean square remainders of the motion, 0 without motion.
    measurements : sequence of MeasurementSet
        K sets, for times and names of channels.
    """

    updates: list[UpdateCurvature]
    motions: Array
    measurements: Sequence[MeasurementSet]

    def largest(self, name: str) -> Array:
        """Return the largest value (K, N) of an attribute of the updates among their rows."""
        return np.array([getattr(curve, name).max(axis=0, initial=0.0) for curve in self.updates])

    @property
    def curved(self) -> NDArray[np.bool_]:
        """Whether any update or motion of a case is beyond `CURVED`, (N,)."""
        return np.asarray(((self.largest("prior") > CURVED) | (self.motions > CURVED)).any(axis=0))

    def first(self) -> NonlinearUpdate | None:
        """Return the first motion or update that is curved in any case, None if there is none."""
        for k, (curve, measured) in enumerate(zip(self.updates, self.measurements, strict=True)):
            motion = self.motions[k]
            if (far := motion > CURVED).any():
                case = int(np.nanargmax(motion))
                return NonlinearUpdate(
                    k, float(measured.t_s[case]), "motion", -1, float(motion[case]), 1.0, np.nan,
                    int(far.sum()),
                )  # fmt: skip
            if (bent := curve.prior > CURVED).any():
                place = np.unravel_index(int(np.nanargmax(curve.prior)), curve.prior.shape)
                row, case = int(place[0]), int(place[1])
                names = [
                    channel.name
                    for block in measured.blocks
                    for channel in block
                    for _ in range(channel.rows)
                ]
                return NonlinearUpdate(
                    k, float(measured.t_s[case]), names[row], row, float(curve.prior[row, case]),
                    float(curve.ratio[row, case]), float(curve.shift[row, case]),
                    int(bent.any(axis=0).sum()),
                )  # fmt: skip
        return None

    def checks(self) -> dict[str, Check]:
        """Return the largest curvatures over the run, with the limit `CURVED`.

        Returns
        -------
        dict of str to Check
            ``curvature``, ``path``, ``posterior_curvature`` and ``motion``.
        """
        over = "remainder of a measurement, in sigmas of its noise,"
        sizes = {
            "curvature": (f"largest {over} over the belief before", self.largest("prior").max(0)),
            "path": (f"largest {over} along an update", self.largest("path").max(axis=0)),
            "posterior_curvature": (f"{over} over the last belief", self.largest("posterior")[-1]),
            "motion": (
                "largest remainder of the motion, in predicted sigmas", self.motions.max(axis=0),
            ),
        }  # fmt: skip
        return {
            name: Check(name, says, float(np.nanmax(each, initial=0.0)), 0.0, CURVED, each,
                        np.zeros(len(each)), np.full(len(each), CURVED))
            for name, (says, each) in sizes.items()
        }  # fmt: skip


def measure_curvatures(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    before: Sequence[Belief] | None,
) -> RunCurvature:
    """Measure the curvature of each update of a run, and of the motion to it.

    Parameters
    ----------
    model : EstimationModel
        The filter's model.
    prior : Belief
        N cases before the first set of measurements, at its time or before.
    measurements : sequence of MeasurementSet
        K sets.
    after : sequence of Belief
        K: the filter's beliefs after each.
    innovations : sequence of Innovation
        K: their rows `used` count.
    controls : sequence of ndarray, shape (p, N)
        K: before each set.
    before : sequence of Belief, optional
        K: the beliefs before each set; predicted by linearisation by default.

    Returns
    -------
    RunCurvature
        Of K updates.
    """
    curves, motions = [], np.zeros((len(measurements), len(prior.t_s)))
    for k, measured in enumerate(measurements):
        at = start = prior if not k else after[k - 1]
        if k or not np.array_equal(prior.t_s, measured.t_s):
            motions[k] = motion_curvature(model, start, measured.t_s, controls[k]).rms
            if before is None:
                at = link(model, start, measured.t_s, controls[k]).predicted
        if before is not None:
            at = before[k]
        curves.append(update_curvature(model, at, after[k], measured, innovations[k].used))
    return RunCurvature(curves, motions, measurements)
