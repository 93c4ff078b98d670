"""The studies of events can fail: faults that are put into the proof are seen by them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hillsphere.engine.dynamics import proof
from hillsphere.engine.dynamics.enclosures import growth
from hillsphere.engine.simulation import command_bounds, regions
from hillsphere.engine.simulation.event_proof import EventProof
from hillsphere.engine.simulation.quick_look import QuickLook
from hillsphere.interfaces import Array
from hillsphere.simulation import Cases, Simulator, simulate

from .test_event_bytes import ROOF, STEEP
from .test_event_commands import test_bounds_contain_dense_commands as check_commands
from .test_simulation_ends import CEILING, GRAVITY, Push, Shaft

PERIOD = 12.0


def throw_flock(number: int, seed: int) -> tuple[Array, Array]:
    """Return throws that come close to the ceiling about half a sample on, and their excess."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(0.35, 0.55, number) * PERIOD
    excess = rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(-3.0, 1.0, number)
    return np.array([CEILING + excess - 0.5 * GRAVITY * at**2, GRAVITY * at]), excess


def count_wrong(number: int = 256) -> int:
    """Count flights that ended otherwise than exact ones do, after flights in weak gravity."""
    loop = Simulator(Shaft(), Push(0.0, period_s=PERIOD), run_time=["gravity"])
    rng = np.random.default_rng(4)
    weak = np.array([rng.uniform(600.0, 990.0, 64), rng.uniform(-15.0, 15.0, 64)])
    loop.fly(Cases(weak, p=np.full((1, 64), 1e-4 * GRAVITY)), 1)
    x0, excess = throw_flock(number, 3)
    flights = loop.fly(Cases(x0, p=np.full((1, number), GRAVITY)), 1)
    status = np.array(flights.status)
    decided = status != "unresolved"
    return int(np.count_nonzero((status == "escape")[decided] != (excess > 0.0)[decided]))


def ignore_parameters(held: Callable[..., Any]) -> Callable[..., Any]:
    """Return `regions._columns_in_box` without its comparison of the parameters."""

    def all_alike(found: Any, which: int, columns: Any) -> Any:
        count = len(columns.h)
        lo, hi = (np.repeat(p[:, which, None], count, axis=1) for p in (found.p_lo, found.p_hi))
        boxes = replace(columns.boxes, p_lo=lo, p_hi=hi)
        return held(found, which, replace(columns, boxes=boxes))

    return all_alike


def test_without_a_fault_none_is_wrong() -> None:
    assert count_wrong() == 0


def test_a_need_too_small_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    need = regions.Regions.need
    monkeypatch.setattr(regions.Regions, "need", lambda self, h: 0.1 * need(self, h))
    assert count_wrong() > 0


def test_slopes_too_small_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    slopes = EventProof._of_all_rows

    def less(self: EventProof, *given: Any) -> Any:
        return tuple(0.1 * part for part in slopes(self, *given))

    monkeypatch.setattr(EventProof, "_of_all_rows", less)
    assert count_wrong() > 0


def test_regions_for_any_parameters_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Regions of weak gravity serve flights in a strong one, if nothing compares it."""
    monkeypatch.setattr(regions, "_columns_in_box", ignore_parameters(regions._columns_in_box))
    every = np.ones(64, dtype=bool)
    monkeypatch.setattr(QuickLook, "_agree", lambda *_: every)
    monkeypatch.setattr(QuickLook, "_departure", lambda *_: every[None, None])
    assert count_wrong() > 0


@pytest.mark.parametrize(("gap", "expected"), [(None, [5, 6, 7, 8]), (6, [7, 8])])
def test_only_what_is_near_a_crossing_leads_to_it(gap: int | None, expected: list[int]) -> None:
    """Of ten open pieces of length 1, the last of which crosses; one of them is perhaps closed."""
    begin, none = np.arange(10.0), np.zeros((1, 10))
    pieces = proof.Pieces(np.full(10, 3), begin, begin + 1.0, none, none, none, none)
    rest, crosses = np.ones(10, dtype=bool), begin == 9.0
    if gap is not None:
        rest[gap] = False
    leads = proof.leading(rest, crosses, pieces, np.array([0.0, 0.0, 0.0, 4.5]))
    assert np.flatnonzero(leads).tolist() == expected


@pytest.mark.parametrize("drift", [0.2, 20.0])
def test_a_bound_far_too_steep_gives_up_or_decides(drift: float) -> None:
    """A dip a thousand times flatter than its bound ends the flight; 100 000 times is given up."""
    rise = np.linspace(15.0, 30.0, 16)
    # At the crossing the slope is √(2 g e)/1000 m = 2e-4/s.
    x0 = np.array([ROOF + 0.01 - 0.5 * rise**2 / GRAVITY, rise])
    law, limit = Push(0.0, period_s=40.0), replace(STEEP, drift=drift)
    flights = simulate(Shaft(), law, Cases(x0), 1, limits=[limit])
    status = "constraint" if drift < 1.0 else "unresolved"
    assert set(zip(flights.status, flights.cause, strict=True)) == {(status, "roof")}


def test_a_tube_too_narrow_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command_bounds, "growth", lambda a, h: 0.1 * growth(a, h))
    missed = 0
    for seed in range(10):
        try:
            check_commands(seed, True)
        except AssertionError:
            missed += 1
    assert missed > 0
