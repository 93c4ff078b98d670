"""Restrictions of a perturbation: some blocks of Δ zero, the others as they are.

µ with all blocks is no smaller than µ with some of them. A search over all blocks can miss what
one over fewer finds: at zero frequency real parameters make I − M Δ singular, beside a full block
that a search gives a phase there, which no real system has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.lower_bound import LowerBound

__all__ = ["Restriction", "improve_by_restrictions", "restrictions"]

_APART = 1.02
"""Ratio of the bounds, besides the gap of the certificate, up to which no restriction is searched:
the searches of the packaged missions' loops end within it at most points."""
_MOST_LEFT_OUT = 4
"""Blocks, not real, up to which each is left out in turn: every restriction takes as long as the
search for the whole."""


@dataclass(frozen=True, eq=False)
class Restriction:
    """A system in M-Δ form some of whose blocks are zero.

    Parameters
    ----------
    system : LtiSystem
        Without the inputs and outputs of those blocks.
    structure : BlockStructure
        The blocks that are left.
    rows, columns : ndarray of int
        Rows and columns of the whole Δ that are theirs.
    shape : tuple of int
        Of the whole Δ, rows by columns.
    """

    system: LtiSystem
    structure: BlockStructure
    rows: np.ndarray
    columns: np.ndarray
    shape: tuple[int, int]

    def extend(self, bound: LowerBound) -> LowerBound:
        """Return a bound of the restriction as one of the whole, whose other blocks are zero."""
        delta = np.zeros(self.shape, dtype=complex)
        delta[np.ix_(self.rows, self.columns)] = bound.delta
        return replace(bound, delta=delta)


def restrictions(
    system: LtiSystem, structure: BlockStructure, kept: int | None = None
) -> Iterator[Restriction]:
    """Yield the restrictions to real blocks, to the others, and without each of the others.

    Parameters
    ----------
    system : LtiSystem
        M, with the outputs and inputs of the structure.
    structure : BlockStructure
        Of Δ.
    kept : int, optional
        A block of all restrictions, as that of performance.
    """
    blocks = [k for k in range(len(structure.blocks)) if k != kept]
    real = [k for k in blocks if structure.blocks[k].kind == "real"]
    others = [k for k in blocks if k not in real]
    sets = [real, others]
    if len(others) <= _MOST_LEFT_OUT:
        sets += [[k for k in blocks if k != out] for out in others]
    parts = structure.parts()
    for chosen in dict.fromkeys(tuple(one) for one in sets if 0 < len(one) < len(blocks)):
        all_kept = sorted(chosen if kept is None else (*chosen, kept))
        rows = np.concatenate([np.arange(structure.shape[1])[parts[k][0]] for k in all_kept])
        columns = np.concatenate([np.arange(structure.shape[0])[parts[k][1]] for k in all_kept])
        yield Restriction(
            LtiSystem(
                system.a, system.b[:, rows], system.c[columns], system.d[np.ix_(columns, rows)],
                system.dt_s,
            ),
            BlockStructure([structure.blocks[k] for k in all_kept]),
            rows, columns, (structure.shape[1], structure.shape[0]),
        )  # fmt: skip


def improve_by_restrictions(
    system: LtiSystem,
    structure: BlockStructure,
    low: LowerBound,
    upper: float,
    gap: float,
    search: Callable[[LtiSystem, BlockStructure], LowerBound],
    kept: int | None = None,
) -> LowerBound:
    """Return the best lower bound of µ, that of restrictions included where the bounds are apart.

    Parameters
    ----------
    system : LtiSystem
        M, with the outputs and inputs of the structure.
    structure : BlockStructure
        Of Δ.
    low : LowerBound
        The bound known.
    upper : float
        A certified upper bound.
    gap : float
        By how much that may be above µ in any case, relatively.
    search : callable
        Returns a lower bound for a system and its structure.
    kept : int, optional
        As of `restrictions`.
    """
    for one in restrictions(system, structure, kept):
        if upper <= low.value * (1.0 + gap) * _APART:
            break
        found = search(one.system, one.structure)
        if found.value > low.value:
            low = one.extend(found)
    return low
