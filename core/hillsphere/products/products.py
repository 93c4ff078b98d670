"""Products, which stages pass to each other: frozen dataclasses of arrays, numbers and strings.

A product holds no compiled code and no live object, so that every product can be written to a
file and read back (`save_product`, `load_product`). A plugin may define its own product classes of
the same form.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.constants import HOUR_S
from hillsphere.base.errors import InputError
from hillsphere.base.lti import LtiSystem
from hillsphere.base.problems import did_you_mean
from hillsphere.products.fields import Label, Shape
from hillsphere.products.product_codec import load_product, save_product

if TYPE_CHECKING:
    from hillsphere.base.time import Epoch
    from hillsphere.interfaces.plant import Plant

__all__ = [
    "Bifurcations",
    "CaseList",
    "CaseTable",
    "ControlDesign",
    "FlightSet",
    "Flown",
    "OrbitSet",
    "PeriodicOrbits",
    "Trajectories",
    "load_product",
    "save_product",
]

_Place = int | np.integer | str
OrbitKey = _Place | slice | Sequence[int] | Sequence[str] | NDArray[np.integer | np.bool_]
"""What chooses orbits of a `PeriodicOrbits`."""


@dataclass(frozen=True, repr=False)
class PeriodicOrbits:
    """Periodic orbits of one plant, members of one or more families.

    ``orbits[3]``, ``orbits["QSO-H"]`` and ``orbits[2:5]`` are the chosen ones, as are a list of
    places or labels and a mask. ``"QSO-H" in orbits`` asks for a label, ``len(orbits)`` is the
    number of orbits; a product without orbits is false, as an empty list is. With the plant they
    are drawn (`plot`), flown (`fly`) and written (`write_oem`).
    """

    frame: str
    """Frame of the states, see `hillsphere.testing.frames`."""
    states: Annotated[tuple[str, ...], Shape("states")]
    """Names of the states."""
    x0: Annotated[Array, Shape("states", "orbits")]
    """State at the start of each orbit, SI."""
    period_s: Annotated[Array, Shape("orbits"), Label("period", 9, "h")]
    """Full period."""
    integral: Annotated[Array, Shape("orbits"), Label("Jacobi constant", 12)]
    """Conserved quantity in normalised units (NaN where the plant has none)."""
    monodromy: Annotated[Array, Shape("states", "states", "orbits")]
    """State transition matrix over one period, normalised units."""
    residual: Annotated[Array, Shape("orbits"), Label("closure", 2)]
    """Norm of x(T) − x(0), normalised units."""
    labels: Annotated[tuple[str, ...], Shape("orbits"), Label("orbit")]
    """One name per orbit."""
    length_m: float
    """Normalised unit of length."""
    time_s: float
    """Normalised unit of time."""

    def __len__(self) -> int:
        """Return the number of orbits."""
        return len(self.labels)

    def __getitem__(self, key: OrbitKey) -> PeriodicOrbits:
        """Return one orbit, by place or label, or a part of them.

        Parameters
        ----------
        key : int, str, slice, or sequence of int, str or bool
            Place from 0 or from the end (negative), label, part, places, labels, or a mask of one
            truth value for each orbit.

        Raises
        ------
        InputError
            If no orbit or more than one has the label, or the key is of another form.
        IndexError
            If there is no such place, or a mask is of another length.
        """
        chosen = self._places(key)
        return replace(
            self, x0=self.x0[:, chosen], period_s=self.period_s[chosen],
            integral=self.integral[chosen], monodromy=self.monodromy[:, :, chosen],
            residual=self.residual[chosen], labels=tuple(self.labels[k] for k in chosen),
        )  # fmt: skip

    def __contains__(self, label: object) -> bool:
        """Return whether an orbit has this label; `InputError` for anything but a label."""
        if not isinstance(label, str):
            raise InputError(
                f"orbits are looked for by label, a string, got an object of class "
                f"{type(label).__name__}"
            )
        return label in self.labels

    def __iter__(self) -> Iterator[PeriodicOrbits]:
        """Return the orbits one by one."""
        return (self[k] for k in range(len(self)))

    def _places(self, key: OrbitKey) -> NDArray[np.intp]:
        """Return the places that a key of `__getitem__` means, shape (K,)."""
        if isinstance(key, str):
            return np.array([self._place_of(key)], dtype=np.intp)
        everywhere = np.arange(len(self))
        if isinstance(key, slice):
            return everywhere[key]
        values = np.asarray(key)
        if values.dtype.kind == "U" and values.ndim == 1:
            return np.array([self._place_of(str(label)) for label in values], dtype=np.intp)
        if (
            values.shape == (0,) and values.dtype.kind == "f"
        ):  # numpy takes [] for numbers with a fraction
            return everywhere[:0]
        # A single truth value would be taken by numpy for an axis more.
        if values.ndim > 1 or values.dtype.kind not in ("iub" if values.ndim else "iu"):
            raise InputError(
                "orbits are chosen by place, label, slice, mask, or a list of places or labels, "
                f"got {str(key)[:60]!r}"
            )
        return np.atleast_1d(everywhere[values])

    def _place_of(self, label: str) -> int:
        count = self.labels.count(label)
        if count > 1:
            raise InputError(f"{count} orbits have the label {label!r}; choose one by its place")
        if not count:
            hint = did_you_mean(label, self.labels, otherwise="there are")
            raise InputError(f"no orbit {label!r}{hint}")
        return self.labels.index(label)

    def __repr__(self) -> str:
        if not len(self):
            return f"<PeriodicOrbits: none, frame {self.frame!r}>"
        least, most = self.period_s.min() / HOUR_S, self.period_s.max() / HOUR_S
        count = f"{len(self)} orbits" if len(self) > 1 else f"orbit {self.labels[0]!r}"
        periods = f"{least:.6g} h" + (f" to {most:.6g} h" if most > least else "")
        return f"<PeriodicOrbits: {count}, period {periods}, frame {self.frame!r}>"

    def fly(self, plant: Plant, *, revolutions: float = 1.0, points: int = 200) -> Trajectories:
        """Return the flights along the orbits, each from its start.

        Parameters
        ----------
        plant : Plant
            Equations of motion of the orbits.
        revolutions : float
            Length of the flights, in periods.
        points : int
            Number of equally spaced times, the first at the start and the last at the end.

        Returns
        -------
        Trajectories
            One plan per orbit, named by its label or else by its number.

        Raises
        ------
        InputError
            If the plant has another frame or other states, or there are fewer than two times.
        """
        from hillsphere.engine.motion import Motion

        motion = Motion(plant)
        if plant.frame != self.frame or motion.states != self.states:
            raise InputError(
                f"plant: it has the states {', '.join(motion.states)} in {plant.frame}, the orbits "
                f"have {', '.join(self.states)} in {self.frame}"
            )
        if points < 2 or not revolutions > 0.0:
            raise InputError(
                f"points must be 2 or more and revolutions positive, got {points}, {revolutions}"
            )
        names = tuple(label or f"orbit {k}" for k, label in enumerate(self.labels))
        lanes = zip(self.x0.T, revolutions * self.period_s, strict=True)
        flights = [motion.propagate(x0, end, times_s=points) for x0, end in lanes]
        return Trajectories(
            frame=self.frame,
            states=self.states,
            plans=names,
            labels=names,
            t_s=np.array([f.t_s for f in flights]).reshape(-1, points).T,
            x=np.array([f.x for f in flights])
            .reshape(-1, len(self.states), points)
            .transpose(1, 2, 0),
        )

    def plot(
        self, plant: Plant, renderer: Literal["plotly", "matplotlib"] = "plotly", points: int = 200
    ) -> Any:
        """Return one revolution of each orbit in space as a figure, km.

        Parameters
        ----------
        plant : Plant
            Equations of motion of the orbits.
        renderer : {"plotly", "matplotlib"}
            Library of the figure.
        points : int
            Points of each orbit.

        Returns
        -------
        plotly.graph_objects.Figure or matplotlib.figure.Figure
            The drawn figure.

        Raises
        ------
        InputError
            As `fly`; if there is no orbit or no such renderer.
        """
        return self.fly(plant, points=points).plot(renderer)

    def write_oem(
        self,
        path: str | os.PathLike[str],
        plant: Plant,
        *,
        epoch: Epoch | str | None = None,
        centre: str | None = None,
        revolutions: float = 1.0,
        points: int = 200,
        object_id: str = "0000-000A",
    ) -> None:
        """Write an orbit as a CCSDS Orbit Ephemeris Message.

        Parameters
        ----------
        path : str or path
            The file.
        plant : Plant
            Equations of motion of the orbit.
        epoch, centre, object_id
            As for `Trajectories.write_oem`.
        revolutions, points
            As for `fly`.

        Raises
        ------
        InputError
            As `fly` and `Trajectories.write_oem`.
        """
        flights = self.fly(plant, revolutions=revolutions, points=points)
        flights.write_oem(path, plant=plant, epoch=epoch, centre=centre, object_id=object_id)


@dataclass(frozen=True)
class OrbitSet:
    """Base of products with a set of periodic orbits.

    Products of orbit families derive from it, so that stages that analyse orbits accept the
    products of every family.

    Parameters
    ----------
    members : PeriodicOrbits
        The orbits.
    """

    members: PeriodicOrbits


@dataclass(frozen=True)
class Trajectories:
    """Coasts, that is flights without manoeuvres; a plan consists of one or several coasts.

    Flights with an open-loop command (a reference to be tracked) are stored likewise, with the
    command in `u`. ``flights[3]`` and ``flights[2:5]`` are the coasts at these places,
    ``flights["down"]`` is the plan of this name, ``len(flights)`` the number of coasts.
    """

    frame: str
    """Frame of the states, see `hillsphere.testing.frames`."""
    states: Annotated[tuple[str, ...], Shape("states")]
    """Names of the states."""
    plans: Annotated[tuple[str, ...], Shape("coasts")]
    """Name of the plan of each coast; the coasts of a plan are consecutive."""
    labels: Annotated[tuple[str, ...], Shape("coasts")]
    """Name of each coast."""
    t_s: Annotated[Array, Shape("times", "coasts")]
    """Times since the beginning of the plan, rising; NaN beyond a coast's end."""
    x: Annotated[Array, Shape("states", "times", "coasts")]
    """States, SI; NaN beyond a coast's end."""
    controls: Annotated[tuple[str, ...], Shape("controls")] = ()
    """Names of the controls; none for coasts."""
    u: Annotated[Array | None, Shape("controls", "times", "coasts")] = None
    """Command held from each time to the next, SI; the last one holds after the end."""

    def __len__(self) -> int:
        """Return the number of coasts."""
        return len(self.labels)

    def __getitem__(self, key: int | slice | str) -> Trajectories:
        """Return one coast by its place, a part of them, or the coasts of a plan by its name."""
        if isinstance(key, str):
            if key not in self.plans:
                names = list(dict.fromkeys(self.plans))
                raise InputError(
                    f"no plan {key!r}{did_you_mean(key, names, otherwise='there are')}"
                )
            chosen = np.flatnonzero([plan == key for plan in self.plans])
        else:
            chosen = np.atleast_1d(np.arange(len(self))[key])
        return replace(
            self, plans=tuple(self.plans[k] for k in chosen),
            labels=tuple(self.labels[k] for k in chosen), t_s=self.t_s[:, chosen],
            x=self.x[:, :, chosen], u=None if self.u is None else self.u[:, :, chosen],
        )  # fmt: skip

    def __iter__(self) -> Iterator[Trajectories]:
        """Return the coasts one by one."""
        return (self[k] for k in range(len(self)))

    def plot(self, renderer: Literal["plotly", "matplotlib"] = "plotly") -> Any:
        """Return the paths in space as a figure, km.

        Parameters
        ----------
        renderer : {"plotly", "matplotlib"}
            Library of the figure.

        Returns
        -------
        plotly.graph_objects.Figure or matplotlib.figure.Figure
            The drawn figure.

        Raises
        ------
        InputError
            If there is no coast or no such renderer.
        """
        from hillsphere.products.flight_figures import flights_chart
        from hillsphere.show.plotting import plot

        return plot(flights_chart(self.frame, self.labels, self.t_s, self.x), renderer)

    def write_oem(
        self,
        path: str | os.PathLike[str],
        *,
        epoch: Epoch | str | None = None,
        plant: Plant | None = None,
        centre: str | None = None,
        object_id: str = "0000-000A",
    ) -> None:
        """Write a plan as a CCSDS Orbit Ephemeris Message, a segment per coast.

        Parameters
        ----------
        path : str or path
            The file.
        epoch : Epoch or str
            Beginning of the plan; a text is a date and time in TDB.
        plant : Plant, optional
            Equations of motion; needed for states in the rotating frame of a moon, which are
            written in the ICRF.
        centre : str, optional
            Name of the body at the origin of what is written: the moon, or its primary. By default
            the origin of the states.
        object_id : str
            Identifier of the object.

        Raises
        ------
        InputError
            If there is not exactly one plan; if an argument is missing that the message needs, or
            contradicts the states (it is named).
        """
        from hillsphere.products.flight_files import Coast, write_coasts

        plans = list(dict.fromkeys(self.plans))
        if len(plans) != 1:
            raise InputError(
                f"a message holds one object, here are {len(plans)} plans"
                + (f": write one of them, such as flights[{plans[0]!r}]" if plans else "")
            )
        coasts = []
        for k, label in enumerate(self.labels):
            there = np.isfinite(self.t_s[:, k])
            coasts.append(Coast(label, self.t_s[there, k], self.x[:, there, k]))
        write_coasts(
            path, coasts, frame=self.frame, states=self.states, name=plans[0].upper(), epoch=epoch,
            plant=plant, centre=centre, object_id=object_id,
        )  # fmt: skip


class Flown(ABC):
    """Base of products with flights, which may be held by other fields, for stages that write them.

    A product that derives from it returns its flights by `to_trajectories`.
    """

    @abstractmethod
    def to_trajectories(self) -> Trajectories:
        """Return the flights, a coast between any two impulses."""


@dataclass(frozen=True)
class FlightSet(Flown):
    """Base of products with flights, for stages that write or analyse them.

    Parameters
    ----------
    flights : Trajectories
        The flights.
    """

    flights: Trajectories

    def to_trajectories(self) -> Trajectories:
        """Return `flights`."""
        return self.flights


@dataclass(frozen=True)
class ControlDesign:
    """Base of products with a controller, for stages that simulate or analyse it.

    Products of syntheses derive from it, so that a law accepts the controller of any of them.

    Parameters
    ----------
    controller : LtiSystem
        Controller from the law's input to its command, SI.
    others : tuple of LtiSystem
        Controllers of the other searches of the same synthesis, the best first. They show how far
        results depend on the search.
    """

    controller: LtiSystem
    others: tuple[LtiSystem, ...] = field(default=(), kw_only=True)

    def design(self, number: int) -> LtiSystem:
        """Return `controller` for the number 1, and one of `others` for each higher number.

        Raises
        ------
        InputError
            If there are fewer controllers.
        """
        if not 1 <= number <= 1 + len(self.others):
            raise InputError(
                f"there is no design {number}; the synthesis has {1 + len(self.others)}"
            )
        return (self.controller, *self.others)[number - 1]


@dataclass(frozen=True)
class Bifurcations:
    """Members of a family at which another family branches off."""

    orbits: PeriodicOrbits
    """The bifurcating members, labelled ``"vertical 1:17"`` and so on."""
    plane: Annotated[tuple[str, ...], Shape("bifurcations"), Label("plane")]
    """``"planar"`` or ``"vertical"``, per member."""
    d: Annotated[tuple[int, ...], Shape("bifurcations")]
    """The resonance is d:n, per member; the stability index is 2 cos(2π d/n)."""
    n: Annotated[tuple[int, ...], Shape("bifurcations")]
    """Revolutions of the orbits that branch off."""
    index: Annotated[Array, Shape("bifurcations"), Label("stability index", 10)]
    """Stability index at the member."""


@dataclass(frozen=True)
class Bands:
    """Quantiles over the cases of a campaign at each sample of their histories.

    Only completed cases count, as for metrics. A case counts up to its own end: at later samples
    the quantiles are those of the remaining cases.
    """

    names: Annotated[tuple[str, ...], Shape("quantities")]
    """Names of the quantities."""
    units: Annotated[tuple[str, ...], Shape("quantities")]
    """Their units."""
    levels: Annotated[tuple[float, ...], Shape("levels")]
    """Levels of the quantiles, ascending."""
    time_s: Annotated[Array, Shape("times")]
    """Times after the first sample of each case."""
    values: Annotated[Array, Shape("levels", "quantities", "times")]
    """The quantiles; NaN where no case has a value."""
    count: Annotated[Integers, Shape("quantities", "times")]
    """Cases that have a finite value there."""


@dataclass(frozen=True)
class Lines:
    """Histories of the cases of a small campaign, one by one."""

    names: Annotated[tuple[str, ...], Shape("quantities")]
    """Names of the quantities."""
    units: Annotated[tuple[str, ...], Shape("quantities")]
    """Their units."""
    case: Annotated[Integers, Shape("cases")]
    """Numbers of the cases."""
    time_s: Annotated[Array, Shape("times")]
    """Times after the first sample of each case."""
    values: Annotated[Array, Shape("quantities", "times", "cases")]
    """Values of the quantities; NaN beyond the end of a case."""


@dataclass(frozen=True)
class LinesToEnds(Lines):
    """Histories of cases of which some end between two samples."""

    end_s: Annotated[Array, Shape("cases")]
    """Time from the first sample to the end of a case that ends after its last sample; NaN if the
    last sample is the end."""
    end_values: Annotated[Array, Shape("quantities", "cases")]
    """Values at `end_s`; NaN for quantities that exist at samples only."""


@dataclass(frozen=True)
class Ladder:
    """Swept points in groups, within each of which one quantity increases."""

    name: str
    """Name of this quantity, ``"σ of the worst case"``."""
    unit: str
    """Its unit; ``"-"`` for none."""
    values: Annotated[Array, Shape("points")]
    """Its values at the points."""
    groups: Annotated[tuple[str, ...], Shape("points")]
    """Name of the group of each point."""


@dataclass(frozen=True)
class CaseTable:
    """Results of a campaign: one row per case, stored by columns.

    The columns of inputs and metrics of a large campaign stay in files of its run directory.
    `input_values` and `values` then give them one by one (`hillsphere.products.columns.Columns`),
    ``table.values[3]`` as an array; ``numpy.asarray(table.values)`` reads all of them.
    """

    stage: str
    """Name of the stage that was repeated."""
    design: str
    """Experimental design: ``"random"``, ``"latin_hypercube"``, ``"sobol"``, ``"sobol_indices"``,
    ``"grid"``, ``"list"``."""
    planned: int
    """Number of planned cases."""
    stopped: str
    """Reason for an early end; ``""`` if all planned cases were computed."""
    case: Annotated[Integers, Shape("cases")]
    """Number of each case, ascending."""
    draw: Annotated[Integers, Shape("cases")]
    """Number by which the random numbers of each case were drawn; cases with equal numbers have
    equal draws."""
    point: Annotated[Integers, Shape("cases")]
    """Index of the swept point of each case; 0 without a sweep."""
    inputs: Annotated[tuple[str, ...], Shape("inputs")]
    """Names of the inputs that differed."""
    input_units: Annotated[tuple[str, ...], Shape("inputs")]
    """Their units."""
    input_values: Annotated[Array, Shape("inputs", "cases")]
    """Their values."""
    metrics: Annotated[tuple[str, ...], Shape("metrics")]
    """Names of the metrics."""
    units: Annotated[tuple[str, ...], Shape("metrics")]
    """Their units."""
    values: Annotated[Array, Shape("metrics", "cases")]
    """Their values; NaN where a case has none."""
    status: Annotated[NDArray[np.str_], Shape("cases")]
    """How each case ended."""
    cause: Annotated[NDArray[np.str_], Shape("cases")]
    """Event or limit that ended each case."""
    failed: Annotated[NDArray[np.bool_], Shape("cases")]
    """Whether the case failed; False for undecided cases, see `hillsphere.cases.case_classes`."""
    message_case: Annotated[Integers, Shape("messages")]
    """Numbers of the cases with a message."""
    messages: Annotated[tuple[str, ...], Shape("messages")]
    """Their messages: class and text of the error."""
    swept: Annotated[tuple[str, ...], Shape("swept")] = ()
    """Names of the quantities that a sweep changed; none for ``monte_carlo``."""
    swept_units: Annotated[tuple[str, ...], Shape("swept")] = ()
    """Their units; ``""`` for a quantity that is not a number."""
    swept_labels: tuple[str, ...] = ()
    """What each is, in words, for axes and legends; ``""`` where nothing declares it. May be
    empty."""
    points: Annotated[Array | None, Shape("swept", "points")] = None
    """Their values at the points. A quantity that is not a number is given by its index in the list
    of the mission."""
    point_labels: Annotated[tuple[str, ...], Shape("points")] = ()
    """One name per point."""
    bands: Bands | None = None
    """Quantiles over time, if requested and any case has a history."""
    ladder: Ladder | None = None
    """Groups of the points, if their list defines them."""
    lines: Lines | None = None
    """Histories of the single cases, if requested of a sweep."""
    step_error: Annotated[Array | None, Shape("cases")] = None
    """Estimate of each case's step error, in the plant's natural units; NaN where a case has none,
    None if the stage gives none."""
    warnings: tuple[str, ...] = ()
    """Warnings that concern all cases, from the nominal flight."""

    @property
    def reproducible(self) -> bool:
        """Whether a repetition gives the same results: no case ran out of time or memory."""
        return not np.isin(self.status, ("killed", "time_limit", "memory")).any()


@dataclass(frozen=True)
class CaseList:
    """Points of a sweep, one per column."""

    names: Annotated[tuple[str, ...], Shape("quantities")]
    """Quantities that are set: ``"stage.hover.state.x"``, ``"gravity.phobos.C2,0"``, or any key of
    the mission."""
    units: Annotated[tuple[str, ...], Shape("quantities")]
    """Their units, as the models write them (``"m/s"``), for a check; ``""`` skips it. Values of
    run-time inputs are SI, those of keys in the key's own unit."""
    values: Annotated[Array, Shape("quantities", "points")]
    """Their values at the points."""
    labels: tuple[str, ...] = ()
    """One name per point; if empty, names are made from the values."""
    ladder: Ladder | None = None
    """Groups of points that differ in the size of one quantity only; for each group a sweep reports
    the size at which failures begin."""
