"""The true world of a navigation: random accelerations, and sensors with faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.seeds import draws
from hillsphere.estimation import MeasurementSet
from hillsphere.interfaces import Array, Integers, Plant, Scene, Variable
from hillsphere.sensor_suite import SensorSuite
from hillsphere.simulation import CommandSteps, ContinuousLaw, JointLaw
from hillsphere.symbolic import Expr

__all__ = ["FaultySensors", "NoControl", "PerturbedReference", "ResampledLaw"]


class ResampledLaw:
    """A continuous law that is given an estimate at the interval of the measurements.

    Parameters
    ----------
    law : ContinuousLaw
        Its equations do not depend on the interval.
    interval_s : float
        Time between samples.
    """

    def __init__(self, law: ContinuousLaw, interval_s: float) -> None:
        self.equations, self.period_s = law, interval_s
        self.measurement: Literal["held", "continuous"] = law.measurement
        self.inputs, self.states = law.inputs, law.states

    def initial(self, n_cases: int) -> Array:
        """Return the initial states of the law."""
        return self.equations.initial(n_cases)

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        """Return its states after a sample."""
        return self.equations.sample(k, t_s, y, ref, xc)

    def derivative(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return the rates of its states."""
        return self.equations.derivative(xc, y, ref, t)

    def control(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return the command."""
        return self.equations.control(xc, y, ref, t)

    def rates_and_command(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[tuple[Expr, ...], tuple[Expr, ...]]:
        """Return both; see `hillsphere.simulation.JointLaw`."""
        law = self.equations
        if isinstance(law, JointLaw):
            return law.rates_and_command(xc, y, ref, t)
        return law.derivative(xc, y, ref, t), law.control(xc, y, ref, t)


@dataclass(frozen=True)
class NoControl:
    """A law without commands.

    Parameters
    ----------
    period_s : float
        Time between samples.
    controls : tuple of Variable
        Controls of the plant.
    """

    period_s: float
    controls: tuple[Variable, ...]
    actuation: Literal["hold", "impulse"] = "hold"

    def initial(self, n_cases: int) -> Array:
        """Return no states."""
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return commands of zero."""
        return np.zeros((len(self.controls), y.shape[1])), xc


class PerturbedReference:
    """A reference together with random accelerations that are held over steps.

    The accelerations enter as a feedforward command, which neither the law nor the filter knows.
    The random numbers of a case depend on its number of draws and on the step since the start, not
    on the interval between samples: flights with different intervals have the same accelerations.

    Parameters
    ----------
    table : ndarray, shape (q, K)
        Reference at the samples, SI.
    interval_s, step_s : float
        Time between samples, and time over which an acceleration is held, rounded so that whole
        steps divide the interval.
    begun_s : ndarray, shape (N,)
        Times of the plant at the start.
    sigma : callable, optional
        Times (N,) → standard deviations (p, N), m/s²; no accelerations by default.
    done : ndarray, shape (N,)
        Thrust as a part of the command. The accelerations are divided by it, since the thrust error
        does not apply to them.
    seed, stream, numbers
        Keys of the random numbers, as in `hillsphere.base.seeds.draws`; numbers (N,).
    """

    def __init__(
        self,
        table: Array,
        interval_s: float,
        step_s: float,
        begun_s: Array,
        sigma: Callable[[Array], Array] | None,
        done: Array,
        seed: int,
        stream: str,
        numbers: Integers,
    ) -> None:
        self._table, self._sigma, self._done = table, sigma, done
        self._interval, self._begun = interval_s, begun_s
        self._steps = max(1, round(interval_s / step_s))
        self._random: Array | None = None
        if sigma is not None:
            # the period after the last sample does not count: it has no accelerations
            total = (table.shape[1] - 1) * self._steps
            rows = len(sigma(begun_s[:1]))
            self._random = draws(seed, stream, numbers, "accelerations", (total, rows))

    @property
    def steps(self) -> int:
        """Number of accelerations in an interval."""
        return self._steps

    def at(self, k: int, t_s: Array, y: Array, cases: Integers) -> Array:
        """Return the reference (q, N)."""
        return np.repeat(self._table[:, k : k + 1], len(t_s), axis=1)

    def feedforward(self, k: int, t_s: Array, cases: Integers) -> CommandSteps | None:
        """Return the accelerations until the next sample, None without any."""
        count = self._steps
        if self._random is None or self._sigma is None or k >= self._table.shape[1] - 1:
            return None
        accelerations = self._random[k * count : (k + 1) * count].copy()
        begin = self._begun + k * self._interval
        for j in range(count):
            accelerations[j] *= self._sigma(begin + j * self._interval / count) / self._done
        return CommandSteps(np.full(count, 1.0 / count), accelerations)


class FaultySensors:
    """Sensors with dropouts, outliers and outages.

    Parameters
    ----------
    suite : SensorSuite
        The true sensors.
    dropouts, outliers : float
        Probabilities that a block is missing, or far off.
    outlier_sigmas : float
        Error of an outlier in each row, with either sign, in units of the noise.
    silent : sequence of (sensors, from, to)
        Outages: numbers of the sensors, and times since the start, s.
    from_s : float
        Time since the start before which there are no dropouts and outliers.
    """

    def __init__(
        self,
        suite: SensorSuite,
        dropouts: float,
        outliers: float,
        outlier_sigmas: float,
        silent: Sequence[tuple[Sequence[int], float, float]],
        from_s: float = 0.0,
    ) -> None:
        self.suite = suite
        self._missing, self._far = _threshold(dropouts), _threshold(outliers)
        self._size, self._silent, self._from = outlier_sigmas, tuple(silent), from_s
        rows = [sum(channel.rows for channel in block) for block in suite.blocks]
        self._block = np.repeat(np.arange(len(rows)), rows)

    @property
    def noise(self) -> int:
        """Normal numbers of each case and time."""
        return self.suite.draws[1] + 2 * len(self.suite.blocks) + self.suite.rows

    def heard(self, since_s: float) -> NDArray[np.bool_]:
        """Return which rows are not in an outage, (m,), at a time since the start."""
        there = np.ones(len(self._block), dtype=bool)
        for sensors, begin, end in self._silent:
            if begin <= since_s <= end:
                there &= ~np.isin(self._block, sensors)
        return there

    def measurements(
        self, x: Array, t_s: Array, since_s: float, scene: Scene, constant: Array, w: Array,
        sigma: Array,
    ) -> MeasurementSet:  # fmt: skip
        """Return the measurements of true states (n, N); `sigma` (m, N) is the stated noise.

        A missing block is NaN. The normal numbers `w` are, in this order, those of the sensors'
        noise, one per block for dropouts, one per block for outliers, and one per row for the sign
        of outliers.
        """
        own, count = self.suite.draws[1], len(self.suite.blocks)
        values = self.suite.measure(x, t_s, scene, constant, w[:own])
        missing, far = w[own : own + count], w[own + count : own + 2 * count]
        wild = w[own + 2 * count : own + 2 * count + self.suite.rows]
        begun = since_s >= self._from
        off = begun & (far < self._far)[self._block]
        values = values + np.where(off, self._size * sigma * np.where(wild < 0.0, -1.0, 1.0), 0.0)
        gone = begun & (missing < self._missing)[self._block] | ~self.heard(since_s)[:, None]
        values[gone] = np.nan
        return MeasurementSet.of(t_s, values, sigma, self.suite.blocks)


def noise_of(plant: Plant) -> Callable[[Array], Array] | None:
    """Return the standard deviations of a plant's random accelerations, None without any."""
    sigma: Callable[[Array], Array] | None = getattr(plant, "noise_sigma", None)
    return sigma


def scene_values(names: Mapping[str, Array], known: Sequence[str]) -> dict[str, Array]:
    """Return those parameters on which a plant's scene depends."""
    return {name: value for name, value in names.items() if name in known}


def _threshold(probability: float) -> float:
    """Return the number below which a normal one lies with this probability."""
    return NormalDist().inv_cdf(probability) if probability > 0.0 else -np.inf
