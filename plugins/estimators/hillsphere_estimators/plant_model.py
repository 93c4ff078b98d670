"""An estimator's model of the world, made of a plant, a law and sensors."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from math import ceil
from typing import Self

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.engine.simulation.flow import velocity_rows
from hillsphere.errors import InputError
from hillsphere.interfaces.loop import ContinuousLaw
from hillsphere.interfaces.plant import Plant
from hillsphere.interfaces.sensing import Scene
from hillsphere.sensor_suite import SensorSuite
from hillsphere_estimators.plant_flow import PlantFlow

__all__ = ["PlantModel"]


class PlantModel:
    r"""An `hillsphere.interfaces.EstimationModel` of a plant and its sensors.

    Without a law, `control` is the control of the plant, held. With a continuous law it is the
    estimate and the reference that the law was given at the last sample, 2 q rows. The command then
    follows from that estimate and is the same for all sigma points of a case: the deviation of a
    point must not be controlled away. Two groups of p rows may follow: accelerations beside the
    command, which the law does not know, and relative errors of the thrust of each component.

    Random accelerations of the standard deviations σ are held over steps of dt and add

    .. math:: Q = \sum_k \Phi_k G_k \sigma^2 G_k^\mathsf{T} \Phi_k^\mathsf{T}, \quad
              G_k = \int_0^{dt} e^{A_k s} B\, ds \approx [dt^2/2;\; dt],

    with the Jacobian A_k of the motion without commands along the estimated flight, the input
    matrix B of the accelerations, and the transition matrix Φ_k from the end of the k-th step to
    the end of the interval.

    Parameters
    ----------
    plant : Plant
        Its equations, at nominal parameters.
    suite : SensorSuite or None
        Its sensors; None for a model with an `observe` of its own.
    law : ContinuousLaw, optional
        Law that commands it.
    noise : callable, optional
        t_s (N,) → σ (p, N), m/s², one row per velocity; none by default.
    step_s : float
        Longest step of the step map.
    noise_step_s : float
        dt, rounded so that whole steps divide an interval.
    method : {"rk6", "dop853"}
        Formula of the step map.

    Raises
    ------
    InputError
        If a step is not positive or the formula unknown; on first use, if the plant and the law do
        not fit.

    Notes
    -----
    Making a model is cheap: its equations are written and compiled when they are first used, and
    shared between models of equal equations.
    """

    def __init__(
        self,
        plant: Plant,
        suite: SensorSuite | None,
        *,
        law: ContinuousLaw | None = None,
        noise: Callable[[Array], Array] | None = None,
        step_s: float = 60.0,
        noise_step_s: float = 60.0,
        method: str = "rk6",
    ) -> None:
        if not (step_s > 0.0 and noise_step_s > 0.0):
            raise InputError(f"steps must be positive, got {step_s} and {noise_step_s} s")
        self.plant, self._suite, self.law = plant, suite, law
        self.step_s, self.noise_step_s, self.method = step_s, noise_step_s, method
        self._noise = noise
        self._scene: Scene = {}
        self._n, self._p = len(plant.states), len(plant.controls)
        self._velocities = velocity_rows(plant)
        self._flow = PlantFlow(plant, law, method)

    @property
    def suite(self) -> SensorSuite:
        """The sensors.

        Raises
        ------
        InputError
            If there are none.
        """
        if self._suite is None:
            raise InputError(f"a {type(self).__name__} without a suite has no sensors")
        return self._suite

    def within(self, scene: Scene) -> Self:
        """Return the same model with another scene of the sensors, arrays (…, N) or (…, 1)."""
        made = copy(self)
        made._scene = dict(scene)
        return made

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states (n, K) later; see `hillsphere.interfaces.EstimationModel`."""
        duration = t1_s - t0_s
        steps = max(1, ceil(float(np.max(np.abs(duration), initial=0.0)) / self.step_s - 1e-9))
        y, p = self._system_inputs(x, control)
        return self._flow.end(y, duration, steps, p, t0_s)[: self._n]

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots (N, n, r) of Q; see `hillsphere.interfaces.EstimationModel`."""
        n, cases = x.shape
        duration = t1_s - t0_s
        noise = self._noise
        if noise is None or not duration.any():
            return np.zeros((cases, n, 1))
        # the number of steps of a case must not depend on the durations of the others
        steps = np.maximum(1, np.rint(np.abs(duration) / self.noise_step_s)).astype(int)
        first = int(steps[0])
        if (steps == first).all():
            return self._noise_roots(noise, x, t0_s, duration / first, first, control)
        roots = np.zeros((cases, n, n))
        for count in np.unique(steps).tolist():
            own = np.flatnonzero(steps == count)
            own_roots = self._noise_roots(
                noise, x[:, own], t0_s[own], duration[own] / count, count, control[:, own]
            )
            roots[own, :, : own_roots.shape[2]] = own_roots
        return roots

    def _noise_roots(
        self,
        noise: Callable[[Array], Array],
        x: Array,
        t0_s: Array,
        dt: Array,
        steps: int,
        control: Array,
    ) -> Array:
        """Return the roots of Q of `steps` random accelerations, each held for dt.

        Parameters
        ----------
        noise : callable
            t_s (N,) → σ (p, N).
        x : ndarray, shape (n, N)
            States at the start.
        t0_s, dt : ndarray, shape (N,)
            Start, and length of a step, s.
        steps : int
            Number of steps.
        control : ndarray, shape (r, N)
            As of `advance`.

        Returns
        -------
        ndarray, shape (N, n, r)
            With r = p columns for one step, else r = n.
        """
        n, cases = x.shape
        middles = self._middles(x, t0_s, dt, steps, control)
        turned = np.array([t0_s + (k + 0.5) * dt for k in range(steps)]).reshape(-1)
        slopes = self._flow.slopes.both(middles, None, turned)[1].reshape(n, n, steps, cases)
        turns = np.empty((steps, cases, n, n))
        np.multiply(slopes.transpose(2, 3, 0, 1), dt[:, None, None], out=turns)
        enters = self._velocities
        one = np.eye(n)
        phi: Array | None = None
        roots = []
        for k in range(steps - 1, -1, -1):
            # G/dt = ∫ e^{A s} ds B / dt = (1 + A dt/2 + A² dt²/6) B, to second order in A dt
            first = turns[k].take(enters, axis=2)
            held = turns[k] @ first / 6.0
            held += 0.5 * first
            held[:, enters, np.arange(len(enters))] += 1.0
            held *= (dt * noise(t0_s + k * dt)).T[:, None, :]
            roots.append(held if phi is None else phi @ held)
            if k:
                # transition over one step, e^{A dt} to second order
                across = one + turns[k] + 0.5 * turns[k] @ turns[k]
                phi = across if phi is None else phi @ across
        if steps == 1:
            return np.asarray(roots[0])
        # p columns for each step: a QR decomposition leaves n, with the same product
        rows = np.swapaxes(np.concatenate(roots, axis=2), 1, 2)
        return np.asarray(np.swapaxes(np.linalg.qr(rows, mode="r"), 1, 2))

    def _middles(self, x: Array, t0_s: Array, dt: Array, steps: int, control: Array) -> Array:
        """Return the estimated states (n, steps · N) in the middle of each step of the noise."""
        if steps == 1:
            # half an Euler step of free motion: its error, dt²/8 times the acceleration's
            # derivative, changes the Jacobian by a second-order term
            return np.asarray(x + 0.5 * dt * self._flow.slopes.rate(x, None, t0_s))
        inner = max(1, ceil(float(np.max(np.abs(dt))) / self.step_s - 1e-9))
        y, p = self._system_inputs(x, control)
        path = self._flow.steps.trajectory(y, dt * steps, steps * inner, p, t0_s)
        path = path[: self._n, ::inner]
        return np.asarray(0.5 * (path[:, :-1] + path[:, 1:])).reshape(self._n, -1)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return perfect measurements; see `hillsphere.interfaces.EstimationModel`."""
        return self.suite.observe(x, t_s, self._scene_of(case))

    def observe_turned(self, x: Array, t_s: Array, case: Integers, turns: Array) -> Array:
        """Return perfect measurements (m, K) with the attitudes of S spacecraft.

        Parameters
        ----------
        x, t_s, case
            As of `observe`.
        turns : ndarray, shape (3 S, K)
            Rotation vectors from the commanded attitudes, rad, see
            `hillsphere_sensors.spacecraft.SpacecraftSensor`.
        """
        attitude = turns.reshape(-1, 3, turns.shape[1])
        return self.suite.observe(x, t_s, self._scene_of(case) | {"attitude": attitude})

    def _scene_of(self, case: Integers) -> dict[str, Array]:
        """Return the scene of columns of these cases (K,)."""
        # mode "clip" leaves out the check of the index, which takes as long as the rest
        return {
            name: value if value.shape[-1] == 1 else value.take(case, axis=-1, mode="clip")
            for name, value in self._scene.items()
        }

    def _system_inputs(self, x: Array, control: Array) -> tuple[Array, Array]:
        """Return states and run-time parameters of the compiled system, plant or closed loop."""
        cases = x.shape[1]
        law = self.law
        if law is None:
            if len(control) not in (0, self._p):
                raise InputError(f"control must have {self._p} rows or none, got {len(control)}")
            return x, control if len(control) else np.zeros((self._p, cases))
        q = law.inputs
        told, p = 2 * q, self._p
        if len(control) not in (told, told + p, told + 2 * p):
            raise InputError(
                f"control must hold the law's estimate and reference, {told} rows, and may hold "
                f"{p} or {2 * p} more, got {len(control)}"
            )
        y = np.concatenate([x, law.initial(cases), np.zeros((1, cases))])
        seen, goal = control[:q], control[q:told]
        more = np.zeros((2 * p, cases))
        more[: len(control) - told] = control[told:]
        gain = np.zeros((p, p, cases))
        gain[np.arange(p), np.arange(p)] = 1.0 + more[p:]
        held = [goal, seen] if law.measurement == "held" else [goal]
        return y, np.concatenate([more[:p], gain.reshape(p * p, cases), *held])
