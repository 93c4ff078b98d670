"""The stage ``navigation``: sensors and a filter in the loop, N flights at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hillsphere.base.seeds import draws
from hillsphere.engine.flight_metrics import FlightMetric
from hillsphere.engine.flying_stage import FlyingStage, collect_histories
from hillsphere.engine.requirements import Judgement
from hillsphere.engine.start_states import with_placed_start_of
from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import (
    Array,
    Context,
    EstimationModel,
    Estimator,
    Parameter,
    Plant,
    Scene,
)
from hillsphere.interfaces.cases import CaseBatch, Histories
from hillsphere.presentation import Presentation
from hillsphere.products import FlightSet
from hillsphere.sensor_suite import SensorSuite
from hillsphere.simulation import BLOCK, Cases, Simulator
from hillsphere.uncertainty.distribution import multiply_lower
from hillsphere_estimators.bias_states import BiasAugmentedModel
from hillsphere_estimators.navigation.attitude import TrueAttitude
from hillsphere_estimators.navigation.bounds import bound_along_plan
from hillsphere_estimators.navigation.divergence import endings, format_ending
from hillsphere_estimators.navigation.effort import law_delta_v
from hillsphere_estimators.navigation.filtering import Filtering, FilterLog, SensorScenes
from hillsphere_estimators.navigation.metrics import (
    Record,
    navigation_histories,
    navigation_metrics,
)
from hillsphere_estimators.navigation.parts import (
    InitialBeliefs,
    biases_of,
    check_scales,
    continuous_law,
    faults_of,
    intervals_of,
    members_of,
    model_of,
    prior_of,
    refuse_considered,
    sensors_of,
    stated_covariance,
    true_sensors,
)
from hillsphere_estimators.navigation.plan import Plan, check_step, plan_of, read_start
from hillsphere_estimators.navigation.presentation import present_navigation
from hillsphere_estimators.navigation.products import NavigationFlight
from hillsphere_estimators.navigation.scene import aims, proximity_scene, sky_of
from hillsphere_estimators.navigation.specs import NavigationSpec
from hillsphere_estimators.navigation.world import (
    NoControl,
    PerturbedReference,
    ResampledLaw,
    noise_of,
)
from hillsphere_estimators.plant_model import PlantModel

__all__ = ["NavigationStage"]

_ORBIT = ("primary_gm", "semi_major_axis", "eccentricity", "true_anomaly")
"""Parameters of the body's orbit. Kepler's equation is solved for a few lanes at a time, until all
of them have converged: if these differed, a case would take other last bits from its neighbours."""


@dataclass(frozen=True)
class _Planned:
    """A plan, and the beliefs of an earlier stage with which its flights begin, if any."""

    plan: Plan
    belief: InitialBeliefs | None


class NavigationStage(FlyingStage[_Planned, Record]):
    """Flights with sensors, a filter and a law in a closed loop.

    Parameters
    ----------
    spec : NavigationSpec
        With its references bound.

    Raises
    ------
    InputError
        If plant, law, sensors and Spec do not fit together.
    """

    kind = "navigation"

    def __init__(self, spec: NavigationSpec) -> None:
        super().__init__(spec.plant.get())
        self._stated = stated_covariance(spec, self.plant)
        self.spec = spec = with_placed_start_of(spec, self.plant)
        self.true_plant: Plant = self.plant if spec.truth.plant is None else spec.truth.plant.get()
        names = [tuple(v.name for v in plant.states) for plant in (self.plant, self.true_plant)]
        if names[0] != names[1]:
            raise InputError(
                f"truth.plant: its states are {', '.join(names[1])}, those of plant "
                f"{', '.join(names[0])}; they must be the same"
            )
        if self.rows.others:
            other = ", ".join(self.rows.names[i] for i in self.rows.others)
            raise InputError(
                f"plant: navigation estimates positions and velocities; this one has {other} too"
            )
        read_start(spec, self.rows)  # which refuses another number of components
        self.law = continuous_law(spec, self.plant)
        self._prefix = "plant." if spec.truth.plant is None else "truth.plant."
        self._nominal = {q.name: q for q in self.true_plant.parameters()}
        if unknown := sorted(set(spec.truth.scale) - set(self._nominal)):
            raise InputError(
                f"truth.scale: the true plant has no parameter {', '.join(unknown)}; it has "
                f"{', '.join(self._nominal)}"
            )
        check_scales(spec.truth.scale, {name: q.value for name, q in self._nominal.items()})
        self._suite = SensorSuite(sensors_of(spec.sensors))
        true = true_sensors(spec, self._suite)
        self._faults = faults_of(spec, true)
        self._sky = sky_of(
            [*self._suite.sensors, *true.sensors], [self.plant, self.true_plant],
            spec.earth and spec.earth.get(), spec.epoch,
        )  # fmt: skip
        self._members = members_of(spec, self._suite)
        self._biases = biases_of(spec, self.plant, self._suite, self.law)
        self._estimator: Estimator = spec.estimator.get()
        opening = spec.opening or spec.estimator
        self._opening: Estimator = opening.get()
        if self._biases is not None and self._biases.considered.any():
            refuse_considered("estimator", self._estimator)
            refuse_considered("opening", self._opening)
        self._count = intervals_of(spec) + 1
        self._since: Array = np.arange(self._count, dtype=float) * spec.interval_s
        self._metrics = navigation_metrics(self.rows.vectors, self._since, spec.report_at_s)

    @property
    def metrics(self) -> tuple[FlightMetric[Record], ...]:
        """Metrics of its flights; see `navigation_metrics`."""
        return self._metrics

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return the inputs that may differ from case to case; see `NavigationSpec`."""
        scale = self.spec.truth.scale
        inputs = [
            replace(q, name=self._prefix + q.name, value=q.value * scale.get(q.name, 1.0))
            for q in self._nominal.values()
            if q.name not in _ORBIT
        ]
        if self.law is not None:
            inputs.append(Parameter("thrust", self.spec.truth.thrust))
        return tuple(inputs)

    def run(
        self,
        ctx: Context,
        reference: FlightSet | None = None,
        belief: InitialBeliefs | None = None,
    ) -> NavigationFlight:
        """Fly a block of 64 cases with different random numbers and nominal inputs.

        Parameters
        ----------
        ctx : Context
            Seed and progress.
        reference : FlightSet, optional
            Trajectories of which one is followed.
        belief : InitialBeliefs, optional
            Beliefs at the start.

        Returns
        -------
        NavigationFlight
            Case by case.
        """
        advance = ctx.track("navigation", BLOCK)
        planned = self._plan(reference=reference, belief=belief)
        batch = self._own_batch(ctx.seed, BLOCK)
        record = self._fly_block(planned, batch)
        advance(BLOCK)
        return self._product(planned, batch, record)

    def present(
        self,
        product: NavigationFlight,
        reference: FlightSet | None = None,
        belief: InitialBeliefs | None = None,
    ) -> Presentation:
        """Show the flights."""
        return present_navigation(product, self.spec)

    @cached_property
    def _model(self) -> PlantModel:
        return model_of(self.spec, self.plant, self._suite, self.law)

    def _model_with_step(self, factor: float) -> PlantModel:
        """Return the filter's model with `factor` times its step."""
        spec = self.spec.model_copy(update={"step_s": factor * self.spec.step_s})
        return model_of(spec, self.plant, self._suite, self.law)

    def _control(self, estimate: Array, goal: Array) -> Array:
        """Return the controls of the motion model, with zeros for the biases.

        They are the estimate and the reference of the law, if there is one.
        """
        pushes = 0
        if self._biases is not None:
            pushes = len(self.plant.controls) * (1 if self.law is None else 2)
        told = [] if self.law is None else [estimate, goal]
        return np.concatenate([*told, np.zeros((pushes, estimate.shape[1]))])

    def _control_without_biases(self, estimate: Array, goal: Array) -> Array:
        """Return the controls of the motion model without biases."""
        told = [] if self.law is None else [estimate, goal]
        return np.concatenate([*told, np.zeros((0, estimate.shape[1]))])

    def _scene(self, t_s: Array, believed: Array) -> Scene:
        return proximity_scene(self.plant, self.rows.positions, t_s, believed, self._sky)

    def _make_plan(
        self, reference: FlightSet | None = None, belief: InitialBeliefs | None = None
    ) -> _Planned:
        """Return what flights along this reference share."""
        plan = plan_of(
            self.spec, self.plant, self.rows, self._since, reference, belief, self._stated
        )
        check_step(plan, self.rows, self._model, self._model_with_step(0.5), self._since)
        return _Planned(plan, belief)

    def _bound(self, plan: Plan, x0: Array, start: Belief) -> Array:
        """Return the Cramér-Rao bounds (S, K, N) of the position errors along the planned paths."""
        rows, cases = self.rows, x0.shape[1]
        prior = start.covariance
        if (x0 == x0[:, :1]).all() and (prior == prior[:1]).all():  # all fly the same path
            x0, prior = x0[:, :1], prior[:1]
        # with twice the step: the step map is of sixth order, and bounds change by 1e-5
        bounds = bound_along_plan(
            self._model_with_step(2.0), x0, prior, start.t_s[0] + self._since, plan.goal,
            self._control_without_biases, self._scene, self._faults.heard,
        )  # fmt: skip
        squares = np.array([one.sigma[rows.positions] ** 2 for one in bounds]).transpose(1, 0, 2)
        each = squares.reshape(rows.vectors, -1, self._count, x0.shape[1]).sum(axis=1)
        return np.broadcast_to(np.sqrt(each), (rows.vectors, self._count, cases))

    def _run_time(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the parameters of the true plant that are not nominal, or differ between cases."""
        differ = {n.removeprefix(self._prefix) for n in names} | set(self.spec.truth.scale)
        return tuple(name for name in self._nominal if name in differ)

    def _simulator(
        self, names: tuple[str, ...], navigation: Filtering | None,
        reference: PerturbedReference | None = None,
    ) -> Simulator:  # fmt: skip
        spec = self.spec
        law = (
            NoControl(spec.interval_s, self.plant.controls)
            if self.law is None
            else ResampledLaw(self.law, spec.interval_s)
        )
        per = max(1, int(np.ceil(spec.interval_s / spec.step_s - 1e-9)))
        return Simulator(
            self.true_plant, law, reference=reference, navigation=navigation, run_time=names,
            method=spec.method, substeps=per,
        )  # fmt: skip

    def _begin(
        self, plan: Plan, batch: CaseBatch, belief: InitialBeliefs | None, t0: Array
    ) -> tuple[Array, Belief]:
        """Return true states (n, N) and beliefs before the first measurement."""
        if belief is not None:
            column = plan.beliefs[batch.draws % len(plan.beliefs)]
            return belief.truths[:, column].copy(), Belief.of(
                belief.means[:, column], belief.covariances[column], t0
            )
        n, width = len(plan.start), len(batch.draws)
        planned = np.repeat(plan.start[:, None], width, axis=1)
        z = draws(batch.seed, batch.stream, batch.draws, "start", (n,))
        off = planned + multiply_lower(plan.root, z)
        belief_spec = self.spec.belief
        is_truth = belief_spec is None or belief_spec.off == "truth"
        truth, mean = (off, planned) if is_truth else (planned, off)
        return np.ascontiguousarray(truth), prior_of(plan.root, mean, t0)

    def _compile(self, planned: _Planned, names: Sequence[str]) -> Simulator:
        """Compile the simulation of cases that differ in these inputs."""
        return self._simulator(self._run_time(names), None)

    def _fly_block(self, planned: _Planned, batch: CaseBatch, *, history: bool = True) -> Record:
        """Fly a block; the measurements are recorded whether histories are wanted or not."""
        plan, belief = planned.plan, planned.belief
        spec, rows = self.spec, self.rows
        fixed = {n: self._nominal[n].value * spec.truth.scale.get(n, 1.0) for n in self._nominal}
        names = self._run_time(batch.names)
        width = len(batch.numbers)
        p = {name: batch.value(self._prefix + name, fixed[name]) for name in names}
        thrust = batch.value("thrust", spec.truth.thrust)
        t0 = np.full(width, plan.begin_s)
        x0, start = self._begin(plan, batch, belief, t0)
        # the random accelerations are those of the true plant
        shaken = PerturbedReference(
            plan.goal, spec.interval_s, spec.noise_step_s, t0, noise_of(self.true_plant),
            thrust, batch.seed, batch.stream, batch.draws,
        )  # fmt: skip
        moved = {name: value for name, value in p.items() if not name.startswith("gravity.")}

        def true_scene(t_s: Array, believed: Array) -> Scene:
            return proximity_scene(
                self.true_plant, rows.positions, t_s, believed, self._sky, **moved
            )

        model = self._model
        log = FilterLog()
        biases, n = self._biases, len(rows.names)

        def within(scene: Scene) -> EstimationModel:
            inner = model.within(scene)
            return inner if biases is None else BiasAugmentedModel(inner, n, biases)

        navigation = Filtering(
            model=model if biases is None else BiasAugmentedModel(model, n, biases),
            within=within,
            faults=self._faults,
            believed=self._suite,
            views=SensorScenes(
                self._scene,
                true_scene,
                lambda told, x: aims(rows.positions, told, x, spec.search_beyond_rad),
            ),
            estimators=(self._opening, self._estimator),
            gate_after=spec.gate_after,
            members=self._members,
            start=start,
            control=self._control,
            goal=plan.goal,
            interval_s=spec.interval_s,
            log=log,
            attitude=None if spec.attitude is None else TrueAttitude(spec.attitude, rows.vectors),
        )
        gain = np.eye(len(self.plant.controls))[:, :, None] * thrust
        flights = self._simulator(names, navigation, shaken).fly(
            Cases(x0, np.array([p[name] for name in names]).reshape(len(names), width),
                  gain=gain, draws=batch.draws, t0_s=t0),
            self._count,
            seed=batch.seed,
            stage=batch.stream,
            history=True,
            # what follows the last measurement concerns nobody
            to_last_sample=True,
        )  # fmt: skip
        assert flights.history is not None
        x = flights.history.x[:, : self._count]
        record = Record.of(
            rows, log, self._since, x, plan.goal, self._bound(plan, x0, start), len(spec.sensors),
            spec.rms_from_s, flights,
        )  # fmt: skip
        dv = law_delta_v(
            self.plant, self.law, spec.method, spec.step_s, plan.begin_s + self._since,
            x + record.error, plan.goal, thrust,
        )  # fmt: skip
        return replace(record, dv_m_s=dv)

    def _judge(
        self, planned: _Planned, batch: CaseBatch, record: Record, values: Array
    ) -> Judgement:
        """Return how flights ended, see `endings`; those with a non-finite filter are undecided."""
        status, cause = endings(record, record.flights, self.spec.diverged_beyond)
        return status, cause, np.array(status) != "completed"

    def _histories(
        self, planned: _Planned, record: Record, wanted: bool | Sequence[str]
    ) -> Histories:
        """Return the histories that are wanted; see `navigation_histories`."""
        times = record.time_s[:, None] + planned.plan.begin_s
        time_s = np.where(np.isnan(record.nees), np.nan, times)
        return collect_histories(navigation_histories(self.rows), record, time_s, wanted)

    def _product(self, planned: _Planned, batch: CaseBatch, record: Record) -> NavigationFlight:
        truth, plan = self.spec.truth, planned.plan
        results = self._results(planned, batch, record)
        crafts = getattr(self.plant, "spacecraft", None)
        labels = tuple(crafts or (f"spacecraft {i + 1}" for i in range(self.rows.vectors)))
        matched = truth.plant is None and not truth.sensors and not truth.scale
        attitude = self.spec.attitude
        if attitude is not None and attitude.believed == "noise":
            matched &= attitude.drift_sigma_rad == 0.0  # a drift is no noise
        x = record.x[:, :, 0]
        return NavigationFlight(
            frame=self.plant.frame,
            spacecraft=labels,
            states=self.rows.names,
            time_s=self._since,
            x=x,
            estimate=x + record.error[:, :, 0],
            goal=plan.goal,
            sigma=record.sigma[:, :, 0],
            position_error_m=record.position_error_m,
            velocity_error_m_s=record.velocity_error_m_s,
            position_sigma_m=record.position_sigma_m,
            control_error_m=record.control_error_m,
            nees=record.nees,
            nis=record.nis,
            used=record.used,
            sent=record.sent,
            bounds_m=np.array(record.bound_m),
            sensors=tuple(ref.name for ref in self.spec.sensors),
            seen=np.mean(record.seen, axis=1),
            matched=matched and truth.thrust == 1.0,
            lost=int(np.isnan(record.nees[-1]).sum()),
            endings=tuple(map(format_ending, results.status, results.cause)),
            metrics=results.metrics,
            units=results.units,
            values=results.values,
        )
