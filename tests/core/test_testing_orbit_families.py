"""The conformance check of orbit families notices families that break their contract."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.interfaces import Array, OrbitProblem
from hillsphere.testing import ContractViolation, check_orbit_family, example

GUESS = np.array([[3.0], [-6.1], [3.0]])


class Altered:
    """The family of quasi-satellite orbits with one thing wrong."""

    def __init__(self, fault: str) -> None:
        self._sound = example("orbit_family", "qso", 0)
        self._problem: OrbitProblem = self._sound.problem[0]
        self.fault = fault
        self.plant = self._sound.plant
        self.unknowns = self._problem.unknowns

    @property
    def problem(self) -> tuple[OrbitProblem, str]:
        return self, "" if self.fault == "mute" else "half a period"

    def residual(self, z: Array) -> tuple[Array, Array]:
        values, slopes = self._problem.residual(z)
        if self.fault == "slopes":
            slopes = slopes * np.array([1.0, 1.001, 1.0])[:, None]
        if self.fault == "rank":
            return np.stack([values[0], values[0]]), np.stack([slopes[0], slopes[0]])
        if self.fault == "few":
            return values[:1], slopes[:1]
        return values, slopes

    def state(self, z: Array) -> Array:
        return self._problem.state(z)

    def period(self, z: Array) -> Array:
        return self._problem.period(z) * (0.5 if self.fault == "period" else 1.0)


def test_sound_family_passes() -> None:
    check_orbit_family(Altered(""), GUESS)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("mute", "in words"),
        ("slopes", "dF/dz"),
        ("few", "more than a curve"),
        ("rank", "rank m"),
        ("period", "state after a period"),
    ],
)
def test_fault_is_noticed(fault: str, message: str) -> None:
    with pytest.raises(ContractViolation, match=message):
        check_orbit_family(Altered(fault), GUESS)
