"""Many families at once, on curves with closed forms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import StepControl, follow
from hillsphere_orbits.lockstep import Done, follow_lanes

FINE = StepControl(first=0.05, largest=0.3, turn=0.3)


class Circles:
    """x² + y² = 1, counting the lanes of every evaluation."""

    unknowns = ("x", "y")

    def __init__(self) -> None:
        self.lanes: list[int] = []

    def residual(self, z: Array) -> tuple[Array, Array]:
        self.lanes.append(z.shape[1])
        return (z**2).sum(axis=0)[None] - 1.0, 2.0 * z[None]


class Cliff:
    """y = 0 where x < 1; beyond it the equations cannot be evaluated, whatever the lane."""

    unknowns = ("x", "y")

    def residual(self, z: Array) -> tuple[Array, Array]:
        if np.any(z[0] >= 1.0):
            raise PropagationError("outside")
        slopes = np.zeros((1, *z.shape))
        slopes[0, 1] = 1.0
        return z[1][None], slopes


def until(reached: Callable[[Array], NDArray[np.bool_]], reason: str = "there") -> Done:
    def done(z: Array, _: NDArray[np.intp]) -> list[str]:
        return [reason if yes else "" for yes in reached(z)]

    return done


def never(z: Array, _: NDArray[np.intp]) -> list[str]:
    return [""] * z.shape[1]


def on_circle(*angles: float) -> Array:
    return np.array([np.cos(angles), np.sin(angles)])


def counter_clockwise(z: Array) -> Array:
    return np.array([-z[1], z[0]])


def test_folds_are_passed_and_every_lane_has_its_end() -> None:
    start = on_circle(0.0, 0.5, 2.0)
    branches = follow_lanes(
        Circles(), start, counter_clockwise(start), done=until(lambda z: z[0] < -0.9), control=FINE
    )
    for lane, branch in enumerate(branches):
        np.testing.assert_array_equal(branch.z[:, 0], start[:, lane])
        angle = np.unwrap(np.arctan2(branch.z[1], branch.z[0]))
        assert np.all(np.diff(angle) > 0.0)
        assert branch.ends == ("start", "there")
        assert branch.z[0, -1] < -0.9 < branch.z[0, -2]
        # y turns at the top, which the first two lanes pass
        np.testing.assert_allclose((branch.z**2).sum(axis=0), 1.0, rtol=0, atol=1e-14)
        np.testing.assert_allclose(branch.tangent, counter_clockwise(branch.z), rtol=0, atol=1e-6)


def test_direction_chooses_the_sense() -> None:
    start = on_circle(0.3, 0.3)
    ahead, back = follow_lanes(
        Circles(), start, np.array([[0.0, 0.0], [1.0, -1.0]]),
        done=until(lambda z: z[0] < 0.0), control=FINE,
    )  # fmt: skip
    assert ahead.z[1, -1] > 0.0 > back.z[1, -1]


def test_a_lane_does_not_depend_on_its_neighbours() -> None:
    start = on_circle(0.0, 1.0, 2.9)
    done = until(lambda z: z[0] < -0.95)
    together = follow_lanes(Circles(), start, counter_clockwise(start), done=done, control=FINE)
    for lane, branch in enumerate(together):
        first = start[:, [lane]]
        alone = follow_lanes(Circles(), first, counter_clockwise(first), done=done, control=FINE)
        np.testing.assert_allclose(alone[0].z, branch.z, rtol=0, atol=1e-14)


def test_lanes_that_have_ended_leave_the_arrays() -> None:
    problem = Circles()
    start = on_circle(0.0, 2.6)
    follow_lanes(
        problem, start, counter_clockwise(start), done=until(lambda z: z[0] < -0.9), control=FINE
    )
    assert problem.lanes[0] == 2
    assert 1 in problem.lanes


def test_the_same_curve_as_one_family_alone() -> None:
    start = on_circle(0.0)
    lane = follow_lanes(
        Circles(), start, np.array([0.0, 1.0]), done=until(lambda z: z[0] < 0.0), control=FINE
    )[0]
    alone = StepControl(first=0.05, members=4)
    single = follow(Circles(), start[:, 0], np.array([0.0, 1.0]), control=alone)
    # the plane normal to the tangent (0, 1) at a distance of 0.05
    for branch in (lane, single):
        np.testing.assert_allclose(np.hypot(*branch.z), 1.0, rtol=0, atol=1e-14)
        assert branch.z[1, 1] == pytest.approx(0.05, abs=1e-14)


def test_a_lane_outside_the_domain_harms_no_other() -> None:
    z = np.array([[0.0, -9.0, 0.5], [0.0, 0.0, 0.0]])
    direction = np.array([[1.0, -1.0, 1.0], [0.0, 0.0, 0.0]])
    right, left, near = follow_lanes(
        Cliff(), z, direction, done=until(lambda z: z[0] < -10.0), control=FINE
    )
    assert left.ends[1] == "there"
    for branch in (right, near):
        assert branch.ends[1] == "no further member: the step collapsed"
        assert 1.0 - 1e-5 < branch.z[0, -1] < 1.0


def test_most_members() -> None:
    control = StepControl(first=0.05, largest=0.05, members=7)
    branch = follow_lanes(
        Circles(), on_circle(0.0), np.array([0.0, 1.0]), done=never, control=control
    )[0]
    assert branch.size == 7
    assert branch.ends[1] == "stopped after 7 members"


def test_members_are_corrected_on_the_exact_equations() -> None:
    class Ellipse(Circles):
        def residual(self, z: Array) -> tuple[Array, Array]:
            weight = np.array([[1.0], [1.0 + 1e-4]])
            return (weight * z**2).sum(axis=0)[None] - 1.0, 2.0 * weight * z[None]

    branch = follow_lanes(
        Circles(), on_circle(0.0), np.array([0.0, 1.0]), done=until(lambda z: z[0] < 0.0),
        control=FINE, exact=lambda chains: Ellipse(),
    )[0]  # fmt: skip
    x, y = branch.z
    np.testing.assert_allclose(x**2 + (1.0 + 1e-4) * y**2, 1.0, rtol=0, atol=1e-14)


def test_no_member_besides_the_first() -> None:
    z = np.array([[1.0 - 1e-7], [0.0]])
    with pytest.raises(ConvergenceError, match=r"lane 0 .*collapsed"):
        follow_lanes(Cliff(), z, np.array([1.0, 0.0]), done=never)


@pytest.mark.parametrize("z", [np.empty((2, 0)), np.zeros(2), np.zeros((3, 1))])
def test_shapes_that_do_not_fit(z: Array) -> None:
    with pytest.raises(InputError, match=r"z must be \(2, M\)"):
        follow_lanes(Circles(), z, np.array([0.0, 1.0]), done=never)
