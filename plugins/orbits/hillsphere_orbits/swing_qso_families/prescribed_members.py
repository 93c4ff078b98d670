"""Members of the families at prescribed values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.correction import correct
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.members import Quantity
from hillsphere_orbits.roots import brackets
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.swing_qso_families.description import integral_of, period_of, position_on
from hillsphere_orbits.swing_qso_families.families import Chain

__all__ = ["PrescribedMembers", "orbits_asked"]

_TOLERANCE = 1e-9  # residual; Newton takes one more step from there


@dataclass(frozen=True)
class PrescribedMembers:
    """Members at prescribed values, by family and position on its chain.

    Parameters
    ----------
    family : list of int, length N
        Number of the family.
    labels : list of str
        Names, all different.
    z : list of ndarray, shape (m, 1)
        Unknowns, of the family's problem.
    position : list of float
        Positions on the chains.
    lost : list of str
        Orbits that lie on a family and could not be corrected, and values that no family has.
    """

    family: list[int]
    labels: list[str]
    z: list[Array]
    position: list[float]
    lost: list[str]


def orbits_asked(
    flow: Flow,
    chains: Sequence[Chain],
    jacobi_constants: Sequence[float],
    periods_s: Sequence[float],
    time_s: float,
) -> PrescribedMembers:
    """Find every orbit of every family at the prescribed values.

    Parameters
    ----------
    flow : Flow
        Equations of motion, normalised.
    chains : sequence of Chain
        The families.
    jacobi_constants : sequence of float
        In natural units.
    periods_s : sequence of float
        Full periods, s.
    time_s : float
        Natural unit of time, s.

    Returns
    -------
    PrescribedMembers
        Possibly empty.

    Raises
    ------
    InputError
        If none of the values is met by any family; what the families have is named.
    """
    wanted: list[tuple[str, str, float, Callable[[Shooting], Quantity], Array]] = []
    if jacobi_constants:
        wanted.append(("C", "", 1.0, integral_of, np.array(jacobi_constants)))
    if periods_s:
        wanted.append(("T", " h", time_s / HOUR_S, period_of, np.array(periods_s) / time_s))
    rows: list[tuple[int, float, str, Array]] = []
    lost: list[str] = []
    absent: list[str] = []
    for symbol, unit, size, quantity_of, values in wanted:
        met: set[int] = set()
        spans = []
        for number, chain in enumerate(chains):
            problem = chain.problem(flow)
            quantity = quantity_of(problem)
            along = quantity(chain.branch.z)[0]
            for k, value in enumerate(values):
                label = f"{chain.start.name}, {symbol} = {value * size:.9g}{unit}"
                for i in brackets(along, float(value)):
                    met.add(k)
                    u = i + (value - along[i]) / (along[i + 1] - along[i])
                    z = _correct_at_value(problem, chain.branch, quantity, float(value), float(u))
                    if z is None:
                        lost.append(f"{label}: Newton's iteration did not converge")
                    else:
                        rows.append((number, position_on(chain.branch, z[:, 0]), label, z))
            spans.append(
                f"{chain.start.name} {along.min() * size:.6g} to {along.max() * size:.6g}{unit}"
            )
        if none := sorted(set(range(values.size)) - met):
            absent.append(
                f"no family has an orbit with {symbol} = "
                f"{', '.join(f'{values[k] * size:.9g}' for k in none)}{unit}; they have: "
                + "; ".join(spans)
            )
    if absent and not rows and not lost:
        raise InputError("; ".join(absent))
    rows.sort(key=lambda row: row[:2])
    return PrescribedMembers(
        [row[0] for row in rows],
        _different([row[2] for row in rows]),
        [row[3] for row in rows],
        [row[1] for row in rows],
        [*lost, *absent],
    )


def _correct_at_value(
    problem: Shooting, branch: Branch, quantity: Quantity, value: float, u: float
) -> Array | None:
    """Return the orbit (m, 1) at which a quantity has a value, near a position, if there is one."""
    guess, _ = branch.guess(np.array([u]))

    def hold(z: Array) -> tuple[Array, Array]:
        values, gradient = quantity(z)
        return (values - value)[None], gradient[None]

    corrected = correct(problem, guess, hold, tolerance=_TOLERANCE)
    i = int(np.clip(np.floor(u), 0, branch.size - 2))
    ends = branch.z[:, i : i + 2]
    chord = float(np.linalg.norm(ends[:, 1] - ends[:, 0]))
    near = float(np.min(np.linalg.norm(corrected.z - ends, axis=0))) <= chord
    return corrected.z if bool(corrected.converged[0]) and near else None


def _different(labels: Sequence[str]) -> list[str]:
    """Return unique labels, numbered where one occurs more than once."""
    names: list[str] = []
    for label in labels:
        count = sum(other.split(" #")[0] == label for other in names)
        names.append(f"{label} #{count + 1}" if count else label)
    return names
