"""Metrics of flights: one record for each, and the table of requirements that follows from them.

A stage that flies declares its metrics once, as a table of `FlightMetric`. Names, units and values
of its cases, their error estimates, the keys of its table ``require``, the check of these, and the
labels of tables and figures follow from the records. Nothing numerical is imported here, because
Specs are built of the records and must load quickly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from pydantic import create_model

from hillsphere.spec.base import Spec, quantity

if TYPE_CHECKING:
    from hillsphere.base.arrays import Array

__all__ = [
    "FlightHistory",
    "FlightMetric",
    "Requirement",
    "RequirementsSpec",
    "limit_shown",
    "requirements_spec",
]

F = TypeVar("F")
"""Type of a block of N flights, of which metrics and histories are computed."""

_LAST_RANK = 9
"""Rank of a requirement that does not say how a flight ended; any number above those that do."""


@dataclass(frozen=True)
class Requirement:
    """A limit on a metric: one key of the table ``require`` of a stage.

    Parameters
    ----------
    key : str
        Name of the key, ending in the SI suffix of its dimension.
    dimension : str
        A key of `hillsphere.spec.UNITS`.
    meaning : str
        What is limited, for the documentation of the Spec.
    sign : float
        1 for a limit on the metric, −1 for a limit on its negative.
    cause : str
        Cause of a case that violates it; ``""`` for the name of the metric.
    status : str
        Limits only flights that ended with this status; ``""`` for all.
    rank : int
        A flight that violates several limits reports the one with the lowest rank.
    allows_zero : bool
        Whether a mission may write zero.
    is_least : bool
        Whether the limit is the smallest permitted value (a clearance), not the largest.
    """

    key: str
    dimension: str
    meaning: str
    sign: float = 1.0
    cause: str = ""
    status: str = ""
    rank: int = _LAST_RANK
    allows_zero: bool = False
    is_least: bool = False


@dataclass(frozen=True)
class FlightMetric(Generic[F]):
    """One number that sums up a flight.

    Parameters
    ----------
    name : str
        Identifier, as missions and products use it.
    unit : str
        SI unit; ``"-"`` for none.
    value : callable
        Block of N flights → values (N,).
    error : callable or None
        Block of N flights → by how much the step error of the integration may change the values
        (N,); None for a metric that it does not change.
    requirements : tuple of Requirement
        Limits that a mission may set.
    label : str
        Heading in tables; by default the name with blanks.
    """

    name: str
    unit: str
    value: Callable[[F], Array]
    error: Callable[[F], Array] | None = None
    requirements: tuple[Requirement, ...] = ()
    label: str = ""

    def __post_init__(self) -> None:
        """Complete the label."""
        object.__setattr__(self, "label", self.label or self.name.replace("_", " "))


@dataclass(frozen=True)
class FlightHistory(Generic[F]):
    """One quantity over the time of a flight.

    Parameters
    ----------
    name : str
        Identifier, by which a campaign asks for it.
    unit : str
        SI unit; ``"-"`` for none.
    values : callable
        Block of N flights → values at K times (K, N); NaN where there is none.
    end : callable or None
        Block of N flights → values at the end of each flight (N,); None for a quantity that only
        samples have.
    """

    name: str
    unit: str
    values: Callable[[F], Array]
    end: Callable[[F], Array] | None = None


class RequirementsSpec(Spec):
    """Limits of metrics; a flight that ends well but violates one of them has failed."""

    def limit(self, key: str) -> float | None:
        """Return the limit that a mission sets under a key, SI; None for none."""
        most: float | None = getattr(self, key)
        return most


def requirements_spec(
    name: str, module: str, metrics: Iterable[FlightMetric[Any]]
) -> type[RequirementsSpec]:
    """Return the Spec of the table ``require``: one optional key for each requirement.

    Parameters
    ----------
    name, module : str
        Under which the class is imported; processes of a campaign look it up there.
    metrics : iterable of FlightMetric
        Whose requirements it takes, in this order.
    """
    fields: dict[str, Any] = {}
    for requirement in (r for metric in metrics for r in metric.requirements):
        bound = {"ge" if requirement.allows_zero else "gt": 0}
        declared = quantity(requirement.dimension, requirement.meaning, default=None, **bound)
        fields[requirement.key] = (float | None, declared)
    return create_model(
        name, __base__=RequirementsSpec, __module__=module, __doc__=RequirementsSpec.__doc__,
        **fields,
    )  # fmt: skip


def limit_shown(metric: FlightMetric[Any], require: RequirementsSpec) -> float | None:
    """Return the largest value that a table shows beside a metric: the first limit that is set."""
    limits: Sequence[float | None] = [
        require.limit(requirement.key)
        for requirement in metric.requirements
        if requirement.sign > 0.0 and not requirement.is_least
    ]
    return next((most for most in limits if most is not None), None)
