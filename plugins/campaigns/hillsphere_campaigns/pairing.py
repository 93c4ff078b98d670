"""Pairs of cases of two campaigns: cases with the same random draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.cases.plan import Plan
from hillsphere.errors import InputError

__all__ = ["Drawn", "PlannedDraws", "pair_cases"]

_FORESEEN = 64
"""Cases of a plan whose draws are compared before anything runs. Designs differ from the first
case on; of two campaigns of other sizes this many suffice to show it, and take no time."""


class Drawn(Protocol):
    """Random draws of cases: of a `hillsphere.products.CaseTable`, or as planned.

    Parameters
    ----------
    design : str
        How the cases were chosen.
    point_labels : tuple of str
        Names of the swept points.
    case, point, draw : ndarray of int, shape (N,)
        Number of each case, its point, and the number by which it draws.
    inputs : tuple of str
        Names of the k quantities that differ at random.
    input_values : ndarray, shape (k, N)
        Their values, SI.
    """

    @property
    def design(self) -> str: ...  # noqa: D102
    @property
    def point_labels(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def case(self) -> Integers: ...  # noqa: D102
    @property
    def point(self) -> Integers: ...  # noqa: D102
    @property
    def draw(self) -> Integers: ...  # noqa: D102
    @property
    def inputs(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def input_values(self) -> Array: ...  # noqa: D102


@dataclass(frozen=True)
class PlannedDraws:
    """The draws of the first cases of a campaign, known before it runs; fields as of `Drawn`."""

    design: str
    point_labels: tuple[str, ...]
    case: Integers
    point: Integers
    draw: Integers
    inputs: tuple[str, ...]
    input_values: Array

    @classmethod
    def of(cls, plan: Plan) -> PlannedDraws:
        """Return those of a plan.

        An input about a nominal value that only the products of earlier stages fix is left out.
        """
        # Every point sees the same draws: the first one tells.
        cases = np.arange(min(plan.repetitions, _FORESEEN))
        values = plan.input_values(cases)
        known = np.flatnonzero(np.isfinite(values).all(axis=1))
        return cls(
            plan.design,
            plan.point_labels,
            cases,
            plan.point_of(cases),
            plan.draw_of(cases),
            tuple(plan.inputs[row] for row in known.tolist()),
            values[known],
        )


def pair_cases(a: Drawn, b: Drawn, name_a: str, name_b: str) -> tuple[Integers, Integers]:
    """Return the rows of two campaigns that are pairs, ordered by point and draw.

    Parameters
    ----------
    a, b : CaseTable or PlannedDraws
        The campaigns.
    name_a, name_b : str
        Their names, for messages.

    Returns
    -------
    tuple of ndarray of int
        Row of each pair in a, in b.

    Raises
    ------
    InputError
        If they have no case in common, were swept over different points, or an input that both
        have differs: then they did not see the same draws.
    """
    both = f"campaigns {name_a!r} and {name_b!r}"
    if a.point_labels != b.point_labels:
        raise InputError(
            f"{both} were swept over different points ({len(a.point_labels)} and "
            f"{len(b.point_labels)}); compare sweeps over the same points"
        )
    if len({a.design, b.design}) == 2:
        raise InputError(f"{both} have different designs, {a.design!r} and {b.design!r}")
    if a.design == "sobol_indices":  # its samples share their draws
        keys_a, keys_b = a.case, b.case
    else:
        keys_a, keys_b = _keys(a, b)
    _, rows_a, rows_b = np.intersect1d(keys_a, keys_b, assume_unique=True, return_indices=True)
    if rows_a.size == 0:
        raise InputError(f"{both} have no case in common; give both the same draws_as and seed")
    for name in (n for n in a.inputs if n in b.inputs):
        of_a = a.input_values[a.inputs.index(name), rows_a]
        of_b = b.input_values[b.inputs.index(name), rows_b]
        unlike = np.flatnonzero((of_a != of_b) & ~(np.isnan(of_a) & np.isnan(of_b)))
        if unlike.size:
            k = unlike[0]
            raise InputError(
                f"{both} did not see the same draws: {name} is {of_a[k]:.17g} in case "
                f"{a.case[rows_a[k]]} of the one and {of_b[k]:.17g} in case {b.case[rows_b[k]]} of "
                "the other; give both the same draws_as, seed and dispersions"
            )
    return rows_a, rows_b


def _keys(a: Drawn, b: Drawn) -> tuple[Integers, Integers]:
    """Return one number for each pair of point and draw."""
    span = 1 + max(int(t.draw.max()) if t.draw.size else 0 for t in (a, b))
    return a.point * span + a.draw, b.point * span + b.draw
