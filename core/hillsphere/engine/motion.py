"""The motion of a plant in SI units, for scripts and notebooks."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.step_map import StepMap
from hillsphere.engine.dynamics.system import System, system
from hillsphere.engine.dynamics.taylor import Taylor
from hillsphere.engine.dynamics.variational import Derivatives
from hillsphere.interfaces.plant import Plant

if TYPE_CHECKING:
    import pandas

    from hillsphere.base.time import Epoch

__all__ = ["Event", "Motion", "Trajectory"]

_TOLERANCE = 1e-12
"""Error of a flight by steps of equal length, in units of the plant's scales: a thousand times the
rounding, so that it is always reached."""
_SAMPLES = 200
"""Times of a trajectory for which only a duration is given: a smooth curve on a page."""


@dataclass(frozen=True)
class Event:
    """A crossing of an event.

    Parameters
    ----------
    name : str
        Name of the event, as the plant calls it.
    t_s : float
        Time, s.
    x : ndarray, shape (n,)
        State then, SI.
    """

    name: str
    t_s: float
    x: Array = field(repr=False)


@dataclass(frozen=True, repr=False)
class Trajectory:
    """States of a flight at given times.

    Parameters
    ----------
    t_s : ndarray, shape (K,)
        Times, s.
    x : ndarray, shape (n, K)
        States, SI: positions in m, velocities in m/s, then others.
    names : tuple of str
        Names of the n states.
    frame : str
        Frame of the states.
    """

    t_s: Array
    x: Array
    names: tuple[str, ...]
    frame: str

    def __len__(self) -> int:
        """Return the number of times."""
        return len(self.t_s)

    def __getitem__(self, key: int | slice | str) -> Any:
        """Return a state (n,), a part of the trajectory, or the values (K,) of a state by name."""
        if isinstance(key, str):
            if key not in self.names:
                raise InputError(f"no state {key!r}; there are: {', '.join(self.names)}")
            return self.x[self.names.index(key)]
        if isinstance(key, slice):
            return Trajectory(self.t_s[key], self.x[:, key], self.names, self.frame)
        return self.x[:, key]

    def __iter__(self) -> Iterator[Array]:
        """Return the states in order."""
        return iter(self.x.T)

    def __repr__(self) -> str:
        if not len(self):
            return f"<Trajectory: no state, frame {self.frame!r}>"
        return (
            f"<Trajectory: {len(self)} states from {self.t_s[0]:g} s to {self.t_s[-1]:g} s, "
            f"frame {self.frame!r}>"
        )

    def to_pandas(self) -> pandas.DataFrame:
        """Return the states as a data frame with a row per time.

        Returns
        -------
        pandas.DataFrame
            Index ``t_s``; columns are the states, SI.

        Raises
        ------
        ImportError
            If pandas is not installed; the extra ``notebook`` brings it.
        """
        import pandas

        index = pandas.Index(self.t_s, name="t_s")
        return pandas.DataFrame(self.x.T, index=index, columns=list(self.names))

    def plot(self, renderer: Any = "plotly") -> Any:
        """Return the path in space as a figure, km.

        Parameters
        ----------
        renderer : {"plotly", "matplotlib"}
            Library of the figure.

        Returns
        -------
        plotly.graph_objects.Figure or matplotlib.figure.Figure
            The drawn figure.
        """
        from hillsphere.show.charts import Axis, Chart, Space
        from hillsphere.show.plotting import plot
        from hillsphere.show.solids import Path

        path = Path(self.x[:3] / 1e3, times=self.t_s / 3600.0)
        scene = Space([path], time=Axis("time", "h"))
        return plot(Chart("Trajectory", [scene], f"Path in the frame {self.frame!r}."), renderer)

    def write_oem(
        self,
        path: str | os.PathLike[str],
        *,
        epoch: Epoch | str | None = None,
        plant: Plant | None = None,
        centre: str | None = None,
        name: str = "TRAJECTORY",
        object_id: str = "0000-000A",
    ) -> None:
        """Write the flight as a CCSDS Orbit Ephemeris Message.

        Parameters
        ----------
        path : str or path
            The file.
        epoch : Epoch or str
            Instant from which times count; a text is a date and time in TDB.
        plant : Plant, optional
            Equations of motion; needed for states in the rotating frame of a moon, which are
            written in the ICRF.
        centre : str, optional
            Name of the body at the origin of what is written: the moon, or its primary. By default
            the origin of the states.
        name, object_id : str
            Name and identifier of the object.

        Raises
        ------
        InputError
            If an argument is missing that the message needs, or contradicts the states (it is
            named).
        """
        from hillsphere.products.flight_files import Coast, write_coasts

        write_coasts(
            path, [Coast("", self.t_s, self.x)], frame=self.frame, states=self.names, name=name,
            epoch=epoch, plant=plant, centre=centre, object_id=object_id,
        )  # fmt: skip


class Motion:
    """Propagation, derivatives and events of a plant, SI.

    Parameters
    ----------
    plant : Plant
        The equations of motion.
    parameters : mapping, optional
        Values of run-time parameters by name, SI; by default nominal.

    Raises
    ------
    InputError
        If the plant has no such parameter.

    Notes
    -----
    States are (n,), or (n, N) for N flights at once; results then have the axis of flights last.
    Plants whose equations are expressions are propagated by adaptive Taylor series with an error
    of the size of rounding; those with gravity given as a function of arrays by steps of equal
    length, with an error of 1e-12 in units of the plant's scales.
    """

    def __init__(self, plant: Plant, parameters: Mapping[str, float] | None = None) -> None:
        self.plant = plant
        nominal = {q.name: q.value for q in plant.parameters()}
        given = dict(parameters or {})
        if unknown := sorted({*given} - {*nominal}):
            raise InputError(f"no parameter {unknown[0]!r}; the plant has: {', '.join(nominal)}")
        names = tuple(given)
        self._system: System = system(plant, run_time=names, normalised=True)
        self._p = np.array([given[name] for name in names])

    def __repr__(self) -> str:
        return f"<Motion of {type(self.plant).__name__}: {', '.join(self.states)}>"

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(v.name for v in self._system.states)

    @property
    def events(self) -> tuple[str, ...]:
        """Names of the events that the plant knows."""
        return tuple(self._system.events)

    def derivative(self, x: ArrayLike, t_s: float = 0.0) -> Array:
        """Return dx/dt.

        Parameters
        ----------
        x : array_like, shape (n,) or (n, N)
            States, SI.
        t_s : float
            Time, s.

        Returns
        -------
        ndarray, shape (n,) or (n, N)
            SI.
        """
        y, back = self._scaled(x)
        rate = self._derivatives.rate(y, self._p, t_s / self._time)
        return back(rate * self._unit[:, None] / self._time)

    def jacobian(self, x: ArrayLike, t_s: float = 0.0) -> Array:
        """Return the exact ∂(dx/dt)/∂x.

        Parameters
        ----------
        x : array_like, shape (n,) or (n, N)
            States, SI.
        t_s : float
            Time, s.

        Returns
        -------
        ndarray, shape (n, n) or (n, n, N)
            SI.
        """
        y, back = self._scaled(x)
        matrix = self._derivatives.both(y, self._p, t_s / self._time)[1]
        return back(matrix * self._ratio[:, :, None] / self._time)

    def propagate(
        self, x: ArrayLike, duration_s: float, *, times_s: ArrayLike | int | None = None,
        t_s: float = 0.0,
    ) -> Trajectory:  # fmt: skip
        """Fly from a state.

        Parameters
        ----------
        x : array_like, shape (n,)
            State at the start, SI.
        duration_s : float
            Duration, s; negative backwards.
        times_s : array_like of shape (K,), or int, optional
            Times after the start, s, or their number; by default 200 equally spaced ones.
        t_s : float
            Time at the start, s.

        Returns
        -------
        Trajectory
            Events do not end the flight.

        Raises
        ------
        InputError
            If the state or the times are not valid.
        PropagationError
            If the state becomes non-finite.
        """
        y, _ = self._scaled(x)
        if y.shape[1] != 1:
            raise InputError("propagate takes one state; use stm or end for many")
        if times_s is None or isinstance(times_s, int):
            number = _SAMPLES if times_s is None else times_s
            if number < 1:
                raise InputError(f"the number of times must be at least 1, got {number}")
            after = np.linspace(0.0, duration_s, number) if number > 1 else np.array([duration_s])
        else:
            after = np.asarray(times_s, dtype=float).reshape(-1)
            outside = (after * np.sign(duration_s) < 0) | (abs(after) > abs(duration_s))
            if outside.any():
                raise InputError(f"time {after[outside][0]:g} s is not within the flight")
        t = t_s + after
        states = self._sample(y[:, 0], t_s / self._time, t / self._time)
        return Trajectory(t, states * self._unit[:, None], self.states, self._system.frame)

    def end(self, x: ArrayLike, duration_s: ArrayLike, t_s: float = 0.0) -> Array:
        """Return the states at the end of flights.

        Parameters
        ----------
        x : array_like, shape (n,) or (n, N)
            States at the start, SI.
        duration_s : array_like, shape () or (N,)
            Durations, s.
        t_s : float
            Time at the start, s.

        Returns
        -------
        ndarray, shape (n,) or (n, N)
            SI.

        Raises
        ------
        PropagationError
            If a state becomes non-finite.
        """
        y, back = self._scaled(x)
        time, start = np.asarray(duration_s, dtype=float) / self._time, t_s / self._time
        if self._system.external is None:
            ended = self._taylor.propagate(y, time, self._p, start)
        else:
            steps = self._steps.choose_steps(y, time, _TOLERANCE, self._p, start)
            ended = self._steps.propagate(y, time, 2 * steps, self._p, start)
        return back(ended * self._unit[:, None])

    def stm(self, x: ArrayLike, duration_s: ArrayLike, t_s: float = 0.0) -> tuple[Array, Array]:
        """Return the states at the end of flights and their state transition matrices.

        Parameters
        ----------
        x, duration_s, t_s
            As for `end`.

        Returns
        -------
        x : ndarray, shape (n,) or (n, N)
            States at the end, SI.
        phi : ndarray, shape (n, n) or (n, n, N)
            ∂x(end)/∂x(start), SI.

        Raises
        ------
        PropagationError
            If a state becomes non-finite.
        """
        y, back = self._scaled(x)
        time, start = np.asarray(duration_s, dtype=float) / self._time, t_s / self._time
        flow = self._steps_with_stm
        steps = flow.choose_steps(y, time, _TOLERANCE, self._p, start)
        ended, phi = flow.propagate(y, time, 2 * steps, self._p, start)
        return back(ended * self._unit[:, None]), back(phi * self._ratio[:, :, None])

    def crossings(
        self, x: ArrayLike, duration_s: float, events: Sequence[str] = (), t_s: float = 0.0
    ) -> list[Event]:
        """Return the crossings of events along a flight.

        Parameters
        ----------
        x : array_like, shape (n,)
            State at the start, SI.
        duration_s : float
            Duration, s.
        events : sequence of str
            Names of events of the plant; by default all.
        t_s : float
            Time at the start, s.

        Returns
        -------
        list of Event
            Every change of sign, in the order of flight; none of them ends it.

        Raises
        ------
        InputError
            If the plant has no such event, or its equations or events are not expressions.
        """
        names = tuple(events) or self.events
        y, _ = self._scaled(x)
        flown = Taylor(self._system, record=names).fly(
            y[:, 0], duration_s / self._time, self._p, t_s / self._time
        )
        found = [
            Event(name, float(time * self._time), state * self._unit)
            for name, (pair,) in flown.crossings.items()
            for time, state in zip(pair[0], pair[1].T, strict=True)
        ]
        return sorted(found, key=lambda event: event.t_s, reverse=duration_s < 0)

    @cached_property
    def _derivatives(self) -> Derivatives:
        return Derivatives(self._system)

    @cached_property
    def _taylor(self) -> Taylor:
        return Taylor(self._system)

    @cached_property
    def _steps(self) -> StepMap:
        return StepMap(self._system)

    @cached_property
    def _steps_with_stm(self) -> StepMap:
        return StepMap(self._system, stm=True)

    @property
    def _unit(self) -> Array:
        return self._system.unit

    @property
    def _time(self) -> float:
        return self._system.time_unit_s

    @property
    def _ratio(self) -> Array:
        return self._unit[:, None] / self._unit[None, :]

    def _sample(self, y: Array, start: float, times: Array) -> Array:
        """Return the states (n, K) at times on the system's clock."""
        if self._system.external is None:
            sampled: Array = self._taylor.sample(y, times, self._p, start)
            return sampled
        states, now = [], start
        for time in times:
            if time != now:
                steps = self._steps.choose_steps(y, time - now, _TOLERANCE, self._p, now)
                y, now = self._steps.propagate(y, time - now, 2 * steps, self._p, now), time
            states.append(y)
        return np.array(states).T

    def _scaled(self, x: ArrayLike) -> tuple[Array, Callable[[Array], Array]]:
        """Return states (n, N) in the system's units, and the function that drops a single axis."""
        given = np.asarray(x, dtype=float)
        n = len(self._unit)
        if given.ndim not in (1, 2) or given.shape[0] != n:
            raise InputError(f"states must be ({n},) or ({n}, N), got {given.shape}")
        if not np.isfinite(given).all():
            raise InputError("states must be finite")
        single = given.ndim == 1
        y = (given[:, None] if single else given) / self._unit[:, None]
        return y, _drop_lane if single else _keep_lanes


def _drop_lane(values: Array) -> Array:
    return values[..., 0]


def _keep_lanes(values: Array) -> Array:
    return values
