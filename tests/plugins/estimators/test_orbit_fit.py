"""The fit of the stage ``orbit_fit`` to tracking data that other code has simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scipy.stats import kstest, chi2

from hillsphere.base.geodetic import Station
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.bias_states import BiasAugmentedModel, BiasStates
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.fixed_steps import FixedStepModel
from hillsphere_estimators.orbit_fit.observables import Observable
from hillsphere_estimators.orbit_fit.records import Record, arrange
from hillsphere_estimators.orbit_fit.stage import fit_records
from hillsphere_estimators.orbit_fit.surroundings import Surroundings
from hillsphere_estimators.orbit_fit.tracking_model import TrackingModel
from hillsphere_estimators.orbit_fit.trajectory import Trajectory
from tests.plugins.estimators import tracking_simulation as sim

ARCSECOND = np.pi / 648000.0
KINDS = ("angles", "ranges", "small body")


class Problem:
    """True values of a kind of tracking, and the model that fits them."""

    def __init__(self, kind: str) -> None:
        self.records: list[Record] = []
        if kind == "small body":
            self._small_body()
        else:
            self._earth(kind)

    def _add(self, observable: Observable, t: Array, values: Array, sigma: Array) -> None:
        self.records.append(Record(observable, t, values, sigma))

    def _earth(self, kind: str) -> None:
        craft = sim.satellite()
        self.truth, self.sigma = sim.START, np.repeat([2e3, 2.0], 3)
        stations = {n: Station(n, np.radians(a), np.radians(b), h)
                    for n, (a, b, h) in sim.PLACES.items()}  # fmt: skip
        self.plant = sim.earth_plant()
        zero = Epoch.parse(sim.DATE, "UTC")
        self.surroundings = Surroundings(
            self.plant, zero, self.plant.planet.orientation, stations, {}, None, (0.0, 7600.0)
        )
        if kind == "angles":
            t = np.concatenate([np.arange(420.0, 1150.0, 30.0), np.arange(7050.0, 7550.0, 50.0)])
            lines = [craft(sim.sent_at(craft, sim.station("A")(s), s)) - sim.station("A")(s)
                     for s in t]  # fmt: skip
            values = np.array([sim.horizon("A", line, s) for line, s in zip(lines, t, strict=True)])
            sigma = 20.0 * ARCSECOND * np.array([1.0 / np.cos(values[:, 1]), np.ones(len(t))])
            self._add(Observable("angles", ("S", "A"), "AZEL"), t, values.T, sigma)
            return
        for name, t in (("A", np.arange(440.0, 1150.0, 50.0)), ("B", np.arange(60.0, 850.0, 50.0))):
            path = [sim.station(name), craft, sim.station(name)]
            ranges = np.array([sim.elapsed(path, s) for s in t]) * sim.C / 2.0
            self._add(Observable("range", (name, "S", name), share=0.5), t, ranges[None],
                      np.full((1, len(t)), 5.0))  # fmt: skip
            ends = [[sim.elapsed(path, s + d) for s in t] for d in (-5.0, 5.0)]
            rates = (np.array(ends[1]) - ends[0]) * sim.C / 20.0
            self._add(
                Observable("range_rate", (name, "S", name), share=0.5, interval_s=10.0), t,
                rates[None], np.full((1, len(t)), 0.01),
            )  # fmt: skip

    def _small_body(self) -> None:
        craft = sim.prober(2.2e5)
        self.plant = sim.small_body_plant()
        zero = Epoch.parse(sim.DATE, "TDB")
        nodes = np.linspace(-6e4, 2.4e5, 101)

        def trajectory(name: str, motion: sim.Motion, h: float) -> Trajectory:
            x = [np.concatenate([motion(s), sim.derivative(motion, s, h)]) for s in nodes]
            return Trajectory(name, nodes, np.array(x).T)

        self.surroundings = Surroundings(
            self.plant, zero, sim.earth_plant().planet.orientation, {},
            {"O": trajectory("O", sim.observer, 10.0), "E": None},
            trajectory("centre", sim.centre_from_earth, 1000.0), (0.0, 2.2e5),
        )  # fmt: skip
        self.truth = self.surroundings.from_inertial(sim.NEAR[:, None], np.zeros(1))[:, 0]
        self.sigma = np.repeat([200.0, 0.005], 3)
        t = np.arange(0.0, 2.1e5, 1e4)
        lines = [craft(sim.sent_at(craft, sim.observer(s), s)) - sim.observer(s) for s in t]
        angles = np.array([[np.arctan2(y, x) % (2 * np.pi), np.arctan2(z, np.hypot(x, y))]
                           for x, y, z in lines])  # fmt: skip
        sigma = 1.0 * ARCSECOND * np.array([1.0 / np.cos(angles[:, 1]), np.ones(len(t))])
        self._add(Observable("angles", ("S", "O"), "RADEC", "ICRF"), t, angles.T, sigma)

        def probe(s: float) -> Array:
            return np.asarray(sim.earth(s) + sim.centre_from_earth(s) + craft(s))

        t = np.arange(5e3, 2.1e5, 2e4)
        ranges = np.array([sim.elapsed([sim.earth, probe, sim.earth], s) for s in t]) * sim.C
        self._add(Observable("range", ("E", "S", "E")), t, ranges[None], np.full((1, len(t)), 10.0))

    def model(self, biases: BiasStates | None = None) -> FixedStepModel:
        arc = arrange(self.records)
        motion = TrackingModel(
            self.plant, [r.observable for r in self.records], self.surroundings, "S", "none", {},
            arc.active, step_s=50.0 if self.truth[0] > 1e5 else 2000.0,
        )  # fmt: skip
        rows = sum(len(r.observable.names) for r in self.records)
        if biases is None:
            biases = BiasStates(np.empty(0), np.empty(0), np.zeros((rows, 0)), np.zeros((0, 0)),
                                np.zeros(0, dtype=bool))  # fmt: skip
        whole = BiasAugmentedModel(motion, 6, biases)
        size = [np.linalg.norm(self.truth[:3]), np.linalg.norm(self.truth[3:])]
        steps = np.concatenate([np.repeat(1e-3 * np.array(size), 3), biases.sigma])
        return FixedStepModel(whole, motion.blocks, steps)

    def measured(self, cases: int, seed: int, outlier: float = 0.0) -> list[Record]:
        random = np.random.default_rng(seed)
        made = [
            replace(r, values=r.values[:, :, None]
                    + r.sigma[:, :, None] * random.normal(size=(*r.values.shape, cases)))
            for r in self.records
        ]  # fmt: skip
        return made

    def prior(self, cases: int, seed: int) -> Belief:
        random = np.random.default_rng(seed)
        off = self.sigma[:, None] * random.normal(size=(6, cases))
        root = np.repeat(np.diag(self.sigma)[None], cases, axis=0)
        return Belief(self.truth[:, None] + off, root, np.zeros(cases))


def fitted(kind: str, cases: int, seed: int) -> tuple[Problem, Any]:
    problem = Problem(kind)
    arc = arrange(problem.measured(cases, seed))
    return problem, batch_least_squares(
        problem.model(), problem.prior(cases, seed + 1), arc.sets, iterations=10
    )


def check(kind: str, cases: int, seed: int) -> float:
    """Fit cases and return the mean NEES after a check of its band and of the squares."""
    problem, fit = fitted(kind, cases, seed)
    assert fit.settled.all()
    errors = nees(fit.belief, np.repeat(problem.truth[:, None], cases, axis=1))
    low, high = chi_square_band(6, cases)
    assert low <= errors.mean() <= high
    low, high = chi_square_band(int(fit.rows[0]), cases)
    assert low <= fit.squares.mean() <= high
    print(kind, cases, errors.mean(), chi_square_band(6, cases), fit.squares.mean() / fit.rows[0])
    # the data say far more than the prior
    assert (fit.belief.sigma[:, 0] < 0.5 * problem.sigma).all()
    if cases >= 100:
        assert kstest(errors, chi2(6).cdf).pvalue > 1e-3
    return float(errors.mean())


@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_as_large_as_the_covariance_says(kind: str) -> None:
    """Ten fits of each kind: mean NEES of six states in its 99.9 % band."""
    check(kind, 10, 20240301)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_errors_of_200_fits_are_as_large_as_the_covariance_says(kind: str) -> None:
    check(kind, 200, 7)
