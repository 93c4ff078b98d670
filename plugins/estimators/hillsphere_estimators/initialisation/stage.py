"""The stage ``initialisation``: a first belief from sensors alone."""

from __future__ import annotations

from itertools import product as combinations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Context
from hillsphere.presentation import Presentation
from hillsphere.sensor_suite import SensorSuite
from hillsphere_estimators.convergence import step_in_sigmas
from hillsphere_estimators.information import Information
from hillsphere_estimators.initialisation.arc_fit import ArcFit, arc_fit, select_starts
from hillsphere_estimators.initialisation.presentation import present_beginning
from hillsphere_estimators.initialisation.products import StartingBelief
from hillsphere_estimators.initialisation.specs import InitialisationSpec
from hillsphere_estimators.navigation.scene import proximity_scene, sky_of
from hillsphere_estimators.navigation.world import noise_of
from hillsphere_estimators.orbit_refinement.linearised import LinearPath, path_to
from hillsphere_estimators.orbit_refinement.motion import BodiesModel
from hillsphere_estimators.orbit_refinement.true_motion import simulate_motion
from hillsphere_estimators.specs import InformationSpec

__all__ = ["InitialisationStage"]

_PASSES = 3
"""Passes of the filter along the path of the last result. The fit neglects the random
accelerations, so that its path is off; each pass linearises along a better one, and the last shows
whether the result still changes."""
_CONVERGED = 0.1
"""Standard deviations by which the last pass may change a result that counts as converged."""
_WIDE = 10.0
"""Standard deviation of the prior in greatest distances and speeds: so wide that the measurements
determine the result. A prior of size 1 would add information that no sensor has measured."""


class InitialisationStage:
    """First beliefs of spacecraft whose states are known by their measurements alone.

    The measurements are fitted by least squares from many starts, see `arc_fit`: for each
    spacecraft several distances along the line of sight, whose direction the attitude gives. A
    filter then passes along the path of the fit, which accounts for the plant's random
    accelerations. The belief is that at the last measurement.

    Parameters
    ----------
    spec : InitialisationSpec
        With its references bound.
    """

    def __init__(self, spec: InitialisationSpec) -> None:
        self.spec = spec
        states = len(spec.plant.get().states)
        if states != 6 * len(spec.spacecraft):
            raise InputError(
                f"{len(spec.spacecraft)} spacecraft have {6 * len(spec.spacecraft)} states, the "
                f"plant has {states}: list as many spacecraft as the plant"
            )

    def run(self, ctx: Context) -> StartingBelief:
        """Simulate the measurements and fit them.

        Parameters
        ----------
        ctx : Context
            Random numbers.

        Returns
        -------
        StartingBelief
            Starting beliefs of all cases.
        """
        spec, seeds = self.spec, self.spec.seeds
        plant, suite = spec.plant.get(), SensorSuite([ref.get() for ref in spec.sensors])
        begin = np.concatenate([[*c.position_m, *c.velocity_m_s] for c in spec.spacecraft])
        truth: Array = np.repeat(begin[:, None], seeds, axis=1)
        times: Array = np.arange(int(spec.duration_s / spec.interval_s + 1e-9) + 1.0)
        times = np.asarray(times * spec.interval_s)
        n = len(truth)
        rows = [6 * (i // 3) + i % 3 for i in range(n // 2)]
        # each points near the asteroid, with a random error, and keeps that attitude
        distance = np.repeat(np.linalg.norm(truth[rows].reshape(-1, 3, seeds), axis=1), 3, axis=0)
        looking = truth.copy()
        looking[rows] += (
            spec.pointing_rad * distance * ctx.rng("pointing").normal(size=(len(rows), seeds))
        )
        sky = sky_of(suite.sensors, [plant])
        scenes = {
            float(t): proximity_scene(plant, rows, np.full(seeds, t), looking, sky) for t in times
        }
        model = BodiesModel(
            plant, suite, scenes, n // 6, reach_m=float(min(spec.depths_m)),
            noise=noise_of(plant), step_s=spec.step_s, noise_step_s=spec.noise_step_s,
        )  # fmt: skip
        path = np.stack(simulate_motion(model, truth, times, ctx.rng("accelerations")), axis=1)
        sets = self._simulate_measurements(model, suite, path, times, ctx)
        prior, starts = self._starts(looking, rows)
        starts = select_starts(model, sets[0], starts, spec.tries)
        ctx.info(f"{len(times)} times of {seeds} cases are fitted from {starts.shape[1]} starts")
        fit = arc_fit(model, prior, sets, starts)
        belief, settled = self._filter_along_fit(model, prior, fit, sets)
        names = tuple(variable.name for variable in plant.states)
        return StartingBelief(
            names, float(times[-1]), belief.x, belief.covariance,
            np.ascontiguousarray(path[:, -1]), fit.squares, fit.rows, settled.astype(float),
        )  # fmt: skip

    def _filter_along_fit(
        self, model: BodiesModel, prior: Belief, fit: ArcFit, sets: list[MeasurementSet]
    ) -> tuple[Belief, NDArray[np.bool_]]:
        """Return the belief at the last time with the random accelerations among the unknowns.

        The fit neglects them. The filter passes along the path of the fit, and then along that of
        its own result (see `LinearPath`). The second value is which cases have converged.
        """
        times = np.array(model.times_s)
        path = np.moveaxis(np.array(simulate_motion(model, fit.belief.x, times, None)), 0, 1)
        present = np.stack([one.present for one in sets], axis=1)
        estimator, last = Information(InformationSpec()), None
        none, settled = np.zeros((0, len(prior.t_s))), fit.settled
        for _ in range(_PASSES):
            linear = LinearPath.about(model, path, present)
            belief = prior
            for one in sets:
                if one.t_s[0] != belief.t_s[0]:
                    belief = estimator.predict(linear, belief, one.t_s, none)
                belief, _ = estimator.update(linear, belief, linear.beyond(one))
            if last is not None:
                settled = fit.settled & (step_in_sigmas(belief, last) < _CONVERGED)
            last, path = belief, path_to(model, belief)
        return belief, settled

    def present(self, product: StartingBelief) -> Presentation:
        """Show the errors beside their standard deviations.

        Parameters
        ----------
        product : StartingBelief
            Product of `run`.

        Returns
        -------
        Presentation
            A table, and the distribution of the normalised errors.
        """
        return present_beginning(product)

    def _starts(self, looking: Array, rows: list[int]) -> tuple[Belief, Array]:
        """Return a prior with next to no information, and the starts (n, S, N) of the search."""
        spec, (n, cases) = self.spec, looking.shape
        line = looking[rows].reshape(-1, 3, cases)
        line = line / np.linalg.norm(line, axis=1, keepdims=True)
        grid = np.array(list(combinations(spec.depths_m, repeat=n // 6)))
        starts = np.zeros((n, len(grid), cases))
        starts[rows] = (grid.T[:, None, :, None] * line[:, :, None]).reshape(-1, len(grid), cases)
        far = _WIDE * max(spec.depths_m)
        sigma = np.tile(np.repeat([far, _WIDE * spec.speed_m_s], 3), n // 6)
        root = np.repeat(np.diag(sigma)[None], cases, axis=0)
        return Belief(starts.mean(axis=1), root, np.zeros(cases)), starts

    def _simulate_measurements(
        self, model: BodiesModel, suite: SensorSuite, path: Array, times: Array, ctx: Context
    ) -> list[MeasurementSet]:
        """Return the measurements at each time along the true path (n, K, N)."""
        random, cases = ctx.rng("sensors"), path.shape[2]
        constant = random.normal(size=(suite.draws[0], cases))
        sets = []
        for k, t in enumerate(times):
            t_s, noise = np.full(cases, t), random.normal(size=(suite.draws[1], cases))
            x = np.ascontiguousarray(path[:, k])
            sets.append(suite.measurements(x, t_s, model.scene(t_s), constant, noise))
        return sets
