"""Checks of estimators: valid beliefs, independent cases, and the linear Kalman filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Channel, Estimator, Integers
from hillsphere.interfaces.beliefs import Belief, Innovation, MeasurementSet
from hillsphere.testing.contract import require

__all__ = ["check_estimator"]

_CASES, _STEPS = 6, 12
"""Cases and times of measurement. Two of the cases lack measurements (below); the others must not
depend on them."""
_SILENT, _PARTLY = 2, 4
"""Indices of two cases: one without any measurement, one that lacks a block."""
_PERIOD = 10.0
"""Time between measurements, s."""
_HEIGHT = 400.0
"""Distance of the sensor from the plane of motion, m, so that its direction always exists."""
_BLOCKS = (
    (Channel("bearing", "rad", "angle"), Channel("range", "m")),
    (Channel("direction", "", "direction"),),
)
_SIGMA = np.array([1e-3, 2.0, 2e-3, 2e-3, 2e-3])[:, None]
_NOTHING = np.zeros((0, _CASES))
_DIRECT = ((Channel("x", "m"), Channel("vy", "m/s")),)


def check_estimator(estimator: Estimator, *, tol: float = 1e-8) -> None:
    """Check an estimator on a target that moves past two sensors, in the plane.

    Parameters
    ----------
    estimator : Estimator
        The estimator.
    tol : float
        Largest difference, in standard deviations, between values that must agree.

    Raises
    ------
    ContractViolation
        Unless

        - beliefs keep their shapes and are finite, with triangular roots of full rank, and have
          the times asked for;
        - innovations have their shapes, and as many degrees of freedom as rows were used, an empty
          row of a direction not among them;
        - no argument is changed, and the same call gives the same bits;
        - each case depends on itself only;
        - a case without measurements does not change, whatever the rows that are not present hold;
        - measured angles may be a revolution off;
        - the uncertainty of speeds does not decrease in a prediction, and that of positions
          decreases by measurements;
        - on a linear problem it agrees with the Kalman filter, whether the errors of the
          measurements are independent or correlated;
        - over twelve measurements its errors stay within six standard deviations.
    """
    what = type(estimator).__name__
    require(isinstance(estimator, Estimator), f"{what} is no Estimator: it needs predict, update")
    kit = _Kit(what, estimator, tol)
    truth, start, sets = _scenario()
    beliefs, _ = kit.run(start, sets)
    for correlation in (0.0, 0.6):
        kit.check_linear(correlation)
    kit.check_lanes(start, sets, beliefs[-1])
    kit.check_turns(start, sets, beliefs[-1])
    kit.check_silence(start, sets)
    off = np.abs(beliefs[-1].x - truth[-1]) / beliefs[-1].sigma
    require(
        float(off.max()) < 6.0,
        f"{what}: after {_STEPS} measurements a state is {off.max():.1f} standard deviations off",
    )
    told = np.arange(_CASES) != _SILENT
    narrow = (beliefs[-1].sigma <= 1.001 * start.sigma)[:2, told]
    require(narrow.all(), f"{what}: positions are known no better after {_STEPS} measurements")


class _Drift:
    """A target in the plane with constant velocity and white acceleration noise."""

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        dt = t1_s - t0_s
        return np.concatenate([x[:2] + dt * x[2:], x[2:]])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        dt = t1_s - t0_s
        root = np.zeros((len(dt), 4, 4))
        for axis in range(2):
            root[:, axis, axis] = 0.01 * dt**1.5 / np.sqrt(3.0)
            root[:, 2 + axis, axis] = 0.01 * np.sqrt(0.75 * dt)
            root[:, 2 + axis, 2 + axis] = 0.01 * np.sqrt(0.25 * dt)
        return root

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        distance = np.sqrt(x[0] ** 2 + x[1] ** 2 + _HEIGHT**2)
        up = np.full(x.shape[1], _HEIGHT)
        return np.array([np.arctan2(x[1], x[0]), np.hypot(x[0], x[1]), *([*x[:2], up] / distance)])


class _Direct(_Drift):
    """The same target, with two of its states as measurements."""

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.ascontiguousarray(x[[0, 3]])


class _Kit:
    """An estimator whose results are checked for their form at each call."""

    def __init__(self, what: str, estimator: Estimator, tol: float) -> None:
        self.what, self._estimator, self._tol = what, estimator, tol

    def run(
        self, belief: Belief, sets: list[MeasurementSet], model: _Drift | None = None
    ) -> tuple[list[Belief], list[Innovation]]:
        """Return the beliefs after each set of measurements, and the innovations."""
        beliefs, brought = list[Belief](), list[Innovation]()
        model = model or _Drift()
        for measured in sets:
            if beliefs:
                belief = self._ahead(model, belief, measured.t_s)
            belief, innovation = self._updated(model, belief, measured)
            beliefs.append(belief)
            brought.append(innovation)
        return beliefs, brought

    def check_linear(self, correlation: float) -> None:
        """Compare with the Kalman filter on a linear problem with correlated errors."""
        model, random = _Direct(), np.random.default_rng(4)
        truth, belief, _ = _scenario()
        x, P = belief.x.T.copy(), belief.covariance
        F = np.eye(4) + _PERIOD * np.eye(4, k=2)
        H = np.eye(4)[[0, 3]]
        sigma = np.array([3.0, 0.1])
        R = np.outer(sigma, sigma) * np.array([[1.0, correlation], [correlation, 1.0]])
        mixed = np.linalg.cholesky(R)
        G = model.process_noise(belief.x, np.zeros(_CASES), np.full(_CASES, _PERIOD), _NOTHING)
        for k in range(_STEPS):
            z = H @ truth[k] + mixed @ random.normal(size=(2, _CASES))
            t_s = np.full(_CASES, k * _PERIOD)
            if k:
                belief = self._ahead(model, belief, t_s)
                x, P = x @ F.T, F @ P @ F.T + G @ np.swapaxes(G, 1, 2)
            stated = R[None] if correlation else sigma[:, None]
            measured = MeasurementSet.of(t_s, z, stated, _DIRECT)
            belief, innovation = self._updated(model, belief, measured)
            S = H @ P @ H.T + R
            gain = np.swapaxes(np.linalg.solve(S, H @ P), 1, 2)
            off = z.T - x @ H.T
            nis = np.einsum("ni,nij,nj->n", off, np.linalg.inv(S), off)
            x, P = x + np.einsum("nij,nj->ni", gain, off), P - gain @ S @ np.swapaxes(gain, 1, 2)
            self._close("the mean of a linear problem", belief.x, x.T, belief.sigma)
            size = belief.sigma.T[:, :, None] * belief.sigma.T[:, None]
            self._close("the covariance of a linear problem", belief.covariance, P, size)
            self._close("the NIS of a linear problem", innovation.nis, nis, 1.0 + nis)

    def check_lanes(self, start: Belief, sets: list[MeasurementSet], end: Belief) -> None:
        """Check that the result of a case does not depend on the order of cases."""
        order = np.random.default_rng(6).permutation(_CASES)
        moved = [m.of_cases(order) for m in sets]
        other = self.run(Belief(start.x[:, order], start.root[order], start.t_s[order]), moved)[0]
        self._close(
            "a case among other neighbours", other[-1].x, end.x[:, order], end.sigma[:, order]
        )

    def check_turns(self, start: Belief, sets: list[MeasurementSet], end: Belief) -> None:
        """Check that a measured angle shifted by 2π gives the same estimate."""
        turn = np.where(np.arange(5) == 0, 2.0 * np.pi, 0.0)[:, None]
        turned = [replace(m, values=m.values - turn) for m in sets]
        other = self.run(start, turned)[0][-1]
        self._close("a measured angle a revolution off", other.x, end.x, end.sigma)

    def check_silence(self, start: Belief, sets: list[MeasurementSet]) -> None:
        """Check that missing measurements, whatever their values, change nothing."""
        silent = replace(sets[0], present=np.zeros_like(sets[0].present))
        after, innovation = self._updated(_Drift(), start, silent)
        self._close("the mean after no measurement", after.x, start.x, start.sigma)
        size = start.sigma.T[:, :, None] * start.sigma.T[:, None]
        self._close("the covariance after no measurement", after.covariance, start.covariance, size)
        require(not innovation.nis.any(), f"{self.what}: no measurement has an innovation")
        strange = replace(
            sets[0],
            values=np.where(sets[0].present, sets[0].values, 1e9),
            sigma=np.where(sets[0].present, sets[0].sigma, np.nan),
        )
        one, other = (self._updated(_Drift(), start, m)[0] for m in (sets[0], strange))
        self._close("the mean, for what is not present", other.x, one.x, one.sigma)

    def _ahead(self, model: _Drift, belief: Belief, t_s: Array) -> Belief:
        arguments = (belief.x, belief.root, belief.t_s, t_s)
        before = [a.copy() for a in arguments]
        later, again = (self._estimator.predict(model, belief, t_s, _NOTHING) for _ in range(2))
        self._check_pure("predict", before, arguments, later, again)
        self._check_belief(later, t_s)
        grown = later.sigma[2:] >= belief.sigma[2:] * (1.0 - 1e-9)
        require(grown.all(), f"{self.what}: speeds are known better after a prediction with noise")
        return later

    def _updated(
        self, model: _Drift, belief: Belief, measured: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        what = self.what
        arguments = (belief.x, belief.root, belief.t_s,
                     measured.t_s, measured.values, measured.sigma, measured.present)  # fmt: skip
        before = [a.copy() for a in arguments]
        (after, innovation), (again, _) = (
            self._estimator.update(model, belief, measured) for _ in range(2)
        )
        self._check_pure("update", before, arguments, after, again)
        self._check_belief(after, measured.t_s)
        m, cases = measured.values.shape
        require(
            innovation.residual.shape == innovation.used.shape == (m, cases)
            and innovation.covariance.shape == (cases, m, m)
            and innovation.nis.shape == (cases,),
            f"{what}: an innovation must have residual and used {(m, cases)}, covariance "
            f"{(cases, m, m)} and nis {(cases,)}",
        )
        require(
            np.isfinite(innovation.residual).all() and np.isfinite(innovation.nis).all(),
            f"{what}: an innovation is not finite",
        )
        real = np.ones((m, 1), dtype=bool)
        if m == len(_SIGMA):
            real[-1] = False
        require(
            not (innovation.used & ~(measured.present & real)).any(),
            f"{what} says that it used rows that hold nothing: not measured, or the third of a "
            "direction, whose difference has two",
        )
        return after, innovation

    def _check_pure(
        self,
        name: str,
        before: Sequence[NDArray[Any]],
        arguments: Sequence[NDArray[Any]],
        one: Belief,
        other: Belief,
    ) -> None:
        for a, b in zip(before, arguments, strict=True):
            require(
                np.array_equal(a, b, equal_nan=True), f"{self.what}: {name} changes an argument"
            )
        require(
            np.array_equal(one.x, other.x) and np.array_equal(one.root, other.root),
            f"{self.what}: the same call of {name} differs",
        )

    def _check_belief(self, belief: Belief, t_s: Array) -> None:
        what, root = self.what, belief.root
        require(belief.x.shape == (4, _CASES), f"{what}: x must stay (4, {_CASES})")
        require(np.array_equal(belief.t_s, t_s), f"{what}: a belief is not at the time asked for")
        require(np.isfinite(belief.x).all() and np.isfinite(root).all(), f"{what}: not finite")
        require(np.array_equal(root, np.tril(root)), f"{what}: a root is not lower triangular")
        least = np.abs(np.diagonal(root, axis1=1, axis2=2)).min()
        require(least > 0.0, f"{what}: a covariance has lost its rank")

    def _close(self, of: str, got: Array, expected: Array, size: Array) -> None:
        worst = float(np.max(np.abs(got - expected) / size))
        require(
            worst <= self._tol,
            f"{self.what}: {of} is off by {worst:.1e} standard deviations, over {self._tol:.0e}",
        )


def _scenario() -> tuple[list[Array], Belief, list[MeasurementSet]]:
    """Return true states, the belief before the first measurement, and measurements."""
    random, model = np.random.default_rng(11), _Drift()
    x = np.array([[-900.0], [80.0], [12.0], [-4.0]]) + random.normal(size=(4, _CASES))
    sigma = np.array([20.0, 20.0, 0.5, 0.5])
    start = Belief.of(
        x + sigma[:, None] * random.normal(size=(4, _CASES)),
        np.repeat(np.diag(sigma**2)[None], _CASES, axis=0),
        np.zeros(_CASES),
    )
    truth, sets = list[Array](), list[MeasurementSet]()
    for k in range(_STEPS):
        t_s = np.full(_CASES, k * _PERIOD)
        if k:
            before = t_s - _PERIOD
            noise = model.process_noise(x, before, t_s, _NOTHING)
            x = model.advance(x, before, t_s, _NOTHING, np.arange(_CASES))
            x = x + np.einsum("nij,nj->in", noise, random.normal(size=(_CASES, 4)))
        shown = model.observe(x, t_s, np.arange(_CASES))
        shown += _SIGMA * random.normal(size=shown.shape)
        shown[2:] /= np.linalg.norm(shown[2:], axis=0)
        shown[:, _SILENT] = np.nan
        shown[:2, _PARTLY] = np.nan
        truth.append(x)
        sets.append(MeasurementSet.of(t_s, shown, _SIGMA, _BLOCKS))
    return truth, start, sets
