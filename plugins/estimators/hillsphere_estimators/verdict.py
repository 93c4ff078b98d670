"""Verdict on a run of a filter from what is known without the true states.

Four kinds of tests are made, of each case and of all cases together:

- the normalised innovations squared (NIS), their mean and their correlation in time [1]_;
- the curvature of each measurement and motion over the beliefs (`linearity`);
- a fit of the whole arc (`refit`): whether the model explains the measurements, and the expected
  NEES of the filter's beliefs in its light.

Every test is at a share of the level: the sum of the shares is the level (Bonferroni), so that a
consistent filter in a linear problem is called anything else with less than that probability.
Where the fit has settled, the innovations about the fitted trajectory decide on the model and the
expected NEES decides on the filter. The filter's own innovations, which are not normal where a wide
prior meets a curved measurement, then decide nothing. Without a fit they decide.

References
----------
.. [1] Bar-Shalom, Li, Kirubarajan (2001), Estimation with applications to tracking and navigation,
   section 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.linearity import UpdateCurvature, motion_curvature, update_curvature
from hillsphere_estimators.refit import Refit, refit
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.smoother import link
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented

__all__ = ["Answer", "Check", "NonlinearUpdate", "Verdict", "verdict"]

Answer: TypeAlias = Literal[
    "consistent", "overconfident", "underconfident", "not linear enough here", "undecided"
]
"""What a verdict says of a run. "not linear enough here" is an overconfident filter whose model is
right but curved; "overconfident" one whose model does not explain the measurements, or whose
covariance is too small for another reason."""

CURVED = 0.5
"""Root mean square remainder, in standard deviations of the noise, above which an update counts as
curved: the variance of the noise that a linear update assumes is then too small by a quarter. For
motion the unit is the predicted standard deviation."""
_LAGS = 5
"""Lags of the test of whiteness. A wrong process noise shows at the first few, an unmodelled force
at all; each further lag spends power on nothing."""
_LIMITS = 20
"""Limits among which the level is divided. Innovations have eight: NIS, late NIS and slow NIS, high
and low each, mean and whiteness; they are tested about the filter and about the fit. The expected
NEES has four: at the end and on average, high and low each. With the level 0.01 each limit is that
of a two-sided band of 99.9 %."""
_OF_FILTER = ("nis", "late_nis", "slow_nis", "mean", "whiteness")
_OF_FIT = ("fit_nis", "fit_late_nis", "fit_slow_nis", "fit_bias", "fit_whiteness")
_OF_SIGMA = tuple(f"sigma_{name}" for name in _OF_FILTER)
"""Names of the tests of innovations: of the filter, about the fit, and of a sigma-point filter."""
_POORLY_FITTED = 2.0
"""Mean NIS per row about a fit above which it is no solution although the model explains the
measurements: curvature adds some ten percent to it, a wrong minimum many times its value."""
_LEAST_SETS = 3
"""Sets of measurements of a case below which a run is too short for whiteness."""
_MOSTLY_REJECTED = 0.5
"""Share of rejected rows above which a filter that rejects has no measurements to follow, as in the
detection of divergence of the stage ``navigation``."""


@dataclass(frozen=True)
class Check:
    """Result of one test, of all cases together and of each of N cases.

    Parameters
    ----------
    name : str
        Its name.
    says : str
        What its statistic is.
    value, low, high : float
        Statistic of all cases, and the limits between which it passes.
    each, each_low, each_high : ndarray, shape (N,)
        The same of each case; NaN where it does not apply.
    reason : str
        Why the test does not apply, "" if it does.
    """

    name: str
    says: str
    value: float
    low: float
    high: float
    each: Array
    each_low: Array
    each_high: Array
    reason: str = ""

    @property
    def above(self) -> bool:
        """Whether the statistic of all cases is above its limit."""
        return bool(self.value > self.high)

    @property
    def below(self) -> bool:
        """Whether it is below its limit."""
        return bool(self.value < self.low)

    @property
    def each_above(self) -> NDArray[np.bool_]:
        """Whether that of a case is above its limit, (N,)."""
        return np.asarray(self.each > self.each_high)

    @property
    def each_below(self) -> NDArray[np.bool_]:
        """Whether that of a case is below its limit, (N,)."""
        return np.asarray(self.each < self.each_low)

    def __str__(self) -> str:
        if self.reason:
            return f"{self.name}: not applicable, {self.reason}"
        band = (
            f"at most {self.high:.3g}" if self.low <= 0.0 else f"{self.low:.3g} to {self.high:.3g}"
        )
        return f"{self.name}: {self.says} {self.value:.3g} (limit {band})"


@dataclass(frozen=True)
class NonlinearUpdate:
    """The first update, or the first motion, that is too curved for a linear filter.

    Parameters
    ----------
    index : int
        Its set of measurements, from 0.
    time_s : float
        Its time, s, in the first case to which it happens.
    channel : str
        Name of the measured channel with the largest curvature; "motion" for the motion that ends
        at this time.
    row : int
        Row of the measurements; −1 for motion.
    size : float
        Largest root mean square remainder over the belief before it, in standard deviations of the
        noise; for motion of the predicted belief.
    ratio : float
        Variance of the innovation by sigma points over that by linearisation; 1 for motion.
    shift : float
        Mean of the remainder, in standard deviations of the innovation or of the predicted belief.
    cases : int
        Number of cases that are as curved at this update.
    """

    index: int
    time_s: float
    channel: str
    row: int
    size: float
    ratio: float
    shift: float
    cases: int

    def __str__(self) -> str:
        if self.row < 0:
            return (
                f"the motion to t = {self.time_s:g} s departs from its linearisation by {self.size:.3g} "
                f"standard deviations of the predicted states (limit {CURVED:g})"
            )
        return (
            f"the update at t = {self.time_s:g} s with {self.channel}: curvature over the belief is "
            f"{self.size:.3g} standard deviations of the noise (limit {CURVED:g})"
        )


@dataclass(frozen=True)
class Verdict:
    """Verdict on a run of N cases.

    Parameters
    ----------
    answer : str
        Of all cases together: "consistent", "overconfident", "underconfident", "not linear enough
        here" or "undecided".
    reason : str
        Why, in a sentence.
    cases : tuple of str
        The same of each case.
    checks : dict of str to Check
        Tests by name: ``nis``, ``late_nis``, ``slow_nis``, ``mean``, ``whiteness`` and ``rejected`` of the
        filter's innovations; the first five with ``fit_`` of those about the fit; ``final_nees``
        and ``mean_nees``, the expected NEES; ``curvature``, ``path``, ``posterior_curvature`` and
        ``motion``.
    nonlinear : NonlinearUpdate, optional
        The first update or motion that is too curved, whatever the answer.
    fit : Refit, optional
        The fit of the whole arc, if there is one.
    level : float
        Probability with which a consistent filter in a linear problem is called anything else.
    """

    answer: Answer
    reason: str
    cases: tuple[Answer, ...]
    checks: dict[str, Check]
    nonlinear: NonlinearUpdate | None
    fit: Refit | None
    level: float

    def lines(self) -> list[str]:
        """Return the answer with its reason, and a line for each test."""
        return [f"{self.answer}: {self.reason}", *(str(check) for check in self.checks.values())]


def verdict(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array] | None = None,
    *,
    before: Sequence[Belief] | None = None,
    level: float = 0.01,
    fit: bool = True,
) -> Verdict:
    """Judge a run of a filter without the true states; see the module.

    Parameters
    ----------
    model : EstimationModel
        The filter's model.
    prior : Belief
        N cases before the first set of measurements, at its time or before.
    measurements : sequence of MeasurementSet
        K sets, in order.
    after : sequence of Belief
        K: the filter's beliefs after each set.
    innovations : sequence of Innovation
        K: those of the filter.
    controls : sequence of ndarray, shape (p, N), optional
        K: before each set; none by default. The first counts only if the prior is earlier.
    before : sequence of Belief, optional
        K: the filter's beliefs before each set; by default predicted by linearisation from those
        after the sets before.
    level : float
        Probability of a false alarm in a linear problem, divided equally among the tests.
    fit : bool
        Whether the whole arc is fitted. It costs some ten runs of an extended filter, three times
        as much where an update is curved.

    Returns
    -------
    Verdict
        With every test's statistic and limit.

    Raises
    ------
    InputError
        If the sequences differ in length, hold other numbers of cases, or there is no measurement.
    """
    cases, count = len(prior.t_s), len(measurements)
    if controls is None:
        controls = [np.zeros((0, cases))] * count
    _check_lengths(prior, measurements, after, innovations, controls, before, level)
    share = level / _LIMITS
    finite = np.array(
        [np.isfinite(b.x).all(axis=0) & np.isfinite(b.root).all(axis=(1, 2)) for b in after]
    )
    whole = finite.all(axis=0)
    checks: dict[str, Check] = {}
    optimal = update_mask(model, len(prior.x)) is None
    for check in _innovation_checks(innovations, share, whole, optimal, len(prior.x), _OF_FILTER):
        checks[check.name] = check
    checks["rejected"] = _rejected_check(measurements, innovations)
    curves, motions = _curvatures(model, prior, measurements, after, innovations, controls, before)
    nonlinear = _first_nonlinear(curves, motions, measurements)
    checks |= _curvature_checks(curves, motions)
    curved = _curved_cases(curves, motions)
    arc, why = _fit_arc(
        model, prior, measurements, after, innovations, controls, fit, whole, bool(curved.any())
    )
    checks |= _fit_checks(arc, why, share, len(prior.x), whole)
    if curved.any():
        checks |= _reference_checks(model, prior, measurements, innovations, controls, share, whole)
    explained = _is_explained(arc, checks, share, len(prior.x), whole)
    about = checks["fit_nis"]
    answers = tuple(
        _classify(
            _Flags.of(checks, k), bool(curved[k]), explained,
            bool(about.each[k] > np.maximum(_POORLY_FITTED, about.each_high[k])),
        )
        for k in range(cases)
    )  # fmt: skip
    overall = _classify(
        _Flags.of(checks), nonlinear is not None, explained, bool(about.value > _POORLY_FITTED)
    )
    reason = _reason(overall, checks, nonlinear, arc, int((~whole).sum()))
    return Verdict(overall, reason, answers, checks, nonlinear, arc, level)


def _check_lengths(
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    before: Sequence[Belief] | None,
    level: float,
) -> None:
    if not 0.0 < level < 1.0:
        raise InputError(f"level must lie between 0 and 1, got {level:g}")
    count, cases = len(measurements), len(prior.t_s)
    if not count:
        raise InputError("a verdict needs at least one set of measurements, got none")
    lengths = {"after": after, "innovations": innovations, "controls": controls}
    if before is not None:
        lengths["before"] = before
    for name, given in lengths.items():
        if len(given) != count:
            raise InputError(
                f"{name} must have one entry for each of {count} sets of measurements, got {len(given)}"
            )
    for k in range(count):
        others = len(measurements[k].t_s), len(after[k].t_s), innovations[k].used.shape[1]
        if set(others) != {cases}:
            raise InputError(
                f"set {k}: the prior has {cases} cases, but measurements, beliefs and innovations "
                f"have {others[0]}, {others[1]} and {others[2]}"
            )


# -- innovations -----------------------------------------------------------------------------------


def _innovation_checks(
    innovations: Sequence[Innovation], share: float, whole: NDArray[np.bool_], optimal: bool,
    states: int, names: tuple[str, ...],
) -> list[Check]:  # fmt: skip
    """Return NIS over all sets, the later half and windows, mean and whiteness of innovations."""
    white, used = _whiten_all(innovations, whole)
    half = len(innovations) // 2
    # the first sets meet the prior: where it is wide their innovations are not normal, and for a
    # fit their mean is not zero, as the point of its linearisation depends on the measurements
    rows = np.cumsum(used.sum(axis=1).max(axis=1))
    met = min(int(np.searchsorted(rows, states)) + 1, half)
    nis = np.sum(white**2, axis=1)
    dof = used.sum(axis=1)
    return [
        _chi_check(names[0], "mean NIS per row", nis.sum(axis=0), dof.sum(axis=0), share),
        _chi_check(names[1], "mean NIS per row, later half", nis[half:].sum(axis=0), dof[half:].sum(axis=0), share),
        _slow_check(names[2], white, used, share, optimal),
        _mean_check(names[3], white[met:], used[met:], share),
        _whiteness_check(names[4], white, used, share, optimal),
    ]  # fmt: skip


def _whiten_all(
    innovations: Sequence[Innovation], whole: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """Return innovations in units of their roots (K, m, N), and used rows; none of lost cases."""
    white, used = [], []
    for innovation in innovations:
        there = innovation.used & whole
        residual = np.where(there, innovation.residual, 0.0).T
        covariance = np.where(
            whole[:, None, None], innovation.covariance, np.eye(residual.shape[1])
        )
        # symmetric roots keep the rows apart as far as they can be
        value, vector = np.linalg.eigh(covariance)
        scaled = np.einsum("Nji,Nj->Ni", vector, residual) / np.sqrt(np.maximum(value, 1e-300))
        white.append(np.where(there, np.einsum("Nij,Nj->Ni", vector, scaled).T, 0.0))
        used.append(there)
    return np.array(white), np.array(used)


def _chi_check(name: str, says: str, squares: Array, dof: Array, share: float) -> Check:
    """Return the test of χ² numbers (N,) and of their sum, two-sided."""
    total, degrees = float(squares.sum()), float(dof.sum())
    some = np.maximum(dof, 1.0)
    low, high = chi2.ppf(share, some) / some, chi2.isf(share, some) / some
    blank = dof > 0.0
    if not degrees:
        return _blank(name, says, len(dof), "no row was used")
    return Check(
        name, says, total / degrees, float(chi2.ppf(share, degrees)) / degrees,
        float(chi2.isf(share, degrees)) / degrees, np.where(blank, squares / some, np.nan),
        np.where(blank, low, np.nan), np.where(blank, high, np.nan),
    )  # fmt: skip


def _slow_check(
    name: str, white: Array, used: NDArray[np.bool_], share: float, optimal: bool
) -> Check:
    """Return the test of sums over windows: the innovations' power at low frequencies.

    Innovations that are not white belong to an overconfident filter if their power exceeds that of
    white noise at some frequency, to a cautious one if it is less. Windows are of 2, 4, 8 … sets, at
    least two in a run, and the largest power counts, at a share of the level for each length.
    """
    says = "NIS per row of sums over windows"
    count, cases = len(white), white.shape[2]
    if not optimal:
        return _blank(name, says, cases, "a filter with considered states has coloured innovations")
    lengths = [2**k for k in range(1, 12) if 2 ** (k + 1) <= count]
    if not lengths:
        return _blank(name, says, cases, f"a run of {count} sets is too short")
    made = []
    for length in lengths:
        whole = count - count % length
        shape = (-1, length, *white.shape[1:])
        # the end of a run is what counts: windows are laid from there
        sums = white[count - whole :].reshape(shape).sum(axis=1)
        many = used[count - whole :].reshape(shape).sum(axis=1)
        squares = np.sum(sums**2 / np.maximum(many, 1), axis=(0, 1))
        dof = np.sum(many > 0, axis=(0, 1))
        made.append(_chi_check(name, says, squares, dof, share / len(lengths)))
    return _most_extreme(made)


def _most_extreme(checks: list[Check]) -> Check:
    """Return, of all cases and of each, the check that is farthest above its limit, or below."""

    def choose(value: Array, low: Array, high: Array) -> NDArray[np.int64]:
        over = np.where(np.isfinite(value), value / np.maximum(high, 1e-300), -np.inf)
        under = np.where(np.isfinite(value), low / np.maximum(value, 1e-300), -np.inf)
        top = np.argmax(over, axis=0)
        above = np.take_along_axis(over, top[None], axis=0)[0] > 1.0
        return np.where(above, top, np.argmax(np.maximum(over, under), axis=0))

    pooled = choose(
        *(np.array([[getattr(c, k)] for c in checks]) for k in ("value", "low", "high"))
    )
    fields = [np.array([getattr(c, k) for c in checks]) for k in ("each", "each_low", "each_high")]
    own = choose(*fields)
    case = np.arange(len(own))
    return replace(
        checks[int(pooled[0])], each=fields[0][own, case], each_low=fields[1][own, case],
        each_high=fields[2][own, case],
    )  # fmt: skip


def _mean_check(name: str, white: Array, used: NDArray[np.bool_], share: float) -> Check:
    """Return the test of the mean innovation of each row, whose normalised sum is χ²."""
    says = "mean innovations, squared, per row"

    def squares(total: Array, many: Array) -> tuple[Array, Array]:
        return np.sum(total**2 / np.maximum(many, 1.0), axis=0), np.sum(many > 0, axis=0)

    total, many = white.sum(axis=0), used.sum(axis=0)
    each, rows = squares(total, many)
    value, all_rows = squares(total.sum(axis=1), many.sum(axis=1))
    return _one_sided(name, says, float(value), float(all_rows), each, rows, share)


def _whiteness_check(
    name: str, white: Array, used: NDArray[np.bool_], share: float, optimal: bool
) -> Check:
    """Return the test of Ljung and Box's kind: squared correlations at the first lags, per row."""
    says = "squared autocorrelations of the innovations, per lag and row"
    count, cases = len(white), white.shape[2]
    if not optimal:
        return _blank(name, says, cases, "a filter with considered states has coloured innovations")
    if count < _LEAST_SETS:
        return _blank(name, says, cases, f"a run of {count} sets is too short")
    each, lags = np.zeros(cases), np.zeros(cases)
    value = degrees = 0.0
    for lag in range(1, min(_LAGS, count - 1) + 1):
        one, other = white[:-lag], white[lag:]
        both = used[:-lag] & used[lag:]
        product = np.sum(one * other, axis=0)
        many = both.sum(axis=0)
        own = (
            np.sum(np.where(both, one, 0.0) ** 2, axis=0),
            np.sum(np.where(both, other, 0.0) ** 2, axis=0),
        )
        # normalised by the sample's own variances (eq. 5.4.2-14 of the reference), times the count
        enough = many >= _LEAST_SETS - 1
        scale = np.maximum(own[0] * own[1], 1e-300)
        each += np.sum(np.where(enough, many * product**2 / scale, 0.0), axis=0)
        lags += enough.sum(axis=0)
        pooled = np.maximum(own[0].sum(axis=1) * own[1].sum(axis=1), 1e-300)
        there = many.sum(axis=1) >= _LEAST_SETS - 1
        value += float(
            np.sum(np.where(there, many.sum(axis=1) * product.sum(axis=1) ** 2 / pooled, 0.0))
        )
        degrees += float(there.sum())
    return _one_sided(name, says, value, degrees, each, lags, share)


def _one_sided(
    name: str, says: str, value: float, degrees: float, each: Array, dof: Array, share: float
) -> Check:
    """Return a test of χ² numbers that only large values fail."""
    if not degrees:
        return _blank(name, says, len(each), "too few rows follow one another")
    some = np.maximum(dof, 1)
    there = dof > 0
    return Check(
        name, says, value / degrees, 0.0, float(chi2.isf(share, degrees)) / degrees,
        np.where(there, each / some, np.nan), np.zeros(len(each)),
        np.where(there, chi2.isf(share, some) / some, np.nan),
    )  # fmt: skip


def _rejected_check(
    measurements: Sequence[MeasurementSet], innovations: Sequence[Innovation]
) -> Check:
    """Return the share of the rows of the later half that a gate has rejected."""
    half = len(measurements) // 2
    sent = np.sum([np.sum(m.present, axis=0) for m in measurements[half:]], axis=0).astype(float)
    # of a direction the third row is never used: it counts as sent only where nothing was rejected
    taken = np.sum([
        np.sum(i.used | (m.present & ~_real(m)[:, None]), axis=0)
        for m, i in zip(measurements[half:], innovations[half:], strict=True)
    ], axis=0)  # fmt: skip
    each = np.where(sent > 0.0, 1.0 - taken / np.maximum(sent, 1.0), np.nan)
    value = 1.0 - float(taken.sum()) / max(float(sent.sum()), 1.0)
    many = len(each)
    return Check(
        "rejected", "share of rows rejected in the later half", value, 0.0, _MOSTLY_REJECTED, each,
        np.zeros(many), np.full(many, _MOSTLY_REJECTED),
    )  # fmt: skip


def _real(measured: MeasurementSet) -> NDArray[np.bool_]:
    from hillsphere_estimators.differences import layout_of

    return layout_of(measured.blocks).real


def _blank(name: str, says: str, cases: int, reason: str) -> Check:
    none = np.full(cases, np.nan)
    return Check(name, says, np.nan, np.nan, np.nan, none, none, none, reason)


# -- curvature -------------------------------------------------------------------------------------


def _curvatures(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    before: Sequence[Belief] | None,
) -> tuple[list[UpdateCurvature], Array]:
    """Return the curvature of each update, and of the motion to it (K, N), 0 without motion."""
    curves, motions = [], []
    for k, measured in enumerate(measurements):
        start = prior if not k else after[k - 1]
        moves = bool(k) or not np.array_equal(prior.t_s, measured.t_s)
        if before is not None:
            at = before[k]
        else:
            at = link(model, start, measured.t_s, controls[k]).predicted if moves else prior
        curves.append(update_curvature(model, at, after[k], measured, innovations[k].used))
        motions.append(
            motion_curvature(model, start, measured.t_s, controls[k]).rms
            if moves
            else np.zeros(len(prior.t_s))
        )
    return curves, np.array(motions)


def _curved_cases(curves: Sequence[UpdateCurvature], motions: Array) -> NDArray[np.bool_]:
    """Return the cases (N,) in which an update or the motion is curved."""
    sizes = np.array([curve.prior.max(axis=0, initial=0.0) for curve in curves])
    return np.asarray(((sizes > CURVED) | (motions > CURVED)).any(axis=0))


def _first_nonlinear(
    curves: Sequence[UpdateCurvature], motions: Array, measurements: Sequence[MeasurementSet]
) -> NonlinearUpdate | None:
    """Return the first motion or update that is curved in any case, None if there is none."""
    for k, (curve, measured) in enumerate(zip(curves, measurements, strict=True)):
        far = motions[k] > CURVED
        if far.any():
            case = int(np.nanargmax(motions[k]))
            return NonlinearUpdate(
                k, float(measured.t_s[case]), "motion", -1, float(motions[k, case]), 1.0, np.nan,
                int(far.sum()),
            )  # fmt: skip
        bent = curve.prior > CURVED
        if bent.any():
            row, case = np.unravel_index(int(np.nanargmax(curve.prior)), curve.prior.shape)
            names = [
                channel.name
                for block in measured.blocks
                for channel in block
                for _ in range(channel.rows)
            ]
            return NonlinearUpdate(
                k, float(measured.t_s[case]), names[row], int(row), float(curve.prior[row, case]),
                float(curve.ratio[row, case]), float(curve.shift[row, case]),
                int(bent.any(axis=0).sum()),
            )  # fmt: skip
    return None


def _curvature_checks(curves: Sequence[UpdateCurvature], motions: Array) -> dict[str, Check]:
    """Return the largest curvatures over the run."""
    last = curves[-1].posterior.max(axis=0, initial=0.0)
    sizes = {
        "curvature": ("largest remainder of a measurement over the belief before, in sigmas of its noise",
                      np.max([c.prior.max(axis=0, initial=0.0) for c in curves], axis=0)),
        "path": ("largest remainder of a measurement along an update, in sigmas of its noise",
                 np.max([c.path.max(axis=0, initial=0.0) for c in curves], axis=0)),
        "posterior_curvature": ("remainder over the last belief, in sigmas of the noise", last),
        "motion": ("largest remainder of the motion, in predicted sigmas", motions.max(axis=0)),
    }  # fmt: skip
    return {
        name: Check(name, says, float(np.nanmax(each)), 0.0, CURVED, each, np.zeros(len(each)),
                    np.full(len(each), CURVED))
        for name, (says, each) in sizes.items()
    }  # fmt: skip


# -- fit of the whole arc --------------------------------------------------------------------------


def _fit_arc(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    asked: bool,
    whole: NDArray[np.bool_],
    curved: bool,
) -> tuple[Refit | None, str]:
    """Return the fit of the whole arc, or None and why there is none."""
    if not asked:
        return None, "it was not asked for"
    if not whole.any():
        return None, "no case has a finite belief"
    # a lost case keeps the prior, so that the batch is computed as a whole
    beliefs = [
        Belief(
            np.where(whole, b.x, prior.x), np.where(whole[:, None, None], b.root, prior.root), b.t_s
        )
        for b in after
    ]
    counted = [
        replace(m, present=m.present & (i.used | ~_real(m)[:, None]))
        for m, i in zip(measurements, innovations, strict=True)
    ]
    try:
        with np.errstate(all="ignore"):
            return refit(model, prior, counted, beliefs, controls, many_starts=curved), ""
    except InputError as error:
        return None, str(error)
    except np.linalg.LinAlgError:
        return None, "a covariance is singular"


def _model_checks(arc: Refit, share: float, good: NDArray[np.bool_], n: int) -> list[Check]:
    """Return the tests of the innovations about the fit, with that of constant errors."""
    made = _innovation_checks(arc.innovations, share, good, True, n, _OF_FIT)
    made[_OF_FIT.index("fit_bias")] = _bias_check("fit_bias", arc, good, share)
    return made


def _reference_checks(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    share: float,
    whole: NDArray[np.bool_],
) -> dict[str, Check]:
    """Return the tests of the innovations of an iterated sigma-point filter.

    A model that some filter's innovations agree with is not wrong. Sigma points account for the
    curvature of the motion, which neither an extended filter nor a pass about the fit does.
    """
    estimator = BatchedUnscented(BatchedUnscentedSpec(update="iterated"))
    belief, made = prior, []
    try:
        with np.errstate(all="ignore"):
            for k, (measured, own) in enumerate(zip(measurements, innovations, strict=True)):
                if k or not np.array_equal(prior.t_s, measured.t_s):
                    belief = estimator.predict(model, belief, measured.t_s, controls[k])
                counted = replace(
                    measured, present=measured.present & (own.used | ~_real(measured)[:, None])
                )
                belief, innovation = estimator.update(model, belief, counted)
                made.append(innovation)
            good = whole & np.isfinite(belief.x).all(axis=0)
            for innovation in made:
                good &= np.isfinite(innovation.covariance).all(axis=(1, 2))
            checks = _innovation_checks(made, share, good, True, len(prior.x), _OF_SIGMA)
    except (InputError, np.linalg.LinAlgError):
        return {}
    return {check.name: check for check in checks[:3]}


def _bias_check(name: str, arc: Refit, good: NDArray[np.bool_], share: float) -> Check:
    """Return the test of constant errors, the same in all cases or another in each.

    The score sᵀ I⁻¹ s is χ² with as many degrees of freedom as the information I has directions.
    """
    says = "squared score of constant errors, per row"

    def squares(score: Array, information: Array) -> tuple[Array, Array]:
        value, vector = np.linalg.eigh(information)
        # directions without information, as those of rows that were never measured
        there = value > 1e-9 * np.maximum(value[:, -1:], 1e-300)
        along = np.einsum("Nji,Nj->Ni", vector, score)
        return (
            np.sum(np.where(there, along**2 / np.where(there, value, 1.0), 0.0), axis=1),
            there.sum(axis=1),
        )

    score = np.where(good[:, None], arc.score, 0.0)
    information = np.where(good[:, None, None], arc.information, 0.0)
    each, rows = squares(score, information)
    common, degrees = squares(score.sum(axis=0)[None], information.sum(axis=0)[None])
    return _most_extreme([
        _one_sided(name, says, float(total), float(dof), each, rows, 0.5 * share)
        for total, dof in ((common[0], degrees[0]), (each.sum(), rows.sum()))
    ])  # fmt: skip


def _fit_checks(
    arc: Refit | None, why: str, share: float, n: int, whole: NDArray[np.bool_]
) -> dict[str, Check]:
    """Return the tests of the model about the fit, and the expected NEES."""
    says = {
        "final_nees": "expected NEES at the end, per state",
        "mean_nees": "expected NEES on average over the sets, per state",
    }
    if arc is not None and not (arc.settled & whole).any():
        arc, why = None, "no fit has settled"
    if arc is None:
        return {name: _blank(name, "", len(whole), why) for name in (*_OF_FIT, *says)}
    good = arc.settled & whole
    made = {c.name: c for c in _model_checks(arc, share, good, n)}
    one = chi2.ppf(share, n) / n, chi2.isf(share, n) / n
    many = float(n * good.sum())
    band = float(chi2.ppf(share, many) / many), float(chi2.isf(share, many) / many)
    for name, values in (
        ("final_nees", arc.expected[-1]),
        ("mean_nees", arc.expected.mean(axis=0)),
    ):
        each = np.where(good, values / n, np.nan)
        made[name] = Check(
            name, says[name], float(np.nanmean(each)), *band, each, np.full(len(each), one[0]),
            np.full(len(each), one[1]),
        )  # fmt: skip
    return made


# -- the answer ------------------------------------------------------------------------------------


def _is_explained(
    arc: Refit | None, checks: dict[str, Check], share: float, n: int, whole: NDArray[np.bool_]
) -> bool:
    """Return whether the model explains the measurements of most cases, and those perfectly.

    The fit of a case may end in a wrong solution. The cases in which it does are told from a wrong
    model by the others: without them the tests pass.
    """
    if arc is None or checks["fit_nis"].reason:
        return False
    good = arc.settled & whole
    apart = np.any([checks[name].each_above for name in _OF_FIT], axis=0)
    rest = good & ~apart
    if 2 * rest.sum() < len(whole):
        return False
    return not any(check.above for check in _model_checks(arc, share, rest, n))


@dataclass(frozen=True)
class _Flags:
    """Which tests of a case, or of all cases together, are above or below their limits."""

    high: frozenset[str]
    low: frozenset[str]
    there: frozenset[str]

    @classmethod
    def of(cls, checks: dict[str, Check], case: int | None = None) -> _Flags:
        """Return those of one case, or of all together."""

        def names(pooled: str, each: str) -> frozenset[str]:
            return frozenset(
                name for name, check in checks.items()
                if (getattr(check, pooled) if case is None else getattr(check, each)[case])
            )  # fmt: skip

        there = frozenset(
            name for name, check in checks.items()
            if np.isfinite(check.value if case is None else check.each[case])
        )  # fmt: skip
        return cls(names("above", "each_above"), names("below", "each_below"), there)


def _classify(flags: _Flags, curved: bool, explained: bool, poorly_fitted: bool = False) -> Answer:
    """Return the answer from the tests of one case or of all.

    Parameters
    ----------
    flags : _Flags
        Tests that have failed.
    curved : bool
        Whether the motion or an update is curved.
    explained : bool
        Whether the model explains most cases, see `_is_explained`.
    poorly_fitted : bool
        Whether the NIS about the fit is above `_POORLY_FITTED`.
    """
    if "nis" not in flags.there:
        return "undecided"
    fitted = "final_nees" in flags.there
    # the power of the innovations, about whatever linearisation: one that passes clears the model
    powers = [
        bool(flags.high & set(names[:3]))
        for names in (_OF_FILTER, _OF_FIT, _OF_SIGMA)
        if names[0] in flags.there
    ]
    wrong = all(powers)
    if fitted and flags.high & set(_OF_FIT[:3]) and poorly_fitted and not (wrong or explained):
        fitted = False
    bias = (_OF_FIT if fitted else _OF_FILTER)[3]
    if not (fitted and flags.high & set(_OF_FIT[:3])):
        wrong = wrong or bias in flags.high
    optimistic = fitted and bool(flags.high & {"final_nees", "mean_nees"})
    # innovations smaller than stated, and a fit that is worse than the model: they contradict
    if curved and poorly_fitted and "nis" in flags.low and not explained and not optimistic:
        return "undecided"
    if optimistic and curved and (explained or not wrong):
        return "not linear enough here"
    if not fitted and curved:
        if powers[0]:
            return "undecided" if "nis" in flags.low else "not linear enough here"
        return "not linear enough here" if "posterior_curvature" in flags.high else "undecided"
    if wrong or optimistic or "rejected" in flags.high:
        return "overconfident"
    names = _OF_FIT if fitted else _OF_FILTER
    if flags.low & {*names[1:3], "final_nees"}:
        return "underconfident"
    # coloured innovations of a filter that shows no power too much: of a curved one by curvature
    return "undecided" if names[4] in flags.high and not curved else "consistent"


def _reason(
    answer: Answer,
    checks: dict[str, Check],
    nonlinear: NonlinearUpdate | None,
    arc: Refit | None,
    lost: int,
) -> str:
    """Return why, in a sentence."""
    failed = [
        str(check)
        for name, check in checks.items()
        if check.above and name not in ("curvature", "path", "posterior_curvature", "motion")
    ]
    low = [str(check) for check in checks.values() if check.below]
    gone = f"; the beliefs of {lost} cases are not finite" if lost else ""
    if answer == "not linear enough here":
        more = f"; {'; '.join(failed)}" if failed else ""
        return f"{nonlinear}{more}{gone}"
    if answer == "overconfident":
        return "; ".join(failed) + gone
    if answer == "underconfident":
        return "; ".join(low) + gone
    if answer == "undecided":
        return f"no test can decide: {checks['final_nees']}{gone}"
    return f"no test fails its limit{gone}"
