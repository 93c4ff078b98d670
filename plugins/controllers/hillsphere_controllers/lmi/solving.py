"""Solution of semidefinite programs by Clarabel, with named errors for doubtful results."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import cvxpy

from hillsphere.errors import InputError
from hillsphere_controllers.errors import InfeasibleError, SynthesisFailedError

__all__ = ["MOST_STATES", "check_order", "cp", "minimise"]

# cvxpy overloads its operators beyond what its annotations tell
cp: Any = cvxpy

_GAP, _FEASIBLE = 1e-6, 1e-7
"""Between the bounds of the objective, and of constraints: tighter ones are seldom reached where
the optimum is not attained, as it is for H∞ norms."""

MOST_STATES = 20
"""Interior-point methods for these inequalities lose their digits beyond about this order."""


def check_order(order: int) -> None:
    """Check that the order is one for which the inequalities are solved reliably.

    Raises
    ------
    InputError
        If the order is zero or above `MOST_STATES`.
    """
    if not 0 < order <= MOST_STATES:
        raise InputError(
            f"matrix inequalities are solved reliably for orders from 1 to {MOST_STATES}, got "
            f"{order}; reduce the order, or use the Riccati equations (full_order) or a fixed "
            "structure (structured)"
        )


def minimise(
    objective: Any, constraints: Sequence[Any], what: str, *, checked: bool = False
) -> float:
    """Minimise an expression by Clarabel; the variables then have their values.

    Parameters
    ----------
    objective : expression
        Of variables of cvxpy.
    constraints : sequence of constraint
        Constraints of cvxpy.
    what : str
        For messages.
    checked : bool
        Whether the caller verifies the solution by other means, so that an inaccurate one may
        serve.

    Raises
    ------
    InfeasibleError
        If there is no solution.
    SynthesisFailedError
        If the solver finds none accurate enough to rely on.
    """
    problem = cp.Problem(cp.Minimize(objective), list(constraints))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the status tells the same
            problem.solve(
                solver=cp.CLARABEL, tol_gap_abs=_GAP, tol_gap_rel=_GAP, tol_feas=_FEASIBLE
            )
    except cp.SolverError as error:
        raise SynthesisFailedError(
            f"{what}: the solver Clarabel gave up ({error}); scale states, inputs and outputs to "
            "order one, or ask for less"
        ) from error
    if problem.status == "optimal" or (checked and problem.status == "optimal_inaccurate"):
        return float(problem.value)
    if problem.status in ("infeasible", "infeasible_inaccurate"):
        raise InfeasibleError(
            f"{what}: the inequalities have no solution; relax limits or the "
            "pole region. With one Lyapunov matrix for all requirements they are sufficient only, "
            "so that another method may still succeed"
        )
    raise SynthesisFailedError(
        f"{what}: the solver Clarabel ended with {problem.status!r}, which is nothing to rely on; "
        "scale states, inputs and outputs to order one, put a small weight on every control and "
        "some noise on every measurement, or ask for less"
    )
