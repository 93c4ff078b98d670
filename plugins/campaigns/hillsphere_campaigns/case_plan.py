"""Planning of a campaign: from names in a mission to the inputs of cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from math import isfinite, log2
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Integers
from hillsphere.base.problems import did_you_mean, format_value
from hillsphere.cases.designs import Design, DesignName
from hillsphere.cases.plan import Plan, SweepVariant
from hillsphere.cases.repeated import Repeated
from hillsphere.cases.swept import Swept, no_sweep
from hillsphere.errors import InputError
from hillsphere.interfaces.dispersion import Dispersion
from hillsphere.interfaces.quantities import Parameter
from hillsphere.mission.links import topological
from hillsphere.runs.assembly import Assembly
from hillsphere.spec import UNITS, Spec
from hillsphere.uncertainty.dispersed import Dispersed, Quantity, quantities_of, resolve
from hillsphere_campaigns.sweep_points import MOST_POINTS

__all__ = ["plan_of"]

_LONGEST_LABEL = 42
"""Characters of a description that serves as the label of an axis: a panel of half a page has room
for some 45 with the unit."""


def plan_of(
    repeated: Repeated,
    dispersions: Sequence[str] = (),
    *,
    cases: int,
    design: DesignName = "random",
    swept: Swept | None = None,
    seed: int | None = None,
    stream: str,
) -> Plan:
    """Plan a campaign.

    Parameters
    ----------
    repeated : Repeated
        The stage that is repeated.
    dispersions : sequence of str
        Names of tables ``[dispersions.NAME]`` of its mission.
    cases : int
        Cases at each swept point, or in all; for ``"sobol_indices"`` in each of its k + 2 samples.
    design : str
        How the cases of a point are chosen.
    swept : Swept, optional
        What is changed from point to point, see `hillsphere.cases.swept`. A name is that of a
        table and of a quantity in it that the stage takes case by case (SI), or of a key. A
        quantity that is dispersed too has its distribution about the swept value.
    seed : int, optional
        Root seed; the mission's if absent.
    stream : str
        Name of the campaign's random numbers; campaigns of the same name see the same ones.

    Returns
    -------
    Plan
        The cases.

    Raises
    ------
    InputError
        If a name is not found, a value does not fit, something is set twice or changes nothing, or
        the design does not suit the dispersions.
    """
    swept = no_sweep() if swept is None else swept.of_stage(repeated.stage)
    inputs = repeated.case_inputs()
    quantities = _quantities_per_case(swept, repeated, inputs)
    keys = [i for i in range(len(swept.names)) if i not in quantities]
    for i in keys:
        _require_used(swept.names[i], repeated, dispersions)
    _require_apart([swept.names[i] for i in keys], repeated)
    swept, parts = _by_variant(swept, keys)
    root = repeated.mission.seed if seed is None else seed
    stages: dict[tuple[tuple[str, int], ...], tuple[Repeated, tuple[Parameter, ...]]] = {}
    samples: dict[tuple[tuple[str, int], ...], Design] = {}
    variants = []
    for first, last in parts:
        choice = {swept.names[i]: int(swept.index[i, first]) for i in keys}
        values = {swept.names[i]: swept.levels[i][choice[swept.names[i]]] for i in keys}
        there = _change_keys(repeated, values, inputs)
        # A dispersion that changes leaves the stage as it is: it need not be built again.
        of_stage = tuple(pair for pair in choice.items() if not pair[0].startswith("dispersions."))
        if of_stage not in stages:
            stages[of_stage] = there, there.case_inputs() if of_stage else inputs
        stage, offered = stages[of_stage]
        assembly = Assembly(there.mission)
        models: dict[str, Dispersion] = {n: assembly.get("dispersions", n) for n in dispersions}
        dispersed = resolve(models, there, offered)
        active, groups = _select_drawn(dispersed, design, cases)
        if groups not in samples:
            samples[groups] = Design(design, cases, groups, root, stream)
        per_case = _quantities_per_case(swept, there, offered)
        _require_untouched(quantities, per_case, swept)
        _check_overlap(per_case, dispersed, swept)
        variants.append(
            SweepVariant(stage, last - first, dispersed, samples[groups], active, per_case)
        )
    totals = {variant.sample.total for variant in variants}
    if len(totals) > 1:
        raise InputError(
            "'sobol_indices' needs the same number of dispersed quantities at every swept point"
        )
    if (total := swept.index.shape[1] * totals.pop()) > MOST_POINTS:
        raise InputError(f"{total} cases are planned; at most {MOST_POINTS} can be computed")
    units = [
        "" if not number else quantities[i].unit if i in quantities else _unit_of(name, repeated)
        for i, (name, number) in enumerate(zip(swept.names, swept.numeric, strict=True))
    ]
    labels = [
        "" if i in quantities else _label_of(name, repeated) for i, name in enumerate(swept.names)
    ]
    return Plan(variants, swept, units, labels, seed=root, stream=stream)


def _quantities_per_case(
    swept: Swept, repeated: Repeated, inputs: Sequence[Parameter]
) -> dict[int, Quantity]:
    """Return the swept quantities that the stage accepts per case, by their rows."""
    found: dict[int, Quantity] = {}
    taken: dict[str, str] = {}
    for i, name in enumerate(swept.names):
        quantity = _quantity(name, repeated, inputs)
        if quantity is None:
            continue
        for value in swept.levels[i]:
            if not swept.numeric[i] or not isfinite(value):
                raise InputError(
                    f"{name}: expected a finite number ({quantity.unit}, SI), got "
                    f"{format_value(value)}"
                )
        said = swept.units[i] if swept.units else ""
        if said and said != quantity.unit:
            raise InputError(f"{name} is in {quantity.unit}, but the list says {said}")
        for other in quantity.inputs:
            if other in taken:
                raise InputError(f"{name} and {taken[other]} set the same quantity; keep one")
            taken[other] = name
        found[i] = quantity
    return found


def _quantity(name: str, repeated: Repeated, inputs: Sequence[Parameter]) -> Quantity | None:
    own = quantities_of(f"stage.{repeated.stage}", repeated, inputs)
    if name in own:
        return own[name]
    table, key = _split(name)
    return quantities_of(table, repeated, inputs).get(key)


def _split(name: str) -> tuple[str, str]:
    """Return table and key of ``"kind.table.key"``."""
    parts = name.split(".", 2)
    return ".".join(parts[:2]), parts[2] if len(parts) == 3 else ""


def _require_used(name: str, repeated: Repeated, dispersions: Sequence[str]) -> None:
    """Raise if a key belongs to a table that has no influence on the cases."""
    table, key = _split(name)
    mission = repeated.mission
    tables = [f"{kind}.{other}" for kind, group in mission.specs.items() for other in group]
    if not key or table not in tables:
        hint = did_you_mean(table, tables, otherwise="tables")
        raise InputError(f"{name}: no such key in this mission{hint}")
    roots = [("stage", repeated.stage), *(("dispersions", other) for other in dispersions)]
    used = [f"{kind}.{other}" for kind, other in topological(roots, mission.specs)]
    if table not in used:
        hint = did_you_mean(table, used, otherwise="it uses")
        if table.startswith("dispersions."):
            hint = f" here; add {table[12:]!r} to the key dispersions"
        raise InputError(
            f"{name}: changes nothing, as stage {repeated.stage!r} does not use {table}{hint}"
        )


def _require_apart(names: Sequence[str], repeated: Repeated) -> None:
    """Raise if two names mean the same key in two units, or one a part of the other."""
    plain: dict[str, str] = {}
    for name in names:
        field, keys = _field_of(name, repeated)
        plain[name] = f"{name.rpartition('.')[0]}.{field}." if keys else f"{name}."
    for name, other in combinations(names, 2):
        if plain[name].startswith(plain[other]) or plain[other].startswith(plain[name]):
            raise InputError(f"{name} and {other} set the same key; keep one")


def _require_untouched(
    before: Mapping[int, Quantity], after: Mapping[int, Quantity], swept: Swept
) -> None:
    """Raise if a swept key sets a quantity that is also swept per case, which would override it."""
    for i, quantity in after.items():
        pair = [before[i].nominal, quantity.nominal]
        if not np.array_equal(pair[:1], pair[1:], equal_nan=True):
            raise InputError(
                f"{swept.names[i]} is swept, and a key that sets the same quantity too; keep one"
            )


def _by_variant(swept: Swept, keys: Sequence[int]) -> tuple[Swept, list[tuple[int, int]]]:
    """Sort the points by variant; return them with the first and last place of each variant."""
    count = swept.index.shape[1]
    if not keys:
        return swept, [(0, count)]
    choices = swept.index[list(keys)]
    order: Integers = np.lexsort(choices[::-1])  # stable; the first key counts most
    swept = swept.reordered(order)
    choices = choices[:, order]
    edges = np.flatnonzero((choices[:, 1:] != choices[:, :-1]).any(axis=0)) + 1
    bounds = [0, *edges.tolist(), count]
    return swept, list(pairwise(bounds))


def _change_keys(
    repeated: Repeated, values: Mapping[str, Any], inputs: Sequence[Parameter]
) -> Repeated:
    """Return the stage with changed keys; errors also suggest quantities accepted per case."""
    if not values:
        return repeated
    # A range yields 4.0 where a key may ask for a whole number; no key refuses 4 for 4.0.
    plain = {
        name: int(value) if isinstance(value, float) and value.is_integer() else value
        for name, value in values.items()
    }
    try:
        return repeated.changed(plain)
    except InputError as error:
        for name in values:
            table, key = _split(name)
            near = did_you_mean(key, quantities_of(table, repeated, inputs))
            if str(error).startswith(name) and "did you mean" in near:
                raise InputError(f"{error} (case by case{near})") from error
        raise


def _select_drawn(
    dispersed: Dispersed, design: DesignName, cases: int
) -> tuple[NDArray[np.bool_], tuple[tuple[str, int], ...]]:
    """Return which quantities a design draws (k,), and how many of each group."""
    active = np.ones(len(dispersed.quantities), dtype=bool)
    if design == "sobol_indices":
        if cases & (cases - 1):
            raise InputError(
                f"'sobol_indices' needs a power of two of cases, got {cases}; take "
                f"{1 << round(log2(cases))}"
            )
        _require_independent(dispersed)
        active = np.diag(dispersed.moments()[1]) > 0.0
        if not active.any():
            raise InputError("'sobol_indices' needs dispersions with a spread; nothing differs")
    groups, begin = [], 0
    for group in dispersed.groups:
        end = begin + len(group.quantities)
        groups.append((group.table, int(np.count_nonzero(active[begin:end]))))
        begin = end
    return active, tuple(groups)


def _require_independent(dispersed: Dispersed) -> None:
    """Raise unless every quantity depends on its own random number alone."""
    for group in dispersed.groups:
        count = len(group.quantities)
        u = np.full((count, count + 1), 0.5)
        u[np.arange(count), np.arange(count) + 1] = 0.9
        values = group.dispersion.quantiles(u, group.nominal)
        if ((values[:, 1:] != values[:, :1]) & ~np.eye(count, dtype=bool)).any():
            raise InputError(
                f"dispersions.{group.table}: its quantities depend on each other, but "
                "'sobol_indices' tells apart what each does alone; leave the correlation out, or "
                "use another design and rank correlations"
            )


def _check_overlap(per_case: Mapping[int, Quantity], dispersed: Dispersed, swept: Swept) -> None:
    """Raise if a swept quantity has a dispersion that does not depend on its nominal value."""
    for i, quantity in per_case.items():
        for group in dispersed.groups:
            for row, other in enumerate(group.quantities):
                if set(quantity.inputs).isdisjoint(other.inputs):
                    continue
                values = {other.nominal, min(swept.levels[i]), max(swept.levels[i])}
                here = np.arange(len(group.quantities)) == row
                means = {
                    float(group.dispersion.mean(np.where(here, value, group.nominal))[row])
                    for value in values
                }
                if quantity.name == other.name and (len(means) > 1 or len(values) == 1):
                    continue
                raise InputError(
                    f"{swept.names[i]}: swept, but dispersions.{group.table} sets it for every "
                    "case without regard to that; leave it out of one of them"
                )


def _unit_of(name: str, repeated: Repeated) -> str:
    """Return the unit in which a mission writes a key, ``"-"`` for none."""
    _, keys = _field_of(name, repeated)
    return keys.get(name.rpartition(".")[2], "-")


def _label_of(name: str, repeated: Repeated) -> str:
    """Return the declared description of a key if it is short enough for an axis, else ``""``."""
    spec, key = _spec_of(name, repeated)
    field = _field_of(name, repeated)[0] or key
    fields = type(spec).model_fields if isinstance(spec, Spec) else {}
    text = (fields[field].description or "") if field in fields else ""
    # A description with a colon or semicolon lists choices, and one with a dot names a key.
    is_label = len(text) <= _LONGEST_LABEL and not any(mark in text for mark in ":;._")
    return text if is_label else ""


def _spec_of(name: str, repeated: Repeated) -> tuple[Any, str]:
    """Return the table that holds a key, as far as it is a `Spec`, and the last part of the key."""
    table, path = _split(name)
    kind, _, other = table.partition(".")
    spec: Any = repeated.mission.specs[kind][other]
    *steps, key = path.split(".")
    for step in steps:
        spec = getattr(spec, step, None)
    return spec, key


def _field_of(name: str, repeated: Repeated) -> tuple[str, dict[str, str]]:
    """Return the field that a key with a unit means, and the unit of each of its spellings."""
    spec, key = _spec_of(name, repeated)
    for field, keys in type(spec).units_by_field().items() if isinstance(spec, Spec) else ():
        if key in keys:
            dimension = str(type(spec).schema_extra(field)["x-dimension"])
            units = [suffix.replace("_", "/") for suffix in UNITS[dimension]]
            return field, dict(zip(keys, units, strict=True))
    return "", {}
