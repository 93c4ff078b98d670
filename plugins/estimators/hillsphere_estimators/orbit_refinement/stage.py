"""The stage ``orbit_refinement``: an asteroid's orbit by telescopes and by spacecraft near it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Context
from hillsphere.model.ephemeris import hill_axes
from hillsphere.presentation import Presentation
from hillsphere.sensor_suite import SensorSuite
from hillsphere.spec import Ref
from hillsphere_estimators.consistency import nees
from hillsphere_estimators.convergence import step_in_sigmas
from hillsphere_estimators.initialisation.arc_fit import arc_fit, select_starts
from hillsphere_estimators.orbit_refinement.linearised import LinearPath, path_to
from hillsphere_estimators.orbit_refinement.motion import BodiesModel
from hillsphere_estimators.orbit_refinement.optical import fit_angles
from hillsphere_estimators.orbit_refinement.presentation import present_refinement
from hillsphere_estimators.orbit_refinement.products import Knowledge, OrbitRefinement
from hillsphere_estimators.orbit_refinement.scenes import orbit_of, scenes_at, starts
from hillsphere_estimators.orbit_refinement.specs import OrbitRefinementSpec
from hillsphere_estimators.orbit_refinement.true_motion import simulate_motion

__all__ = ["OrbitRefinementStage"]

_STARTS = np.linspace(-3.0, 3.0, 241)
"""Starts of the first fit, in standard deviations along the direction in which the position of the
asteroid is known worst: every 1/40 standard deviation, so that one of them lies near each
minimum."""
_KEPT_STARTS = 3
"""Starts, out of those of `_STARTS` that fit the first measurement best, from which a fit is
solved. The sum of squares may have a minimum on either side of the spacecraft; each further start
costs a whole fit."""
_CONVERGED = 0.1
"""Standard deviations by which the last pass may change a result that counts as converged."""
_FAR_M = 1e8
"""Distance to observed bodies, without spacecraft, that sets the steps of differences: states about
the Sun, 1e11 m, resolve it to twelve digits."""
_AT_ONCE = 20_000
"""Columns for which sensors are simulated at once, which bounds the memory."""
_SHOWN_OPTICAL = 30
"""Number of times, about, at which the beliefs of the optical part are kept for the figure."""


class OrbitRefinementStage:
    """Refinement of an asteroid's orbit.

    In the optical part it is observed from the Earth, and the angles are fitted (see `optical`). In
    the tracking part spacecraft whose positions are hardly known stand near it, and a filter
    estimates asteroid and spacecraft together from the measurements of each arm. All arms have the
    same flights and, sensor by sensor, the same noise.

    All cases of all geometries are computed at once, geometry by geometry.

    Parameters
    ----------
    spec : OrbitRefinementSpec
        With its references bound.
    """

    def __init__(self, spec: OrbitRefinementSpec) -> None:
        self.spec = spec
        plant = spec.plant.get()
        if len(plant.states) != 6 * (1 + len(spec.spacecraft)):
            raise InputError(
                f"the plant of an orbit refinement with {len(spec.spacecraft)} spacecraft needs "
                f"{6 * (1 + len(spec.spacecraft))} states, the asteroid's six first; it has "
                f"{len(plant.states)}: list as many bodies in the plant"
            )
        self._earth = orbit_of(spec.earth.get(), "earth")
        self._starts = starts(spec.asteroid.get(), spec.geometries)

    def run(self, ctx: Context) -> OrbitRefinement:
        """Compute the optical part and the tracking part.

        Parameters
        ----------
        ctx : Context
            Random numbers and progress.

        Returns
        -------
        OrbitRefinement
            Errors and covariances over time.
        """
        spec, seeds = self.spec, self.spec.seeds
        truth = np.repeat(self._starts, seeds, axis=1)
        times = _times(spec.optical_duration_s, spec.optical_interval_s)
        scenes = scenes_at(times, self._earth, spec.geometries, seeds)
        suite = SensorSuite([ref.get() for ref in spec.optical])
        model = BodiesModel(spec.plant.get(), suite, scenes, 1, reach_m=_FAR_M, step_s=spec.step_s)
        flown = simulate_motion(model, truth, times, None)
        sets = _simulate_measurements(suite, "optical", spec.optical, flown, model, ctx)
        prior = self._prior(truth, ctx)
        ctx.info(f"{len(times)} optical observations of {truth.shape[1]} cases are fitted")
        kept = np.unique(np.linspace(0, len(times) - 1, _SHOWN_OPTICAL).astype(int))
        known, settled = fit_angles(model, prior, sets, kept.tolist())
        optical = self._knowledge(known, [flown[k] for k in kept], [sets[k] for k in kept])
        distance = np.min(
            [np.linalg.norm((x - scenes[float(t)]["earth"])[:3], axis=0)
             for x, t in zip(flown, times, strict=True)], axis=0,
        )[::seeds]  # fmt: skip
        tracked, joint, converged, craft = self._refine(known[-1], flown[-1], float(times[-1]), ctx)
        return OrbitRefinement(
            tuple(g.name for g in spec.geometries),
            tuple(arm.name for arm in spec.arms),
            distance,
            optical,
            settled.reshape(-1, seeds).astype(float),
            tracked,
            joint,
            6 * (1 + len(spec.spacecraft)),
            converged.astype(float),
            craft,
        )

    def present(self, product: OrbitRefinement) -> Presentation:
        """Show tables and figures.

        Parameters
        ----------
        product : OrbitRefinement
            Product of `run`.

        Returns
        -------
        Presentation
            Errors after each part, gains, consistency; errors over time.
        """
        return present_refinement(product, self.spec)

    def _prior(self, truth: Array, ctx: Context) -> Belief:
        """Return the belief before any observation."""
        sizes = [np.linalg.norm(truth[rows], axis=0) for rows in (slice(3), slice(3, 6))]
        sigma = self.spec.initial_error * np.repeat(sizes, 3, axis=0)
        x = truth + sigma * ctx.rng("prior").normal(size=truth.shape)
        root = sigma.T[:, :, None] * np.eye(6)
        return Belief(x, root, np.zeros(truth.shape[1]))

    def _refine(
        self, asteroid: Belief, truth: Array, start_s: float, ctx: Context
    ) -> tuple[tuple[Knowledge, ...], Array, NDArray[np.bool_], Array]:
        """Track the spacecraft with each arm.

        Returns
        -------
        knowledge : tuple of Knowledge
            One for each arm.
        joint_nees : ndarray, shape (A, G, M)
            NEES of all states at the end.
        settled : ndarray of bool, shape (A, G, M)
            Whether the case has converged.
        craft : ndarray, shape (A, K, G, M)
            Standard deviation of the velocity of the spacecraft that is known worst, m/s.
        """
        spec, cases = self.spec, truth.shape[1]
        crafts = len(spec.spacecraft)
        times = start_s + np.concatenate([[0.0], _times(spec.duration_s, spec.interval_s)[1:]])
        scenes = scenes_at(times, self._earth, spec.geometries, spec.seeds)

        def noise(t_s: Array) -> Array:
            held = np.repeat([0.0] + [spec.acceleration_noise_m_s2] * crafts, 3)
            return np.broadcast_to(held[:, None], (held.size, np.size(t_s)))

        refs = _unique([ref for arm in spec.arms for ref in arm.sensors])
        suite = SensorSuite([ref.get() for ref in refs])
        quiet = spec.acceleration_noise_m_s2 == 0.0 or not crafts
        model = BodiesModel(
            spec.plant.get(), suite, scenes, 1 + crafts, reach_m=self._reach(),
            noise=None if quiet else noise, step_s=spec.step_s, noise_step_s=spec.interval_s,
        )  # fmt: skip
        places = np.concatenate([truth, *(self._craft(i, truth) for i in range(crafts))])
        flown = simulate_motion(model, places, times, None if quiet else ctx.rng("accelerations"))
        sets = _simulate_measurements(suite, "tracking", refs, flown, model, ctx)
        prior = self._joint_prior(asteroid, places, ctx)
        knowledge, joint = [], []
        beliefs, seen, settled = self._filter_arms(
            model, prior, sets, self._rows_of_arms(suite), ctx
        )
        for a in range(len(spec.arms)):
            own = slice(a * cases, (a + 1) * cases)
            of_arm = [Belief(b.x[:, own], b.root[own], b.t_s[own]) for b in beliefs]
            shown = [
                replace(m, present=present[:, own]) for m, present in zip(sets, seen, strict=True)
            ]
            knowledge.append(self._knowledge(of_arm, flown, shown))
            joint.append(nees(of_arm[-1], flown[-1]).reshape(-1, spec.seeds))
        by_arm = (len(spec.arms), len(spec.geometries), spec.seeds)
        sigma = np.array([b.sigma for b in beliefs])
        # without spacecraft there are no rows, and the maximum is zero
        speeds = sigma[:, 6:].reshape(len(times), crafts, 6, sigma.shape[2])[:, :, 3:]
        worst = np.max(np.linalg.norm(speeds, axis=2), axis=1, initial=0.0)
        craft = np.moveaxis(worst.reshape(len(times), *by_arm), 1, 0)
        return tuple(knowledge), np.array(joint), settled.reshape(by_arm), craft

    def _reach(self) -> float:
        """Return the least distance between the asteroid and a spacecraft."""
        offsets = np.reshape([craft.offset_m for craft in self.spec.spacecraft], (-1, 3))
        return float(np.min(np.linalg.norm(offsets, axis=1), initial=_FAR_M))

    def _rows_of_arms(self, suite: SensorSuite) -> NDArray[np.bool_]:
        """Return which rows each arm measures, (A, m)."""
        own = [{id(ref.get()) for ref in arm.sensors} for arm in self.spec.arms]
        used = [[id(sensor) in ids for sensor in suite.sensors] for ids in own]
        sizes = [sum(channel.rows for channel in block) for block in suite.blocks]
        return np.repeat(np.array(used), sizes, axis=1)

    def _filter_arms(
        self,
        model: BodiesModel,
        prior: Belief,
        sets: list[MeasurementSet],
        used: NDArray[np.bool_],
        ctx: Context,
    ) -> tuple[list[Belief], list[NDArray[np.bool_]], NDArray[np.bool_]]:
        """Filter the measurements of each arm, the arms side by side as lanes.

        The first pass is that of the filter, from a fit to the first measurements. Further passes
        have the sensors linearised along the path of the last result, see `LinearPath`.

        Returns
        -------
        beliefs : list of Belief
            The first is before any measurement; at the other times after the measurements.
        present : list of ndarray of bool
            Which rows were used.
        settled : ndarray of bool, shape (A · N,)
            Whether the last pass changed the result by less than a tenth of its standard deviation.
        """
        arms, cases = len(used), len(prior.t_s)
        model = model.beside(arms)
        belief = Belief(
            np.tile(prior.x, arms), np.tile(prior.root, (arms, 1, 1)), np.tile(prior.t_s, arms)
        )
        present = [np.tile(m.present, arms) & np.repeat(used.T, cases, axis=1) for m in sets]
        shown = [
            MeasurementSet(
                np.tile(m.t_s, arms), np.tile(m.values, arms), np.tile(m.sigma, arms), m.blocks, own
            )
            for m, own in zip(sets, present, strict=True)
        ]
        advance = ctx.track("tracking", len(sets) * (1 + self.spec.passes))
        begun = select_starts(model, shown[0], _spread(belief), _KEPT_STARTS)
        first = arc_fit(model, belief, shown[:1], begun)
        advance(1)
        beliefs = self._filter(model, [belief, first.belief], shown[1:], advance)
        settled = first.settled
        every = np.stack(present, axis=1)
        for _ in range(self.spec.passes):
            linear = LinearPath.about(model, path_to(model, beliefs[-1]), every)
            beyond = [linear.beyond(one) for one in shown]
            again = self._filter(linear, [belief], beyond, advance)
            settled = step_in_sigmas(again[-1], beliefs[-1]) < _CONVERGED
            beliefs = again
        # the first two are of the same time, before and after its measurements
        return [beliefs[0], *beliefs[2:]], present, settled

    def _filter(
        self, model: BodiesModel, beliefs: list[Belief], sets: list[MeasurementSet], advance: Any
    ) -> list[Belief]:
        """Return the beliefs given, followed by those after each further set of measurements."""
        estimator: Any = self.spec.estimator.get()
        none = np.zeros((0, len(beliefs[0].t_s)))
        for one in sets:
            belief = beliefs[-1]
            if one.t_s[0] != belief.t_s[0]:
                belief = estimator.predict(model, belief, one.t_s, none)
            beliefs.append(estimator.update(model, belief, one)[0])
            advance(1)
        return beliefs

    def _craft(self, number: int, asteroid: Array) -> Array:
        """Return the heliocentric states (6, N) of a spacecraft."""
        craft = self.spec.spacecraft[number]
        axes, _ = hill_axes(asteroid)
        place, speed = np.array(craft.offset_m), np.array(craft.speed_m_s)
        turned = [np.einsum("ijn,j->in", axes, vector) for vector in (place, speed)]
        return np.asarray(asteroid + np.concatenate(turned))

    def _joint_prior(self, asteroid: Belief, places: Array, ctx: Context) -> Belief:
        """Return the joint belief of asteroid and spacecraft when tracking begins."""
        spec, (n, cases) = self.spec, places.shape
        sigma = np.repeat([spec.spacecraft_position_sigma_m, spec.spacecraft_speed_sigma_m_s], 3)
        root = np.zeros((cases, n, n))
        root[:, :6, :6] = asteroid.root
        x = places.copy()
        x[:6] = asteroid.x
        random = ctx.rng("spacecraft")
        for first in range(6, n, 6):
            rows = slice(first, first + 6)
            root[:, rows, rows] = np.diag(sigma)
            x[rows] += sigma[:, None] * random.normal(size=(6, cases))
        return Belief(x, root, asteroid.t_s)

    def _knowledge(
        self, beliefs: Sequence[Belief], truth: Sequence[Array], sets: Sequence[MeasurementSet]
    ) -> Knowledge:
        """Return errors and standard deviations of the asteroid, geometry by geometry."""
        seeds = self.spec.seeds

        def by_geometry(values: list[Array]) -> Array:
            return np.array(values).reshape(len(values), -1, seeds)

        off = [b.x[:6] - x[:6] for b, x in zip(beliefs, truth, strict=True)]

        def sizes(states: list[Array], rows: slice) -> Array:
            return by_geometry([np.linalg.norm(x[rows], axis=0) for x in states])

        place, speed = slice(3), slice(3, 6)
        spread = [b.sigma for b in beliefs]
        own = [nees(b, x, np.arange(6)) for b, x in zip(beliefs, truth, strict=True)]
        seen = [m.present.sum(axis=0).reshape(-1, seeds).mean(axis=1) for m in sets]
        return Knowledge(
            np.array([b.t_s[0] for b in beliefs]),
            sizes(off, place),
            sizes(off, speed),
            sizes(spread, place),
            sizes(spread, speed),
            by_geometry(own),
            np.array(seen),
        )


def _spread(prior: Belief) -> Array:
    """Return starts (n, S, N) along the direction in which the asteroid's position is known worst.

    The standard deviation in that direction may exceed the distance from the spacecraft, and the
    sum of squares of the first fit then has several minima.
    """
    values, axes = np.linalg.eigh(prior.covariance[:, :3, :3])
    worst = (axes[:, :, -1] * np.sqrt(values[:, -1:])).T
    starts = np.repeat(prior.x[:, None], len(_STARTS), axis=1)
    starts[:3] += worst[:, None] * _STARTS[:, None]
    return starts


def _unique(refs: Sequence[Ref]) -> list[Ref]:
    """Return the references to different components, in order."""
    return list({id(ref.get()): ref for ref in refs}.values())


def _times(duration_s: float, interval_s: float) -> Array:
    return np.asarray(interval_s * np.arange(int(np.floor(duration_s / interval_s + 1e-9)) + 1.0))


def _simulate_measurements(
    suite: SensorSuite,
    part: str,
    refs: Sequence[Ref],
    truth: Sequence[Array],
    model: BodiesModel,
    ctx: Context,
) -> list[MeasurementSet]:
    """Return the measurements of true states.

    Each sensor has a random stream of its own, which does not depend on the other sensors.
    """
    cases, times = truth[0].shape[1], np.array(model.times_s)
    # a sensor that was given in Python has no name: its number takes the place of one
    names = [ref.name if ref.name != "(given)" else f"{k}" for k, ref in enumerate(refs)]
    streams = [ctx.rng(f"{part} {name}") for name in names]
    pairs = list(zip(suite.sensors, streams, strict=True))
    constant = np.concatenate([r.normal(size=(s.draws[0], cases)) for s, r in pairs])
    width = max(1, _AT_ONCE // cases)
    sets = []
    for first in range(0, len(times), width):
        some = times[first : first + width]
        x = np.concatenate(truth[first : first + width], axis=1)
        noise = np.concatenate([r.normal(size=(s.draws[1], x.shape[1])) for s, r in pairs])
        every = suite.measurements(
            x, np.repeat(some, cases), model.scene_of(some, cases),
            np.tile(constant, len(some)), noise,
        )  # fmt: skip
        for k in range(len(some)):
            own = slice(k * cases, (k + 1) * cases)
            sets.append(
                MeasurementSet(
                    every.t_s[own], every.values[:, own], every.sigma[:, own], every.blocks,
                    every.present[:, own],
                )
            )  # fmt: skip
    return sets
