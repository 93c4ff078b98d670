"""Newton correction, pseudo-arclength and members at values, on curves with closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.errors import ConvergenceError, InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import (
    Boundary,
    Branch,
    StepControl,
    continue_both,
    follow,
)
from hillsphere_orbits.correction import correct, fixed, tangents
from hillsphere_orbits.members import coordinate, members_at, members_where
from hillsphere_orbits.roots import brackets, extrema


class Circle:
    """x² + y² = 1: a family with two turning points in each unknown."""

    unknowns = ("x", "y")

    def residual(self, z: Array) -> tuple[Array, Array]:
        return (z**2).sum(axis=0)[None] - 1.0, 2.0 * z[None]


class RedundantHelix:
    """(cos s, sin s, s) by three equations of rank two, one the product of a root with another."""

    unknowns = ("x", "y", "s")

    def residual(self, z: Array) -> tuple[Array, Array]:
        x, y, s = z
        one, zero = np.ones_like(x), np.zeros_like(x)
        f = np.array([x - np.cos(s), y - np.sin(s), x - np.cos(s)])
        rows = [[one, zero, np.sin(s)], [zero, one, -np.cos(s)], [one, zero, np.sin(s)]]
        return f, np.array(rows)


class Line:
    """y = 0 where x < 1; beyond it the equations cannot be evaluated."""

    unknowns = ("x", "y")

    def residual(self, z: Array) -> tuple[Array, Array]:
        if np.any(z[0] >= 1.0):
            raise PropagationError("outside")
        slopes = np.zeros((1, *z.shape))
        slopes[0, 1] = 1.0
        return z[1][None], slopes


class Flights:
    """sin(y − c(x)) = 0: the curve c, a flight of stairs, and parallel ones kπ above and below."""

    unknowns = ("x", "y")

    def residual(self, z: Array) -> tuple[Array, Array]:
        away = z[1] - self.stair(z[0])
        slopes = np.array([-15.0 / np.cosh(20.0 * (z[0] - 1.0)) ** 2, np.ones_like(away)])
        return np.sin(away)[None], (np.cos(away) * slopes)[None]

    def stair(self, x: Array) -> Array:
        return np.asarray(0.75 * (1.0 + np.tanh(20.0 * (x - 1.0))))


START = np.array([1.0, 0.0])
UP = np.array([0.0, 1.0])


def arc(problem: Circle, *, to: float = -0.5) -> Branch:
    """From (1, 0) over the top to x = to, so that y passes its maximum on the way."""
    edge = Boundary("x at its limit", lambda z: z[0] - to)
    return follow(problem, START, UP, boundaries=[edge])


def test_newton_polishes_beyond_its_tolerance() -> None:
    found = correct(Circle(), np.array([[0.8, 0.1], [0.7, 1.1]]), tolerance=1e-6)
    assert bool(np.all(found.converged))
    assert float(found.error.max()) < 1e-11
    assert found.iterations <= 4


def test_shortest_step_without_a_constraint() -> None:
    """The Moore–Penrose step from a point on a ray goes along the ray."""
    z = correct(Circle(), np.array([[2.0], [2.0]])).z
    np.testing.assert_allclose(z[:, 0], [0.5**0.5, 0.5**0.5], rtol=1e-14)


def test_natural_parameter() -> None:
    z = correct(Circle(), np.array([[0.5, 0.5], [1.0, 1.0]]), fixed(0, np.array([0.6, 0.8]))).z
    np.testing.assert_allclose(z, [[0.6, 0.8], [0.8, 0.6]], rtol=1e-14)


def test_redundant_equations_by_least_squares() -> None:
    start = correct(RedundantHelix(), np.array([[1.0, 0.1, 0.05]]).T, fixed(2, 0.0)).z[:, 0]
    edge = Boundary("one turn", lambda z: 2 * np.pi - z[2])
    branch = follow(RedundantHelix(), start, np.array([0.0, 0.0, 1.0]), boundaries=[edge])
    np.testing.assert_allclose(branch.z[0], np.cos(branch.z[2]), rtol=0, atol=1e-11)
    np.testing.assert_allclose(branch.z[1], np.sin(branch.z[2]), rtol=0, atol=1e-11)
    np.testing.assert_allclose(branch.z[:, -1], [1.0, 0.0, 2 * np.pi], rtol=0, atol=1e-11)


def test_failed_lanes_are_named() -> None:
    found = correct(Circle(), np.array([[0.6, 0.6], [0.8, 0.8]]), fixed(0, np.array([0.6, 3.0])))
    np.testing.assert_array_equal(found.converged, [True, False])
    with pytest.raises(ConvergenceError, match=r"the circle: .* did not converge for second \("):
        found.checked("the circle", ["first", "second"])


def test_through_turning_points() -> None:
    branch = arc(Circle())
    assert branch.ends == ("start", "x at its limit")
    np.testing.assert_allclose(branch.z[:, -1], [-0.5, 0.75**0.5], rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(branch.z, axis=0), 1.0, rtol=0, atol=1e-11)
    angle = np.arctan2(branch.z[1], branch.z[0])
    assert bool(np.all(np.diff(angle) > 0))
    np.testing.assert_allclose(branch.tangent, [-np.sin(angle), np.cos(angle)], rtol=0, atol=1e-11)


def test_a_step_does_not_end_on_another_family() -> None:
    """Beyond the stair Newton's iteration leads from the tangent to a curve 4π above."""
    control = StepControl(first=0.5, largest=0.5)
    edge = Boundary("the end", lambda z: 2.0 - z[0])
    branch = follow(Flights(), 0.2 * START, START, boundaries=[edge], control=control)
    assert branch.ends[1] == "the end"
    y = Flights().stair(branch.z[0])
    np.testing.assert_allclose(branch.z[1], y, rtol=0, atol=1e-10)


def test_steps_adapt() -> None:
    control = StepControl(first=1e-3, largest=0.2, members=200)
    branch = follow(
        Circle(), START, UP, control=control,
        boundaries=[Boundary("half", lambda z: z[1] + 1e-3)],
    )  # fmt: skip
    steps = np.linalg.norm(np.diff(branch.z, axis=1), axis=0)
    assert steps[0] == pytest.approx(1e-3, rel=1e-3)
    # the tangent may turn by 0.25 rad, which on the unit circle is the step
    assert 0.05 < steps.max() <= 0.2


def test_both_directions() -> None:
    edges = [Boundary("top", lambda z: 0.9 - z[1]), Boundary("bottom", lambda z: z[1] + 0.9)]
    branch = continue_both(Circle(), START, UP, boundaries=edges)
    assert branch.ends == ("bottom", "top")
    np.testing.assert_allclose(branch.z[1, [0, -1]], [-0.9, 0.9], rtol=0, atol=1e-11)
    assert bool(np.all(np.diff(branch.z[1]) > 0))
    assert bool(np.all(np.sum(branch.tangent[:, :-1] * np.diff(branch.z, axis=1), axis=0) > 0))


def test_most_members() -> None:
    branch = follow(Circle(), START, UP, control=StepControl(members=5))
    assert branch.size == 5
    assert branch.ends[1] == "stopped after 5 members"


def test_step_collapse_is_said() -> None:
    branch = follow(Line(), np.array([0.0, 0.0]), np.array([1.0, 0.0]))
    assert branch.ends[1] == "no further member: the step collapsed"
    assert 0.999 < branch.z[0, -1] < 1.0


def test_start_beyond_a_boundary() -> None:
    with pytest.raises(InputError, match="beyond the end: too far right"):
        follow(Circle(), START, UP, boundaries=[Boundary("too far right", lambda z: 0.5 - z[0])])


def test_nearest_of_two_boundaries() -> None:
    edges = [Boundary("far", lambda z: 0.5 - z[1]), Boundary("near", lambda z: 0.47 - z[1])]
    branch = follow(Circle(), START, UP, boundaries=edges, control=StepControl(first=0.25))
    assert branch.ends[1] == "near"
    assert branch.z[1, -1] == pytest.approx(0.47, abs=1e-11)


def test_family_of_one_member() -> None:
    edges = [Boundary("a", lambda z: -z[1]), Boundary("b", lambda z: z[1])]
    with pytest.raises(ConvergenceError, match="no member besides the first"):
        continue_both(Circle(), START, UP, boundaries=edges)


def test_resampling_keeps_ends_and_spaces_evenly() -> None:
    branch = arc(Circle())
    even = branch.resampled(Circle(), 31)
    np.testing.assert_allclose(even.z[:, [0, -1]], branch.z[:, [0, -1]], rtol=0, atol=1e-11)
    steps = np.linalg.norm(np.diff(even.z, axis=1), axis=0)
    assert steps.max() / steps.min() < 1.01
    np.testing.assert_allclose(
        even.tangent, tangents(Circle(), even.z, even.tangent), rtol=0, atol=1e-14
    )


def test_members_between_two() -> None:
    branch = arc(Circle())
    z = branch.at(Circle(), np.linspace(0, branch.size - 1, 57))
    np.testing.assert_allclose(np.linalg.norm(z, axis=0), 1.0, rtol=0, atol=1e-12)
    guess, _ = branch.guess(np.linspace(0, branch.size - 1, 57))
    # chords of at most 0.25: the cubic is good to s⁴/384
    np.testing.assert_allclose(guess, z, rtol=0, atol=3e-5)


def test_prescribed_values_are_all_found() -> None:
    """Y = 0.95 is passed twice, 0.3 once, 2 never; the end counts."""
    branch = arc(Circle())
    end = float(branch.z[0, -1])
    found = members_at(Circle(), branch, coordinate(1), np.array([0.95, 2.0, 0.3]))
    np.testing.assert_array_equal(found.target, [0, 0, 2])
    assert found.missing(3) == [1]
    expected = [0.0975**0.5, -(0.0975**0.5), 0.91**0.5]
    np.testing.assert_allclose(found.z[0], expected, rtol=0, atol=1e-13)
    at_end = members_at(Circle(), branch, coordinate(0), np.array([end]))
    assert at_end.z[0, 0] == pytest.approx(end, abs=1e-14)


def test_scaled_coordinate() -> None:
    found = members_at(Circle(), arc(Circle()), coordinate(1, 2.0), np.array([0.6]))
    assert found.z[1, 0] == pytest.approx(0.3, abs=1e-14)


def test_function_roots_beside_an_extremum() -> None:
    """Y has its maximum 1 between two members: a pair of roots that no sign change shows."""
    branch = arc(Circle()).resampled(Circle(), 6)
    target = 1.0 - 1e-5
    assert branch.z[1].max() < target
    found = members_where(Circle(), branch, lambda z: z[1], np.array([target, 1.5, 0.5]))
    np.testing.assert_array_equal(found.target, [0, 0, 2])
    root = (1 - target**2) ** 0.5
    np.testing.assert_allclose(found.z[0], [root, -root, 0.75**0.5], rtol=0, atol=1e-9)


def test_nothing_found() -> None:
    found = members_where(Circle(), arc(Circle()), lambda z: z[1], np.array([7.0]))
    assert found.z.shape == (2, 0)
    assert members_at(Circle(), arc(Circle()), coordinate(0), np.array([7.0])).z.shape == (2, 0)


def test_sample_on_the_target_counts_once() -> None:
    np.testing.assert_array_equal(brackets(np.array([0.0, 1.0, 2.0, 1.0]), 1.0), [1, 2])
    np.testing.assert_array_equal(brackets(np.array([0.0, 1.0, 2.0]), 1.0), [1])


@pytest.mark.parametrize("at", [0.3, 2.37, 5.8])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_extrema_inside_and_next_to_the_ends(at: float, sign: float) -> None:
    def parabola(u: Array) -> Array:
        return np.asarray(sign * (u - at) ** 2)

    u, f = extrema(parabola, parabola(np.arange(7.0)))
    np.testing.assert_allclose(u, [at], rtol=0, atol=1e-5)
    np.testing.assert_allclose(f, [0.0], rtol=0, atol=1e-10)


def test_no_extrema() -> None:
    u, _ = extrema(lambda u: np.asarray(2.0 * u), 2.0 * np.arange(5.0))
    assert u.size == 0
