"""Routes of structured synthesis, and what its verdict says of them.

The plant with two basins is conditionally stable: y = (s + z)²/(s + p)³ (u + w₁), (y, ρ u) is to
be small, u = −k (y + ν w₂). Its closed loop's polynomial is
s³ + (3p + k) s² + (3p² + 2kz) s + (p³ + k z²), so that by Routh's criterion it is stable just if
2z k² + (3p² + 6pz − z²) k + 8p³ > 0: below the smaller root and above the larger one. A low gain
leaves the gain at rest z²/p³ nearly as it is; with a high one it falls to about ρ.
"""

from __future__ import annotations

import numpy as np
import pytest

import hillsphere_controllers as hc
from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.structured.continuation import Blend, follow_blend
from hillsphere_controllers.structured.effort import effort_number
from hillsphere_controllers.structured.neighbours import larger_structure, smaller_structure
from hillsphere_controllers.structured.records import Problem, SearchResult, Start
from hillsphere_controllers.structured.reduced_start import gain_size, static_starts
from hillsphere_controllers.structured.requirements import DesignPlant
from hillsphere_controllers.structured.route_names import (
    BOUNDED,
    FULL_ORDER,
    LARGER,
    RESTARTS,
    SMALLER,
    STARTS,
)
from hillsphere_controllers.structured.routes import RouteSearch, applicable_routes
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import (
    Diagonal,
    Structure,
    controller_of,
    free_state_space,
    mask_gains,
    static,
)
from hillsphere_controllers.structured.synthesis import synthesise
from hillsphere_controllers.structured.verdict import make_verdict
from hillsphere_controllers.structured.verification import full_order
from hillsphere_controllers.systems.algebra import gain, lower_lft

P, Z, RHO, NU = 0.1, 200.0, 1.0, 0.001


def two_basins() -> LtiSystem:
    """Return the conditionally stable plant, from (w₁, w₂, u) to (y, ρ u, y + ν w₂)."""
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(P**3), -3.0 * P**2, -3.0 * P]])
    b, c, none = np.array([[0.0], [0.0], [1.0]]), np.array([[Z**2, 2.0 * Z, 1.0]]), np.zeros((3, 1))
    return LtiSystem(
        a, np.hstack([b, none, b]), np.vstack([c, none.T, c]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, RHO], [0.0, NU, 0.0]]),
    )  # fmt: skip


def result(route: str, gamma: float, note: str = "") -> SearchResult:
    """Return the result of a search by a route."""
    return SearchResult(Start(0, 0, route=route), np.zeros(1), gamma, -1.0, note=note)


def test_agreement_of_random_starts_confirms_nothing_and_other_routes_find_the_better_basin() -> (
    None
):
    plant = two_basins()
    high, low = np.roots([2.0 * Z, 3.0 * P**2 + 6.0 * P * Z - Z**2, 8.0 * P**3]).real.tolist()

    def norm(k: float) -> float:
        return hinf_norm(lower_lft(plant, gain(np.array([[-k]])))).value

    # the basins, by a scan of the one parameter
    assert not lower_lft(plant, gain(np.array([[-0.5 * high]]))).is_stable
    lower = min(map(norm, low * np.linspace(0.1, 0.999, 30)))
    upper = min(map(norm, high * np.geomspace(1.001, 1e3, 120)))
    assert lower > 1e6 * upper

    starts = synthesise(DesignPlant(plant), static(1, 1), starts=3, effort="quick")
    # every start agrees on the worse basin, that from the reduced controller of full order too
    np.testing.assert_allclose(starts.starts, lower, rtol=0.02)
    assert starts.verdict.kind == "starts alone"
    assert "not confirmed" in str(starts.verdict)

    found = synthesise(DesignPlant(plant), static(1, 1), starts=3)
    np.testing.assert_array_equal(found.starts, starts.starts)
    assert found.gamma == pytest.approx(upper, rel=2e-3)  # spacing of the scan
    assert found.verdict.kind == "confirmed"
    assert set(found.verdict.arrived) == {FULL_ORDER, BOUNDED}
    assert found.verdict.gap == pytest.approx(found.gamma / found.lower_bound - 1.0)
    assert f"{found.lower_bound:.6g}" in str(found.verdict)


def test_one_route_is_not_enough() -> None:
    alone = [result(STARTS, 2.0), result(STARTS, 2.0), result(RESTARTS, 2.0)]
    assert make_verdict(alone, {}, 2.0, 0.0, np.inf).kind == "starts alone"
    nothing = result(FULL_ORDER, np.inf, "not stable")
    other = [*alone, nothing, result(LARGER, 2.01)]
    verdict = make_verdict(other, {SMALLER: "no order below"}, 2.0, 1.6, 1.7)
    assert (verdict.kind, verdict.arrived) == ("one route", (STARTS,))
    assert dict(zip(verdict.routes, verdict.remarks, strict=True))[SMALLER] == "no order below"
    assert dict(zip(verdict.routes, verdict.remarks, strict=True))[FULL_ORDER] == "not stable"
    assert "25 % above the proved lower bound" in str(verdict)
    # only restarts near the best arrive
    verdict = make_verdict([*other, result(RESTARTS, 1.9)], {}, 1.9, 0.0, 1.7)
    assert (verdict.kind, verdict.arrived) == ("one route", ())
    assert "No lower bound is proved" in str(verdict)
    assert "10.5 % less" in str(verdict)
    agreed = [*other, result(BOUNDED, 2.001)]
    assert make_verdict(agreed, {}, 2.0, 0.0, np.inf).kind == "confirmed"
    assert make_verdict(alone, {}, 2.0, 1.999, 2.0).kind == "best"
    assert make_verdict(agreed, {}, 2.0, 0.0, np.inf, confined=True).kind == "confined"


def test_effort_is_a_word_or_a_number() -> None:
    assert [effort_number(one) for one in ("quick", "normal", "thorough")] == [0.0, 1.0, 5.0]
    assert effort_number(0.5) == 0.5
    for wrong in ("slow", -1.0, np.nan, 1e3, True):
        with pytest.raises(InputError, match="effort must be 'quick'"):
            effort_number(wrong)  # type: ignore[arg-type]


def test_blend_leads_from_one_controller_to_the_other_with_its_slopes() -> None:
    random = np.random.default_rng(0)
    structure, known = free_state_space(1, 2, 1), LtiSystem(
        np.diag([-1.0, -2.0]), np.ones((2, 1)), random.normal(size=(2, 2)), np.zeros((2, 1))
    )  # fmt: skip
    theta, s = random.normal(size=structure.size), np.array([0.3, 2.0])
    theta[0] = -0.7
    own = controller_of(structure, theta).response(s)
    for share in (0.0, 0.4, 1.0):
        blend = Blend(structure, known, share)
        made = controller_of(blend, theta).response(s)
        np.testing.assert_allclose(made, (1.0 - share) * known.response(s) + share * own)
        slope = random.normal(size=blend.gains(theta).shape)
        step = 1e-6 * np.eye(structure.size)
        central = [
            np.sum(slope * (blend.gains(theta + d) - blend.gains(theta - d))) / 2e-6 for d in step
        ]
        np.testing.assert_allclose(blend.pull_back(theta, slope), central, atol=1e-8)


def test_path_goes_to_a_gain_that_stabilises() -> None:
    # ẍ = u, of which position and rate are measured: u = −x − 2ẋ is followed to a static gain
    plant = LtiSystem(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 1.0]]),
        np.vstack([np.eye(2), np.zeros((1, 2)), np.eye(2)]),
        np.array([[0.0, 0.0]] * 2 + [[0.0, 1.0]] + [[0.0, 0.0]] * 2),
    )  # fmt: skip
    known = gain(np.array([[-1.0, -2.0]]))
    theta, share, count = follow_blend(
        [DesignPlant(plant)], static(1, 2), known, np.zeros(2), np.ones(2)
    )
    assert share == 1.0
    assert count > 0
    assert lower_lft(plant, controller_of(static(1, 2), theta)).is_stable
    # a controller that does not stabilise leads nowhere
    bad = gain(np.array([[1.0, 2.0]]))
    assert follow_blend([DesignPlant(plant)], static(1, 2), bad, np.zeros(2), np.ones(2))[1] == 0.0


@pytest.mark.parametrize(
    "structure",
    [
        free_state_space(2, 2, 1),
        free_state_space(2, 1, 2, strictly_proper=True),
        Pid(),
        Pid(integral=False),
        TransferFunction(1),
        TransferFunction(3, 1),
        Diagonal([Pid(), static(1, 1)]),
    ],
)
def test_controller_of_the_order_below_is_one_of_the_structure(structure: Structure) -> None:
    pair = smaller_structure(structure)
    assert pair is not None
    less, pad = pair
    assert less.order < structure.order
    random = np.random.default_rng(1)
    theta, s = random.uniform(0.5, 1.5, less.size), np.array([0.1, 1.0, 30.0])
    middle, spread = np.zeros(structure.size), np.ones(structure.size)
    padded = pad(theta, middle, spread, 2.0, random)
    assert padded.shape == (structure.size,)
    np.testing.assert_allclose(
        controller_of(structure, padded).response(s), controller_of(less, theta).response(s)
    )


def test_structures_without_an_order_below_and_larger_ones() -> None:
    patterned = mask_gains(np.array([[np.nan, 1.0], [np.nan, 0.0]]), 1)
    without: tuple[Structure, ...] = (
        static(2, 2), patterned, TransferFunction(2, 2), Pid(integral=False, derivative=False),
    )  # fmt: skip
    for none in without:
        assert smaller_structure(none) is None
    assert larger_structure(static(2, 3)).order == 1
    assert larger_structure(free_state_space(2, 1, 1)).order == 3
    assert larger_structure(Pid()).order == 2
    assert larger_structure(patterned).size == 4
    plant = DesignPlant(two_basins())
    routes, remarks = applicable_routes(Problem((plant,), static(1, 1)))
    assert routes == (LARGER, BOUNDED)
    assert remarks[SMALLER] == "a static gain has no order below"
    assert remarks[FULL_ORDER] == "no controller of full order was found"


def test_gains_of_a_controller_at_frequencies_of_its_loop() -> None:
    # K = −2/(s + 1) on 1/(s + 1): |K| is largest at the slowest pole of (s + 1)² + 2, |s| = √3,
    # where it is 2/2
    plant = LtiSystem(
        np.array([[-1.0]]), np.array([[1.0, 1.0]]), np.array([[1.0], [1.0]]), np.zeros((2, 2))
    )
    known = LtiSystem(np.array([[-1.0]]), np.array([[1.0]]), np.array([[-2.0]]), np.array([[0.0]]))
    assert gain_size(plant, known) == pytest.approx(1.0)
    starts = static_starts(plant, known, static(1, 1), np.zeros(1))
    np.testing.assert_allclose(starts, -0.5, rtol=1e-9)  # Re −2/(1 + √3 j)
    assert static_starts(plant, known, free_state_space(1, 1, 1), np.zeros(4)) == []


def test_full_order_of_a_singular_problem_proves_no_bound() -> None:
    # neither u nor the noise on y is weighted
    plant = LtiSystem(
        np.array([[1.0]]), np.array([[1.0, 1.0]]), np.array([[1.0], [1.0]]), np.zeros((2, 2))
    )
    made = full_order([DesignPlant(plant)], static(1, 1), regularised=True)
    assert made is not None
    assert made.bound == 0.0
    assert lower_lft(plant, made.controller).is_stable
    assert made.gamma == pytest.approx(hinf_norm(lower_lft(plant, made.controller)).value)


def test_route_from_the_order_below_and_a_search_in_the_scale_of_its_parameters() -> None:
    # ẍ = u + w, z = (x, 0.1 u), y = (x, ẋ): the static minimum is a start of order 1
    plant = LtiSystem(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 1.0]]),
        np.array([[1.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
        np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.0], [0.0, 0.0]]),
    )  # fmt: skip
    least = synthesise(DesignPlant(plant), static(1, 2), starts=1, effort="quick").gamma
    search = RouteSearch(Problem((DesignPlant(plant),), free_state_space(1, 1, 2)))
    found = search(Start(0, 1, route=SMALLER))
    assert found.allowed
    assert found.gamma <= least * (1.0 + 1e-6)
    again = search(Start(1, 1, found.theta, rescaled=True))
    assert again.gamma <= found.gamma * (1.0 + 1e-9)


def test_path_leads_to_a_controller_with_an_integrator() -> None:
    # ẋ = x + w + u, z = (x, u), y = x + v: an integrator that is not coupled is no stable loop
    plant = DesignPlant(
        LtiSystem(
            np.array([[1.0]]), np.array([[1.0, 0.0, 1.0]]), np.array([[1.0], [0.0], [1.0]]),
            np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
        )
    )  # fmt: skip
    structure = Pid(derivative=False)
    full = full_order([plant], structure)
    assert full is not None
    found = RouteSearch(Problem((plant,), structure, full=full))(Start(0, 1, route=FULL_ORDER))
    assert found.allowed
    assert found.gamma >= full.bound


def test_toolbox_gives_the_verdict_and_takes_the_effort() -> None:
    plant = LtiSystem(
        np.array([[1.0]]), np.array([[1.0, 0.0, 1.0]]), np.array([[1.0], [0.0], [1.0]]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
    )  # fmt: skip
    quick = hc.hinfstruct(plant, hc.tunableGain(1, 1), starts=2, effort="quick")
    assert quick.verdict is not None
    assert quick.verdict.kind in ("starts alone", "best")
    normal = hc.hinfstruct(plant, hc.tunableGain(1, 1), starts=2, effort=1.0)
    assert "lower bound" in str(normal.verdict)
    assert normal.gamma == quick.gamma
    with pytest.raises(InputError, match="effort"):
        hc.hinfstruct(plant, hc.tunableGain(1, 1), effort="much")  # type: ignore[arg-type]
