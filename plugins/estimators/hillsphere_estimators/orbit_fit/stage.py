"""The stage ``orbit_fit``: an orbit from recorded tracking data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.base.geodetic import WGS84, Station
from hillsphere.base.orientation import OrientationTable
from hillsphere.errors import InputError, PropagationError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.model.earth.planet import StationedPlanet
from hillsphere.presentation import Presentation
from hillsphere.time import Epoch
from hillsphere.uncertainty.copula import covariance_factor
from hillsphere_estimators.bias_states import BiasAugmentedModel, BiasStates
from hillsphere_estimators.fixed_steps import FixedStepModel
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.navigation.parts import refuse_considered
from hillsphere_estimators.orbit_fit.ambiguity import resolve_ranges
from hillsphere_estimators.orbit_fit.failure import check_above_ground, describe_trajectory
from hillsphere_estimators.orbit_fit.filtering import NO_FILTER, run_filter
from hillsphere_estimators.orbit_fit.fitting import EditedFit, fit_and_edit
from hillsphere_estimators.orbit_fit.judgement import Judgement, judge_fit
from hillsphere_estimators.orbit_fit.presentation import present_fit
from hillsphere_estimators.orbit_fit.products import FilterRun, FittedRows, OrbitFit
from hillsphere_estimators.orbit_fit.reading import TrackingData, read_tracking_data, text_of
from hillsphere_estimators.orbit_fit.records import Arc, Record, arrange, labels_of
from hillsphere_estimators.orbit_fit.specs import OrbitFitSpec
from hillsphere_estimators.orbit_fit.starting import FirstGuess, first_guess, start_epoch
from hillsphere_estimators.orbit_fit.surroundings import Surroundings, is_about_earth, zero_of
from hillsphere_estimators.orbit_fit.tracking_model import TrackingModel
from hillsphere_estimators.orbit_fit.trajectory import Trajectory, read_trajectory

__all__ = ["OrbitFitStage", "fit_records"]

_WIDE = 10.0
"""Standard deviation that stands for no prior, in distances and speeds of the start: data that
determine the orbit to a thousandth of it are changed by a millionth of their own."""
_STEP = 1e-3
"""Step of differences, in distances and speeds of the start: their error is of fourth order, and a
position at 1 au keeps six digits of a step of 10 m."""
_MOST_STATES = 200_000
"""Most states of the ephemeris that is written, about 20 MB of text."""


@dataclass(frozen=True)
class _Situation:
    """What a stage knows before it fits."""

    zero: Epoch
    start_s: float
    guess: FirstGuess
    data: TrackingData
    surroundings: Surroundings


class OrbitFitStage:
    """An orbit from recorded tracking data, by batch least squares and by a filter.

    Parameters
    ----------
    spec : OrbitFitSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant has not six states, or the filter cannot take considered errors.
    """

    def __init__(self, spec: OrbitFitSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        if len(self.plant.states) != 6:
            raise InputError(
                f"plant: an orbit fit needs the six states of one spacecraft, got "
                f"{len(self.plant.states)}"
            )
        if spec.estimator is not None and any(bias.considered for bias in spec.biases):
            refuse_considered("estimator", spec.estimator.get())

    def run(self, ctx: Context) -> OrbitFit:
        """Read the data, fit them and judge the fit.

        Parameters
        ----------
        ctx : Context
            Log and progress.

        Returns
        -------
        OrbitFit
            State, covariance, residuals and verdict.
        """
        spec = self.spec
        here = self._situation()
        count = sum(record.values.size for record in here.data.records)
        ctx.info(f"{count} values of {here.data.craft} are fitted")
        records, doubts = here.data.records, tuple[str, ...]()
        if any(record.observable.modulus_m for record in records):
            arc = arrange(records)
            model, prior, _ = self._model_and_prior(here, records, arc)
            records, doubts = resolve_ranges(model, prior, records, arc, spec.has_prior)
        arc = arrange(records)
        model, prior, names = self._model_and_prior(here, records, arc)
        threshold = spec.editing_sigmas or None
        advance = ctx.track("fits", spec.editing_rounds)
        try:
            # a fit that diverges may overflow before it fails
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                fitted = fit_and_edit(model, prior, arc, threshold, spec.editing_rounds, advance)
        except (InputError, PropagationError) as error:
            told = self._describe(here, records, arc, model, prior.x[:, 0])
            raise InputError(
                f"start: the fit diverges from this start ({error}): {told}"
            ) from error
        free = 0 if spec.has_prior else 6
        if not fitted.fit.settled[0]:
            told = self._describe(here, records, arc, model, fitted.fit.belief.x[:, 0])
            doubts = (
                f"it has not converged in {int(fitted.fit.iterations[0])} steps",
                *told,
                *doubts,
            )
        judged = judge_fit(fitted, arc, prior, records, threshold, free, doubts)
        run = NO_FILTER
        if spec.estimator is not None:
            ctx.info("the filter runs over the values that the fit has used")
            sets = arc.only(fitted.residuals.used)
            run = run_filter(model, prior, sets, spec.estimator.get(), fitted.fit.belief)
        return self._product(here, records, arc, model, prior, names, fitted, judged, run)

    def present(self, product: OrbitFit) -> Presentation:
        """Show state, residuals and verdict, and write the orbit as messages.

        Parameters
        ----------
        product : OrbitFit
            Product of `run`.

        Returns
        -------
        Presentation
            Tables, figures and files (CCSDS OPM and OEM).
        """
        return present_fit(product)

    def _situation(self) -> _Situation:
        """Read all files and place everything."""
        spec = self.spec
        epoch = start_epoch(spec.start)
        zero = zero_of(self.plant, epoch)
        start_s = epoch.seconds_since(zero)
        data = read_tracking_data(spec, zero)
        times = np.concatenate([[start_s], *(record.t_s for record in data.records)])
        planet: object = spec.body.get() if spec.body else getattr(self.plant, "planet", None)
        if planet is not None and not isinstance(planet, StationedPlanet):
            raise InputError(f"body: expected a body of type planet, got {type(planet).__name__}")
        orientation = OrientationTable.installed() if planet is None else planet.orientation
        ellipsoid = WGS84 if planet is None else planet.ellipsoid
        stations = {
            s.name: Station(s.name, s.latitude_rad, s.longitude_rad, s.height_m, ellipsoid)
            for s in spec.stations
        }
        observers: dict[str, Trajectory | None] = {
            o.name: None if o.file is None
            else read_trajectory(text_of(o.file), o.file, zero, f"observers: {o.name}")
            for o in spec.observers
        }  # fmt: skip
        centre = None
        if spec.centre is not None:
            if is_about_earth(self.plant):
                raise InputError("centre: the plant is about the Earth itself; remove the key")
            centre = read_trajectory(text_of(spec.centre), spec.centre, zero, "centre")
        surroundings = Surroundings(
            self.plant, zero, orientation, stations, observers, centre,
            (float(times.min()), float(times.max())),
        )  # fmt: skip
        guess = first_guess(spec.start, self.plant, start_s)
        check_above_ground(self.plant, guess.x, start_s, guess.key)
        return _Situation(zero, start_s, guess, data, surroundings)

    def _model_and_prior(
        self, here: _Situation, records: Sequence[Record], arc: Arc
    ) -> tuple[FixedStepModel, Belief, tuple[list[str], list[str]]]:
        """Return the model with constant errors, the prior, and names and units of the errors."""
        spec = self.spec
        size = np.linalg.norm(here.guess.x[:3])
        speed = max(float(np.linalg.norm(here.guess.x[3:])), 1e-6 * float(size))
        sigma = np.repeat(
            [spec.position_sigma_m or _WIDE * size, spec.velocity_sigma_m_s or _WIDE * speed], 3
        )
        noise = spec.acceleration_noise_m_s2

        def accelerations(t_s: Array) -> Array:
            return np.full((3, np.size(t_s)), noise)

        motion = TrackingModel(
            self.plant, [record.observable for record in records], here.surroundings,
            here.data.craft, spec.aberration, here.data.transmissions, arc.active,
            noise=accelerations if noise else None, step_s=spec.step_s,
            noise_step_s=spec.noise_step_s,
        )  # fmt: skip
        biases, names, units = _biases(spec, records)
        whole = BiasAugmentedModel(motion, 6, biases)
        root = np.diag(sigma) if spec.prior == "stated" else _stated_root(here.guess)
        belief = Belief(here.guess.x[:, None], root[None], np.array([here.start_s]))
        prior = whole.append_biases(belief)
        steps = np.concatenate([np.repeat([_STEP * size, _STEP * speed], 3), biases.sigma])
        return FixedStepModel(whole, motion.blocks, steps), prior, (names, units)

    def _describe(
        self, here: _Situation, records: Sequence[Record], arc: Arc, model: FixedStepModel, x: Array
    ) -> tuple[str, ...]:
        """Return what is wrong with the trajectory of a fit that has failed."""
        return describe_trajectory(
            model, self.plant, here.surroundings, here.data.craft,
            [record.observable.path for record in records], arc, x, here.start_s,
        )  # fmt: skip

    def _product(
        self,
        here: _Situation,
        records: Sequence[Record],
        arc: Arc,
        model: FixedStepModel,
        prior: Belief,
        names: tuple[list[str], list[str]],
        fitted: EditedFit,
        judged: Judgement,
        run: FilterRun,
    ) -> OrbitFit:
        """Return the product."""
        spec, belief = self.spec, fitted.fit.belief
        t, states, covariance = self._ephemeris(here, arc, model, belief)
        scale = "UTC" if is_about_earth(self.plant) else "TDB"
        date = here.zero.to(scale)
        left = here.data.left_out
        surroundings = here.surroundings
        frame = {"teme": "TEME", "gcrs": "GCRF"}[surroundings.axes]
        centre = "EARTH" if surroundings.about_earth else self.plant.frame.partition(":")[2].upper()
        return OrbitFit(
            spacecraft=here.data.craft,
            states=(*(v.name for v in self.plant.states), *names[0]),
            epoch=date.isot(np.array([here.start_s]), 9)[0],
            time_scale=scale,
            zero=date.isot(np.zeros(1), 9)[0],
            frame=self.plant.frame,
            mean=belief.x[:, 0],
            covariance=belief.covariance[0],
            start=prior.x[:, 0],
            considered=model.considered.astype(float),
            bias_units=tuple(names[1]),
            answer=judged.answer,
            reasons=judged.reasons,
            hints=judged.hints,
            squares=judged.squares,
            low=judged.low,
            high=judged.high,
            dof=judged.dof,
            rounds=fitted.rounds,
            rows=_rows(records, arc, fitted, judged),
            left_out=tuple(what for what, _ in left),
            left_out_why=tuple(why for _, why in left),
            left_out_count=np.array(list(left.values()), dtype=float),
            notes=here.data.notes,
            filter=run,
            ephemeris_t_s=t,
            ephemeris=states,
            ephemeris_covariance=covariance,
            ephemeris_frame=frame if surroundings.about_earth else "ICRF",
            centre=centre,
            object_id=spec.object_id or here.data.craft,
        )

    def _ephemeris(
        self, here: _Situation, arc: Arc, model: FixedStepModel, belief: Belief
    ) -> tuple[Array, Array, Array]:
        """Return times (K,), inertial states (6, K), and the covariance of the first (6, 6)."""
        begin, end = (float(arc.sets[k].t_s[0]) for k in (0, -1))
        begin, end = min(begin, here.start_s), max(end, here.start_s)
        step = self.spec.ephemeris_interval_s
        count = int(np.ceil((end - begin) / step - 1e-9)) if end > begin else 1
        if count > _MOST_STATES:
            raise InputError(
                f"ephemeris_interval: the data span {(end - begin) / DAY_S:.4g} d, which are "
                f"{count} states; at most {_MOST_STATES}"
            )
        t = begin + step * np.arange(count + 1.0)
        none, one = np.zeros((0, 1)), np.zeros(1, dtype=int)
        first, phi = transition(model, belief, t[:1], none)
        states = [first]
        for k in range(count):
            states.append(model.advance(states[-1], t[k : k + 1], t[k + 1 : k + 2], none, one))
        x = np.concatenate(states, axis=1)
        inertial = here.surroundings.inertial(x, t)
        # the states are linear in those of the plant's frame
        cases = np.repeat(np.eye(6)[:, :, None], 1, axis=2)
        turn = np.stack(
            [here.surroundings.inertial(cases[:, k], t[:1])[:, 0] for k in range(6)], axis=1
        )
        moved = turn @ (phi[0] @ belief.root[0])[:6]
        return t, inertial, moved @ moved.T


def _stated_root(guess: FirstGuess) -> Array:
    """Return a root (6, 6) of the covariance that the message of the start states.

    Raises
    ------
    InputError
        If it states none.
    """
    if guess.covariance is None:
        raise InputError(
            f"prior: {guess.key} states no covariance at the time of the start; give an OPM with "
            "one, or position_sigma and velocity_sigma"
        )
    return covariance_factor(guess.covariance)


def _biases(
    spec: OrbitFitSpec, records: Sequence[Record]
) -> tuple[BiasStates, list[str], list[str]]:
    """Return the constant errors, their names and their units.

    Raises
    ------
    InputError
        If an error is of something that is not measured.
    """
    rows = [
        (record.observable, row) for record in records
        for row in range(len(record.observable.names))
    ]  # fmt: skip
    sigma, shown, considered, names, units = [], [], [], [], []
    for number, bias in enumerate(spec.biases):
        for key, kind, row, unit in (
            ("angle_1_rad", "angles", 0, "rad"), ("angle_2_rad", "angles", 1, "rad"),
            ("range_m", "range", 0, "m"), ("range_rate_m_s", "range_rate", 0, "m/s"),
            ("frequency_hz", "frequency", 0, "Hz"),
        ):  # fmt: skip
            size = getattr(bias, key)
            if size is None:
                continue
            own = np.array(
                [o.receiver == bias.station and o.kind == kind and r == row for o, r in rows],
                dtype=float,
            )
            if not own.any():
                raise InputError(
                    f"biases[{number}].{key}: {bias.station} has measured no such value that is "
                    "used"
                )
            sigma.append(size)
            shown.append(own)
            considered.append(bias.considered)
            what = rows[int(np.argmax(own))][0].names[row]
            names.append(f"{bias.station}: {what}")
            units.append(unit)
    k = len(sigma)
    return BiasStates(
        np.array(sigma), np.full(k, np.inf), np.array(shown).reshape(k, len(rows)).T,
        np.zeros((0, k)), np.array(considered, dtype=bool),
    ), names, units  # fmt: skip


def _rows(records: Sequence[Record], arc: Arc, fitted: EditedFit, judged: Judgement) -> FittedRows:
    """Return the residuals of the product."""
    about = fitted.residuals
    channels = [c for record in records for c in record.observable.channels]
    return FittedRows(
        tuple(labels_of(records)),
        tuple(c.unit for c in channels),
        np.array([row.count for row in judged.rows], dtype=float),
        np.array([row.edited for row in judged.rows], dtype=float),
        np.array([row.mean for row in judged.rows]),
        np.array([row.rms for row in judged.rows]),
        np.array([row.bias for row in judged.rows]),
        np.array([row.correlation for row in judged.rows]),
        np.array([arc.sets[k].t_s[0] for k in arc.at]),
        arc.row.astype(float),
        about.residual * arc.sigma,
        about.residual / np.maximum(about.sigma(), 1e-3),
        about.used.astype(float),
    )


def fit_records(
    model: FixedStepModel,
    prior: Belief,
    records: Sequence[Record],
    *,
    threshold: float | None = 4.0,
    rounds: int = 12,
) -> tuple[EditedFit, Judgement]:
    """Fit records that were made in Python, and judge the fit.

    Parameters
    ----------
    model : FixedStepModel
        Of a `TrackingModel` whose observables are those of the records.
    prior : Belief
        At the start, N = 1.
    records : sequence of Record
        The data, of one case.
    threshold : float or None
        Of the editing.
    rounds : int
        Fits at most.

    Returns
    -------
    fit : EditedFit
        The fit.
    judged : Judgement
        The verdict.
    """
    arc = arrange(records)
    fitted = fit_and_edit(model, prior, arc, threshold, rounds, lambda _: None)
    return fitted, judge_fit(fitted, arc, prior, records, threshold, 0)
