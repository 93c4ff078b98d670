"""When lanes that fly together take the next flights: after how many steps the batch stops."""

from __future__ import annotations

from hillsphere.engine.dynamics.lane_refill import LaneRefill


def ended(steps: list[int]) -> LaneRefill:
    """Return the state of a batch whose lanes have all flown one flight."""
    refill = LaneRefill(len(steps))
    refill.note(steps, list(range(len(steps))))
    return refill


def at_start() -> list[float]:
    return [0.0] * 8


def test_flights_that_resemble_each_other_end_before_the_batch_stops() -> None:
    # To stop for each lane alone would take eight stops instead of one.
    assert ended([200, 210, 220, 230, 240, 250, 260, 270]).steps(at_start) > 270


def test_short_flights_among_long_ones_do_not_wait_for_these() -> None:
    # With mean 2113 and deviation 1945 steps, waiting for all costs 1.4·1945 + 30 steps a flight.
    refill = ended([150, 150, 160, 160, 4000, 4000, 4000, 4280])
    refill.note([150] * 8, [0, 1, 2, 3])
    # the others have flown a fourth of their flights, which leaves them three times as many steps
    steps = refill.steps(lambda: [0.0] * 4 + [0.25] * 4)
    assert 160 <= steps < 200


def test_a_stop_follows_after_some_steps_while_nothing_is_known() -> None:
    assert LaneRefill(8).steps(at_start) == 256


def test_the_steps_of_a_flight_are_counted_over_stops() -> None:
    once, twice = LaneRefill(2), LaneRefill(2)
    once.note([300, 300], [0, 1])
    twice.note([200, 100], [])
    twice.note([100, 200], [0, 1])
    assert once.steps(lambda: [0.0, 0.0]) == twice.steps(lambda: [0.0, 0.0]) == 300 + 16
