"""Plants for guidance: free space with a uniform field, and Phobos with its landings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.interfaces import GuidanceTask, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, constant

DATA = Path(__file__).parents[3] / "missions" / "data"


class Uniform:
    """Motion along axes in a uniform field, whose accelerations are commanded."""

    frame = "uniform"
    scales = Scales(length_m=1000.0, time_s=100.0)

    def __init__(self, field: tuple[float, ...]) -> None:
        names = "xyz"[: len(field)]
        self.field = field
        self.states = (
            *(Variable(q, 1) for q in names),
            *(Variable(f"v{q}", 1, -1) for q in names),
        )
        self.controls = tuple(Variable(f"a{q}", 1, -2) for q in names)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return none."""
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return velocities, then field and command."""
        d = len(self.field)
        return (*x[d:], *(constant(g) + a for g, a in zip(self.field, u, strict=True)))

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return none."""
        return {}


@pytest.fixture(scope="session")
def line() -> Uniform:
    """Return one axis, no field."""
    return Uniform((0.0,))


@pytest.fixture(scope="session")
def uniform() -> Uniform:
    """Return three axes, gravity along −z."""
    return Uniform((0.0, 0.0, -0.02))


@pytest.fixture(scope="session")
def phobos() -> Any:
    """Return the elliptic three-body problem about Phobos, degree-4 field, locked."""
    body = create(
        "body",
        "moon",
        name="phobos",
        primary_gm_m3_s2=4.282837362069909e13,
        semi_major_axis_km=9376.0,
        eccentricity=0.0151,
        semi_axes_km=(13.03, 11.40, 9.14),
    )
    gravity = create("gravity", "harmonics", file=str(DATA / "phobos-gravity-degree4.gfc"))
    return create("plant", "three_body", body=body, gravity=gravity, orbit="elliptic")


@pytest.fixture(scope="session")
def landing() -> GuidanceTask:
    """Go from rest near L1 to latitude 12°, longitude 25°, at 0.5 m/s, in 133 minutes."""
    axes = np.array([13030.0, 11400.0, 9140.0])
    lat, lon = np.radians([12.0, 25.0])
    way = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    place = way / np.sqrt(np.sum((way / axes) ** 2))
    up = place / axes**2
    up /= np.linalg.norm(up)
    start = np.array([16560.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    return GuidanceTask(start, place, -0.5 * up, 7980.0, up=up)
