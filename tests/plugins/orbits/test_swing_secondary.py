"""Secondary bifurcations of matrices with known spectra, and of quasi-satellite orbits."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.qso.families import Qso
from hillsphere_orbits.secondary import secondary
from hillsphere_orbits.stability import stability_indices

Index = Callable[[Array], Array]


def decoupled(planar: Index, vertical: Index) -> Callable[[Array], Array]:
    """Return u → matrices with these indices, the third axis separate."""

    def at(u: Array) -> Array:
        m = np.zeros((6, 6, u.size))
        for (i, j), b in (((0, 3), planar(u)), ((2, 5), vertical(u))):
            m[i, i], m[i, j], m[j, i] = b, -1.0, 1.0
        m[1, 1] = m[4, 4] = m[1, 4] = 1.0
        return m

    return at


def coupled(sigma: Index, tau: Index) -> Callable[[Array], Array]:
    """Return u → matrices with b₁ + b₂ = σ and b₁ b₂ = τ, in coordinates that mix all axes."""
    mix = np.random.default_rng(5).normal(size=(6, 6))
    back = np.linalg.inv(mix)

    def at(u: Array) -> Array:
        s, t = sigma(u), tau(u)
        m = np.zeros((u.size, 6, 6))
        m[:, 1, 0] = m[:, 2, 1] = m[:, 3, 2] = 1.0
        m[:, 0, 0], m[:, 0, 1], m[:, 0, 2], m[:, 0, 3] = s, -(t + 2.0), s, -1.0
        m[:, 4, 4] = m[:, 5, 5] = m[:, 4, 5] = 1.0
        return np.ascontiguousarray(np.moveaxis(mix @ m @ back, 0, 2))

    return at


def samples(at: Callable[[Array], Array], count: int = 11) -> Array:
    return at(np.arange(count, dtype=float))


def still(value: float) -> Index:
    return lambda u: np.full(u.shape, value)


def test_every_kind_of_one_plane() -> None:
    at = decoupled(lambda u: 2.55 - 0.5 * u, still(0.3))
    found = secondary(at, samples(at), resonances=[(1, 3), (1, 5)], integral=lambda u: u**2)
    assert found.kind == ("branching", "1:5", "1:3", "doubling")
    assert set(found.plane) == {"planar"}
    roots = [(2.55 - b) / 0.5 for b in (2.0, 2.0 * cos(0.4 * pi), -1.0, -2.0)]
    np.testing.assert_allclose(found.position, roots, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.index[1], 0.3, rtol=1e-12)


@pytest.mark.parametrize(
    "integral, kind",
    [
        (lambda u: (u - 3.7) ** 2 + 0.1 * (u - 3.7) ** 3, "fold"),
        (lambda u: (u - 3.9) ** 2, "branching"),
        (None, "tangent"),
    ],
)
def test_fold_is_where_the_integral_turns(integral: Index | None, kind: str) -> None:
    at = decoupled(lambda u: 2.0 + np.tanh(u - 3.7), still(0.3))
    found = secondary(at, samples(at), integral=integral)
    assert found.kind == (kind,)
    np.testing.assert_allclose(found.position, [3.7], rtol=0, atol=1e-7)


def test_out_of_the_plane_it_is_never_a_fold() -> None:
    at = decoupled(still(1.0), lambda u: 2.0 + np.tanh(u - 3.7))
    found = secondary(at, samples(at), integral=lambda u: (u - 3.7) ** 2)
    assert (found.kind, found.plane) == (("branching",), ("vertical",))


def test_pair_of_roots_between_two_samples() -> None:
    """2 ± 0.1 about 3.45: both neighbours are on the same side, by twenty times the depth."""
    at = decoupled(lambda u: 2.0 + (u - 3.45) ** 2 - 0.01, still(0.3))
    found = secondary(at, samples(at))
    assert found.kind == ("tangent", "tangent")
    np.testing.assert_allclose(found.position, [3.35, 3.55], rtol=0, atol=1e-7)


def test_touching_is_not_passing() -> None:
    """An orbit with two mirrors has b = q² − 2, which turns back at −2."""
    at = decoupled(lambda u: (0.4 * u - 1.3) ** 2 - 2.0, still(0.3))
    found = secondary(at, samples(at))
    assert "doubling" not in found.kind


def test_coupled_pairs() -> None:
    """Indices 0.2 ± √(4.3 − u): real, then complex; the upper one passes 2 at 4.3 − 1.8²."""
    at = coupled(still(0.4), lambda u: 0.04 - (4.3 - u))
    found = secondary(at, samples(at), integral=lambda u: u)
    assert found.kind == ("branching", "krein")
    assert set(found.plane) == {""}
    np.testing.assert_allclose(found.position, [4.3 - 1.8**2, 4.3], rtol=0, atol=1e-7)


def test_pair_that_is_always_one() -> None:
    """Orbits of high resonance: one pair stays 1, 1 and must not be counted at every sample."""
    first = 3.1 - 0.6 * np.arange(11)
    at = coupled(lambda u: 2.0 + 3.1 - 0.6 * u, lambda u: 2.0 * (3.1 - 0.6 * u))
    found = secondary(at, samples(at), integral=lambda u: u, resonances=[(1, 4)])
    assert found.kind == ("branching", "1:4", "doubling")
    roots = np.interp([-2.0, 0.0, 2.0], first[::-1], np.arange(11)[::-1])[::-1]
    np.testing.assert_allclose(found.position, roots, rtol=0, atol=1e-6)


def test_nothing_found() -> None:
    at = decoupled(still(1.0), still(-0.5))
    found = secondary(at, samples(at))
    assert found.kind == found.plane == ()
    assert found.position.shape == (0,)
    assert found.index.shape == (2, 0)


def test_bad_input() -> None:
    at = decoupled(still(1.0), still(1.0))
    with pytest.raises(InputError, match="two samples"):
        secondary(at, samples(at, 1))
    with pytest.raises(InputError, match="got 2:3"):
        secondary(at, samples(at), resonances=[(1, 3), (2, 3)])


def test_planar_resonance_of_quasi_satellite_orbits() -> None:
    """1:3 at x0 = 29.507 km, to the metre: about Phobos as an ellipsoid of 1.860 g/cm³."""
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0
    )
    gravity = create(
        "gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], gm_km3_s2=7.059650784871513e-4
    )
    plant = create("plant", "hill", body=body, gravity=gravity)
    family = create("orbit_family", "qso", Qso, plant=plant).family(28e3, 31e3, 21)
    problem, branch = family.problem, family.branch

    def at(u: Array) -> Array:
        return np.asarray(problem.monodromy(branch.at(problem, u)))

    found = secondary(at, problem.monodromy(branch.z), resonances=[(1, 3)])
    assert found.kind == ("1:3",)
    assert found.plane == ("planar",)
    z = branch.at(problem, found.position)
    assert z[0, 0] * plant.scales.length_m == pytest.approx(29507.0, abs=1.0)
    np.testing.assert_allclose(found.index[0], -1.0, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        found.index[:, 0],
        np.array(stability_indices(problem.monodromy(z)))[:, 0],
        rtol=0,
        atol=1e-9,
    )
