"""Random grazing flights about a body: no event between the ends of steps is missed.

The surface of each case is put so that the exact flight comes to a given excess of it: the
flight is computed by SciPy's DOP853, all cases at once, its closest approach is refined on the
dense output, and the size of the body, a run-time parameter, follows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hillsphere import create
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array, Integers, Parameter, Variable
from hillsphere.model.bodies import Moon, MoonSpec
from hillsphere.simulation import Cases, Flights, Limit, Simulator
from hillsphere.spec import Ref
from hillsphere.symbolic import Expr, Params
from hillsphere_gravity.polyhedron import Polyhedron
from hillsphere_plants.hill import ArrayHill, Hill
from hillsphere_plants.specs import HillSpec

GM = 7.0875e5
AXES = np.array([13030.0, 11400.0, 9140.0])
PERIOD, SAMPLES = 60.0, 4
GRID = 1000
"""Points of a sample at which the exact flight is looked at."""
SIZE_M = 13e3
"""By which a position is divided where a value is told without dimension."""


class Sized:
    """A plant about a body whose surface is scaled from case to case."""

    def _own_parameters(self) -> tuple[Parameter, ...]:
        return (*super()._own_parameters(), Parameter("size", 1.0))  # type: ignore[misc]

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        found = dict(super().events(x, t, p))  # type: ignore[misc]
        # The level is a quadric for the ellipsoid, linear in the distance for the polyhedron.
        found["impact"] = (found["impact"] + 1.0) / p["size"] - 1.0
        return found


class SizedHill(Sized, Hill):
    pass


class SizedArrayHill(Sized, ArrayHill):
    pass


@dataclass(frozen=True)
class World:
    """A plant, its pull (3, N) → (3, N) and its level (3, N) → (N,) by formulas of this test."""

    plant: Hill | ArrayHill
    pull: Callable[[Array], Array]
    level: Callable[[Array], Array]


def ellipsoid_world() -> World:
    gravity = create("gravity", "point_mass", gm_m3_s2=GM)
    plant = SizedHill(HillSpec(body=Ref("moon", moon()), gravity=Ref("gravity", gravity)))
    return World(
        plant,
        lambda r: -GM * r / np.sum(r * r, axis=0) ** 1.5,
        lambda r: np.sum((r / AXES[:, None]) ** 2, axis=0) - 1.0,
    )


def polyhedron_world() -> World:
    """Return an icosahedron deformed to these axes: 20 faces, gravity and surface of arrays."""
    shape = create("shape", "ellipsoid", axes_m=tuple(AXES))
    gravity = create(
        "gravity", "polyhedron", shape=Ref("shape", shape), subdivisions=0, gm_m3_s2=GM
    )
    assert isinstance(gravity, Polyhedron)
    bare = Moon(MoonSpec(primary_gm_m3_s2=4.282837e13, semi_major_axis_m=9377e3))
    plant = SizedArrayHill(HillSpec(body=Ref("moon", bare), gravity=Ref("gravity", gravity)))
    field, mesh = GravityField(gravity), gravity.mesh

    def level(r: Array) -> Array:
        # Convex: the farthest of the planes of its faces.
        return np.asarray(np.max(mesh.normals.T @ r / mesh.heights[:, None], axis=0) - 1.0)

    return World(plant, field.acceleration, level)


def moon() -> Moon:
    return Moon(
        MoonSpec(primary_gm_m3_s2=4.282837e13, semi_major_axis_m=9377e3, semi_axes_m=tuple(AXES))
    )


class Coasting:
    """No command; the base of the laws of this study, which tell their command to the reference."""

    actuation: Literal["hold", "impulse"] = "hold"
    period_s = PERIOD

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def command(self, k: int, y: Array) -> Array:
        return np.zeros((3, y.shape[1]))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return self.command(k, y), xc


class Held(Coasting):
    """A braking acceleration up to 1 cm/s², which turns from sample to sample."""

    def command(self, k: int, y: Array) -> Array:
        turning = np.array([[np.cos(2.0 * k)], [np.sin(2.0 * k)], [0.3]])
        return np.asarray(-1e-4 * y[3:6] + 4e-3 * turning)


class Kicks(Held):
    """Some m/s at each sample."""

    actuation: Literal["hold", "impulse"] = "impulse"

    def command(self, k: int, y: Array) -> Array:
        return 300.0 * super().command(k, y)


class Filtered:
    """A filtered velocity is braked; affine where its measurement is held."""

    inputs, period_s, gain = 6, PERIOD, 1e-4
    states = (Variable("fx", 1, -1), Variable("fy", 1, -1), Variable("fz", 1, -1))

    def __init__(self, measurement: Literal["held", "continuous"], pole_rad_s: float) -> None:
        self.measurement, self.pole = measurement, pole_rad_s

    def initial(self, n_cases: int) -> Array:
        return np.zeros((3, n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        return xc

    def derivative(self, xc: Any, y: Any, ref: Any, t: Any) -> tuple[Any, ...]:
        return tuple(self.pole * (y[3 + i] - xc[i]) for i in range(3))

    def control(self, xc: Any, y: Any, ref: Any, t: Any) -> tuple[Any, ...]:
        return tuple(-self.gain * q for q in xc)


Law = Coasting | Filtered
Value = Callable[[Array, Array], Array]
"""Times and states (6, ...) → values (...)."""


class Path:
    """A sample of exact flights, from SciPy's dense output."""

    def __init__(self, sol: Any, rows: int, count: int) -> None:
        self._sol, self._rows, self._count = sol, rows, count
        self._knots = np.asarray(sol.ts)
        parts = sol.interpolants
        self._f = np.array([q.F.reshape(-1, rows, count)[:, :6] for q in parts])
        self._y = np.array([q.y_old.reshape(rows, count)[:6] for q in parts])

    def on_grid(self, t: Array) -> Array:
        """Return the states (6, N, T) at times (T,)."""
        return np.asarray(self._sol(t).reshape(self._rows, self._count, -1)[:6])

    def at(self, t: Array) -> Array:
        """Return the states (6, N) of each case at a time of its own (N,)."""
        part = np.clip(np.searchsorted(self._knots, t, "right") - 1, 0, len(self._y) - 1)
        lane = np.arange(self._count)
        x = (t - self._knots[part]) / np.diff(self._knots)[part]
        f, y = self._f[part, :, :, lane], np.zeros((self._count, 6))
        for i in range(f.shape[1]):  # Dop853DenseOutput, SciPy 1.11
            y += f[:, -1 - i]
            y *= (x if i % 2 == 0 else 1.0 - x)[:, None]
        return np.asarray((y + self._y[part, :, lane]).T)


def exact_flights(world: World, law: Law, x0: Array) -> list[Path]:
    """Fly each sample by DOP853."""
    n = world.plant.mean_motion_rad_s
    count = x0.shape[1]
    y = x0 if isinstance(law, Coasting) else np.concatenate([x0, law.initial(count)])
    flights = []
    for k in range(SAMPLES):
        u = np.zeros((3, count))
        if isinstance(law, Coasting):
            u = law.command(k, y)
            if law.actuation == "impulse":
                y, u = np.concatenate([y[:3], y[3:] + u]), np.zeros_like(u)
        seen = y[:6].copy()

        def rate(t: float, flat: Array, u: Array = u, seen: Array = seen) -> Array:
            s = flat.reshape(-1, count)
            r, v = s[:3], s[3:6]
            if isinstance(law, Filtered):
                u = -law.gain * s[6:]
            a = world.pull(r) + u
            a[0] += 2.0 * n * v[1] + 3.0 * n * n * r[0]
            a[1] -= 2.0 * n * v[0]
            a[2] -= n * n * r[2]
            rows = [v, a]
            if isinstance(law, Filtered):
                told = seen if law.measurement == "held" else s
                rows.append(law.pole * (told[3:6] - s[6:]))
            return np.concatenate(rows).reshape(-1)

        found = solve_ivp(
            rate, (0.0, PERIOD), y.reshape(-1), method="DOP853", rtol=1e-11, atol=1e-9,
            max_step=10.0, dense_output=True,
        )  # fmt: skip
        flights.append(Path(found.sol, len(y), count))
        y = found.y[:, -1].reshape(len(y), count)
    return flights


class Approach:
    """The closest approach of exact flights in terms of a value, and when they first meet it."""

    def __init__(self, value: Value, flights: list[Path]) -> None:
        self._value, self._flights = value, flights
        grid = self._grid = np.linspace(0.0, PERIOD, GRID + 1)
        values = np.array(
            [value(k * PERIOD + grid, f.on_grid(grid)) for k, f in enumerate(flights)]
        )
        self._flat = values[:, :, :-1].transpose(1, 0, 2).reshape(values.shape[1], -1)
        number = self._flat.argmin(axis=1)
        self.inner = (number > 2) & (number < SAMPLES * GRID - 3)
        lo, hi = (np.clip(number + j, 0, SAMPLES * GRID) * grid[1] for j in (-1, 1))
        self.at = number * grid[1]
        self.least, self.start = self._flat.min(axis=1), self._flat[:, 0]
        for _ in range(5):
            step = (hi - lo) / 10.0
            times = lo + step * np.arange(11)[:, None]
            near = np.array([self._of(t) for t in times])
            best = near.argmin(axis=0)
            self.at = times[best, np.arange(len(best))]
            self.least = np.minimum(self.least, near.min(axis=0))
            lo, hi = np.maximum(lo, self.at - step), np.minimum(hi, self.at + step)

    def _of(self, t: Array) -> Array:
        """Return the values (N,) at times (N,)."""
        sample = np.clip(t // PERIOD, 0, SAMPLES - 1).astype(int)
        out = np.empty_like(t)
        for k in np.unique(sample):
            mine = sample == k
            x = self._flights[k].at(np.where(mine, t - k * PERIOD, 0.0))
            out[mine] = self._value(t, x)[mine]
        return out

    def first(self, threshold: Array) -> tuple[Array, Array]:
        """Return when the value first falls to a threshold (N,), NaN if never, and its slope."""
        below = self._flat <= threshold[:, None]
        hit = below.any(axis=1)
        meets = hit | (self.least <= threshold)
        right = np.where(hit, below.argmax(axis=1) * self._grid[1], self.at)
        # Between grid points the closest approach is the only one that falls below.
        right = np.where(hit & (self.at < right) & (self.least <= threshold), self.at, right)
        left = np.maximum(right - self._grid[1], 0.0)
        for _ in range(45):
            middle = 0.5 * (left + right)
            above = self._of(middle) > threshold
            left, right = np.where(above, middle, left), np.where(above, right, middle)
        slope = (self._of(right + 1e-3) - self._of(np.maximum(right - 1e-3, 0.0))) / 2e-3
        return np.where(meets, right, np.nan), np.abs(slope)


def draw_starts(number: int, seed: int) -> Array:
    """Return chords whose closest approach to the body lies within the flight."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(3, number))
    way /= np.linalg.norm(way, axis=0)
    across = np.cross(way, rng.normal(size=(3, number)), axis=0)
    across /= np.linalg.norm(across, axis=0)
    speed = rng.uniform(30.0, 90.0, number)
    before = rng.uniform(40.0, SAMPLES * PERIOD - 60.0, number)
    r = rng.uniform(1.0, 1.4, number) * 1.1 * AXES.max() * way
    return np.concatenate([r - across * speed * before, speed * across])


def excesses(number: int, seed: int) -> Array:
    """Return excesses of 1 mm to 100 m over and under the surface, without dimension."""
    rng = np.random.default_rng(seed + 1)
    return np.asarray(
        rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(-3.0, 2.0, number) / SIZE_M
    )


@dataclass(frozen=True)
class Study:
    """What a study found: how the flights ended, and how the exact ones do."""

    flights: Flights
    meets: NDArray[np.bool_]
    first: Array
    time_error: Array
    slope: Array
    excess: Array

    @property
    def status(self) -> Array:
        return np.array(self.flights.status)


def surface(world: World) -> Value:
    def value(t: Array, x: Array) -> Array:
        return world.level(x[:3].reshape(3, -1)).reshape(x.shape[1:])

    return value


def compared(flights: Flights, approach: Approach, threshold: Array, use: Array) -> Study:
    first, slope = (q[use] for q in approach.first(threshold))
    allowed = 1e-6 + 1e-10 / np.maximum(slope, 1e-12)
    excess = (approach.least - threshold)[use]
    return Study(flights, excess < 0.0, first, allowed, slope, excess)


def study(world: World, law: Law, substeps: int, number: int, seed: int) -> Study:
    """Fly grazing flights and compare them with the exact ones."""
    x0 = draw_starts(number, seed)
    approach = Approach(surface(world), exact_flights(world, law, x0))
    size = (approach.least + 1.0) / (1.0 + excesses(number, seed))
    use = approach.inner & (approach.start > size - 1.0)
    # The others begin or end at their closest.
    assert np.count_nonzero(use) > 0.7 * number
    loop = Simulator(world.plant, law, run_time=["size"], substeps=substeps)
    flights = loop.fly(Cases(x0[:, use], p=size[None, use]), SAMPLES)
    return compared(flights, approach, size - 1.0, use)


def study_limit(
    bound: Mapping[str, Any], speed: Array, substeps: int, number: int, seed: int
) -> Study:
    """Fly past a sphere whose centre moves at a velocity (3,), a limit of radius by case."""
    world, law = ellipsoid_world(), Held()
    x0 = draw_starts(number, seed)

    def distance(t: Array, x: Array) -> Array:
        away = [x[i] - speed[i] * t for i in range(3)]
        return np.asarray(np.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2) / SIZE_M)

    approach = Approach(distance, exact_flights(world, law, x0))
    radius = approach.least - excesses(number, seed)
    use = approach.inner & (approach.start > radius)
    kept = radius[use]

    def value(t: Array, x: Array, cases: Integers) -> Array:
        return np.asarray(distance(t, x) - kept[cases])

    loop = Simulator(world.plant, law, run_time=["size"], substeps=substeps)
    small = np.full((1, len(kept)), 0.01)
    limit = Limit("sphere", value, **bound)
    flights = loop.fly(Cases(x0[:, use], p=small), SAMPLES, limits=[limit])
    return compared(flights, approach, radius, use)


def check(found: Study, status: str = "impact") -> None:
    """Demand that none is missed, at most 5 % are not resolved, and times agree."""
    assert np.mean(found.status == "unresolved") <= 0.05
    check_decided(found, status)


def check_decided(found: Study, status: str) -> None:
    """Demand that what is decided is decided rightly."""
    open_ = found.status == "unresolved"
    assert 0.3 < np.mean(found.meets) < 0.7
    assert_array_equal(found.status[found.meets & ~open_], status)
    assert_array_equal(found.status[~found.meets & ~open_], "completed")
    met = found.meets & ~open_
    late = np.abs(found.flights.time_s - found.first)
    assert (late[met] <= found.time_error[met]).all()


# A few flights of each kind always, a thousand before a release.
FLIGHTS = [100, pytest.param(1000, marks=pytest.mark.slow)]


@pytest.mark.parametrize("number", FLIGHTS)
@pytest.mark.parametrize(
    ("law", "substeps"),
    [
        (Coasting(), 1), (Coasting(), 40), (Kicks(), 2), (Held(), 1), (Held(), 6),
        (Filtered("held", 0.3), 6), (Filtered("held", 0.3), 40),
        pytest.param(Filtered("continuous", 0.1), 6, marks=pytest.mark.slow),
    ],
    ids=lambda q: None if isinstance(q, int) else type(q).__name__,
)  # fmt: skip
def test_grazing_an_ellipsoid_in_hill_s_problem(law: Law, substeps: int, number: int) -> None:
    check(study(ellipsoid_world(), law, substeps, number, 7))


@pytest.mark.parametrize("number", FLIGHTS)
@pytest.mark.parametrize(
    ("law", "substeps"),
    [(Coasting(), 1), pytest.param(Kicks(), 2, marks=pytest.mark.slow), (Held(), 6),
     pytest.param(Filtered("held", 0.3), 40, marks=pytest.mark.slow)],
)  # fmt: skip
def test_grazing_a_polyhedron_with_array_gravity(law: Law, substeps: int, number: int) -> None:
    check(study(polyhedron_world(), law, substeps, number, 11))


STEEPNESS = [1.0 / SIZE_M] * 3 + [0.0] * 3
FASTEST_M_S = 100.0 * 3.0**0.5
"""Bound of the sum of the components of the velocity, by which such a limit is proved."""


@pytest.mark.parametrize(
    ("speed", "substeps"),
    [
        (25.0, 1),
        pytest.param(0.0, 1, marks=pytest.mark.slow),
        pytest.param(25.0, 6, marks=pytest.mark.slow),
        pytest.param(25.0, 40, marks=pytest.mark.slow),
    ],
)
def test_grazing_a_limit_with_a_slope(speed: float, substeps: int) -> None:
    """A sphere at rest; one that moves, whose value drifts by its speed.

    Where nothing but the slope is bounded, a crossing thirty times flatter than the bound is not
    told from a touch: a dip of less than some ten metres may stay open, and an approach to less
    than a metre.
    """
    velocity = speed * np.array([0.6, -0.8, 0.0])
    bound = {"lipschitz": STEEPNESS, "drift": 1.000001 * speed / SIZE_M}
    found = study_limit(bound, velocity, substeps, 64, 13)
    check_decided(found, "constraint")
    open_ = found.status == "unresolved"
    steep = found.slope > (FASTEST_M_S + speed) / SIZE_M / 32.0
    assert not (open_ & found.meets & steep).any()
    assert not (open_ & (found.excess > 1.0 / SIZE_M)).any()


def test_a_limit_without_bound_is_left_open_near_zero() -> None:
    """1.5 s apart the value changes by 0.02, so that no dip from the margin of 0.1 is unseen."""
    found = study_limit({}, np.zeros(3), 40, 64, 17)
    ends = found.status[found.meets]
    assert np.isin(ends, ["constraint", "unresolved"]).all()
    assert_array_equal(found.status[~found.meets], "unresolved")
