"""How long a search takes until it finds the satellite."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.interfaces import Array
from hillsphere_tracking.assisted_tracking.searching import simulate_search
from hillsphere_tracking.assisted_tracking.specs import SearchSpec
from hillsphere_tracking.pointing.search import plan_search

DEGREE = np.pi / 180.0
BEAM = 1.0 * DEGREE
SPEC = SearchSpec.model_validate({"speed_deg_s": 2, "dwell_s": 0.5})
T = 30.0 + np.arange(0.0, 200.0)


def held(right_deg: float, up_deg: float) -> Array:
    return np.repeat(np.array([right_deg, up_deg])[:, None, None] * DEGREE, T.size, axis=1)


def covariance(right_deg: float, up_deg: float) -> Array:
    return (np.diag([right_deg**2, up_deg**2]) * DEGREE**2)[:, :, None]


def test_within_the_beam_it_takes_one_dwell() -> None:
    found = simulate_search(SPEC, BEAM, T, held(0.6, 0.7), covariance(5.0, 0.1))
    assert found.time_s[0] == SPEC.dwell_s
    assert (found.found[0], found.at_once[0]) == (1.0, 1.0)


def test_a_line_is_searched_to_one_side_first() -> None:
    # along a line, at 2°/s from the prediction: within the beam from 3° on towards 4°
    both = np.concatenate([held(4.0, 0.0), held(-4.0, 0.0)], axis=2)
    p = np.repeat(covariance(3.0, 0.01), 2, axis=2)
    found = simulate_search(SPEC, BEAM, T, both, p)
    assert (found.found.tolist(), found.at_once.tolist()) == ([1.0, 1.0], [0.0, 0.0])
    times = np.sort(found.time_s)
    assert times[0] == pytest.approx(SPEC.dwell_s + 3.0 / 2.0 + SPEC.dwell_s, abs=0.06)
    search = plan_search(p[:, :, 0], BEAM, SPEC.speed_rad_s, dwell_s=SPEC.dwell_s)
    reach = float(np.abs(search.path_rad[0]).max()) / DEGREE
    assert times[1] == pytest.approx(0.5 + (2.0 * reach + 3.0) / 2.0 + 0.5, abs=0.06)


def test_what_is_not_found_is_said_to_be_not_found() -> None:
    found = simulate_search(SPEC, BEAM, T, held(0.0, 40.0), covariance(1.0, 1.0))
    # A number, as every metric of a case that came to its end; it is no time to reacquire.
    assert found.time_s[0] == T[-1] - T[0]
    assert (found.found[0], found.at_once[0]) == (0.0, 0.0)


def test_the_error_may_move_into_the_beam() -> None:
    off = held(0.0, 0.0).copy()
    off[1, :, 0] = (3.0 - 0.05 * (T - T[0])) * DEGREE
    # no spread: the antenna stays at the prediction
    found = simulate_search(SPEC, BEAM, T, off, covariance(1e-3, 1e-3))
    assert (found.found[0], found.at_once[0]) == (1.0, 0.0)
    assert found.time_s[0] == pytest.approx(2.0 / 0.05 + SPEC.dwell_s, abs=0.06)


@pytest.mark.parametrize(
    ("off", "p"),
    [
        (held(np.nan, 0.0), covariance(1.0, 1.0)),
        (held(5.0, 0.0), covariance(np.inf, 1.0)),
        (held(0.0, 0.0), covariance(np.nan, 1.0)),
    ],
)
def test_errors_that_are_not_finite(off: Array, p: Array) -> None:
    found = simulate_search(SPEC, BEAM, T, off, p)
    assert np.isnan([found.time_s, found.found, found.at_once]).all()
