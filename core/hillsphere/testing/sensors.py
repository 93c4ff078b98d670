"""Checks of sensors: measurements, error model, and independence of lanes."""

from __future__ import annotations

from typing import TypeAlias, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.errors import HillsphereError
from hillsphere.interfaces import Array, Channel, Scene, Sensor, StationSensor
from hillsphere.testing.contract import require

__all__ = ["check_sensor"]

_DRAWS = 4000
"""Draws of the noise for each state: σ estimated from the median (37 % efficient) errs by 1.8 %."""
_MEASURED = 4
"""States at which the noise is examined; each costs `_DRAWS` evaluations."""
_KINDS = get_args(get_type_hints(Channel)["kind"])
_TO_SIGMA = 1.482602218505602
"""Ratio of the standard deviation of a normal number to its median absolute deviation,
1/Φ⁻¹(3/4)."""

Booleans: TypeAlias = NDArray[np.bool_]


def check_sensor(
    sensor: Sensor, x: Array, t_s: Array, scene: Scene, *, tol: float = 1e-12, spread: float = 0.1
) -> None:
    """Check a sensor.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    x : ndarray, shape (n, N)
        States, SI, N ≥ 8; some of them must be visible.
    t_s : ndarray, shape (N,)
        Their times, s.
    scene : Scene
        Scene with all entries that the sensor needs.
    tol : float
        Largest relative difference between a lane and the same lane in another place.
    spread : float
        Largest relative difference between the declared standard deviations and those of its
        measurements, over 4000 draws.

    Raises
    ------
    ContractViolation
        Unless

        - its channels have different names, each a unit and a known kind, and angles are in rad;
        - true and measured values are (m, N), finite except where nothing is measured; angles lie
          within [−π, 2π) and directions have unit length;
        - lanes that are not visible are not measured, missing measurements are NaN in all rows, and
          at least one lane is measured;
        - measurements depend on the declared numbers of normal numbers;
        - without constant errors of the case, the measurements of one state scatter with the
          standard deviation `sigma` (estimated from medians, so that outliers do not count), and
          angles and numbers are independent of each other;
        - the same call gives the same bits, and no argument is changed;
        - each lane's result depends on that lane only;
        - an empty scene is refused with a `HillsphereError`; if the sensor states in ``takes`` the
          entries that it needs, they suffice, and a scene without any one of them is refused by
          `observe` or `visible` with a `HillsphereError` that names the entry;
        - a sensor of a ground station gives one believed station per case, and its `bias` is the
          median of its errors.
    """
    what = type(sensor).__name__
    require(isinstance(sensor, Sensor), f"{what} is no Sensor: see hillsphere.interfaces.Sensor")
    rows = _check_channels(what, sensor.channels)
    require(
        len(sensor.draws) == 2 and all(isinstance(k, int) and k >= 0 for k in sensor.draws),
        f"{what}: draws must be two numbers ≥ 0, got {sensor.draws!r}",
    )
    cases = np.shape(t_s)[0]
    require(cases >= 8, f"{what}: a check needs at least 8 states, got {cases}")
    random = np.random.default_rng(17)
    constant, noise = (random.normal(size=(k, cases)) for k in sensor.draws)
    results = _everything(what, sensor, x, t_s, scene, constant, noise)
    true, visible, sigma, measured = results
    _check_values(what, sensor.channels, true, "observe")
    require(
        sigma.shape == (rows, cases) and np.isfinite(sigma).all() and (sigma >= 0.0).all(),
        f"{what}: sigma must be {(rows, cases)}, finite and not negative",
    )
    require(
        visible.shape == (cases,) and visible.dtype == np.bool_,
        f"{what}: visible must be ({cases},) of bool, is {visible.shape} of {visible.dtype}",
    )
    require(
        measured.shape == (rows, cases), f"{what}: measure must be {(rows, cases)}, "
        f"is {measured.shape}",
    )  # fmt: skip
    missing = np.isnan(measured)
    there = ~missing.any(axis=0)
    require(
        np.array_equal(there, ~missing.all(axis=0)),
        f"{what}: a measurement is NaN in some rows only; where nothing is measured all are",
    )
    require(not (there & ~visible).any(), f"{what} measures what is not visible; that must be NaN")
    require(there.any(), f"{what} measures nothing of all these states; give it some that it sees")
    _check_values(what, sensor.channels, measured[:, there], "measure")
    _check_lanes(what, sensor, (x, t_s, scene, constant, noise), results, tol, random)
    if scene:
        _check_empty_scene(what, sensor, x, t_s)
    if hasattr(sensor, "takes"):
        _check_taken_entries(what, sensor, sensor.takes, x, t_s, scene)
    for lane in np.flatnonzero(there)[:_MEASURED]:
        _check_errors(what, sensor, x[:, lane], t_s[lane], _at(scene, lane, cases), spread, random)


def _check_channels(what: str, channels: tuple[Channel, ...]) -> int:
    names = [channel.name for channel in channels]
    require(names and len(set(names)) == len(names), f"{what}: names of channels repeat: {names}")
    for channel in channels:
        require(
            channel.kind in _KINDS,
            f"{what}: kind of channel {channel.name!r} must be one of {', '.join(_KINDS)}, got "
            f"{channel.kind!r}",
        )
        require(
            channel.kind != "angle" or channel.unit == "rad",
            f"{what}: the angle {channel.name!r} must be in rad, is in {channel.unit!r}",
        )
    return sum(channel.rows for channel in channels)


def _check_values(what: str, channels: tuple[Channel, ...], values: Array, of: str) -> None:
    rows = sum(channel.rows for channel in channels)
    require(
        values.ndim == 2 and values.shape[0] == rows and np.isfinite(values).all(),
        f"{what}: {of} must be ({rows}, N) and finite, is {values.shape}",
    )
    row = 0
    for channel in channels:
        own = values[row : row + channel.rows]
        row += channel.rows
        if channel.kind == "angle":
            require(
                (own >= -np.pi).all() and (own < 2.0 * np.pi).all(),
                f"{what}: {of}: the angle {channel.name!r} must lie within [−π, 2π), got "
                f"{own.min():.4g} to {own.max():.4g}",
            )
        if channel.kind == "direction":
            off = float(np.max(np.abs(np.linalg.norm(own, axis=0) - 1.0)))
            require(
                off < 1e-9, f"{what}: {of}: the direction {channel.name!r} is no unit vector "
                f"(by {off:.1e})",
            )  # fmt: skip


def _everything(
    what: str, sensor: Sensor, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array
) -> tuple[Array, Booleans, Array, Array]:
    """Call all functions of a sensor twice; check that results repeat and arguments stay."""
    arguments = (x, t_s, *scene.values(), constant, noise)
    before = [a.copy() for a in arguments]
    answers = []
    for _ in range(2):
        try:
            measured = sensor.measure(x, t_s, scene, constant, noise)
        except (IndexError, ValueError) as error:
            require(
                False,
                f"{what}: measure fails with {len(constant)} and {len(noise)} numbers drawn, as "
                f"draws = {sensor.draws} says: {error}",
            )
        answers.append(
            (sensor.observe(x, t_s, scene), sensor.visible(x, t_s, scene),
             sensor.sigma(x, t_s, scene), measured)
        )  # fmt: skip
    for name, one, other in zip(("observe", "visible", "sigma", "measure"), *answers, strict=True):
        require(
            np.array_equal(one, other, equal_nan=True), f"{what}: the same call of {name} differs"
        )
    for a, b in zip(arguments, before, strict=True):
        require(np.array_equal(a, b, equal_nan=True), f"{what} changes an argument")
    return answers[0]


def _check_lanes(
    what: str,
    sensor: Sensor,
    arguments: tuple[Array, Array, Scene, Array, Array],
    results: tuple[Array, Booleans, Array, Array],
    tol: float,
    random: np.random.Generator,
) -> None:
    x, t_s, scene, constant, noise = arguments
    order = random.permutation(t_s.size)
    moved = {name: _at(scene, order, t_s.size)[name] for name in scene}
    there = _everything(
        what, sensor, x[:, order], t_s[order], moved, constant[:, order], noise[:, order]
    )
    for name, one, other in zip(("observe", "visible", "sigma", "measure"), results, there,
                                strict=True):  # fmt: skip
        here: Array = np.asarray(one[..., order], dtype=float)
        again: Array = np.asarray(other, dtype=float)
        size = max(float(np.nanmax(np.abs(here))), 1e-300)
        same = np.array_equal(np.isnan(here), np.isnan(again))
        worst = float(np.nanmax(np.abs(here - again))) / size
        require(
            same and worst <= tol,
            f"{what}: {name} of a lane depends on its neighbours (by {worst:.1e})",
        )


def _check_empty_scene(what: str, sensor: Sensor, x: Array, t_s: Array) -> None:
    try:
        sensor.observe(x, t_s, {})
    except HillsphereError:
        pass
    except Exception as error:
        require(
            False,
            f"{what}: an empty scene ends in {type(error).__name__}: {error}; raise a "
            "HillsphereError that says what is lacking",
        )


def _check_taken_entries(
    what: str, sensor: Sensor, takes: tuple[str, ...], x: Array, t_s: Array, scene: Scene
) -> None:
    """Check that a sensor needs each entry of the scene that it states, and no other."""
    absent = [name for name in takes if name not in scene]
    require(not absent, f"{what} takes {absent} from the scene; give the check a scene with them")
    own = {name: scene[name] for name in takes}
    refused = _refusal(what, sensor, x, t_s, own)
    require(
        refused is None,
        f"{what}: a scene of what it takes, {list(takes)}, is refused: {refused}; state every "
        "entry that it needs in takes",
    )
    for name in takes:
        refused = _refusal(what, sensor, x, t_s, {n: v for n, v in own.items() if n != name})
        require(
            refused is not None,
            f"{what} takes {name!r} from the scene, but works without it; leave it out of takes, "
            "or refuse a scene that lacks it",
        )
        require(
            repr(name) in str(refused),
            f"{what}: the message about a scene without {name!r} does not name it: {refused}",
        )


def _refusal(
    what: str, sensor: Sensor, x: Array, t_s: Array, scene: Scene
) -> HillsphereError | None:
    """Return the error with which a sensor refuses a scene; None if it works with it."""
    try:
        sensor.observe(x, t_s, scene)
        sensor.visible(x, t_s, scene)
    except HillsphereError as error:
        return error
    except Exception as error:
        require(
            False,
            f"{what}: a scene of {list(scene)} ends in {type(error).__name__}: {error}; raise a "
            "HillsphereError that names what is lacking",
        )
    return None


def _check_errors(
    what: str,
    sensor: Sensor,
    x: Array,
    t_s: float,
    scene: Scene,
    spread: float,
    random: np.random.Generator,
) -> None:
    """Check the scatter of repeated measurements of one state."""
    states, times = np.repeat(x[:, None], _DRAWS, axis=1), np.full(_DRAWS, t_s)
    constant = np.zeros((sensor.draws[0], _DRAWS))
    noise = random.normal(size=(sensor.draws[1], _DRAWS))
    sigma = sensor.sigma(states[:, :1], times[:1], scene)[:, 0]
    true = sensor.observe(states[:, :1], times[:1], scene)
    off = sensor.measure(states, times, scene, constant, noise) - true
    off = off[:, ~np.isnan(off).any(axis=0)]
    linear = []
    row = 0
    for channel in sensor.channels:
        if channel.kind == "angle":
            off[row] = np.remainder(off[row] + np.pi, 2.0 * np.pi) - np.pi
        if channel.kind != "direction":
            linear.append(row)
        row += channel.rows
    if off.shape[1] < _DRAWS // 10:
        return
    middle = np.median(off, axis=1)
    scatter = _TO_SIGMA * np.median(np.abs(off - middle[:, None]), axis=1)
    for k in linear:
        require(
            abs(scatter[k] - sigma[k]) <= spread * sigma[k] + 1e-15 * abs(true[k, 0]),
            f"{what}: row {k} scatters by {scatter[k]:.4g}, sigma says {sigma[k]:.4g}",
        )
    noisy = [k for k in linear if sigma[k] > 0.0]
    ranks = np.argsort(np.argsort(off[noisy], axis=1), axis=1)
    crossed = np.corrcoef(ranks) - np.eye(len(noisy)) if len(noisy) > 1 else np.zeros((1, 1))
    require(
        float(np.max(np.abs(crossed))) < 0.15,
        f"{what}: errors of different rows are correlated ({np.max(np.abs(crossed)):.2f}), which "
        f"sigma cannot say; draws = {sensor.draws} may be too few",
    )
    if isinstance(sensor, StationSensor):
        _check_station(what, sensor, states, times, scene, middle, scatter)


def _check_station(
    what: str,
    sensor: StationSensor,
    states: Array,
    times: Array,
    scene: Scene,
    middle: Array,
    scatter: Array,
) -> None:
    constant = np.zeros((sensor.draws[0], 3))
    told = sensor.believed_stations(constant)
    require(len(told) == 3, f"{what}: {len(told)} believed stations for 3 cases")
    bias = sensor.bias(states[:, :3], times[:3], scene, constant)
    require(
        bias.shape == (2, 3) and np.isfinite(bias).all(),
        f"{what}: bias must be (2, N) and finite, is {bias.shape}",
    )
    # the median of so many draws is known to 1.25 of their scatter over √4000
    off = np.abs(middle - bias[:, 0]) / np.maximum(scatter, 1e-12)
    require(
        float(off.max()) < 0.15,
        f"{what}: the middle of its errors is {middle}, bias says {bias[:, 0]}",
    )


def _at(scene: Scene, lanes: NDArray[np.intp] | np.intp, cases: int) -> dict[str, Array]:
    """Return a scene for some of its lanes; entries common to all lanes are kept."""
    picked = np.atleast_1d(lanes)
    return {
        name: value[..., picked] if value.shape[-1:] == (cases,) else value
        for name, value in scene.items()
    }
