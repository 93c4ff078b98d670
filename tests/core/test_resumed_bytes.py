"""A run that was interrupted and resumed yields the same bytes as one that was not."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from hillsphere.cases.isolation import BlockOutcome, compute
from hillsphere.errors import Interrupted
from hillsphere.interfaces import Array, Context
from hillsphere.interfaces.cases import CaseBatch, CaseResults
from hillsphere.mission import load_mission
from hillsphere.plugins import Component, Registry, hookimpl
from hillsphere.plugins import builtin as components
from hillsphere.presentation import Presentation
from hillsphere.products.product_codec import canonical, load_product, save_product
from hillsphere.runs.pipeline import resume_run, run_mission
from hillsphere.spec import Ref, Spec, StageSpec, need, option

HERE = __name__


@dataclass(frozen=True)
class Views:
    """Arrays as stages make them: turned, sliced, spread."""

    turned: Array
    sliced: Array
    cube: Array
    spread: Array
    number: Array


def views() -> Views:
    rng = np.random.default_rng(11)
    matrix = rng.normal(size=(64, 65)) * 10.0 ** rng.uniform(-8, 8, size=(64, 65))
    return Views(
        turned=matrix.T,
        sliced=matrix[::3, ::-2],
        cube=rng.normal(size=(4, 5, 6)).transpose(2, 0, 1),
        spread=np.broadcast_to(rng.normal(size=(7, 1)), (7, 9)),
        number=np.array(2.5),
    )


def _arrays(product: Views) -> dict[str, Array]:
    return {name: getattr(product, name) for name in Views.__dataclass_fields__}


def test_the_last_bits_of_a_sum_depend_on_the_order_in_memory() -> None:
    """Why it matters: the premise of the tests below."""
    made = views().turned
    assert made.sum() != np.ascontiguousarray(made).sum()


def test_what_goes_on_is_what_the_file_gives_back(tmp_path: Path) -> None:
    save_product(tmp_path / "p.npz", views())
    loaded, same = _arrays(load_product(tmp_path / "p.npz")), _arrays(canonical(views()))
    for name, made in _arrays(views()).items():
        assert same[name].flags.c_contiguous
        assert same[name].strides == loaded[name].strides
        assert same[name].shape == loaded[name].shape == made.shape
        np.testing.assert_array_equal(same[name], made)
        assert same[name].sum() == loaded[name].sum()


def test_order_in_memory_leaves_no_trace_in_the_file(tmp_path: Path) -> None:
    save_product(tmp_path / "a.npz", views())
    save_product(tmp_path / "b.npz", canonical(views()))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


class ViewNeeds(Spec):
    """What a sum is taken of."""

    views: Ref = need(f"{HERE}:Views", "to be summed")


class FirstSpec(StageSpec):
    """Makes views."""

    produces = f"{HERE}:Views"


class SecondSpec(StageSpec):
    """Makes views of views."""

    produces = f"{HERE}:Views"
    needs: ViewNeeds = option("what it takes")


class First:
    """Makes views."""

    def __init__(self, spec: FirstSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context) -> Views:
        return views()

    def present(self, product: Views) -> Presentation:
        return Presentation()


class Second:
    """Adds up what it is given, and passes views on; is stopped when it is told."""

    stop: ClassVar[bool] = False

    def __init__(self, spec: SecondSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context, views: Views) -> Views:
        if Second.stop:
            Second.stop = False
            raise KeyboardInterrupt
        sums = np.outer(views.turned.sum(axis=0), views.turned @ views.turned.sum(axis=0))
        return Views(
            turned=sums.T,
            sliced=(views.turned @ views.turned.T)[::2],
            cube=views.cube.transpose(1, 0, 2) * views.turned.sum(),
            spread=views.spread.T,
            number=np.array(views.sliced.sum() + views.cube.sum() + views.spread.sum()),
        )

    def present(self, product: Views, views: Views) -> Presentation:
        return Presentation()


class Plugin:
    @hookimpl
    def hillsphere_components(self) -> Iterator[Component]:
        yield Component("stage", "first", f"{HERE}:First", f"{HERE}:FirstSpec", "")
        yield Component("stage", "second", f"{HERE}:Second", f"{HERE}:SecondSpec", "")


MISSION = """format = 1
name = "bytes"
title = "Bytes"
seed = 5
[stage.one]
type = "first"
[stage.two]
type = "second"
needs = { views = "one" }
[stage.three]
type = "second"
needs = { views = "two" }
"""


def _digests(directory: Path) -> dict[str, str]:
    files = sorted(directory.glob("*.npz"))
    return {path.name: sha256(path.read_bytes()).hexdigest() for path in files}


def test_a_stopped_run_ends_in_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "cache"))
    registry = Registry()
    registry.add_plugin("hillsphere", components)
    registry.add_plugin("bytes", Plugin())
    path = tmp_path / "bytes.toml"
    path.write_text(MISSION, "utf-8")
    mission = load_mission(path, registry=registry)
    whole = run_mission(mission, out=tmp_path / "whole", use_cache=False)
    assert whole.state == "success"
    Second.stop = True
    with pytest.raises(Interrupted):
        run_mission(mission, out=tmp_path / "stopped", use_cache=False)
    assert sorted(_digests(tmp_path / "stopped")) == ["one.npz"]
    assert resume_run(tmp_path / "stopped", mission=path, registry=registry).state == "success"
    assert _digests(tmp_path / "stopped") == _digests(tmp_path / "whole")
    assert len(_digests(tmp_path / "whole")) == 3
    # ... and with every stage from the cache, as in a third run
    for out in ("cold", "warm"):
        run_mission(mission, out=tmp_path / out)
        assert _digests(tmp_path / out) == _digests(tmp_path / "whole")


def _forget(directory: Path, stages: list[str]) -> None:
    """Make a run look as if it had been stopped before these stages."""
    manifest = json.loads((directory / "manifest.json").read_text("utf-8"))
    manifest["state"] = "interrupted"
    for stage in stages:
        manifest["stages"][stage].update(state="not run", product=None)
        (directory / f"{stage}.npz").unlink()
    (directory / "manifest.json").write_text(json.dumps(manifest), "utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["phobos-qso", "deimos-qso", "phobos-hover", "robust-control-demo"]
)
def test_a_packaged_mission_ends_in_the_same_bytes_from_any_stage_on(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "cache"))
    mission = load_mission(name, profile="fast")
    run_mission(mission, out=tmp_path / "run", use_cache=False)
    whole = _digests(tmp_path / "run")
    order = mission.order()
    assert len(whole) == len(order)
    for number in range(1, len(order)):
        _forget(tmp_path / "run", order[number:])
        assert resume_run(tmp_path / "run").state == "success"
        assert _digests(tmp_path / "run") == whole, f"resumed before {order[number]}"


def test_blocks_of_a_campaign_have_one_order_in_memory() -> None:
    """NumPy's ``values[:, lanes]`` is in Fortran order; a checkpoint gives back C order."""

    class Stage:
        def case_inputs(self) -> tuple[Any, ...]:
            return ()

        def run_cases(self, batch: CaseBatch, history: Any = False, **inputs: Any) -> CaseResults:
            lanes = len(batch.numbers)
            return CaseResults(
                metrics=("a", "b", "c"), units=("m", "m", "m"),
                values=np.arange(3.0 * lanes).reshape(lanes, 3).T,
                status=("completed",) * lanes, cause=("",) * lanes,
                failed=np.zeros(lanes, dtype=bool),
            )  # fmt: skip

    numbers = np.arange(64, dtype=np.int64)
    batch = CaseBatch(numbers, numbers, np.zeros(64, dtype=bool), (), np.zeros((0, 64)), 1, "s")
    found: BlockOutcome = compute(Stage(), batch, {})
    assert found.values.flags.c_contiguous
