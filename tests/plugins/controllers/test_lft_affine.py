"""Affine matrices as LFTs: exact, and with their weakest directions left out by a rule."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.linear_fractional.affine import AffineFit, affine_fit, affine_lft
from hillsphere_controllers.linear_fractional.algebra import state_space
from hillsphere_controllers.linear_fractional.left_out import cover_error, without_cover
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty, real_parameter
from hillsphere_controllers.mu.robustness import robust_stability


def symmetric(values: list[float], seed: int) -> Array:
    """Return a symmetric matrix with these eigenvalues."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(len(values),) * 2))[0]
    return np.asarray(turn * np.array(values) @ turn.T)


def fit_of(constant: Array, slopes: list[Array]) -> AffineFit:
    return AffineFit(np.zeros(len(slopes)), constant, np.array(slopes), 0.0, 1)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(st.integers(0, 10_000))
def test_untruncated_lft_is_the_matrix(seed: int) -> None:
    random = np.random.default_rng(seed)
    base, slopes = random.normal(size=(4, 5)), random.normal(size=(3, 4, 5))
    slopes[1] = np.outer(slopes[1, :, 0], slopes[1, 0])  # rank one
    centre = random.normal(size=3)
    points = np.hstack([centre[:, None], centre[:, None] + random.normal(size=(3, 5))])
    fit = affine_fit(points, base + np.tensordot((points.T - centre), slopes, axes=1))
    assert fit.checks == 2
    # nominal values that are not in the middle bend the way from δ to the parameter
    bounds = tuple(
        real_parameter(n, c - 1.0, c + 2.0, c) for n, c in zip("abc", centre, strict=True)
    )
    made = affine_lft(fit, bounds)
    assert made.after.tolist() == [4, 1, 4] == made.before.tolist()
    at = centre[:, None] + random.uniform(-1.0, 2.0, (3, 20))
    values = dict(zip("abc", at, strict=True))
    expected = base + np.tensordot((at.T - centre), slopes, axes=1)
    assert_allclose(made.lft.matrices(values)[3], expected, rtol=0.0, atol=1e-12)


def test_weakest_directions_go_until_the_share_is_reached() -> None:
    # directions 1, 0.3, 0.03 and 0.4, 0.02, 0.001 about a matrix of norm 5
    constant = np.diag([0.0, 3.0, 4.0])
    fit = fit_of(constant, [symmetric([1.0, -0.3, 0.03], 1), symmetric([0.4, 0.02, 0.001], 2)])
    bounds = (real_parameter("a", -1.0, 1.0), real_parameter("b", -1.0, 1.0))
    root = float(np.sqrt(0.03**2 + 0.02**2 + 0.001**2)) / 5.0
    made = affine_lft(fit, bounds, truncation=1.001 * root, truncation_of="nominal")
    assert (made.before.tolist(), made.after.tolist()) == ([3, 3], [2, 1])
    assert made.dropped == pytest.approx(root, rel=1e-12)
    assert 0.0 < made.sampled <= made.bound
    # a little less, and the largest of the three stays
    less = affine_lft(fit, bounds, truncation=0.999 * root, truncation_of="nominal")
    assert less.after.tolist() == [3, 1]
    # twice the bounds count twice
    wide = (real_parameter("a", -2.0, 2.0), real_parameter("b", -2.0, 2.0))
    assert affine_lft(
        fit, wide, truncation=1.001 * root, truncation_of="nominal"
    ).after.tolist() == [3, 2]
    # the norm is that of the rows and columns that change
    bigger = np.zeros((5, 5))
    bigger[:3, :3], bigger[3:, 3:] = constant, 1e6
    slopes = np.zeros((2, 5, 5))
    slopes[:, :3, :3] = fit.slopes
    padded = AffineFit(fit.base, bigger, slopes, 0.0, 1)
    assert affine_lft(
        padded, bounds, truncation=1.001 * root, truncation_of="nominal"
    ).after.tolist() == [2, 1]


def test_what_is_left_is_off_by_no_more_than_its_bound() -> None:
    random = np.random.default_rng(3)
    slopes = [symmetric(random.normal(size=4).tolist(), k) for k in range(5)]
    fit = fit_of(10.0 * np.eye(4), slopes)
    bounds = [real_parameter(f"p{k}", -1.0, 1.0) for k in range(5)]
    made = affine_lft(fit, bounds, truncation=0.05, truncation_of="nominal")
    assert 0 < made.after.sum() < made.before.sum() == 20
    signs = random.choice([-1.0, 1.0], (5, 400))
    whole = fit(signs)
    kept = {u.name for u in made.lft.uncertainties}
    got = made.lft.matrices({u.name: row for u, row in zip(bounds, signs, strict=True)
                             if u.name in kept})[3]  # fmt: skip
    change = float(np.linalg.norm(whole - fit.constant, 2, axis=(1, 2)).max())
    off = float(np.linalg.norm(whole - got, 2, axis=(1, 2)).max())
    assert 0.5 * made.sampled * change < off < 1.05 * made.bound * change


def test_matrices_that_are_not_affine_are_refused() -> None:
    points = np.array([[0.0, 1.0, -1.0]])
    with pytest.raises(InputError, match=r"not affine.*fit polynomials"):
        affine_fit(points, (points[0] ** 2 + points[0])[:, None, None] * np.eye(2))
    # two parameters that are affine each by itself, not together
    both = np.array([[0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]])
    with pytest.raises(InputError, match="not affine"):
        affine_fit(both, (both[0] * both[1] + both[0])[:, None, None] * np.eye(2))


@pytest.mark.parametrize(
    ("points", "samples", "said"),
    [
        (np.zeros((2, 3)), np.zeros((4, 2, 2)), r"\(k, N\) and samples"),
        (np.full((1, 2), np.nan), np.zeros((2, 2, 2)), "finite"),
        (np.array([[0.0, 1.0], [0.0, 1.0]]), np.zeros((2, 2, 2)), "apart"),
        (np.array([[0.0, 1.0, 2.0], [0.0, 2.0, 4.0]]), np.zeros((3, 2, 2)), "apart"),
    ],
)
def test_samples_must_tell_the_parameters_apart(points: Array, samples: Array, said: str) -> None:
    with pytest.raises(InputError, match=said):
        affine_fit(points, samples)


def test_only_real_parameters_are_affine() -> None:
    fit = fit_of(np.eye(2), [np.eye(2)])
    with pytest.raises(InputError, match="1 real parameters"):
        affine_lft(fit, [Uncertainty("a", "complex")])


def test_a_small_change_of_a_large_matrix_is_kept_by_default() -> None:
    fit = fit_of(1e3 * np.eye(2), [np.diag([1.0, 0.0]), np.diag([0.0, 0.5])])
    bounds = [real_parameter(n, -1.0, 1.0) for n in "ab"]
    assert affine_lft(fit, bounds, truncation=0.05).after.tolist() == [1, 1]
    nominal = affine_lft(fit, bounds, truncation=0.05, truncation_of="nominal")
    assert nominal.after.tolist() == [0, 0]
    # shares of √(1 + 1/4): the weaker direction is 0.447 of the change
    assert affine_lft(fit, bounds, truncation=0.44).after.tolist() == [1, 1]
    half = affine_lft(fit, bounds, truncation=0.45)
    assert half.after.tolist() == [1, 0]
    assert half.dropped == pytest.approx(0.5 / np.sqrt(1.25), rel=1e-12)
    for wrong in ({"truncation": 1.0}, {"truncation": -0.1}, {"truncation_of": "all"}):
        with pytest.raises(InputError, match="truncation"):
            affine_lft(fit, bounds, **wrong)


@pytest.mark.parametrize("count", [3, 14])
def test_the_cover_contains_what_is_left_out(count: int) -> None:
    """With few parameters the corners decide the block's size, with many the weights."""
    random = np.random.default_rng(count)
    rows = np.array([1e-3, 1.0, 1e4])  # badly scaled
    slopes = random.normal(size=(count, 3, 2)) * rows[:, None]
    fit = fit_of(100.0 * random.normal(size=(3, 2)), list(slopes))
    bounds = [real_parameter(f"p{k}", -1.0, 2.0, 0.3) for k in range(count)]
    made = affine_lft(fit, bounds, truncation=0.3)
    points = random.uniform(-1.0, 2.0, (count, 400))
    points[:, :300] = np.where(points[:, :300] > 0.5, 2.0, -1.0)
    kept = {u.name for u in made.truncated.uncertainties}
    assert made.truncated.size == made.after.sum() < made.before.sum()
    named = {u.name: row for u, row in zip(bounds, points, strict=True) if u.name in kept}
    error = fit(points) - made.truncated.matrices(named)[3]
    (out, into), d = made.truncated.closed_channels, made.lft.system.d
    cover = made.lft.uncertainties[-1]
    assert (cover.name, cover.covers) == ("left_out", True)
    left, right = d[out + cover.columns :, into : into + cover.rows], d[out : out + cover.columns]
    right = right[:, into + cover.rows :]
    delta = np.linalg.pinv(left) @ error @ np.linalg.pinv(right)
    assert_allclose(left @ delta @ right / rows[:, None], error / rows[:, None], atol=1e-9)
    sizes = np.linalg.norm(delta, 2, axis=(1, 2))
    assert 0.3 < sizes.max() <= 1.0 + 1e-6  # rows seven decades apart cost digits of the inverse
    # the worst corner of a few parameters is met: 1.7 of 1.3 and 1.7 is the farther bound
    assert count > 10 or sizes.max() > 0.9


def test_a_certificate_with_the_cover_holds_for_the_whole_family() -> None:
    """ẋ = −(1 + 0.5 a + 0.01 b) x is unstable first at |a|, |b| = 1/0.51: µ is 0.51."""
    fit = fit_of(np.array([[-1.0]]), [np.array([[-0.5]]), np.array([[-0.01]])])
    bounds = [real_parameter(n, -1.0, 1.0) for n in "ab"]
    made = affine_lft(fit, bounds, truncation=0.05)
    assert made.after.tolist() == [1, 0]
    for lft, mu in ((made.lft, 0.51), (made.truncated, 0.5)):
        system = state_space(lft, 1)
        bound = robust_stability(system.system, system.structure, gap=1e-4).upper
        assert mu * (1.0 - 1e-6) <= bound <= mu * 1.001
    bare = made.truncated
    assert without_cover(bare) is bare
    # a second approximation has a block of its own
    twice = cover_error(made.lft, np.eye(1), np.eye(1))
    assert [u.name for u in twice.uncertainties] == ["a", "left_out", "left_out_2"]
    with pytest.raises(InputError, match="needs L"):
        cover_error(made.lft, np.eye(2), np.eye(1))
