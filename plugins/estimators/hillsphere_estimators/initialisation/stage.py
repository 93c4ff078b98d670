"""The stage ``initialisation``: from sensors alone to a first belief."""

from __future__ import annotations

from itertools import product as combinations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Context
from hillsphere.presentation import Presentation
from hillsphere.sensor_suite import SensorSuite
from hillsphere_estimators.initialisation.arc_fit import arc_fit, screened
from hillsphere_estimators.initialisation.presentation import present_beginning
from hillsphere_estimators.initialisation.products import StartingBelief
from hillsphere_estimators.initialisation.specs import InitialisationSpec
from hillsphere_estimators.navigation.scene import proximity_scene
from hillsphere_estimators.refinement.motion import BodiesModel
from hillsphere_estimators.roots import lower_root

__all__ = ["InitialisationStage"]

_WIDE = 10.0
"""How wide, in greatest distances and speeds, what is known before is taken: sensors decide."""


class InitialisationStage:
    """First beliefs of spacecraft of which nothing is known but what their sensors measure.

    The first measurements are fitted by least squares from many starts (see `arc_fit`): each along
    the line in which the spacecraft looks at the asteroid, at several distances. A line of sight is
    known, as the attitude is. The belief is that at the last measurement.

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
        """Measure and fit.

        Parameters
        ----------
        ctx : Context
            Gives the random numbers.

        Returns
        -------
        StartingBelief
            Of all cases.
        """
        spec, seeds = self.spec, self.spec.seeds
        plant, suite = spec.plant.get(), SensorSuite([ref.get() for ref in spec.sensors])
        begin = np.concatenate([[*c.position_m, *c.velocity_m_s] for c in spec.spacecraft])
        truth: Array = np.repeat(begin[:, None], seeds, axis=1)
        times: Array = np.arange(int(spec.duration_s / spec.interval_s + 1e-9) + 1.0)
        times = np.asarray(times * spec.interval_s)
        n = len(truth)
        rows = [6 * (i // 3) + i % 3 for i in range(n // 2)]
        # each looks near the asteroid, and keeps that attitude
        distance = np.repeat(np.linalg.norm(truth[rows].reshape(-1, 3, seeds), axis=1), 3, axis=0)
        looking = truth.copy()
        looking[rows] += (
            spec.pointing_rad * distance * ctx.rng("pointing").normal(size=(len(rows), seeds))
        )
        scenes = {float(t): proximity_scene(plant, rows, np.full(seeds, t), looking) for t in times}
        model = BodiesModel(
            plant, suite, scenes, n // 6, reach_m=float(min(spec.depths_m)), step_s=spec.step_s
        )
        path, _ = model.path(truth, times)
        sets = self._measured(model, suite, path, times, ctx)
        prior, starts = self._starts(looking, rows)
        starts = screened(model, sets[0], starts, spec.tries)
        ctx.info(f"{len(times)} times of {seeds} cases are fitted from {starts.shape[1]} starts")
        fit = arc_fit(model, prior, sets, starts)
        end, phi = model.path(fit.belief.x, times)
        root = lower_root(np.swapaxes(phi[:, -1] @ fit.belief.root, 1, 2))
        names = tuple(variable.name for variable in plant.states)
        return StartingBelief(
            names, float(times[-1]), np.ascontiguousarray(end[:, -1]),
            root @ np.swapaxes(root, 1, 2), np.ascontiguousarray(path[:, -1]), fit.squares,
            fit.rows, fit.settled.astype(float),
        )  # fmt: skip

    def present(self, product: StartingBelief) -> Presentation:
        """Show errors beside what is said of them.

        Parameters
        ----------
        product : StartingBelief
            What `run` returned.

        Returns
        -------
        Presentation
            A table, and the distribution of the normalised errors.
        """
        return present_beginning(product)

    def _starts(self, looking: Array, rows: list[int]) -> tuple[Belief, Array]:
        """Return a belief that knows next to nothing, and states to begin from (n, S, N)."""
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

    def _measured(
        self, model: BodiesModel, suite: SensorSuite, path: Array, times: Array, ctx: Context
    ) -> list[MeasurementSet]:
        random, cases = ctx.rng("sensors"), path.shape[2]
        constant = random.normal(size=(suite.draws[0], cases))
        found = []
        for k, t in enumerate(times):
            t_s, noise = np.full(cases, t), random.normal(size=(suite.draws[1], cases))
            x = np.ascontiguousarray(path[:, k])
            found.append(suite.measurements(x, t_s, model.scene(t_s), constant, noise))
        return found
