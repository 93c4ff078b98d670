"""A mission nobody has tuned: axes, μ, amplitudes and resonances drawn at random.

The draw is seeded by the release, so that every release meets a new body and a failure can be
repeated. Everything is held against the independent integrator of this folder.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

import hillsphere
from hillsphere.products import PeriodicOrbits, load_product

if TYPE_CHECKING:
    from tests.missions.conftest import HillReference, Orbits

Array = NDArray[np.float64]

PRIMARY_GM = 42828.37  # km³/s², Mars
SEMI_MAJOR_AXIS = 9377.0  # km, Phobos
GRID = 24

MISSION = """
format = 1
name = "random-moon"
title = "Planar quasi-satellite orbits around a moon drawn at random"
seed = 1

[body.moon]
type = "moon"
name = "moon"
primary_gm_km3_s2 = {primary}
semi_major_axis_km = {semi_major_axis}

[gravity.moon]
type = "ellipsoid"
axes_km = {axes}
gm_km3_s2 = {mu!r}

[plant.hill]
type = "hill"
body = "moon"
gravity = "moon"

[stage.family]
type = "qso_family"
plant = "hill"
x_amplitudes_km = {amplitudes}

[stage.bifurcations]
type = "bifurcations"
plant = "hill"
needs = {{ family = "family" }}
vertical = {vertical}
planar = {planar}
"""


@dataclass(frozen=True)
class Draw:
    """A moon and what is asked about its QSOs."""

    axes_km: tuple[float, float, float]
    mu: float
    amplitudes_km: tuple[float, ...]
    vertical: tuple[int, ...]
    planar: tuple[int, ...]

    @property
    def mission(self) -> str:
        """The mission file."""
        return MISSION.format(
            primary=PRIMARY_GM,
            semi_major_axis=SEMI_MAJOR_AXIS,
            axes=list(self.axes_km),
            mu=self.mu,
            amplitudes=list(self.amplitudes_km),
            vertical=json.dumps([f"1:{n}" for n in self.vertical]),
            planar=json.dumps([f"1:{n}" for n in self.planar]),
        )


def draw(text: str) -> Draw:
    """Draw a moon from a text.

    Longest axis 8-16 km towards the primary, each further axis 0.6-1 of the one before,
    μ = 3e-4…3e-3 km³/s²; amplitudes from clear of the surface (1.3 of the longest axis, 0.9 of the
    Hill length) to five Hill lengths, in no order. Within these bounds the family exists and its
    x amplitude determines the member (checked for 150 draws with the reference). Resonances from
    1:8 (vertical) and 1:4 (planar) on stay away from the extrema of the indices, where two roots
    may lie closer than the reference's grid.
    """
    rng = np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big"))
    a = rng.uniform(8.0, 16.0)
    b = a * rng.uniform(0.6, 1.0)
    c = b * rng.uniform(0.6, 1.0)
    mu = float(np.exp(rng.uniform(np.log(3e-4), np.log(3e-3))))
    length = np.cbrt(mu * SEMI_MAJOR_AXIS**3 / PRIMARY_GM)
    low, high = max(1.3 * a, 0.9 * length), 5.0 * length
    # One near each end: the resonances are asked for between the outermost.
    ratio = high / low
    ends = [low * ratio ** rng.uniform(0.0, 0.1), low * ratio ** rng.uniform(0.9, 1.0)]
    between = list(low * ratio ** rng.uniform(0.1, 0.9, 3))
    return Draw(
        axes_km=(float(a), float(b), float(c)),
        mu=mu,
        amplitudes_km=tuple(float(x) for x in rng.permutation(ends + between)),
        vertical=tuple(int(n) for n in rng.choice(np.arange(8, 25), 3, replace=False)),
        planar=tuple(int(n) for n in rng.choice(np.arange(4, 10), 3, replace=False)),
    )


@dataclass(frozen=True)
class Outcome:
    """The draw, what the mission made of it, and what the reference says."""

    draw: Draw
    reference: HillReference
    expected: Orbits
    tables: dict[str, Any]
    orbits: PeriodicOrbits


@pytest.fixture(scope="module")
def outcome(
    hill_reference: type[HillReference], tmp_path_factory: pytest.TempPathFactory
) -> Outcome:
    """Run the mission that this release draws, once."""
    drawn = draw(hillsphere.__version__)
    directory: Path = tmp_path_factory.mktemp("random")
    (directory / "random.toml").write_text(drawn.mission, "utf-8")
    mission = hillsphere.load_mission(str(directory / "random.toml"))
    hillsphere.run_mission(mission, out=directory / "run", use_cache=False)
    summary = json.loads((directory / "run" / "summary.json").read_text("utf-8"))
    assert not summary["failures"], (drawn, summary["failures"])
    family = load_product(directory / "run" / "family.npz")
    reference = hill_reference(drawn.axes_km, drawn.mu, PRIMARY_GM, SEMI_MAJOR_AXIS)
    return Outcome(
        draw=drawn,
        reference=reference,
        expected=reference.orbits(drawn.amplitudes_km),
        tables=summary["tables"],
        orbits=family if isinstance(family, PeriodicOrbits) else family.members,
    )


def test_table_1(outcome: Outcome) -> None:
    rows = outcome.tables["table_1"]["rows"]
    assert len(rows) == len(outcome.draw.amplitudes_km), outcome.draw
    expected = outcome.expected
    speed = outcome.reference.speed_m_s
    for i, x0 in enumerate(outcome.draw.amplitudes_km):
        row = min(rows, key=lambda candidate: abs(candidate["x0_km"] - x0))
        assert row["x0_km"] == pytest.approx(x0, rel=1e-12)
        for name, value, tolerance in (
            ("vy0", expected.vy0[i], 1e-11),
            ("period", expected.period[i], 1e-11),
            ("jacobi", expected.jacobi[i], 1e-11),
            ("y_max_km", expected.y_max_km[i], 1e-10),
            ("b_planar", expected.b_planar[i], 1e-9),
            ("b_vertical", expected.b_vertical[i], 1e-9),
            ("vy_m_s", -expected.vy0[i] * speed, 1e-11),
            ("vx_m_s", expected.vx_at_y_max[i] * speed, 1e-10),
            ("period_h", expected.period[i] / outcome.reference.mean_motion / 3600, 1e-11),
        ):
            near = pytest.approx(value, rel=tolerance, abs=tolerance)
            assert row[name] == near, (name, x0, outcome.draw)


def test_closure_and_determinant(outcome: Outcome) -> None:
    orbits, reference = outcome.orbits, outcome.reference
    unit = np.array([reference.length_km * 1e3] * 3 + [reference.speed_m_s] * 3)[:, None]
    x, period = orbits.x0 / unit, orbits.period_s * reference.mean_motion
    assert np.abs(reference.flow(x, period) - x).max() <= 1e-11, outcome.draw
    determinant = np.linalg.det(orbits.monodromy.transpose(2, 0, 1))
    assert np.abs(determinant - 1).max() <= 1e-8, outcome.draw


def test_all_bifurcations_and_no_others(outcome: Outcome) -> None:
    """Between the outermost amplitudes, by sign changes on the reference's own curve."""
    low, high = min(outcome.draw.amplitudes_km), max(outcome.draw.amplitudes_km)
    grid = np.geomspace(low, high, GRID)
    curve = outcome.reference.orbits(grid, rtol=1e-8, accuracy=1e-6)
    rows = outcome.tables["bifurcations"]["rows"]
    for plane, numbers in (("vertical", outcome.draw.vertical), ("planar", outcome.draw.planar)):
        index = curve.b_vertical if plane == "vertical" else curve.b_planar
        for n in numbers:
            expected = int(np.count_nonzero(np.diff(np.sign(index - 2 * np.cos(2 * np.pi / n)))))
            found = [
                row["x0_km"]
                for row in rows
                if (row["plane"], row["resonance"]) == (plane, f"1:{n}")
                and low <= row["x0_km"] <= high
            ]
            assert len(found) == expected, (plane, n, outcome.draw)


def test_bifurcations_meet_their_resonance(outcome: Outcome) -> None:
    low, high = min(outcome.draw.amplitudes_km), max(outcome.draw.amplitudes_km)
    rows = [r for r in outcome.tables["bifurcations"]["rows"] if low <= r["x0_km"] <= high]
    assert rows, outcome.draw
    orbits = outcome.reference.orbits([row["x0_km"] for row in rows])
    for i, row in enumerate(rows):
        index = orbits.b_vertical if row["plane"] == "vertical" else orbits.b_planar
        resonance = 2 * np.cos(2 * np.pi * row["d"] / row["n"])
        assert index[i] == pytest.approx(resonance, abs=1e-9), (row, outcome.draw)
        assert row["b"] == pytest.approx(resonance, abs=1e-9), (row, outcome.draw)
        assert row["period"] == pytest.approx(orbits.period[i], rel=1e-11), (row, outcome.draw)
