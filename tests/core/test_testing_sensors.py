"""The conformance kit finds what is broken in a sensor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Channel, Scene
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.testing import ContractViolation, check_sensor, example
from hillsphere.time import Epoch

N = 40
SIGMA = np.array([[1e-3], [50.0]])


class Sound:
    """Bearing and distance of a beacon in the plane, and the direction to it, within its reach."""

    channels: Any = (
        Channel("bearing", "rad", "angle"), Channel("range", "m"),
        Channel("direction", "", "direction"),
    )  # fmt: skip
    draws: Any = (1, 4)

    def _away(self, x: Array, scene: Scene) -> Array:
        if "beacon" not in scene:
            raise InputError("the scene lacks 'beacon'")
        return np.asarray(scene["beacon"] - x[:3])

    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        d = self._away(x, scene)
        distance = np.linalg.norm(d, axis=0)
        return np.array([np.arctan2(d[1], d[0]), distance, *(d / distance)])

    def visible(self, x: Array, t_s: Array, scene: Scene) -> Any:
        return self.observe(x, t_s, scene)[1] < 1e6

    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        return np.broadcast_to(np.concatenate([SIGMA, np.full((3, 1), 1e-3)]), (5, x.shape[1]))

    def errors(self, constant: Array, noise: Array) -> Array:
        return np.asarray(SIGMA * noise[:2] + np.array([[0.0], [10.0]]) * constant[0])

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        shown = self.observe(x, t_s, scene)
        shown[:2] += self.errors(constant, noise)
        shown[0] = np.remainder(shown[0] + np.pi, 2.0 * np.pi) - np.pi
        shown[2:] += 1e-3 * np.array([noise[2], noise[3], noise[2]])
        shown[2:] /= np.linalg.norm(shown[2:], axis=0)
        return np.where(self.visible(x, t_s, scene), shown, np.nan)


class NamesRepeat(Sound):
    channels = (Channel("a", "rad", "angle"), Channel("a", "m"), Channel("b", "", "direction"))


class UnknownKind(Sound):
    channels = (Channel("a", "rad", "angel"),)  # type: ignore[arg-type]  # the fault


class Degrees(Sound):
    channels = (Channel("a", "deg", "angle"),)


class DrawsAreNoNumbers(Sound):
    draws = (1,)


class DrawsTooFew(Sound):
    draws = (0, 4)


class DrawsShared(Sound):
    """One number for two errors: a slice of one row is broadcast in silence."""

    def errors(self, constant: Array, noise: Array) -> Array:
        return np.asarray(SIGMA * noise[:1] + np.zeros((2, 1)))


class AnglesNotWrapped(Sound):
    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        found = super().observe(x, t_s, scene)
        found[0] += 2.0 * np.pi
        return found


class MeasuredNotWrapped(Sound):
    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        shown = super().measure(x, t_s, scene, constant, noise)
        shown[0] += 2.0 * np.pi
        return shown


class NoUnitVector(Sound):
    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        found = super().observe(x, t_s, scene)
        found[2:] *= 2.0
        return found


class MeasuresTheHidden(Sound):
    def visible(self, x: Array, t_s: Array, scene: Scene) -> Any:
        return np.zeros(x.shape[1], dtype=bool)

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        return self.observe(x, t_s, scene)


class SeesNothing(Sound):
    def visible(self, x: Array, t_s: Array, scene: Scene) -> Any:
        return np.zeros(x.shape[1], dtype=bool)


class VisibleAsNumbers(Sound):
    def visible(self, x: Array, t_s: Array, scene: Scene) -> Any:
        return super().visible(x, t_s, scene).astype(float)


class HalfMissing(Sound):
    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        shown = super().measure(x, t_s, scene, constant, noise)
        shown[1, ::2] = np.nan
        return shown


class NegativeSigma(Sound):
    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        return -super().sigma(x, t_s, scene)


class SigmaIsVariance(Sound):
    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        return super().sigma(x, t_s, scene) ** 2


class OwnRandomness(Sound):
    def __init__(self) -> None:
        self.random = np.random.default_rng(1)

    def errors(self, constant: Array, noise: Array) -> Array:
        return np.asarray(SIGMA * self.random.normal(size=noise[:2].shape))


class ChangesStates(Sound):
    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        found = super().observe(x, t_s, scene)
        x[0] += 1.0
        return found


class Neighbours(Sound):
    def errors(self, constant: Array, noise: Array) -> Array:
        mixed = noise.copy()
        mixed[0, 0] += noise[0, -1]
        return super().errors(constant, mixed)


class SceneOfHope(Sound):
    def _away(self, x: Array, scene: Scene) -> Array:
        return np.asarray(scene["beacon"] - x[:3])


class Stated(Sound):
    """A sensor that states what it takes from the scene."""

    takes: Any = ("beacon",)


class TakesAnAbsentEntry(Stated):
    takes = ("beacon", "lighthouse")


class TakesMoreThanItStates(Stated):
    takes = ()


class StatesMoreThanItTakes(Stated):
    takes = ("beacon", "fog")


class NamesNothing(Stated):
    def _away(self, x: Array, scene: Scene) -> Array:
        if "beacon" not in scene:
            raise InputError("something is lacking")
        return super()._away(x, scene)


class TakesInHope(Stated):
    takes = ("beacon", "fog")

    def visible(self, x: Array, t_s: Array, scene: Scene) -> Any:
        return super().visible(x, t_s, scene) & (scene["fog"][0] >= 0.0)


def around() -> tuple[Array, Array, Scene]:
    random = np.random.default_rng(2)
    x = random.normal(size=(6, N)) * 3e5
    x[:, 0] = 5e6  # out of reach
    scene = {"beacon": np.ones((3, 1)) * 1e4, "fog": np.ones((1, 1))}
    return x, np.linspace(0.0, 100.0, N), scene


def test_a_sound_sensor_passes() -> None:
    check_sensor(Sound(), *around())
    check_sensor(Stated(), *around())


@pytest.mark.parametrize(
    ("broken", "match"),
    [
        (NamesRepeat, "names of channels repeat"),
        (UnknownKind, "kind of channel 'a' must be one of linear, angle, direction"),
        (Degrees, "must be in rad, is in 'deg'"),
        (DrawsAreNoNumbers, "draws must be two numbers"),
        (DrawsTooFew, r"fails with 0 and 4 numbers drawn"),
        (DrawsShared, "errors of different rows are correlated"),
        (AnglesNotWrapped, r"observe: the angle 'bearing' must lie within"),
        (MeasuredNotWrapped, r"measure: the angle 'bearing' must lie within"),
        (NoUnitVector, "no unit vector"),
        (MeasuresTheHidden, "measures what is not visible"),
        (SeesNothing, "measures nothing of all these"),
        (VisibleAsNumbers, "of bool, is"),
        (HalfMissing, "NaN in some rows only"),
        (NegativeSigma, "finite and not negative"),
        (SigmaIsVariance, "scatters by"),
        (OwnRandomness, "same call of measure differs"),
        (ChangesStates, "same call of observe differs|changes an argument"),
        (Neighbours, "measure of a lane depends on its neighbours"),
        (SceneOfHope, "an empty scene ends in KeyError"),
        (TakesAnAbsentEntry, r"takes \['lighthouse'\] from the scene; give the check"),
        (TakesMoreThanItStates, r"a scene of what it takes, \[\], is refused"),
        (StatesMoreThanItTakes, "takes 'fog' from the scene, but works without it"),
        (NamesNothing, "a scene without 'beacon' does not name it: something is lacking"),
        (TakesInHope, r"a scene of \['beacon'\] ends in KeyError"),
    ],
)
def test_what_breaks_a_sensor_is_found(broken: type[Sound], match: str) -> None:
    with pytest.raises(ContractViolation, match=match):
        check_sensor(broken(), *around())


class OtherBias:
    """An antenna that tells of other biases than it has."""

    def __init__(self) -> None:
        self.inner = example("sensor", "antenna")

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def bias(self, x: Array, t_s: Array, scene: Scene, constant: Array) -> Array:
        return np.asarray(-self.inner.bias(x, t_s, scene, constant))


def test_an_antenna_that_tells_of_other_biases_is_found() -> None:
    random = np.random.default_rng(1)
    place = random.normal(size=(3, 200))
    t_s = np.linspace(0.0, 1e5, 200)
    scene = {"earth_fixed": earth_fixed("teme", Epoch.parse("2020-01-01", "UTC"), t_s)}
    x = np.concatenate([7.5e6 * place / np.linalg.norm(place, axis=0), np.zeros((3, 200))])
    check_sensor(example("sensor", "antenna"), x, t_s, scene)
    with pytest.raises(ContractViolation, match="the middle of its errors"):
        check_sensor(OtherBias(), x, t_s, scene)
