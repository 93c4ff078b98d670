"""The stage ``linearise``: linear models of a plant along a trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.engine.course import Course, Rows, course_along
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere.products import FlightSet
from hillsphere_controllers.stages.linearise.derivatives import Derived, Slopes, find_affine
from hillsphere_controllers.stages.linearise.influence import (
    end_deviations,
    fit_weights,
    jacobian_shares,
    largest_accelerations,
)
from hillsphere_controllers.stages.linearise.parameters import (
    dispersed_parameters,
    parameter_samples,
)
from hillsphere_controllers.stages.linearise.presentation import present_linearisation
from hillsphere_controllers.stages.linearise.products import LinearisedFlight
from hillsphere_controllers.stages.linearise.specs import LineariseSpec

__all__ = ["LineariseStage"]


@dataclass(frozen=True)
class _Sampled:
    """Values (q, S) of the parameters at every point, the first nominal, and names of samples."""

    values: Array
    names: tuple[str, ...]


class LineariseStage:
    """Linear models of a plant along a trajectory.

    Parameters
    ----------
    spec : LineariseSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant lacks positions, velocities or controls, or the dispersions do not fit it.
    """

    def __init__(self, spec: LineariseSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        self.rows = Rows(self.plant)
        if not self.plant.controls:
            raise InputError("plant: it has no controls; nothing could be commanded")
        self.dispersed = dispersed_parameters(
            self.plant, spec.plant.name, spec.dispersions, spec.sigmas
        )

    def run(self, ctx: Context, reference: FlightSet) -> LinearisedFlight:
        """Make the models.

        Parameters
        ----------
        ctx : Context
            Progress, and the seed of the corners.
        reference : FlightSet
            With the trajectory.

        Returns
        -------
        LinearisedFlight
            At each point: the nominal model, one with each parameter at its upper bound, one at its
            lower bound with each that is not affine, and those at corners.

        Raises
        ------
        InputError
            If there is no such trajectory, a point lies beyond its end, or the plant's rates are
            not finite at one.
        StageError
            If the trajectory is not one of this plant.
        """
        spec, dispersed = self.spec, self.dispersed
        course = course_along(self.plant, self.rows, reference, spec.follow)
        t = self._times(course)
        advance = ctx.track("linearisation", 3 if dispersed.names else 1)
        slopes = Slopes(self.plant, self.rows, dispersed, spec.start_time_s)
        x, u = np.ascontiguousarray(course.at(t)), self._command(course, t)
        middle = _evaluate_derivatives(slopes, x, u, t, dispersed.nominal[:, None])
        advance(1)
        count = len(dispersed.names)
        affine = np.ones(0, dtype=bool)
        changes = np.zeros((0, *middle.a.shape[:2], t.size))
        largest, ends = np.zeros(0), np.zeros(0)
        if count:
            affine, changes = self._changes(slopes, x, u, t)
            advance(1)
            grid = _grid(reference, spec.follow)
            largest = largest_accelerations(slopes, course, grid, dispersed)
            ends = end_deviations(
                slopes, self.rows, course, grid, self._command(course, grid), dispersed
            )
            advance(1)
        covariance = self._covariance(middle.acceleration, u)
        samples = self._samples(affine, ctx)
        systems, labels, values = self._models(slopes, x, u, t, samples, covariance)
        states = tuple(self.rows.names[i] for i in self.rows.moving)
        (flight,) = (label for label in reference.flights.labels if spec.follow in ("", label))
        return LinearisedFlight(
            systems=systems,
            labels=labels,
            parameters=("point", *dispersed.names),
            units=("-", *dispersed.units),
            values=values,
            nominal=np.concatenate([[1.0], dispersed.nominal]),
            controls=slopes.controls,
            measurements=len(states),
            weights=(),
            flight=flight,
            frame=self.plant.frame,
            t_s=t,
            states=states,
            rates=tuple(self.rows.names[i] for i in self.rows.velocities),
            commands=tuple(v.name for v in self.plant.controls),
            x=x[self.rows.moving],
            u=u,
            sigma=dispersed.sigma,
            affine=affine,
            acceleration_slopes=middle.acceleration,
            acceleration_covariance=covariance,
            jacobian_share=jacobian_shares(middle.a, changes) if count else np.zeros((0, t.size)),
            largest_acceleration=largest,
            end_deviation_m=ends,
            fit_weight=fit_weights(changes) if count else np.zeros(0),
        )

    def present(self, product: LinearisedFlight, reference: FlightSet) -> Presentation:
        """Show poles and unknown accelerations along the trajectory, and effects of parameters."""
        return present_linearisation(product)

    def _times(self, course: Course) -> Array:
        """Return the times of the points since the trajectory's start."""
        length, spec = course.length_s, self.spec
        if not spec.times_s:
            return np.arange(1, spec.points + 1) * length / spec.points
        times = np.array(spec.times_s)
        if times.max() > length:
            raise InputError(
                f"times_s: {times.max():.6g} s is beyond the trajectory's end at {length:.6g} s"
            )
        return times

    def _command(self, course: Course, t: Array) -> Array:
        command = course.command(t)
        return np.zeros((len(self.plant.controls), t.size)) if command is None else command

    def _changes(
        self, slopes: Slopes, x: Array, u: Array, t: Array
    ) -> tuple[NDArray[np.bool_], Array]:
        """Return which parameters enter A affinely, and the changes of A by one σ of each."""
        d = self.dispersed
        count = len(d.names)
        nominal = np.repeat(d.nominal[:, None], count, axis=1)
        versions = []
        for ends in (0.5 * (d.lower + d.upper), d.upper, d.lower):
            values = nominal.copy()
            np.fill_diagonal(values, ends)
            versions.append(_evaluate_derivatives(slopes, x, u, t, values).a)
        parts = [np.moveaxis(one.reshape(*one.shape[:2], count, t.size), 2, 0) for one in versions]
        middle, up, down = parts
        per_sigma = d.sigma / (d.upper - d.lower)
        return find_affine(middle, up, down), (up - down) * per_sigma[:, None, None, None]

    def _covariance(self, acceleration: Array, u: Array) -> Array:
        """Return the covariance (r, r, N) of the unknown acceleration."""
        made = np.einsum("iqN,qp,jpN->ijN", acceleration, self.dispersed.covariance, acceleration)
        if self.spec.command_error and len(u) == len(made):
            for i, row in enumerate(u):
                made[i, i] += (self.spec.command_error * row) ** 2
        return np.asarray(made)

    def _samples(self, affine: NDArray[np.bool_], ctx: Context) -> _Sampled:
        d, pairs = self.dispersed, self.spec.corners
        if not d.names:
            return _Sampled(np.zeros((0, 1)), ("nominal",))
        values = parameter_samples(d, pairs, ctx.rng("corners"))
        count = len(d.names)
        kept = np.concatenate([np.ones(count, dtype=bool), ~affine, np.ones(2 * pairs, dtype=bool)])
        names = [
            *(f"{name} up" for name in d.names),
            *(f"{name} down" for name in d.names),
            *(f"corner {k % pairs + 1}{' opposite' * (k >= pairs)}" for k in range(2 * pairs)),
        ]
        return _Sampled(
            np.concatenate([d.nominal[:, None], values[:, kept]], axis=1),
            ("nominal", *(name for name, there in zip(names, kept, strict=True) if there)),
        )

    def _models(
        self, slopes: Slopes, x: Array, u: Array, t: Array, samples: _Sampled, covariance: Array
    ) -> tuple[tuple[LtiSystem, ...], tuple[str, ...], Array]:
        """Return the models, point by point, their names and the values of their parameters."""
        derivatives = _evaluate_derivatives(slopes, x, u, t, samples.values)
        s, m, r = len(derivatives.a), slopes.controls, len(covariance)
        signals = _signals(self.rows, m, r if covariance.any() else 0)
        states = tuple(self.rows.names[i] for i in self.rows.moving)
        accelerated = [self.rows.moving.index(i) for i in self.rows.velocities]
        order = [self.rows.moving.index(i) for i in (*self.rows.positions, *self.rows.velocities)]
        systems: list[LtiSystem] = []
        labels: list[str] = []
        values: list[Array] = []
        for i in range(t.size):
            disturbed = np.zeros((s, r))
            disturbed[accelerated] = _root(covariance[:, :, i])
            for k, name in enumerate(samples.names):
                place = k * t.size + i
                b = [derivatives.b[:, :, place]]
                if covariance.any():
                    b.insert(0, disturbed)
                a, out = derivatives.a[:, :, place], np.eye(s)[order]
                through = np.zeros((s, len(signals[0])))
                systems.append(LtiSystem(a, np.hstack(b), out, through, None, *signals, states))
                labels.append(f"{name}, point {i + 1}")
                values.append(np.concatenate([[i + 1.0], samples.values[:, k]]))
        return tuple(systems), tuple(labels), np.array(values).T


def _evaluate_derivatives(slopes: Slopes, x: Array, u: Array, t: Array, p: Array) -> Derived:
    """Return the derivatives at N points for S values of the parameters (q, S): (..., S N)."""
    samples = p.shape[1]
    return slopes.at(
        np.tile(x, samples), np.tile(u, samples), np.repeat(p, t.size, axis=1), np.tile(t, samples)
    )


def _signals(rows: Rows, controls: int, disturbed: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of inputs and outputs."""
    inputs = [f"d[{k}]" for k in range(disturbed)] + [f"a[{k}]" for k in range(controls)]
    outputs = [f"r[{k}]" for k in range(len(rows.positions))]
    outputs += [f"v[{k}]" for k in range(len(rows.velocities))]
    return tuple(inputs), tuple(outputs)


def _root(covariance: Array) -> Array:
    """Return the symmetric root of a covariance: it moves smoothly from point to point."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)


def _grid(reference: FlightSet, follow: str) -> Array:
    """Return the trajectory's own times since its start."""
    flights = reference.flights
    lane = next(i for i, label in enumerate(flights.labels) if follow in ("", label))
    t = flights.t_s[:, lane]
    t = t[np.isfinite(t)]
    return np.asarray(t - t[0])
