"""What passes between stages: frozen dataclasses of arrays, numbers and strings.

Nothing compiled and no live object stands in a product, so that every product can be written to a
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
    """A product with periodic orbits that were asked for.

    Products of families derive from it, so that any stage that judges orbits takes them, whatever
    the family and whoever wrote it.

    Parameters
    ----------
    members : PeriodicOrbits
        The orbits.
    """

    members: PeriodicOrbits


@dataclass(frozen=True)
class Trajectories:
    """Coasts, that is flights without manoeuvres, one or more making up each plan.

    Flights under a command that is known beforehand (a reference to be tracked) stand here too:
    then `u` gives it.
    """

    frame: str
    """Frame of the states, see `hillsphere.testing.frames`."""
    states: Annotated[tuple[str, ...], Shape("states")]
    """Names of the states."""
    plans: Annotated[tuple[str, ...], Shape("coasts")]
    """Name of the plan that each coast belongs to; those of a plan follow each other."""
    labels: Annotated[tuple[str, ...], Shape("coasts")]
    """Name of each coast."""
    t_s: Annotated[Array, Shape("times", "coasts")]
    """Times since the beginning of the plan, rising; NaN beyond a coast's end."""
    x: Annotated[Array, Shape("states", "times", "coasts")]
    """States, SI; NaN beyond a coast's end."""
    controls: Annotated[tuple[str, ...], Shape("controls")] = ()
    """Names of the controls; none for coasts."""
    u: Annotated[Array | None, Shape("controls", "times", "coasts")] = None
    """Command from each time to the next, held, SI; the last is that beyond the end."""


@dataclass(frozen=True)
class FlightSet:
    """A product with flights, for stages that write or judge them.

    Parameters
    ----------
    flights : Trajectories
        The flights.
    """

    flights: Trajectories


@dataclass(frozen=True)
class ControlDesign:
    """A product with a controller, for stages that fly or judge it.

    Products of syntheses derive from it, so that a law takes the controller of any of them.

    Parameters
    ----------
    controller : LtiSystem
        From what the law sees to what it commands, SI.
    others : tuple of LtiSystem
        Those at which other searches of the same synthesis ended, the best first: how much of what
        a controller does is a matter of the search.
    """

    controller: LtiSystem
    others: tuple[LtiSystem, ...] = field(default=(), kw_only=True)

    def design(self, number: int) -> LtiSystem:
        """Return the controller for 1, the others for what follows.

        Raises
        ------
        InputError
            If there are not as many.
        """
        if not 1 <= number <= 1 + len(self.others):
            raise InputError(
                f"design {number} is asked for, of a synthesis that has {1 + len(self.others)}"
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

    Over the cases that came to their end (as for metrics), with the values that they have there: a
    case that ended sooner than others leaves the bands at its end.

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
    """Histories of cases that do not all end at a sample, with their ends.

    Parameters
    ----------
    names, units, case, time_s, values
        As of `Lines`.
    end_s : ndarray, shape (N,)
        When a case ended after its last sample, after its first one; NaN where the last sample was
        the end.
    end_values : ndarray, shape (q, N)
        The values then; NaN for what only samples have.
    """

    end_s: Array
    end_values: Array


@dataclass(frozen=True)
class Ladder:
    """Points that come in groups, in each of which one thing grows.

    Parameters
    ----------
    name, unit : str
        What grows, ``"σ of the worst case"``, and its unit; ``"-"`` for none.
    values : ndarray, shape (P,)
        How large it is at the P points.
    groups : tuple of str
        Name of the group of each point.
    """

    name: str
    unit: str
    values: Array
    groups: tuple[str, ...]


@dataclass(frozen=True)
class CaseTable:
    """What came of a campaign, one row per case, stored by columns.

    Parameters
    ----------
    stage : str
        Name of the stage that was repeated.
    design : str
        How the cases were chosen: ``"random"``, ``"latin_hypercube"``, ``"sobol"``,
        ``"sobol_indices"``, ``"grid"``, ``"list"``.
    planned : int
        Number of cases that were to be computed.
    stopped : str
        Why it ended before; ``""`` if it did not.
    case : ndarray of int, shape (N,)
        Number of each case, ascending.
    draw : ndarray of int, shape (N,)
        Number of its random numbers; equal numbers saw equal draws.
    point : ndarray of int, shape (N,)
        Its row in the swept points; 0 if nothing was swept.
    inputs, input_units : tuple of str
        Names and units of the k inputs that differed.
    input_values : ndarray, shape (k, N)
        Their values.
    metrics, units : tuple of str
        Names and units of the m metrics.
    values : ndarray, shape (m, N)
        Their values; NaN where a case has none.
    status, cause : ndarray of str, shape (N,)
        How each case ended, and what ended it.
    failed : ndarray of bool, shape (N,)
        Whether that counts as a failure; never of a case that its status says to be undecided, see
        `hillsphere.cases.case_classes`.
    message_case : ndarray of int, shape (F,)
        Numbers of the cases of which there is more to say.
    messages : tuple of str
        What there is to say of them: class and text of the error.
    swept : tuple of str
        Names of the d quantities that a sweep changed; none for ``monte_carlo``.
    swept_units : tuple of str
        Their units; ``""`` for what is no number.
    points : ndarray, shape (d, P)
        Their values at the P points; of what is no number its place in the list.
    point_labels : tuple of str
        One name per point.
    bands : Bands or None
        Quantiles over time, if they were asked for and any case has a history.
    ladder : Ladder or None
        Of the P points, if their list has one.
    lines : Lines or None
        Histories of the single cases, if a sweep was asked for them.
    step_error : ndarray, shape (N,), or None
        Estimate of each case's step error, in the plant's natural units; NaN where a case has none,
        None if the stage gives none.
    warnings : tuple of str
        What is to be borne in mind of all cases: warnings of the nominal flight.
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
        """Whether a repetition yields the same: no case was lost for want of time or memory."""
        return not np.isin(self.status, ("killed", "time_limit", "memory")).any()


@dataclass(frozen=True)
class CaseList:
    """Points that a sweep is to compute, one per column.

    Parameters
    ----------
    names : tuple of str
        What is set: ``"stage.hover.state.x"``, ``"gravity.phobos.C2,0"``, any key of the mission.
    units : tuple of str
        Their units, as the models write them (``"m/s"``), for a check; ``""`` for none. Values of
        run-time inputs are SI, those of keys in the key's own unit.
    values : ndarray, shape (k, N)
        Values of the k quantities at the N points.
    labels : tuple of str
        One name per point; empty for names made of the values.
    ladder : Ladder or None
        Which points differ by the size of one thing only: along it a sweep tells where failures
        begin.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    labels: tuple[str, ...] = ()
    ladder: Ladder | None = None
