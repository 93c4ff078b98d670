"""The choice of the best controller among the results of searches."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.errors import NotStabilisableError, SynthesisFailedError
from hillsphere_controllers.structured.records import Problem, SearchResult
from hillsphere_controllers.structured.structure import controller_of
from hillsphere_controllers.structured.verification import Verified, verify_controller

__all__ = ["SAME", "best_verified", "explain_failure"]

SAME = 1e-4
"""Minima whose γ differ by less, relative, are taken for the same."""
_ON_AXIS = 1e-6
"""Real part of the rightmost poles, relative to the plant's rate, that counts as zero: a double
pole on the axis is found to the root of rounding, 1e-8, and the descent to it ends a little
before."""


def best_verified(
    problem: Problem,
    candidates: Sequence[SearchResult],
    prefer: Callable[[LtiSystem], float] | None,
    tie: float,
) -> tuple[SearchResult, Verified, Array]:
    """Return the best candidate that passes the check of its closed loops.

    Parameters
    ----------
    problem : Problem
        The problem.
    candidates : sequence of SearchResult
        From the best γ on.
    prefer : callable or None
        Among equals that for which this is smallest is taken.
    tie : float
        Relative difference of γ up to which controllers are equal.

    Returns
    -------
    tuple of SearchResult, Verified, ndarray of shape (E, 2)
        The controller, its check, and γ of the equals with what was to be small, that of the one
        that is taken first.

    Raises
    ------
    SynthesisFailedError
        If no candidate passes.
    """
    passed: list[tuple[SearchResult, Verified]] = []
    reasons = []
    margin = SAME if prefer is None else -tie / (1.0 + tie)
    for candidate in candidates:
        if passed and min(v.gamma for _, v in passed) <= candidate.gamma * (1.0 + margin):
            break
        try:
            check = verify_controller(
                problem.plants, controller_of(problem.structure, candidate.theta)
            )
        except InputError as error:  # such gains that the loop is not well posed in floating point
            reasons.append(str(error))
            continue
        wrong = check.wrong(problem.region)
        if problem.controller_stable and not check.controller_abscissa_1_s < 0.0:
            wrong = f"the controller has poles with real part {check.controller_abscissa_1_s:.3g}"
        if wrong:
            reasons.append(wrong)
        else:
            passed.append((candidate, check))
    if not passed:
        raise SynthesisFailedError(
            f"no controller found passes the check of its closed loops ({reasons[0]}); limit the "
            "gains (largest_gain), ask for a pole region, or scale the plant"
        )
    least = min(v.gamma for _, v in passed)
    if prefer is None:
        return *min(passed, key=lambda pair: pair[1].gamma), np.zeros((0, 2))
    equal = [pair for pair in passed if pair[1].gamma <= least * (1.0 + tie)]
    values = [prefer(controller_of(problem.structure, candidate.theta)) for candidate, _ in equal]
    order = np.argsort(values, kind="stable")
    best = equal[int(order[0])]
    return *best, np.array([[equal[k][1].gamma, values[k]] for k in order.tolist()])


def explain_failure(results: Sequence[SearchResult]) -> Exception:
    """Return the error that says why no controller was found.

    Parameters
    ----------
    results : sequence of SearchResult
        Of all searches, none allowed.
    """
    stable = [f for f in results if np.isfinite(f.gamma)]
    if stable:
        best = min(stable, key=lambda f: f.excess)
        return SynthesisFailedError(
            f"no controller found from {len(results)} starts keeps the constraints: the best "
            f"exceeds one by {100.0 * np.expm1(best.excess):.3g} %; relax them, give the "
            "structure more parameters, or use more starts"
        )
    best = min(results, key=lambda f: f.abscissa)
    if abs(best.abscissa) <= _ON_AXIS:
        return NotStabilisableError(
            f"no controller of this structure that stabilises all plants was found from "
            f"{len(results)} starts; the best has its rightmost poles on the imaginary axis, as "
            "far as rounding tells. That is no proof, but where all starts end there, the gains of "
            "the structure as a rule move these poles to the axis only (as PI control does those "
            "of a double integrator): give the structure another action or more states"
        )
    return NotStabilisableError(
        f"no controller of this structure that stabilises all plants was found from {len(results)} "
        f"starts; the best has poles with a real part of {best.abscissa:.3g} times the plant's "
        "rate: give the structure more parameters, an initial controller, or use more starts"
    )
