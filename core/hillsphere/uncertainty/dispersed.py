"""Resolution of a mission's dispersions to the case inputs of the repeated stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.matching import match_names
from hillsphere.cases.repeated import Repeated
from hillsphere.interfaces.dispersion import Dispersion, StageDispersion
from hillsphere.interfaces.quantities import Parameter

__all__ = ["Dispersed", "Group", "Quantity", "quantities_of", "resolve"]


@dataclass(frozen=True)
class Quantity:
    """A quantity of a mission that corresponds to one or several case inputs of a stage.

    Parameters
    ----------
    name : str
        Its name, ``"gravity.phobos.C2,0"``; for the stage's own table without that name,
        ``"state.x"``.
    inputs : tuple of str
        The stage's case inputs that it sets, one for each path of references to its table.
    nominal : float
        Nominal value, SI.
    unit : str
        Unit.
    """

    name: str
    inputs: tuple[str, ...]
    nominal: float
    unit: str


@dataclass(frozen=True)
class Group:
    """One dispersion with its quantities.

    Parameters
    ----------
    table : str
        Name of its table.
    dispersion : Dispersion
        Their joint distribution.
    quantities : tuple of Quantity
        The quantities in the order of the dispersion.
    """

    table: str
    dispersion: Dispersion
    quantities: tuple[Quantity, ...]

    @property
    def nominal(self) -> Array:
        """Nominal values (k,), SI."""
        return np.array([quantity.nominal for quantity in self.quantities])


@dataclass(frozen=True)
class Dispersed:
    """The dispersed inputs of a stage's cases.

    Parameters
    ----------
    groups : tuple of Group
        One per dispersion; no quantity is in two of them.
    """

    groups: tuple[Group, ...]

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All k quantities, in order."""
        return tuple(q for group in self.groups for q in group.quantities)

    def values(self, u: Array, nominal: Mapping[str, float] | None = None) -> Array:
        """Return values (k, N), SI.

        Parameters
        ----------
        u : ndarray, shape (k, N)
            Independent uniform numbers in (0, 1).
        nominal : mapping of str to float, optional
            Name of a quantity → value that replaces its nominal one.
        """
        parts, row = [], 0
        for group in self.groups:
            count = len(group.quantities)
            about = group.nominal
            for i, quantity in enumerate(group.quantities):
                about[i] = (nominal or {}).get(quantity.name, about[i])
            parts.append(group.dispersion.quantiles(u[row : row + count], about))
            row += count
        return np.concatenate(parts) if parts else np.empty((0, u.shape[1]))

    def moments(self) -> tuple[Array, Array]:
        """Return mean values (k,) and covariance (k, k), SI."""
        means = [group.dispersion.mean(group.nominal) for group in self.groups]
        covariance = np.zeros((sum(map(len, means)),) * 2)
        row = 0
        for group, mean in zip(self.groups, means, strict=True):
            here = slice(row, row + len(mean))
            covariance[here, here] = group.dispersion.covariance(group.nominal)
            row += len(mean)
        return np.concatenate([np.empty(0), *means]), covariance


def resolve(
    dispersions: Mapping[str, Dispersion],
    repeated: Repeated,
    case_inputs: Sequence[Parameter] | None = None,
) -> Dispersed:
    """Find the case inputs of dispersions.

    Parameters
    ----------
    dispersions : mapping of str to Dispersion
        Name of the dispersion's table → dispersion.
    repeated : Repeated
        The stage and its mission.
    case_inputs : sequence of Parameter, optional
        The stage's case inputs, if already known.

    Returns
    -------
    Dispersed
        The dispersed quantities, in the order of `dispersions`.

    Raises
    ------
    InputError
        If the stage does not use a dispersion's table or has no case inputs of it, a name matches
        no quantity, a quantity has another unit or no nominal value, sizes do not match, or another
        dispersion contains the same quantity. The message names the dispersion.
    """
    inputs = repeated.case_inputs() if case_inputs is None else case_inputs
    taken: dict[str, str] = {}
    groups = []
    for table, dispersion in dispersions.items():
        try:
            group = _group(table, dispersion, repeated, inputs)
        except InputError as error:
            raise InputError(f"dispersions.{table}: {error}") from error
        for quantity in group.quantities:
            for name in quantity.inputs:
                if name in taken:
                    raise InputError(
                        f"dispersions.{table}: {quantity.name} is dispersed by "
                        f"dispersions.{taken[name]} already; leave it out of one of them"
                    )
                taken[name] = table
        groups.append(group)
    return Dispersed(tuple(groups))


def quantities_of(
    table: str, repeated: Repeated, case_inputs: Sequence[Parameter]
) -> dict[str, Quantity]:
    """Return the quantities of a table that are case inputs of a stage, by name.

    Parameters
    ----------
    table : str
        ``"gravity.phobos"``.
    repeated : Repeated
        The stage and its mission.
    case_inputs : sequence of Parameter
        The stage's case inputs.

    Returns
    -------
    dict of str to Quantity
        Name in the table → quantity. A quantity with several case inputs occurs once.
    """
    own = table in ("stage", f"stage.{repeated.stage}")
    quantities: dict[str, Quantity] = {}
    for prefix in repeated.paths(table):
        for parameter in case_inputs:
            name = parameter.name.removeprefix(prefix)
            if not parameter.name.startswith(prefix) or not name:
                continue
            if name in quantities:
                known = quantities[name]
                inputs = (*known.inputs, parameter.name)
                quantities[name] = Quantity(known.name, inputs, known.nominal, known.unit)
            else:
                full = name if own else f"{table}.{name}"
                quantities[name] = Quantity(
                    full, (parameter.name,), parameter.value, parameter.unit
                )
    return quantities


def _group(
    table: str, dispersion: Dispersion, repeated: Repeated, inputs: Sequence[Parameter]
) -> Group:
    offered = quantities_of(dispersion.of, repeated, inputs)
    if not offered:
        raise InputError(_nothing_there(dispersion.of, repeated, inputs))
    if isinstance(dispersion, StageDispersion):
        dispersion = dispersion.bind_to(repeated.build())
    names = match_names(dispersion.keys, list(offered), dispersion.of)
    group = Group(table, dispersion, tuple(offered[name] for name in names))
    for quantity in group.quantities:
        if dispersion.unit and quantity.unit != dispersion.unit:
            raise InputError(
                f"its numbers are in {dispersion.unit}, but {quantity.name} is in "
                f"{quantity.unit}; give another unit, or leave it out for SI"
            )
    lower, upper = dispersion.bounds(group.nominal, 1.0)
    bad = np.flatnonzero(~(np.isfinite(lower) & np.isfinite(upper)))
    if bad.size:
        raise InputError(
            f"{group.quantities[int(bad[0])].name} has no nominal value before earlier stages have "
            "run, so the distribution cannot be relative to it; give absolute values (uniform with "
            "lower and upper, choice, samples)"
        )
    # A wrong number of sizes is reported now, not when the first case is drawn.
    dispersion.quantiles(np.full((len(names), 1), 0.5), group.nominal)
    return group


def _nothing_there(table: str, repeated: Repeated, inputs: Sequence[Parameter]) -> str:
    """Return the message that a table has no case inputs of a stage, with the reason."""
    if repeated.paths(table):
        return (
            f"of: stage {repeated.stage!r} takes no quantity of {table} case by case; a key of it "
            "can be swept"
        )
    names = [f"{kind}.{name}" for kind, group in repeated.mission.specs.items() for name in group]
    usable = [name for name in names if quantities_of(name, repeated, inputs)]
    there = f"it uses {', '.join(usable)}" if usable else "it takes nothing case by case"
    return f"of: stage {repeated.stage!r} does not use {table}; {there}"
