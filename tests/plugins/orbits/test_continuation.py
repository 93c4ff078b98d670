"""Newton correction, pseudo-arclength and members at values, on curves with closed forms."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from hillsphere.errors import ConvergenceError, InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import (
    Boundary,
    Branch,
    StepControl,
    _advance,
    continue_both,
    follow,
)
from hillsphere_orbits.correction import Problem, correct, fix_component, tangents
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
    z = correct(
        Circle(), np.array([[0.5, 0.5], [1.0, 1.0]]), fix_component(0, np.array([0.6, 0.8]))
    ).z
    np.testing.assert_allclose(z, [[0.6, 0.8], [0.8, 0.6]], rtol=1e-14)


def test_redundant_equations_by_least_squares() -> None:
    start = correct(RedundantHelix(), np.array([[1.0, 0.1, 0.05]]).T, fix_component(2, 0.0)).z[:, 0]
    edge = Boundary("one turn", lambda z: 2 * np.pi - z[2])
    branch = follow(RedundantHelix(), start, np.array([0.0, 0.0, 1.0]), boundaries=[edge])
    np.testing.assert_allclose(branch.z[0], np.cos(branch.z[2]), rtol=0, atol=1e-11)
    np.testing.assert_allclose(branch.z[1], np.sin(branch.z[2]), rtol=0, atol=1e-11)
    np.testing.assert_allclose(branch.z[:, -1], [1.0, 0.0, 2 * np.pi], rtol=0, atol=1e-11)


def test_failed_lanes_are_named() -> None:
    found = correct(
        Circle(), np.array([[0.6, 0.6], [0.8, 0.8]]), fix_component(0, np.array([0.6, 3.0]))
    )
    np.testing.assert_array_equal(found.converged, [True, False])
    with pytest.raises(ConvergenceError, match=r"the circle: .* did not converge for second \("):
        found.require_converged("the circle", ["first", "second"])


class Steep:
    """One equation that magnifies errors beside one without a root: z₁² + 4e-7 = 0."""

    unknowns = ("first", "second")

    def __init__(self, slope: float, offset: float = 0.0) -> None:
        self.slope, self.offset = slope, offset

    def residual(self, z: Array) -> tuple[Array, Array]:
        values = np.array([self.slope * (z[0] - 1.0) + self.offset, z[1] ** 2 + 4e-7])
        zero = np.zeros_like(z[0])
        return values, np.array([[zero + self.slope, zero], [zero, 2.0 * z[1]]])


@pytest.mark.parametrize("slope", [1.0, 1e6, 1e9, 1e12])
def test_a_steep_equation_excuses_no_other(slope: float) -> None:
    found = correct(Steep(slope), np.array([[1.0], [0.3]]))
    assert not found.converged[0]
    assert found.error[0] > 1e-8


@pytest.mark.parametrize("slope", [1e300, np.inf])
def test_an_excessive_slope_excuses_no_residual(slope: float) -> None:
    class Flat(Steep):
        def residual(self, z: Array) -> tuple[Array, Array]:
            values = np.array([np.ones_like(z[0]), z[1] - 1.0])
            zero = np.zeros_like(z[0])
            return values, np.array([[zero + slope, zero], [zero, zero + 1.0]])

    assert not correct(Flat(slope), np.array([[1.0], [1.0]]), iterations=0).converged[0]


def test_rounding_of_the_unknowns_is_a_solution() -> None:
    """With a slope of 3e3 no float solves an equation to the tolerance of 1e-12."""

    class Sloped:
        unknowns = ("only",)

        def residual(self, z: Array) -> tuple[Array, Array]:
            return 3e3 * (z - 1.0) + 1.5e-12, np.full((1, 1, z.shape[1]), 3e3)

    assert correct(Sloped(), np.array([[1.1]])).converged[0]


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
    even = branch.resample(Circle(), 31)
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
    branch = arc(Circle()).resample(Circle(), 6)
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


class Floor:
    """y = 0: a straight family, on which every prediction is a member."""

    unknowns = ("x", "y")

    def residual(self, z: Array) -> tuple[Array, Array]:
        slopes = np.zeros((1, *z.shape))
        slopes[0, 1] = 1.0
        return z[1][None], slopes


class Step:
    """f(k (y − h H(x − 1))) = 0 with f(0) = 0 and H a smooth step: level before and behind it.

    From the level part a long prediction misses the other one by h, and the tangents agree.
    """

    unknowns = ("x", "y")

    def __init__(self, height: float, stiffness: float = 0.0) -> None:
        self.height, self.stiffness = height, stiffness

    def residual(self, z: Array) -> tuple[Array, Array]:
        tanh = np.tanh(60.0 * (z[0] - 1.0))
        away = z[1] - 0.5 * self.height * (1.0 + tanh)
        by_x = -30.0 * self.height * (1.0 - tanh**2)
        slopes = np.array([[by_x, np.ones_like(away)]])
        if not self.stiffness:
            return away[None], slopes
        grown = np.exp(self.stiffness * away)
        return (grown - 1.0)[None], self.stiffness * grown * slopes


def advance(problem: Problem, z: Array, tangent: Array, step: float) -> tuple[bool, bool]:
    """Take one step of turn 0.25 rad; return whether it succeeds and whether it was easy."""
    new, line, easy = _advance(
        problem, z[:, None], tangent[:, None], step, StepControl(turn=0.25)
    )  # fmt: skip
    assert (new is None) == (line is None)
    return new is not None, easy


RIGHT = np.array([1.0, 0.0])


def test_a_member_too_far_from_its_prediction_is_on_another_family() -> None:
    """A tangent that turns by ≤ 0.25 rad over a step of 2 leads astray by ≤ 0.25 · 2."""
    origin = np.zeros(2)
    assert advance(Step(0.49), origin, RIGHT, 2.0) == (True, True)
    assert advance(Step(-0.49), origin, RIGHT, 2.0) == (True, True)
    assert advance(Step(0.5), origin, RIGHT, 2.0) == (True, True)  # exactly as far
    assert advance(Step(0.51), origin, RIGHT, 2.0) == (False, False)
    assert advance(Step(-0.51), origin, RIGHT, 2.0) == (False, False)
    assert advance(Step(0.31), origin, RIGHT, 1.2) == (False, False)  # 0.25 · 1.2 = 0.3
    assert advance(Step(0.29), origin, RIGHT, 1.2) == (True, True)


def test_a_step_may_turn_by_a_quarter_radian() -> None:
    """On the unit circle a step s leads on by an angle arcsin s; easy is below 0.4 · 0.25."""
    for angle, expected in ((0.09, (True, True)), (0.11, (True, False)), (0.24, (True, False)),
                            (0.26, (False, False))):  # fmt: skip
        assert advance(Circle(), START, UP, float(np.sin(angle))) == expected


def test_a_step_of_many_newton_steps_is_not_easy() -> None:
    """exp(k (y − h)) − 1 from y = 0 by hand: k h = 0.98 takes six steps, 2.45 more than eight."""

    def newton_steps(k: float, h: float) -> int:
        y, count = 0.0, 0
        while abs(np.exp(k * (y - h)) - 1.0) > StepControl().tolerance:
            y -= (1.0 - np.exp(-k * (y - h))) / k
            count += 1
        return count

    assert newton_steps(2.0, 0.49) == 6
    assert newton_steps(1.7 / 0.49, 0.49) == 8  # as many as are allowed
    assert newton_steps(1.9 / 0.49, 0.49) == 9
    assert newton_steps(5.0, 0.49) > 8
    assert advance(Step(0.49, stiffness=1.7 / 0.49), np.zeros(2), RIGHT, 2.0) == (True, False)
    assert advance(Step(0.49, stiffness=1.9 / 0.49), np.zeros(2), RIGHT, 2.0) == (False, False)
    assert advance(Step(0.49, stiffness=2.0), np.zeros(2), RIGHT, 2.0) == (True, False)
    assert advance(Step(0.49, stiffness=5.0), np.zeros(2), RIGHT, 2.0) == (False, False)


def test_steps_double_up_to_the_largest() -> None:
    branch = follow(Floor(), np.zeros(2), RIGHT, control=StepControl(members=8))
    steps = [0.05, 0.1, 0.2, 0.4, 0.5, 0.5, 0.5]
    np.testing.assert_allclose(np.diff(branch.z[0]), steps, rtol=1e-12)
    np.testing.assert_array_equal(branch.z[1], 0.0)
    np.testing.assert_allclose(branch.tangent, np.outer(RIGHT, np.ones(8)), atol=1e-15)


def test_a_step_that_is_not_easy_keeps_its_length() -> None:
    """A step s on the circle leads on by arcsin s; 0.4 turns too far and is halved, 0.2 stays."""
    for first, kept in ((0.15, 0.15), (0.4, 0.2)):
        control = StepControl(first=first, members=6)
        branch = follow(Circle(), START, UP, control=control)
        angles = np.unwrap(np.arctan2(branch.z[1], branch.z[0]))
        np.testing.assert_allclose(np.diff(angles), np.arcsin(kept), rtol=1e-9)


def test_halving_ends_at_the_smallest_step() -> None:
    """Before the wall at 1 the last step is the last of 2⁻ᵏ that is not below the smallest."""
    control = StepControl(first=0.25, largest=0.25, smallest=0.01)
    branch = follow(Line(), np.array([0.1, 0.0]), RIGHT, control=control)
    # from 0.1: 0.25 thrice to 0.85; 0.125 fits; 0.0625 does not, nor do doubled steps; …
    assert branch.ends[1] == "no further member: the step collapsed"
    steps = np.diff(branch.z[0])
    assert steps.min() >= 0.01
    assert 1.0 - 0.02 < branch.z[0, -1] < 1.0


def wall(beyond: float, z: Array) -> Array:
    return np.asarray(-z[0] - beyond)


def test_a_start_within_rounding_of_a_boundary_is_on_it() -> None:
    """Beyond by up to 1e-9 is rounding, by 2e-9 is not; the branch is that single member."""
    for beyond, fine in ((5e-10, True), (1e-9, True), (2e-9, False)):
        edge = Boundary("the wall", partial(wall, beyond))
        if fine:
            branch = follow(Floor(), np.zeros(2), RIGHT, boundaries=[edge])
            assert branch.size == 1
            assert branch.ends == ("start", "the wall")
        else:
            with pytest.raises(InputError, match="beyond the end: the wall"):
                follow(Floor(), np.zeros(2), RIGHT, boundaries=[edge])


def test_a_boundary_that_is_left_is_none() -> None:
    """A start on a boundary, going inwards, is followed to the other one."""
    edges = [Boundary("here", lambda z: z[0]), Boundary("there", lambda z: 0.33 - z[0])]
    branch = follow(Floor(), np.zeros(2), RIGHT, boundaries=edges)
    assert branch.ends == ("start", "there")
    np.testing.assert_allclose(branch.z[0], [0.0, 0.05, 0.15, 0.33], rtol=1e-9)


class Gap(Floor):
    """The floor, with no member between two values of x."""

    def __init__(self, left: float, right: float) -> None:
        self.left, self.right = left, right

    def residual(self, z: Array) -> tuple[Array, Array]:
        values, slopes = super().residual(z)
        return np.where((z[0] > self.left) & (z[0] < self.right), 1.0, values), slopes


def test_where_a_boundary_lies_in_a_gap_the_last_member_inside_ends_the_branch() -> None:
    """Steps of 0.05, 0.1 and 0.2 lead from 0 to 0.35, over a boundary at 0.3 in the gap."""
    edges = [Boundary("far", lambda z: 9.0 - z[0]), Boundary("edge", lambda z: 0.3 - z[0])]
    branch = follow(Gap(0.2, 0.34), np.zeros(2), RIGHT, boundaries=edges)
    np.testing.assert_allclose(branch.z[0], [0.0, 0.05, 0.15], rtol=1e-12)
    assert branch.ends[1].startswith("edge (within one member: ")
    # two members are enough, one is none: then the failure is said
    branch = follow(Gap(0.06, 0.14), np.zeros(2), RIGHT, boundaries=[
        Boundary("edge", lambda z: 0.1 - z[0])
    ])  # fmt: skip
    np.testing.assert_allclose(branch.z[0], [0.0, 0.05], rtol=1e-12)
    with pytest.raises(ConvergenceError):
        follow(Gap(0.01, 0.04), np.zeros(2), RIGHT, boundaries=[
            Boundary("edge", lambda z: 0.03 - z[0])
        ])  # fmt: skip


def by_hand(x: list[float], y: list[float]) -> Branch:
    """Return a chain of members on the x axis or beside it, with tangents along x."""
    z = np.array([x, y])
    return Branch(z, np.outer(RIGHT, np.ones(len(x))), ("left", "right"))


def test_a_member_lies_within_a_chord_of_one_of_its_neighbours() -> None:
    """Chords of 1 and 2; distances to the nearer end by Pythagoras."""
    chain = by_hand([0.0, 1.0, 3.0], [0.0, 0.0, 0.0])
    fine = np.array([[0.5, -0.9, 1.0, 4.9, 3.0], [0.8, 0.0, -2.0, 0.0, 1.9]])
    u = np.array([0.5, 0.5, 1.5, 1.5, 2.0])
    np.testing.assert_array_equal(chain.near(u, fine, "it", list("abcde")), fine)
    # √(0.5² + 0.9²) > 1, 1.1 > 1, √(1² + 1.8²) > 2 from both ends, 2.1 > 2
    poor = np.array([[0.5, 2.1, 2.0, 5.1, 3.0], [0.9, 0.0, 1.8, 0.0, 1.9]])
    with pytest.raises(ConvergenceError, match=r"it: .* left the family for a, b, c, d; it needs"):
        chain.near(u, poor, "it", list("abcde"))


def test_guesses_are_hermites_cubic() -> None:
    """By SciPy's, whose slopes are the tangents t stretched to |c|² t/(c·t), c the chord."""
    random = np.random.default_rng(3)
    z = np.array([[0.0, 1.0, 2.5, 3.0], [0.0, 0.4, 0.1, 0.9], [1.0, 0.8, 0.3, 0.2]])
    tangent = np.gradient(z, axis=1) + 0.2 * random.normal(size=z.shape)
    tangent /= np.linalg.norm(tangent, axis=0)
    chain = Branch(z, tangent, ("", ""))
    u = np.array([0.0, 0.3, 0.9, 1.0, 1.6, 2.25, 2.7, 3.0])
    guess, planes = chain.guess(u)
    other = random.normal(size=guess.shape)
    values, slopes = planes(other)
    for k, at in enumerate(u):
        i = min(int(at), 2)
        chord = z[:, i + 1] - z[:, i]
        stretched = [tangent[:, j] * (chord @ chord) / (chord @ tangent[:, j]) for j in (i, i + 1)]
        cubic = CubicHermiteSpline([i, i + 1], z[:, i : i + 2].T, stretched)
        np.testing.assert_allclose(guess[:, k], cubic(at), rtol=0, atol=1e-13)
        normal = chord / np.linalg.norm(chord)
        foot = z[:, i] + (at - i) * chord
        np.testing.assert_allclose(slopes[0, :, k], normal, rtol=0, atol=1e-14)
        np.testing.assert_allclose(values[0, k], normal @ (other[:, k] - foot), atol=1e-13)


def test_resampling_by_length_and_by_relative_length() -> None:
    """Chords 1, 1, 2, 4 at distances 0, 1, 2, 4, 8 from the origin: relative to them, 1 each."""
    chain = by_hand([0.0, 1.0, 2.0, 4.0, 8.0], [0.0] * 5)
    even = chain.resample(Floor(), 5)
    np.testing.assert_allclose(even.z[0], [0.0, 2.0, 4.0, 6.0, 8.0], atol=1e-12)
    relative = chain.resample(Floor(), 9, relative=True)
    expected = [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0]
    np.testing.assert_allclose(relative.z[0], expected, atol=1e-12)
    back = Branch(chain.z[:, ::-1], -chain.tangent, chain.ends).resample(
        Floor(), 9, relative=True
    )  # fmt: skip
    np.testing.assert_allclose(back.z[0], expected[::-1], atol=1e-12)
    for branch, sense in ((even, 1.0), (relative, 1.0), (back, -1.0)):
        assert branch.ends == ("left", "right")
        np.testing.assert_allclose(branch.tangent[0], sense, atol=1e-15)


def test_both_ways_hold_the_start_once() -> None:
    edges = [Boundary("left", lambda z: z[0] + 0.2), Boundary("right", lambda z: 0.3 - z[0])]
    branch = continue_both(Floor(), np.zeros(2), RIGHT, boundaries=edges)
    np.testing.assert_allclose(branch.z[0], [-0.2, -0.15, -0.05, 0, 0.05, 0.15, 0.3], atol=1e-12)
    np.testing.assert_allclose(branch.tangent[0], 1.0, atol=1e-15)
    assert branch.ends == ("left", "right")
    # on a boundary at one side
    half = continue_both(Floor(), np.array([0.3, 0.0]), RIGHT, boundaries=edges)
    assert half.ends == ("left", "right")
    np.testing.assert_allclose(half.z[0, [0, -1]], [-0.2, 0.3], atol=1e-12)
    assert bool(np.all(np.diff(half.z[0]) > 0.0))


def test_a_closed_family_ends_after_the_most_members() -> None:
    """400 of them if nothing else is said, as `StepControl` documents."""
    branch = follow(Circle(), START, UP)
    assert branch.size == 400
    assert branch.ends[1] == "stopped after 400 members"
