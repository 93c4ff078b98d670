"""How the H∞ synthesis searches γ: by toy problems whose solvable γ and loops' norms are known."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.plugins.controllers.test_hinf_synthesis import scalar_plant

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import HinfNorm
from hillsphere_controllers.errors import SingularProblemError, SynthesisFailedError
from hillsphere_controllers.full_order import hinf
from hillsphere_controllers.full_order.gamma_problem import GammaProblem
from hillsphere_controllers.full_order.hinf import HinfDesign, hinf_synthesis

PLANT = scalar_plant(1.0)


def design(gamma: float, upper: float | None = None) -> HinfDesign:
    norm = HinfNorm(gamma, 1.0, gamma if upper is None else upper)
    return HinfDesign(PLANT, gamma, PLANT, norm, 0.0, gamma)


@dataclass
class Toy:
    """Solvable from a level of γ on."""

    solvable: float
    by_pencil: bool = False
    asked: list[float] = field(default_factory=list)

    def solve(self, gamma: float, *, checked: bool = True) -> Any:
        self.asked.append(gamma)
        return None if gamma < self.solvable else ("X", "Y")


@pytest.mark.parametrize(
    ("solvable", "guess", "expected", "asked"),
    [
        (1.0, 1.0, (0.96, 1.04), 2),  # a good guess: on both sides of it
        (2.0, 1.0, (1.04, 9.0), 1),  # too low: nothing below is asked
        (0.5, 1.0, (0.1, 0.96), 2),  # too high: lower twice
        (1.0, np.nan, (0.1, 9.0), 0),
        (1.0, 20.0, (0.1, 9.0), 0),  # outside of what is known already
    ],
)
def test_beside_a_guess(
    solvable: float, guess: float, expected: tuple[float, float], asked: int
) -> None:
    """0.4 tolerances above and below it."""
    toy: Any = Toy(solvable)
    found = hinf._bracket_guess(toy, guess, 0.1, 9.0, 0.1)
    assert_allclose(found, expected, rtol=1e-12)
    assert len(toy.asked) == asked


def test_the_better_design_has_the_lower_upper_bound() -> None:
    one, other = design(2.0, 2.5), design(2.1, 2.2)
    assert hinf._better(one, other) is other
    assert hinf._better(other, one) is other
    assert hinf._better(one, None) is one
    assert hinf._better(None, one) is one
    assert hinf._better(None, None) is None
    assert hinf._better(one, design(1.0, 2.5)) is one  # of two alike the first


@pytest.mark.parametrize(
    ("least", "expected"),
    [(1.5, 1.5), (2.0, 2.0), (2.0 * (1.0 + 5e-10), 2.0), (2.0 * (1.0 + 2e-9), 0.0), (3.0, 0.0)],
)
def test_a_proof_that_the_design_refutes_is_none(least: float, expected: float) -> None:
    """Of γ = 2; rounding in the ninth digit refutes nothing."""
    assert hinf._attach_lower_bound(design(2.0), least).least == expected


def made_by(monkeypatch: pytest.MonkeyPatch, norms: Any) -> list[tuple[float, bool, bool]]:
    """Have designs of a γ bear `norms(γ)`; return what is asked: γ, checked, by the pencil."""
    asked: list[tuple[float, bool, bool]] = []

    def made(plant: Any, problem: Any, gamma: float, *, checked: bool = True) -> Any:
        asked.append((gamma, checked, problem.by_pencil))
        norm = norms(gamma)
        return None if norm is None else design(norm)

    monkeypatch.setattr(hinf, "_design_at", made)
    return asked


def test_backing_off_ends_at_the_first_loop_that_keeps_its_gamma(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Levels 2 (1 + 0.01 f): f = 1 gives nothing, 1.5 a loop above its γ, 3 one below."""
    loops = {2.02: None, 2.03: 2.5, 2.06: 2.05, 2.2: 2.1}
    toy: Any = Toy(2.0)
    asked = made_by(monkeypatch, lambda gamma: loops[round(gamma, 6)])
    found = hinf._back_off(PLANT, toy, 2.0, 0.01)
    assert found is not None
    assert (found.gamma, found.solvable) == (2.05, 2.0)
    assert_allclose([gamma for gamma, *_ in asked], [2.02, 2.03, 2.06], rtol=1e-12)
    assert all(checked for _, checked, _ in asked)
    # none keeps it: the best of all
    asked = made_by(monkeypatch, lambda gamma: 3.0 + gamma)
    found = hinf._back_off(PLANT, toy, 2.0, 0.01)
    assert found is not None
    assert found.gamma == pytest.approx(5.02)
    assert len(asked) == 5
    made_by(monkeypatch, lambda gamma: None)
    assert hinf._back_off(PLANT, toy, 2.0, 0.01) is None


@pytest.mark.parametrize(
    ("norms", "lower"),
    [
        (lambda gamma: 0.985, True),  # below 0.99 of the best
        (lambda gamma: 0.995, False),
        (lambda gamma: 0.5 if gamma == 0.5 else None, True),  # one is enough
        (lambda gamma: None, False),
    ],
)
def test_what_the_bisection_refused_may_do_better(
    monkeypatch: pytest.MonkeyPatch, norms: Any, lower: bool
) -> None:
    toy: Any = Toy(1.0, by_pencil=True)
    asked = made_by(monkeypatch, norms)
    assert hinf._improves_below(PLANT, toy, design(1.0), 0.2) is lower
    expected = [(g, False, pencil) for pencil in (False, True) for g in (0.98, 0.9, 0.5)]
    assert asked == expected
    assert toy.by_pencil is True  # as it was
    asked.clear()
    assert hinf._improves_below(PLANT, toy, design(1.0), 0.6) is (lower and norms(0.9) is not None)
    assert [gamma for gamma, *_ in asked] == [0.98, 0.9] * 2
    toy.by_pencil = False
    hinf._improves_below(PLANT, toy, design(1.0), 0.6)
    assert toy.by_pencil is False


def test_many_gammas_close_in_on_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops exist from γ = 3 on, and have the norm γ: 12 values in four ever narrower spans.

    By the pencil they exist from 2.5 on, so that this search has the better one.
    """
    toy: Any = Toy(0.0)
    asked = made_by(
        monkeypatch, lambda gamma: gamma if gamma >= (2.5 if toy.by_pencil else 3.0) else None
    )
    found = hinf._scan_gamma(PLANT, toy, (1e-8, 1e8))
    assert found is not None
    assert 2.5 <= found.gamma < 2.5 * 1.02
    assert found.solvable == found.gamma
    assert len(asked) == 2 * 4 * 12
    assert_allclose([asked[0][0], asked[11][0]], [1e-8, 1e8], rtol=1e-9)
    assert not any(checked for _, checked, _ in asked)
    # where the second span lies: about the best of the first, as wide as between its neighbours
    first = np.geomspace(1e-8, 1e8, 12)
    at, ratio = first[first >= 3.0][0], first[1] / first[0]
    second = [gamma for gamma, *_ in asked[12:24]]
    assert_allclose(second, np.geomspace(at / ratio, at * ratio, 12), rtol=1e-9)
    asked = made_by(monkeypatch, lambda gamma: None)
    assert hinf._scan_gamma(PLANT, toy, (1e-8, 1e8)) is None
    assert len(asked) == 2 * 12  # a span of nothing is not narrowed


def test_without_a_bracket_sixteen_decades_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    spans: list[tuple[float, float]] = []

    def tried(plant: Any, problem: Any, span: tuple[float, float]) -> None:
        spans.append((span[0] / problem.size, span[1] / problem.size))

    monkeypatch.setattr(hinf, "_scan_gamma", tried)
    monkeypatch.setattr(GammaProblem, "bracket", lambda self: (0.0, None))
    with pytest.raises(SynthesisFailedError, match="were solved for no γ"):
        hinf_synthesis(PLANT, 1, 1, regularisation=0.0)
    assert_allclose(spans, [(1e-8, 1e8)], rtol=1e-12)


def test_where_backing_off_fails_all_above_the_proof_is_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The scalar problem a = 1 has the least γ 1 + √3; the search goes to ten times that."""
    spans: list[tuple[float, float]] = []
    result: list[HinfDesign | None] = [None]

    def tried(plant: Any, problem: Any, span: tuple[float, float]) -> HinfDesign | None:
        spans.append(span)
        return result[0]

    monkeypatch.setattr(hinf, "_scan_gamma", tried)
    monkeypatch.setattr(hinf, "_back_off", lambda *args: None)
    with pytest.raises(SynthesisFailedError, match="no controller near it makes a stable"):
        hinf_synthesis(PLANT, 1, 1, regularisation=0.0)
    result[0] = design(50.0)
    assert hinf_synthesis(PLANT, 1, 1, regularisation=0.0).gamma == 50.0
    least = 1.0 + np.sqrt(3.0)
    for low, high in spans:
        assert least * (1.0 - 2e-4) < low < least  # what is proved, by the bisection's tolerance
        assert_allclose(high, 10.0 * least, rtol=2e-4)


def proved_up_to(bound: float) -> type[GammaProblem]:
    """Return the class of problems in which rounding hides every proof of a γ above a bound."""

    class Bounded(GammaProblem):
        def solve(self, gamma: float, *, checked: bool = True) -> Any:
            before = self.proved
            found = super().solve(gamma, checked=checked)
            if gamma > bound:
                self.proved = before
            return found

    return Bounded


@pytest.mark.parametrize("lost", [1.5e-4, 2e-3, 5e-2, 0.15, 0.35])
def test_a_proof_is_sought_a_little_below_what_the_bisection_refuses(
    monkeypatch: pytest.MonkeyPatch, lost: float
) -> None:
    """Of γ above (1 − `lost`) times the least one, 1 + √3, there is no proof; nearly there is."""
    least = 1.0 + np.sqrt(3.0)
    monkeypatch.setattr(hinf, "GammaProblem", proved_up_to(least * (1.0 - lost)))
    # narrow from the beginning: what the bisection refuses is not proved by chance
    monkeypatch.setattr(GammaProblem, "bracket", lambda self: (0.999999 * least, least))
    found = hinf_synthesis(PLANT, 1, 1, tolerance=1e-5, regularisation=0.0)
    assert 1.0 - 3.4 * lost < found.least / least <= 1.0 - lost  # steps grow by 10/3 at most
    assert_allclose(found.solvable, least, rtol=1e-12)


def test_without_a_proof_eight_decades_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    spans: list[tuple[float, float]] = []

    def tried(plant: Any, problem: Any, span: tuple[float, float]) -> HinfDesign:
        spans.append(span)
        return design(50.0)

    monkeypatch.setattr(hinf, "GammaProblem", proved_up_to(0.0))
    monkeypatch.setattr(hinf, "_scan_gamma", tried)
    monkeypatch.setattr(hinf, "_back_off", lambda *args: None)
    found = hinf_synthesis(PLANT, 1, 1, regularisation=0.0)
    assert (found.gamma, found.least) == (50.0, 0.0)
    least = 1.0 + np.sqrt(3.0)
    assert_allclose(spans, [(1e-8 * least, 10.0 * least)], rtol=2e-4)


@pytest.mark.parametrize("a", [1.0, 3.0])
def test_a_plant_of_measurements_and_controls_alone(a: float) -> None:
    r"""1/(s − a) with control weight and noise of size δ: the least gain is that of δ² K/(1 − G K).

    min ‖K/(1 − G K)‖∞ is the reciprocal of the least Hankel singular value of the unstable part,
    1/(2a) for 1/(s − a) (K. Glover 1986, Robust stabilization of linear multivariable
    systems: relations to approximation, Int. J. Control 43, 741-766).
    """
    one = np.ones((1, 1))
    plant = LtiSystem(a * one, one, one, 0.0 * one)
    for size in (1.0, 0.1):
        found = hinf_synthesis(plant, 1, 1, regularisation=size)
        assert_allclose(found.solvable, 2.0 * a * size**2, rtol=1e-4)
    with pytest.raises(SingularProblemError, match=r"outputs \(there are 0\)"):
        hinf_synthesis(plant, 1, 1, regularisation=0.0)


def test_a_loop_whose_norm_is_not_told_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Static gains k about ẋ = x + u: the pole is 1 + k."""

    def closed(gain: float) -> HinfDesign:
        none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
        return hinf._verify_design(PLANT, LtiSystem(*none, np.array([[gain]])), 7.0)

    with pytest.raises(SynthesisFailedError, match="not stable"):
        closed(-0.5)
    fine = closed(-3.0)
    assert fine.solvable == 7.0
    assert fine.gamma == fine.norm.value
    assert fine.least == 0.0
    monkeypatch.setattr(hinf, "hinf_norm", lambda loop: HinfNorm(1.0, 0.0, np.inf))
    with pytest.raises(SynthesisFailedError, match="do not determine its norm"):
        closed(-3.0)


@pytest.mark.parametrize(("controls", "measurements"), [(0, 1), (4, 1), (1, 0), (1, 4), (-1, 1)])
def test_numbers_that_do_not_fit(controls: int, measurements: int) -> None:
    with pytest.raises(InputError, match=r"do not fit a plant of 3 × 3"):
        hinf_synthesis(PLANT, controls, measurements)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 9e-13}, "tolerance must be"),
        ({"tolerance": 1.0}, "tolerance must be"),
        ({"back_off": -0.1}, "back-off must be"),
        ({"back_off": np.inf}, "back-off must be"),
        ({"regularisation": np.nan}, "regularisation must be"),
    ],
)
def test_options_out_of_range(options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        hinf_synthesis(PLANT, 1, 1, **options)  # type: ignore[arg-type]


def test_a_regularised_problem_proves_nothing_of_the_plant() -> None:
    assert hinf_synthesis(PLANT, 1, 1, back_off=0.0).least > 0.0
    assert hinf_synthesis(PLANT, 1, 1, regularisation=0.01).least == 0.0
