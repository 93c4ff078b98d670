"""Unscented filter and smoother beside the textbook's sums over weighted points, where all bends.

The expected values are those of the dense form: means and covariances as sums over 2n + 1 points
with the weights of Wan and van der Merwe (2000), eq. 15, the update by the gain P_xz S⁻¹ and a
difference of covariances, the smoother of Särkkä (2008). The code under test never forms these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Channel, Integers
from hillsphere_estimators.sigma_points import (
    SigmaRule,
    sigma_points,
    transform_motion,
    update_mask,
)
from hillsphere_estimators.smoother import link, smooth
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented, belief_of_images

RULES = [SigmaRule(), SigmaRule(alpha=0.5, beta=2.3, kappa=0.7), SigmaRule(1.2, 1.44, 1.0)]
SIGMA = np.array([0.3, 0.5, 0.2])
CONTROL = np.array([[0.4, -0.3]])
START, LATER = np.array([10.0, 20.0]), np.array([12.0, 21.0])


class Bent:
    """Two states, two cases with motions of their own; a control and times enter."""

    blocks = tuple((Channel(f"z{k}", "m"),) for k in range(3))

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        a, b = x
        dt = t1_s - t0_s
        bend = np.array([0.3, -0.8])[case]
        return np.array([a + dt * b + bend * b**2, 0.9 * b + control[0] + 0.4 * np.sin(a) * b])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        root = np.array([[0.2, 0.0, 0.1], [0.1, 0.3, -0.2]])
        return np.asarray((t1_s - t0_s)[:, None, None] * root)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        a, b = x
        return np.array([a**2 + 0.1 * t_s, a * b + case, np.sin(2.0 * b) + a])


class Flown(Bent):
    """The same, of which the second state is not estimated."""

    considered = np.array([False, True])


@dataclass(frozen=True)
class Normal:
    """Mean and covariance."""

    mean: Array
    covariance: Array


@dataclass(frozen=True)
class Joint:
    """What the points of a belief and their images show."""

    image: Normal
    cross: Array


def beliefs() -> Belief:
    covariance = np.array([[[0.5, 0.2], [0.2, 0.4]], [[0.3, -0.1], [-0.1, 0.6]]])
    return Belief.of(np.array([[1.0, -0.5], [0.6, 1.2]]), covariance, START)


def of_case(belief: Belief, case: int) -> Normal:
    return Normal(belief.x[:, case], belief.covariance[case])


def by_points(rule: SigmaRule, prior: Normal, function: object) -> Joint:
    """Sum over the points x, x ± √(n + λ) S_j with the weights of eq. 15."""
    n = len(prior.mean)
    lam = rule.alpha**2 * (n + rule.kappa) - n
    steps = np.sqrt(n + lam) * np.linalg.cholesky(prior.covariance)
    points = prior.mean[:, None] + np.hstack([np.zeros((n, 1)), steps, -steps])
    weights = np.full(2 * n + 1, 0.5 / (n + lam))
    weights[0] = lam / (n + lam)
    spread = weights.copy()
    spread[0] += 1.0 - rule.alpha**2 + rule.beta
    images = function(points)  # type: ignore[operator]
    mean = images @ weights
    off = images - mean[:, None]
    return Joint(
        Normal(mean, (spread * off) @ off.T),
        (spread * (points - prior.mean[:, None])) @ off.T,
    )


def step_of(rule: SigmaRule, prior: Normal, case: int) -> Joint:
    """Predict one case."""
    model, many = Bent(), np.full(2 * len(prior.mean) + 1, 1.0)
    joint = by_points(
        rule,
        prior,
        lambda x: model.advance(
            x, START[case] * many, LATER[case] * many, CONTROL[:, case, None] * many,
            np.full(many.shape, case),
        ),
    )  # fmt: skip
    root = model.process_noise(prior.mean[:, None], START[[case]], LATER[[case]], CONTROL)[0]
    image = Normal(joint.image.mean, joint.image.covariance + root @ root.T)
    return Joint(image, joint.cross)


def transform_case(rule: SigmaRule, prior: Normal, case: int) -> Joint:
    """Show one case to the sensors."""
    many = np.ones(2 * len(prior.mean) + 1)
    return by_points(
        rule, prior, lambda x: Bent().observe(x, START[case] * many, np.full(many.shape, case))
    )


def estimator(rule: SigmaRule, **keys: object) -> BatchedUnscented:
    given = {"alpha": rule.alpha, "beta": rule.beta, "kappa": rule.kappa, **keys}
    return BatchedUnscented(BatchedUnscentedSpec(**given))  # type: ignore[arg-type]


def make_measurements() -> MeasurementSet:
    values = np.array([[2.9, 1.8], [1.4, 0.1], [2.2, -0.9]])
    return MeasurementSet.of(START, values, SIGMA[:, None], Bent.blocks)


@pytest.mark.parametrize("rule", RULES)
def test_prediction(rule: SigmaRule) -> None:
    found = estimator(rule).predict(Bent(), beliefs(), LATER, CONTROL)
    assert_array_equal(found.t_s, LATER)
    for case in range(2):
        image = step_of(rule, of_case(beliefs(), case), case).image
        assert_allclose(found.x[:, case], image.mean, rtol=1e-12)
        assert_allclose(found.covariance[case], image.covariance, rtol=1e-12)


@pytest.mark.parametrize("rule", RULES)
def test_images_are_halves_of_the_points_differences(rule: SigmaRule) -> None:
    """Odd rows give the cross covariance, Sᵀ's rows with them, and even rows none."""
    images = transform_motion(rule, Bent(), beliefs(), LATER, CONTROL)
    assert images.odd.shape == (2, 2, 2)
    assert images.even.shape == (2, 3, 2)
    for case in range(2):
        prior = of_case(beliefs(), case)
        joint = step_of(rule, prior, case)
        root = beliefs().root[case]
        assert_allclose(root @ images.odd[case], joint.cross, rtol=1e-12, atol=1e-14)
        middle = Bent().advance(
            prior.mean[:, None], START[[case]], LATER[[case]], CONTROL[:, [case]], np.array([case])
        )
        assert_allclose(images.middle[:, [case]], middle, rtol=1e-14)
        assert_allclose(images.shift[:, case], joint.image.mean - middle[:, 0], rtol=1e-11)
        total = sum(rows[case].T @ rows[case] for rows in (images.odd, images.even))
        noise = Bent().process_noise(prior.mean[:, None], START[[case]], LATER[[case]], CONTROL)[0]
        assert_allclose(total + noise @ noise.T, joint.image.covariance, rtol=1e-12)


def test_points_of_a_belief() -> None:
    belief = beliefs()
    points = sigma_points(belief, 3.0)
    assert points.shape == (2, 5, 2)
    for case in range(2):
        root = np.linalg.cholesky(belief.covariance[case])
        expected = belief.x[:, [case]] + 3.0 * np.hstack([np.zeros((2, 1)), root, -root])
        assert_allclose(points[:, :, case], expected, rtol=1e-13)


@pytest.mark.parametrize("rule", RULES)
def test_plain_update(rule: SigmaRule) -> None:
    after, innovation = estimator(rule, update="plain").update(
        Bent(), beliefs(), make_measurements()
    )
    for case in range(2):
        prior = of_case(beliefs(), case)
        joint = transform_case(rule, prior, case)
        s = joint.image.covariance + np.diag(SIGMA**2)
        residual = make_measurements().values[:, case] - joint.image.mean
        gain = joint.cross @ np.linalg.inv(s)
        assert_allclose(after.x[:, case], prior.mean + gain @ residual, rtol=1e-11)
        assert_allclose(
            after.covariance[case], prior.covariance - gain @ s @ gain.T, rtol=1e-10, atol=1e-13
        )
        assert_allclose(innovation.residual[:, case], residual, rtol=1e-11)
        assert_allclose(innovation.covariance[case], s, rtol=1e-11)
        assert_allclose(innovation.nis[case], residual @ np.linalg.solve(s, residual), rtol=1e-11)


@pytest.mark.parametrize("rule", RULES)
def test_update_of_some_states_by_schmidt(rule: SigmaRule) -> None:
    """The gain's row of the other state is zero, and the covariance is Joseph's form."""
    after, _ = estimator(rule, update="plain").update(Flown(), beliefs(), make_measurements())
    for case in range(2):
        prior = of_case(beliefs(), case)
        joint = transform_case(rule, prior, case)
        s = joint.image.covariance + np.diag(SIGMA**2)
        gain = joint.cross @ np.linalg.inv(s)
        gain[1] = 0.0
        both = gain @ joint.cross.T
        assert_allclose(
            after.x[:, case],
            prior.mean + gain @ (make_measurements().values[:, case] - joint.image.mean),
            rtol=1e-11,
        )
        assert_allclose(
            after.covariance[case],
            prior.covariance - both - both.T + gain @ s @ gain.T,
            rtol=1e-10,
        )


def test_tempered_update_is_a_chain_of_plain_ones() -> None:
    """Each power p of the likelihood is a plain update with noise R/p from the belief before it.

    The first power is the inverse of the largest variance that curvature adds in units of the
    noise, the next ones grow at most tenfold, and all sum to one.
    """
    rule, powers = RULES[1], 4
    after, _ = estimator(rule, update="tempered", powers=powers).update(
        Bent(), beliefs(), make_measurements()
    )
    for case in range(2):
        now, left, last, used = of_case(beliefs(), case), 1.0, np.inf, []
        for k in range(powers):
            joint = transform_case(rule, now, case)
            straight = joint.cross.T @ np.linalg.solve(now.covariance, joint.cross)
            bend = np.diag(joint.image.covariance - straight) / SIGMA**2
            power = min(1.0 / max(bend.max(), 1.0), 10.0 * last, left)
            power = left if k == powers - 1 else power
            s = joint.image.covariance + np.diag(SIGMA**2) / power
            gain = joint.cross @ np.linalg.inv(s)
            residual = make_measurements().values[:, case] - joint.image.mean
            now = Normal(now.mean + gain @ residual, now.covariance - gain @ s @ gain.T)
            left, last = left - power, power
            used.append(power)
            if left <= 0.0:
                break
        assert len(used) > 1  # else nothing is tempered
        assert_allclose(after.x[:, case], now.mean, rtol=1e-9)
        assert_allclose(after.covariance[case], now.covariance, rtol=1e-9)


def test_iterated_update_rests_at_its_own_linearisation() -> None:
    """The posterior is that of the statistical linearisation about itself [García-Fernández].

    With z ≈ A x + b + ω about the posterior, A = P_xzᵀ P⁻¹ and Ω what curvature leaves.
    """
    rule = RULES[1]
    # measured at what the states 0.3σ from the prior show, so that it settles near them
    x = beliefs().x + 0.2
    values = Bent().observe(x, START, np.arange(2))
    near = MeasurementSet.of(START, values, SIGMA[:, None], Bent.blocks)
    after, innovation = estimator(
        rule, update="iterated", iterations=200, tolerance_sigmas=1e-11
    ).update(Bent(), beliefs(), near)
    for case in range(2):
        prior, posterior = of_case(beliefs(), case), of_case(after, case)
        joint = transform_case(rule, posterior, case)
        slopes = np.linalg.solve(posterior.covariance, joint.cross).T
        bent = joint.image.covariance - slopes @ posterior.covariance @ slopes.T
        s = slopes @ prior.covariance @ slopes.T + bent + np.diag(SIGMA**2)
        gain = prior.covariance @ slopes.T @ np.linalg.inv(s)
        expected = joint.image.mean + slopes @ (prior.mean - posterior.mean)
        residual = near.values[:, case] - expected
        assert_allclose(posterior.mean, prior.mean + gain @ residual, rtol=0, atol=1e-8)
        assert_allclose(
            posterior.covariance, prior.covariance - gain @ s @ gain.T, rtol=0, atol=1e-8
        )
        # the innovation is about the prior, whatever the iteration ends at
        first = transform_case(rule, prior, case).image
        assert_allclose(innovation.residual[:, case], near.values[:, case] - first.mean, rtol=1e-10)


@pytest.mark.parametrize("rule", RULES)
def test_smoother(rule: SigmaRule) -> None:
    """One step back, x_s = x + G (x'_s − x'), P_s = P + G (P'_s − P') Gᵀ, G = C P'⁻¹.

    Curvature widens P' beyond what the odd half of the images and the noise make of it.
    """
    now = beliefs()
    tie = link(Bent(), now, LATER, CONTROL, rule)
    later = Belief.of(
        tie.predicted.x + np.array([[0.3, -0.2], [0.1, 0.4]]), 0.4 * tie.predicted.covariance, LATER
    )
    first, last = smooth([now, later], [tie])
    assert last is later
    assert_array_equal(first.t_s, START)
    filtered = estimator(rule).predict(Bent(), now, LATER, CONTROL)
    assert_allclose(tie.predicted.covariance, filtered.covariance, rtol=1e-11)
    for case in range(2):
        prior = of_case(now, case)
        joint = step_of(rule, prior, case)
        assert_allclose(tie.predicted.x[:, case], joint.image.mean, rtol=1e-12)
        gain = joint.cross @ np.linalg.inv(joint.image.covariance)
        assert_allclose(tie.gain[case], gain, rtol=1e-10)
        rest = prior.covariance - gain @ joint.image.covariance @ gain.T
        assert_allclose(tie.rest[case] @ tie.rest[case].T, rest, rtol=1e-9, atol=1e-12)
        shift = later.x[:, case] - joint.image.mean
        assert_allclose(first.x[:, case], prior.mean + gain @ shift, rtol=1e-10)
        gained = later.covariance[case] - joint.image.covariance
        assert_allclose(
            first.covariance[case], prior.covariance + gain @ gained @ gain.T, rtol=1e-9, atol=1e-12
        )


def test_three_beliefs_go_back_in_their_order() -> None:
    """Two steps by the same formula, the second from what the first has given."""
    rule = RULES[0]
    now = beliefs()
    one = link(Bent(), now, LATER, CONTROL, rule)
    middle = Belief.of(one.predicted.x + 0.1, 0.7 * one.predicted.covariance, LATER)
    two = link(Bent(), middle, LATER + 1.5, CONTROL, rule)
    end = Belief.of(two.predicted.x - 0.2, 0.5 * two.predicted.covariance, LATER + 1.5)
    found = smooth([now, middle, end], [one, two])
    expected = [end]
    for belief, tie in ((middle, two), (now, one)):
        later, pieces = expected[-1], []
        for case in range(2):
            gain, wide = tie.gain[case], tie.predicted.covariance[case]
            x = belief.x[:, case] + gain @ (later.x - tie.predicted.x)[:, case]
            p = belief.covariance[case] + gain @ (later.covariance[case] - wide) @ gain.T
            pieces.append((x, p))
        x, p = (np.array(part) for part in zip(*pieces, strict=True))
        expected.append(Belief.of(x.T, p, belief.t_s))
    for ours, theirs in zip(found, expected[::-1], strict=True):
        assert_allclose(ours.x, theirs.x, rtol=1e-9)
        assert_allclose(ours.covariance, theirs.covariance, rtol=1e-8, atol=1e-11)
    for ties in ([one], [one, two, two]):
        with pytest.raises(InputError, match=r"smoothing 3 beliefs needs 2 links, got"):
            smooth([now, middle, end], ties)


def test_images_and_noise_make_a_belief() -> None:
    images = transform_motion(RULES[1], Bent(), beliefs(), LATER, CONTROL)
    bare = belief_of_images(images, np.zeros((2, 2, 1)), LATER)
    wide = belief_of_images(images, np.array([[[0.5], [0.0]], [[0.0], [2.0]]]), LATER)
    added = wide.covariance - bare.covariance
    assert_allclose(added[0], [[0.25, 0.0], [0.0, 0.0]], rtol=0, atol=1e-12)
    assert_allclose(added[1], [[0.0, 0.0], [0.0, 4.0]], rtol=0, atol=1e-12)


def test_rules_of_sigma_points() -> None:
    assert SigmaRule(alpha=0.5, beta=2.0, kappa=1.0).reach(3) == pytest.approx(1.0)  # 0.5 √4
    assert SigmaRule(alpha=2.0, beta=4.0).reach(4) == pytest.approx(4.0)  # β = α² is allowed
    for alpha, beta in ((2.0, 3.9), (0.0, 2.0)):
        with pytest.raises(InputError, match="sigma points need alpha > 0"):
            SigmaRule(alpha=alpha, beta=beta)
    assert SigmaRule(kappa=-2.5).reach(3) == pytest.approx(np.sqrt(0.5))


def test_considered_states() -> None:
    assert update_mask(Bent(), 2) is None
    assert_array_equal(update_mask(Flown(), 2), [1.0, 0.0])

    class NoneHeld(Bent):
        considered = np.array([False, False])

    assert update_mask(NoneHeld(), 2) is None
    with pytest.raises(InputError, match=r"considered must be \(3,\)"):
        update_mask(Flown(), 3)


def one_case(belief: Belief, case: int) -> Belief:
    own = slice(case, case + 1)
    return Belief(belief.x[:, own], belief.root[own], belief.t_s[own])


class Alike(Bent):
    """Both cases with the same sensors."""

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return super().observe(x, t_s, np.zeros_like(case))


def near_and_far() -> tuple[Belief, MeasurementSet]:
    """Return a case that settles soon and one whose second step is longer than one deviation."""
    covariance = np.array([[[0.02, 0.0], [0.0, 0.02]], [[4.0, 0.0], [0.0, 9.0]]])
    prior = Belief.of(np.array([[1.0, 1.0], [0.6, -2.0]]), covariance, np.full(2, 10.0))
    truth = np.array([[1.05, 3.0], [0.65, 1.5]])
    values = Alike().observe(truth, prior.t_s, np.arange(2))
    sigma = np.repeat(np.array([[0.05], [0.05], [0.02]]), 2, axis=1)
    return prior, MeasurementSet.of(prior.t_s, values, sigma, Bent.blocks)


def measurements_of_case(measured: MeasurementSet, case: int) -> MeasurementSet:
    own = slice(case, case + 1)
    return MeasurementSet.of(
        measured.t_s[own], measured.values[:, own], measured.sigma[:, own], measured.blocks
    )


def test_only_the_case_that_leaps_takes_the_update_in_powers() -> None:
    """Two iterations: the near case keeps what they gave, the far one that of the powers."""
    prior, sets = near_and_far()
    rule = RULES[0]
    keys = {"iterations": 2, "tolerance_sigmas": 1e-9}
    together, _ = estimator(rule, update="iterated", **keys).update(Alike(), prior, sets)
    powers, _ = estimator(rule, update="tempered").update(Alike(), prior, sets)
    plain, _ = estimator(rule, update="plain").update(Alike(), prior, sets)
    alone, _ = estimator(rule, update="iterated", **keys).update(
        Alike(), one_case(prior, 0), measurements_of_case(sets, 0)
    )
    assert_allclose(together.x[:, 0], alone.x[:, 0], rtol=1e-12)
    assert np.abs(together.x[:, 0] - powers.x[:, 0]).max() > 1e-9
    assert np.abs(together.x[:, 0] - plain.x[:, 0]).max() > 1e-9
    assert_allclose(together.x[:, 1], powers.x[:, 1], rtol=1e-12)
    assert_allclose(together.covariance[1], powers.covariance[1], rtol=1e-9)


def test_a_case_within_the_tolerance_rests() -> None:
    """With a tolerance of half a deviation the first iteration is the last, however many may be."""
    prior, sets = near_and_far()
    prior, sets = one_case(prior, 0), measurements_of_case(sets, 0)
    found = [
        estimator(RULES[0], update="iterated", iterations=n, tolerance_sigmas=0.5)
        .update(Alike(), prior, sets)[0]
        .x
        for n in (2, 30)
    ]
    assert_array_equal(found[0], found[1])
