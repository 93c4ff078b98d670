"""The mission ``deimos-qso``: another body by the mission file alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.missions.pages import check_page

from hillsphere.formats.oem import read_oem

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.missions.conftest import HillReference, Run

pytestmark = pytest.mark.slow  # 50 s


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, mission_run: Callable[..., Run]) -> Run:
    out = tmp_path_factory.mktemp("missions") / "deimos"
    return mission_run(out, "deimos-qso", "--profile", "fast", "--no-cache")


def test_orbit_by_an_independent_solution(run: Run, hill_reference: type[HillReference]) -> None:
    reference = hill_reference((7.8, 6.0, 5.1), 9.62e-5, semi_major_axis_km=23458.0)
    (row,) = run.rows("table_1")
    expected = reference.orbits(row["x0_km"])
    assert row["x0_km"] == 30.0
    assert row["vy0"] == pytest.approx(expected.vy0[0], rel=0, abs=1e-12)
    assert row["period"] == pytest.approx(expected.period[0], rel=0, abs=1e-12)
    assert row["jacobi"] == pytest.approx(expected.jacobi[0], rel=0, abs=1e-12)
    assert row["b_vertical"] == pytest.approx(expected.b_vertical[0], rel=0, abs=1e-10)


def test_members_in_space_close_in_other_equations(
    run: Run, hill_reference: type[HillReference]
) -> None:
    reference = hill_reference((7.8, 6.0, 5.1), 9.62e-5, semi_major_axis_km=23458.0)
    rows = run.rows("spatial_members")
    assert [row["z_km"] for row in rows] == [20.0, 40.0]
    x = np.zeros((6, len(rows)))
    x[0], x[4] = ([row[key] for row in rows] for key in ("x0", "vy0"))
    x[2] = [row["z_km"] / reference.length_km for row in rows]
    half = 0.5 * np.array([row["period"] for row in rows])
    end = reference.flow(x, half)
    # y, vx, vz vanish after half a period
    assert np.max(np.abs(end[[1, 3, 5]])) < 1e-8


def test_the_ephemeris_is_about_mars(run: Run) -> None:
    (path,) = sorted((run.directory / "files" / "ephemerides").glob("*.oem"))
    (segment,) = read_oem(path.read_text("utf-8"))
    assert (segment.center_name, segment.ref_frame) == ("MARS", "ICRF")
    distance = np.linalg.norm(segment.x[:3], axis=0) / 1e3
    # 30 km along the line from Mars, twice that and a little more along the orbit
    assert np.all(np.abs(distance - 23458.0) < 32.0)


def test_its_page_works_in_a_browser(run: Run) -> None:
    check_page(run.directory)
