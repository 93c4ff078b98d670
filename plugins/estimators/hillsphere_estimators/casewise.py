"""Estimators of N cases, of which one that fails leaves the others as they are.

A case fails if its belief, its prediction or the prediction of a measured row is no number. In a
batch its belief becomes NaN (`hillsphere.estimation.Belief.finite`), a failure of the class
``numerics``; a single case raises. A failed case is computed with the belief of another one, so
that no model meets a NaN that an earlier step has left. If a model raises `PropagationError`, the
cases to blame are found by trying each.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError, PropagationError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers
from hillsphere_estimators.differences import layout_of
from hillsphere_estimators.innovations import WhitenedInnovation, usable
from hillsphere_estimators.linearisation import predict_measurement
from hillsphere_estimators.roots import unit
from hillsphere_estimators.state_angles import state_angles, wrap_means

__all__ = ["CasewiseEstimator", "drop_failed", "mark_failed", "refuse_no_cases", "replace_failed"]

Flags = NDArray[np.bool_]


class CasewiseEstimator(ABC):
    """An estimator whose cases fail one by one; derived classes give `_predict` and `_update`.

    Means of states that are angles are returned in (−π, π].
    """

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at other times; see `hillsphere.interfaces.Estimator`.

        Raises
        ------
        InputError
            If there is no case, the belief of a single one is not finite, or a case is predicted
            backward over process noise.
        PropagationError
            If the prediction of a single case is not finite.
        """
        safe, failed, control = replace_failed(belief, control)
        if failed.all():
            return replace(belief, t_s=np.asarray(t_to_s, dtype=float))
        try:
            after = self._predict(model, safe, t_to_s, control)
        except PropagationError:
            if len(failed) == 1:
                raise
            failed = failed | self._find_failing(model, safe, t_to_s, control)
            if failed.all():
                raise
            own = np.where(failed, np.argmin(failed), np.arange(len(failed)))
            after = self._predict(model, _take_states(safe, own), t_to_s, control[:, own])
        failed = failed | ~after.finite
        if failed.any() and len(failed) == 1:
            raise PropagationError(
                f"the prediction from {belief.t_s[0]:.12g} s to {t_to_s[0]:.12g} s is not finite: "
                f"the model moves the mean {belief.x[:, 0].tolist()} to {after.x[:, 0].tolist()}"
            )
        return wrap_means(mark_failed(after, failed), state_angles(model, len(belief.x)))

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements; see `hillsphere.interfaces.Estimator`.

        Raises
        ------
        InputError
            If there is no case, belief and measurements do not fit, or the prediction of a row that
            was measured is not finite in a single case.
        PropagationError
            If the updated belief of a single case is not finite.
        """
        safe, failed, _ = replace_failed(belief)
        after, innovation, missed = self._update(model, safe, measurements)
        if missed.any() and len(failed) == 1:
            raise InputError(_describe_missed(model, belief, measurements))
        missed = missed | failed
        failed = missed | ~after.finite
        if failed.any() and len(failed) == 1:
            raise PropagationError(
                f"the update at {belief.t_s[0]:.12g} s is not finite: the model predicts no "
                f"numbers near the mean {belief.x[:, 0].tolist()}"
            )
        if missed.any():
            innovation = _mark_missed(innovation, usable(measurements)[1], missed)
        return wrap_means(
            mark_failed(after, failed), state_angles(model, len(belief.x))
        ), innovation

    def _find_failing(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Flags:
        """Return the cases (N,) whose prediction raises, each tried in the place of all."""
        cases = len(belief.t_s)
        failing = np.zeros(cases, dtype=bool)
        for case in range(cases):
            all_its = np.full(cases, case)
            one = Belief(belief.x[:, all_its], belief.root[all_its], belief.t_s[all_its])
            try:
                self._predict(model, one, np.asarray(t_to_s)[all_its], control[:, all_its])
            except PropagationError:
                failing[case] = True
        return failing

    @abstractmethod
    def _predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the prediction of finite beliefs."""

    @abstractmethod
    def _update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation, Flags]:
        """Return the update of finite beliefs, and the cases (N,) whose rows `drop_failed` left."""


def refuse_no_cases(belief: Belief) -> None:
    """Refuse a belief of no cases.

    Parameters
    ----------
    belief : Belief
        Beliefs of N cases.

    Raises
    ------
    InputError
        If N = 0.
    """
    if not len(belief.t_s):
        raise InputError("the belief must have at least one case, got none")


def replace_failed(belief: Belief, control: Array | None = None) -> tuple[Belief, Flags, Array]:
    """Return a belief with failed cases replaced by a sound one.

    Parameters
    ----------
    belief : Belief
        Beliefs of N cases, NaN in failed ones.
    control : ndarray, shape (p, N), optional
        Their controls.

    Returns
    -------
    belief : Belief
        Finite, unless all of several cases have failed; at its own times.
    failed : ndarray of bool, shape (N,)
        Which cases had failed.
    control : ndarray, shape (p, N)
        The controls, likewise.

    Raises
    ------
    InputError
        If the belief has no cases, or that of a single case is not finite.
    """
    refuse_no_cases(belief)
    failed = ~belief.finite
    control = np.zeros((0, len(failed))) if control is None else control
    if not failed.any() or (failed.all() and len(failed) > 1):
        return belief, failed, control
    if len(failed) == 1:
        raise InputError(
            f"the belief at {belief.t_s[0]:.12g} s is not finite: its mean is "
            f"{belief.x[:, 0].tolist()}"
        )
    own = np.where(failed, np.argmin(failed), np.arange(len(failed)))
    return _take_states(belief, own), failed, control[:, own]


def _take_states(belief: Belief, own: Integers) -> Belief:
    """Return means and covariances of the cases `own` (N,), at the times of the belief."""
    return Belief(belief.x[:, own], belief.root[own], belief.t_s)


def mark_failed(belief: Belief, failed: Flags) -> Belief:
    """Return a belief with NaN in failed cases (N,); the same object if there is none."""
    if not failed.any():
        return belief
    x = np.where(failed, np.nan, belief.x)
    return Belief(x, np.where(failed[:, None, None], np.nan, belief.root), belief.t_s)


def drop_failed(expected: WhitenedInnovation) -> tuple[WhitenedInnovation, Flags]:
    """Leave out the rows of cases whose predicted measurements are no numbers.

    Parameters
    ----------
    expected : WhitenedInnovation
        Of N cases.

    Returns
    -------
    expected : WhitenedInnovation
        With finite numbers only; failed cases use no row.
    failed : ndarray of bool, shape (N,)
        Which cases have failed.
    """
    parts = [np.isfinite(a) for a in (expected.residual, expected.linear, expected.bent)]
    if all(part.all() for part in parts):
        return expected, np.zeros(len(expected.residual), dtype=bool)
    finite: Flags = np.asarray(
        parts[0].all(axis=1) & parts[1].all(axis=(1, 2)) & parts[2].all(axis=(1, 2))
    )
    keep = finite[:, None, None]
    root = expected.root
    return WhitenedInnovation(
        np.where(finite[:, None], expected.residual, 0.0),
        np.where(keep, expected.linear, 0.0),
        np.where(keep, expected.bent, 0.0),
        expected.used & finite,
        None if root is None else np.where(keep, root, unit(root.shape[1])),
    ), ~finite


def _mark_missed(innovation: Innovation, used: Flags, missed: Flags) -> Innovation:
    """Return an innovation with NaN in cases (N,) whose rows could not be predicted."""
    return Innovation(
        np.where(missed & used, np.nan, innovation.residual),
        np.where(missed[:, None, None], np.nan, innovation.covariance),
        np.where(missed, used, innovation.used),
        np.where(missed, np.nan, innovation.nis),
    )


def _describe_missed(model: EstimationModel, belief: Belief, measurements: MeasurementSet) -> str:
    """Return the message on rows of a single case that were measured but cannot be predicted."""
    layout = layout_of(measurements.blocks)
    shown = predict_measurement(model, belief, layout)[:, 0]
    rows = np.flatnonzero(~np.isfinite(shown) & measurements.present[:, 0])
    where = f"rows {rows.tolist()} at" if rows.size else "rows near"
    return (
        f"at {belief.t_s[0]:.12g} s the model predicts no finite measurement of {where} the mean "
        f"{belief.x[:, 0].tolist()}, although they were measured; give NaN for values that are not "
        "to be used"
    )
