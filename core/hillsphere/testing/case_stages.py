"""Checks of stages that campaigns repeat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hillsphere.interfaces import Array, CaseStage, Integers, Parameter
from hillsphere.interfaces.cases import LANES, CaseBatch, CaseResults, Histories
from hillsphere.plugins.registry import Registry, default_registry, validate
from hillsphere.testing.contract import require
from hillsphere.testing.examples import bound_example, example_inputs

__all__ = ["check_case_stage"]

_FIRST = 7  # a case that is no multiple of the block, and not zero


def check_case_stage(
    type_: str,
    keys: Mapping[str, Any] | None = None,
    inputs: Mapping[str, Any] | None = None,
    *,
    spread: float = 1e-3,
    inert: Sequence[str] = (),
    registry: Registry | None = None,
) -> CaseResults:
    """Check a stage that campaigns repeat.

    Parameters
    ----------
    type_ : str
        Type of the stage.
    keys : mapping, optional
        Keys as in a mission, with references given as objects; by default the first example of its
        Spec.
    inputs : mapping, optional
        Products of earlier stages by name; by default those of the examples of other stages.
    spread : float
        Change of the inputs: a fraction of the nominal value, or an amount in SI units if that is
        zero.
    inert : sequence of str
        Inputs that legitimately have no effect in the checked flights (a budget that is not spent,
        a coefficient that a symmetry hides).
    registry : Registry, optional
        Registry of the stage; by default of all installed plugins.

    Returns
    -------
    CaseResults
        Results of a block in which all inputs differ, for further tests.

    Raises
    ------
    ContractViolation
        Unless

        - the inputs have different names and nominal values that are numbers or NaN;
        - results have one column per lane, the same metrics for every block, and finite values for
          every case that did not fail; histories are as long as their times;
        - the bits of a case do not depend on its lane, its number, its neighbours, filler lanes, or
          histories, and are the same at a second call;
        - noise depends on the draws only;
        - every input has an effect.
    """
    registry = registry or default_registry()
    record = registry.get("stage", type_)
    if keys is None:
        spec = bound_example(record, registry)
    else:
        spec = validate(record.load_spec(), keys, where=f"stage {type_!r}")
    given = dict(example_inputs(spec, registry) if inputs is None else inputs)
    stage = record.load_target()(spec)
    what = f"stage {type_!r}"
    require(isinstance(stage, CaseStage), f"{what} has no case_inputs and run_cases")
    kit = _Kit(what, stage, given)
    offered = stage.case_inputs()
    _check_inputs(what, offered)
    numbers = tuple(q for q in offered if np.isfinite(q.value))
    random = np.random.default_rng(11)
    width = np.array([spread * abs(q.value) if q.value else spread for q in numbers])
    nominal = np.array([q.value for q in numbers])
    values = nominal[:, None] + width[:, None] * random.normal(size=(len(numbers), LANES))
    names = tuple(q.name for q in numbers)
    batch = _batch(names, values, _FIRST + np.arange(LANES))
    results = kit.run(batch)
    _check_bits(kit, batch, results, random)
    _check_draws(kit, batch)
    _check_effects(kit, numbers, width, frozenset(inert))
    return results


class _Kit:
    """A stage, its inputs, and the metrics that all blocks must share."""

    def __init__(self, what: str, stage: CaseStage, given: Mapping[str, Any]) -> None:
        self.what, self._stage, self._given = what, stage, given
        self._named: tuple[object, object] | None = None

    def run(self, batch: CaseBatch, *, history: bool | tuple[str, ...] = False) -> CaseResults:
        """Run a block and check its form."""
        what = self.what
        results: CaseResults = self._stage.run_cases(batch, history=history, **self._given)
        named = (results.metrics, results.units)
        require(self._named in (None, named), f"{what}: metrics or units differ between blocks")
        self._named = named
        require(
            len(results.units) == len(results.metrics)
            and len(set(results.metrics)) == len(results.units),
            f"{what}: needs metrics of different names, each with a unit",
        )
        shape = (len(results.metrics), LANES)
        require(
            results.values.shape == shape and results.values.dtype == np.float64,
            f"{what}: values are {results.values.shape}, they must be {shape}",
        )
        require(
            len(results.status) == len(results.cause) == LANES
            and results.failed.shape == (LANES,)
            and results.failed.dtype == np.bool_,
            f"{what}: status, cause and failed must have one element per lane, failed boolean",
        )
        bad = ~results.failed & ~np.isfinite(results.values).all(axis=0)
        require(
            not bad.any(), f"{what}: cases {np.flatnonzero(bad)} did not fail and are not finite"
        )
        require(
            (results.histories is not None) == bool(history),
            f"{what}: histories must be there if they are asked for, and only then",
        )
        if results.histories is not None:
            h = results.histories
            require(
                h.time_s.ndim == 2
                and h.time_s.shape[1] == LANES
                and h.values.shape == (len(h.names), *h.time_s.shape)
                and len(h.units) == len(h.names),
                f"{what}: histories must be (q, K, {LANES}) with q names and units, times (K, "
                f"{LANES})",
            )
        return results


def _check_inputs(what: str, offered: Sequence[Parameter]) -> None:
    names = [q.name for q in offered]
    require(len(set(names)) == len(names), f"{what}: two inputs have one name")
    infinite = [q.name for q in offered if np.isinf(q.value)]
    require(not infinite, f"{what}: nominal values of {infinite} must be numbers, or NaN")
    require(all(q.unit for q in offered), f"{what}: an input has no unit; say '-'")


def _check_bits(
    kit: _Kit, batch: CaseBatch, results: CaseResults, random: np.random.Generator
) -> None:
    """Check that the bits of a case do not depend on the other cases of its block."""
    again = kit.run(batch)
    _require_same(kit, results, again, np.arange(LANES), "at a second call")
    order = random.permutation(LANES)
    turned = kit.run(_lanes(batch, order, np.zeros(LANES, dtype=bool)))
    _require_same(kit, results, turned, order, "in another place")
    kept = np.sort(random.permutation(LANES)[:5])
    sparse = np.concatenate([kept, np.repeat(kept[-1:], LANES - len(kept))])
    alone = kit.run(_lanes(batch, sparse, np.arange(LANES) >= len(kept)))
    _require_same(kit, results, alone, kept, "among filler")
    renumbered = kit.run(replace(batch, numbers=batch.numbers + 1000))
    _require_same(kit, results, renumbered, np.arange(LANES), "under another number")
    told = kit.run(batch, history=True)
    _require_same(kit, results, told, np.arange(LANES), "with histories")
    if told.histories is not None and told.histories.names:
        _check_some_histories(kit, batch, told.histories)


def _check_some_histories(kit: _Kit, batch: CaseBatch, told: Histories) -> None:
    """Check that a history requested by its name equals the one among all histories."""
    name = told.names[-1]
    some = kit.run(batch, history=(name,)).histories
    require(
        some is not None and name in some.names, f"{kit.what}: keeps no history of {name} by name"
    )
    assert some is not None
    k = min(len(some.time_s), len(told.time_s))
    one, other = (h.values[h.names.index(name)] for h in (some, told))
    same = np.array_equal(one[:k], other[:k], equal_nan=True)
    rest = np.isnan(one[k:]).all() and np.isnan(other[k:]).all()
    require(same and bool(rest), f"{kit.what}: the history of {name} differs where it is named")


def _check_draws(kit: _Kit, batch: CaseBatch) -> None:
    """Check that equal inputs and draws give equal results."""
    one = np.repeat(batch.values[:, :1], LANES, axis=1)
    draws = np.repeat(np.arange(2), LANES // 2)
    results = kit.run(_batch(batch.names, one, draws))
    halves = (slice(0, LANES // 2), slice(LANES // 2, LANES))
    for half in halves:
        first = half.start or 0
        same = np.array_equal(
            results.values[:, half],
            np.repeat(results.values[:, first : first + 1], LANES // 2, axis=1),
            equal_nan=True,
        )
        require(same, f"{kit.what}: lanes of equal inputs and draws differ")


def _check_effects(
    kit: _Kit, numbers: Sequence[Parameter], width: Array, inert: frozenset[str]
) -> None:
    """Check that every input changes something: a metric, how a case ends, or its history."""
    names = tuple(q.name for q in numbers)
    nominal = np.array([q.value for q in numbers])
    without: list[str] = []
    per_block = LANES - 1
    for first in range(0, len(numbers), per_block):
        values = np.repeat(nominal[:, None], LANES, axis=1)
        some = range(first, min(first + per_block, len(numbers)))
        for lane, i in enumerate(some, start=1):
            values[i, lane] += width[i]
        results = kit.run(_batch(names, values, np.zeros(LANES, dtype=np.int64)), history=True)
        h = results.histories
        assert h is not None
        everything = np.concatenate([results.values, h.time_s, h.values.reshape(-1, LANES)])
        for lane, i in enumerate(some, start=1):
            same = (results.status[lane], results.cause[lane]) == (
                results.status[0],
                results.cause[0],
            )
            if same and np.array_equal(everything[:, lane], everything[:, 0], equal_nan=True):
                without.append(names[i])
    idle = [name for name in without if name not in inert]
    require(not idle, f"{kit.what}: inputs {idle} change nothing; leave them out of case_inputs")
    wrong = sorted(inert - set(without))
    require(not wrong, f"{kit.what}: inputs {wrong} are called inert and are not, or not offered")


def _batch(names: tuple[str, ...], values: Array, draws: Integers) -> CaseBatch:
    numbers = 100 + np.arange(LANES)
    filler = np.zeros(LANES, dtype=bool)
    return CaseBatch(numbers, draws, filler, names, np.ascontiguousarray(values), 3, "contract")


def _lanes(batch: CaseBatch, which: Integers, filler: np.ndarray[Any, Any]) -> CaseBatch:
    return replace(
        batch,
        numbers=batch.numbers[which],
        draws=batch.draws[which],
        filler=filler,
        values=np.ascontiguousarray(batch.values[:, which]),
    )


def _require_same(
    kit: _Kit, results: CaseResults, other: CaseResults, lanes: Integers, where: str
) -> None:
    """Require that case lanes[j] of `found` is case j of `other`, to the last bit."""
    count = len(lanes)
    same = results.values[:, lanes].tobytes() == other.values[:, :count].tobytes()
    ends = all(
        (results.status[i], results.cause[i], results.failed[i])
        == (other.status[j], other.cause[j], other.failed[j])
        for j, i in enumerate(lanes.tolist())
    )
    require(same and ends, f"{kit.what}: cases differ {where}: they must not touch each other")
