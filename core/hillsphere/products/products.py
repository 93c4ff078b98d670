"""Products, which stages pass to each other: frozen dataclasses of arrays, numbers and strings.

A product holds no compiled code and no live object, so that every product can be written to a
file and read back (`save_product`, `load_product`). A plugin may define its own product classes of
the same form.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.base.lti import LtiSystem
from hillsphere.products.fields import Label, Shape
from hillsphere.products.product_codec import load_product, save_product

__all__ = [
    "Bifurcations",
    "CaseList",
    "CaseTable",
    "ControlDesign",
    "FlightSet",
    "OrbitSet",
    "PeriodicOrbits",
    "Trajectories",
    "load_product",
    "save_product",
]


@dataclass(frozen=True)
class PeriodicOrbits:
    """Periodic orbits of one plant, members of one or more families."""

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
    command in `u`.
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


@dataclass(frozen=True)
class FlightSet:
    """Base of products with flights, for stages that write or analyse them.

    Parameters
    ----------
    flights : Trajectories
        The flights.
    """

    flights: Trajectories


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

    Parameters
    ----------
    names, units : tuple of str
        Of the q quantities.
    levels : tuple of float
        Of the l quantiles, ascending.
    time_s : ndarray, shape (K,)
        Times after the first sample of each case.
    values : ndarray, shape (l, q, K)
        The quantiles; NaN where no case has a value.
    count : ndarray of int, shape (q, K)
        Cases that have a finite value there.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    levels: tuple[float, ...]
    time_s: Array
    values: Array
    count: Integers


@dataclass(frozen=True)
class Lines:
    """Histories of the cases of a small campaign, one by one.

    Parameters
    ----------
    names, units : tuple of str
        Of the q quantities.
    case : ndarray of int, shape (N,)
        Numbers of the cases.
    time_s : ndarray, shape (K,)
        Times after the first sample of each case.
    values : ndarray, shape (q, K, N)
        Their values; NaN beyond the end of a case.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    case: Integers
    time_s: Array
    values: Array


@dataclass(frozen=True)
class LinesToEnds(Lines):
    """Histories of cases of which some end between two samples.

    Parameters
    ----------
    names, units, case, time_s, values
        As for `Lines`.
    end_s : ndarray, shape (N,)
        Time from the first sample to the end of a case that ends after its last sample; NaN if the
        last sample is the end.
    end_values : ndarray, shape (q, N)
        Values at `end_s`; NaN for quantities that exist at samples only.
    """

    end_s: Array
    end_values: Array


@dataclass(frozen=True)
class Ladder:
    """Swept points in groups, within each of which one quantity increases.

    Parameters
    ----------
    name, unit : str
        Name of this quantity, ``"σ of the worst case"``, and its unit; ``"-"`` for none.
    values : ndarray, shape (P,)
        Its values at the P points.
    groups : tuple of str
        Name of the group of each point.
    """

    name: str
    unit: str
    values: Array
    groups: tuple[str, ...]


@dataclass(frozen=True)
class CaseTable:
    """Results of a campaign: one row per case, stored by columns.

    Parameters
    ----------
    stage : str
        Name of the stage that was repeated.
    design : str
        Experimental design: ``"random"``, ``"latin_hypercube"``, ``"sobol"``,
        ``"sobol_indices"``, ``"grid"``, ``"list"``.
    planned : int
        Number of planned cases.
    stopped : str
        Reason for an early end; ``""`` if all planned cases were computed.
    case : ndarray of int, shape (N,)
        Number of each case, ascending.
    draw : ndarray of int, shape (N,)
        Number by which the random numbers of each case were drawn; cases with equal numbers have
        equal draws.
    point : ndarray of int, shape (N,)
        Index of the swept point of each case; 0 without a sweep.
    inputs, input_units : tuple of str
        Names and units of the k inputs that differed.
    input_values : ndarray, shape (k, N)
        Their values.
    metrics, units : tuple of str
        Names and units of the m metrics.
    values : ndarray, shape (m, N)
        Their values; NaN where a case has none.
    status, cause : ndarray of str, shape (N,)
        How each case ended, and the event or limit that ended it.
    failed : ndarray of bool, shape (N,)
        Whether the case failed; False for undecided cases, see `hillsphere.cases.case_classes`.
    message_case : ndarray of int, shape (F,)
        Numbers of the cases with a message.
    messages : tuple of str
        Their messages: class and text of the error.
    swept : tuple of str
        Names of the d quantities that a sweep changed; none for ``monte_carlo``.
    swept_units : tuple of str
        Their units; ``""`` for a quantity that is not a number.
    points : ndarray, shape (d, P)
        Their values at the P points. A quantity that is not a number is given by its index in the
        list of the mission.
    point_labels : tuple of str
        One name per point.
    bands : Bands or None
        Quantiles over time, if requested and any case has a history.
    ladder : Ladder or None
        Groups of the P points, if their list defines them.
    lines : Lines or None
        Histories of the single cases, if requested of a sweep.
    step_error : ndarray, shape (N,), or None
        Estimate of each case's step error, in the plant's natural units; NaN where a case has none,
        None if the stage gives none.
    warnings : tuple of str
        Warnings that concern all cases, from the nominal flight.
    """

    stage: str
    design: str
    planned: int
    stopped: str
    case: Integers
    draw: Integers
    point: Integers
    inputs: tuple[str, ...]
    input_units: tuple[str, ...]
    input_values: Array
    metrics: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    status: NDArray[np.str_]
    cause: NDArray[np.str_]
    failed: NDArray[np.bool_]
    message_case: Integers
    messages: tuple[str, ...]
    swept: tuple[str, ...] = ()
    swept_units: tuple[str, ...] = ()
    points: Array | None = None
    point_labels: tuple[str, ...] = ()
    bands: Bands | None = None
    ladder: Ladder | None = None
    lines: Lines | None = None
    step_error: Array | None = None
    warnings: tuple[str, ...] = ()

    @property
    def reproducible(self) -> bool:
        """Whether a repetition gives the same results: no case ran out of time or memory."""
        return not np.isin(self.status, ("killed", "time_limit", "memory")).any()


@dataclass(frozen=True)
class CaseList:
    """Points of a sweep, one per column.

    Parameters
    ----------
    names : tuple of str
        Quantities that are set: ``"stage.hover.state.x"``, ``"gravity.phobos.C2,0"``, or any key of
        the mission.
    units : tuple of str
        Their units, as the models write them (``"m/s"``), for a check; ``""`` skips it. Values of
        run-time inputs are SI, those of keys in the key's own unit.
    values : ndarray, shape (k, N)
        Values of the k quantities at the N points.
    labels : tuple of str
        One name per point; if empty, names are made from the values.
    ladder : Ladder or None
        Groups of points that differ in the size of one quantity only; for each group a sweep
        reports the size at which failures begin.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    labels: tuple[str, ...] = ()
    ladder: Ladder | None = None
