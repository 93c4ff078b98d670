from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.errors import InputError
from hillsphere.interfaces import Dispersion, Parameter
from hillsphere.plugins import create
from hillsphere_controllers.linear_fractional.uncertainties import (
    Uncertainty,
    bound_dispersion,
    corners,
    physical_values,
    random_values,
    real_parameter,
)


class Lander:
    def parameters(self) -> Sequence[Parameter]:
        return (
            Parameter("mass", 100.0, "kg"),
            Parameter("inertia", 20.0, "kg m2"),
            Parameter("bias", 0.0, "N m"),
        )


def made(type_: str, parameters: tuple[str, ...], **keys: Any) -> Dispersion:
    model: Dispersion = create(
        "dispersions", type_, of="plant.lander", parameters=parameters, **keys
    )
    return model


def test_normalised_at_bounds_and_nominal() -> None:
    one = real_parameter("mass", 80.0, 150.0, 90.0)
    assert_allclose(one.normalise(np.array([80.0, 90.0, 150.0])), [-1, 0, 1], rtol=0, atol=1e-14)
    assert_allclose(one.physical(np.array([-1.0, 0.0, 1.0])), [80.0, 90.0, 150.0], rtol=1e-14)
    between = np.linspace(80.0, 150.0, 50)
    delta = one.normalise(between)
    assert (np.diff(delta) > 0.0).all()
    assert_allclose(one.physical(delta), between, rtol=1e-14)
    assert real_parameter("mass", 80.0, 150.0).curvature == 0.0


def test_bounds_of_a_dispersion_at_three_sigmas() -> None:
    found = bound_dispersion(Lander(), made("normal", ("mass", "inertia"), sigma_relative=0.05))
    assert [u.name for u in found] == ["mass", "inertia"]
    assert_allclose([(u.lower, u.nominal, u.upper) for u in found],
                    [(85.0, 100.0, 115.0), (17.0, 20.0, 23.0)], rtol=1e-12)  # fmt: skip
    (narrow, _) = bound_dispersion(
        Lander(), made("normal", ("mass", "inertia"), sigma=1.0), sigmas=2.0
    )
    assert_allclose((narrow.lower, narrow.upper), (98.0, 102.0), rtol=1e-12)


def test_bounds_stay_within_what_is_possible() -> None:
    (found,) = bound_dispersion(
        Lander(), made("uniform", ("mass",), lower=99.0, upper=130.0), sigmas=9.0
    )
    assert (found.lower, found.nominal, found.upper) == (99.0, 100.0, 130.0)


def test_a_nominal_value_outside_gives_way_to_the_mean() -> None:
    (found,) = bound_dispersion(
        Lander(), made("uniform", ("mass",), lower=110.0, upper=130.0), sigmas=9.0
    )
    assert (found.lower, found.nominal, found.upper) == (110.0, 120.0, 130.0)


def test_what_has_no_spread_is_not_uncertain() -> None:
    """A tenth of a nominal value of zero is nothing."""
    found = bound_dispersion(Lander(), made("normal", ("*s", "bias"), sigma_relative=0.1))
    assert [u.name for u in found] == ["mass"]


def test_random_values() -> None:
    several = (
        real_parameter("mass", 80.0, 150.0),
        Uncertainty("phase", "complex"),
        Uncertainty("wheel", "full", 2, 3),
    )
    values = random_values(several, 500, seed=1)
    assert 80.0 <= values["mass"].min() < 85.0
    assert 145.0 < values["mass"].max() <= 150.0
    assert 0.9 < np.abs(values["phase"]).max() <= 1.0
    assert values["wheel"].shape == (500, 2, 3)
    assert_allclose(np.linalg.norm(values["wheel"], 2, axis=(1, 2)), 1.0, rtol=1e-12)
    again = random_values(several, 500, seed=1)
    assert_array_equal(values["phase"], again["phase"])


def test_corners() -> None:
    found = corners((real_parameter("a", 0.0, 1.0), real_parameter("b", 2.0, 3.0)))
    assert_array_equal(found["a"], [0, 0, 1, 1])
    assert_array_equal(found["b"], [2, 3, 2, 3])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: real_parameter("mass", 1.0, 1.0), "between finite bounds"),
        (lambda: real_parameter("mass", 0.0, 1.0, 1.0), "neither of them"),
        (lambda: real_parameter("mass", 0.0, np.inf, 1.0), "finite bounds"),
        (lambda: real_parameter("", 0.0, 1.0), "name"),
        (lambda: Uncertainty("mass", "real", 2, 2), "only a full block"),
        (lambda: Uncertainty("wheel", "full", 0, 2), "at least one row"),
        (lambda: corners((Uncertainty("phase", "complex"),)), "'phase' is complex"),
        (lambda: corners([real_parameter(f"p{i}", 0.0, 1.0) for i in range(21)]), "too many"),
        (
            lambda: bound_dispersion(Lander(), made("normal", ("thrust",), sigma=1.0)),
            "no quantity 'thrust'",
        ),
    ],
)
def test_what_does_not_fit_is_said(wrong: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        wrong()


def test_worst_values_in_their_units() -> None:
    skew = real_parameter("k", 0.5, 2.0, 1.25)
    off = real_parameter("m", 1.0, 4.0, 1.5)  # c = −2/3: no value beyond δ = 1.5
    found = physical_values([skew, off], {"k": -1.0, "m": 1.0})
    assert_allclose([found["k"], found["m"]], [0.5, 4.0], rtol=1e-14)
    assert np.isnan(physical_values([off], {"m": 1.6})["m"])
    with pytest.raises(InputError, match="no real parameter 'q'; there are k, m"):
        physical_values([skew, off], {"q": 1.0})
