"""Blocks of cases and their results: the data between a campaign and the stage it repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.base.matching import match_names
from hillsphere.products.fields import Shape

__all__ = ["LANES", "CaseBatch", "CaseResults", "Histories", "histories_to_keep"]

Flags = NDArray[np.bool_]

LANES = 64
"""Lanes of every block. Another number would change the last bits of results."""


@dataclass(frozen=True)
class CaseBatch:
    """A block of 64 lanes, one case each.

    Lanes without a case of their own repeat another case of the block and are marked as `filler`.
    A stage that computes case by case may skip them (their results are ignored); a stage that
    computes on arrays computes all lanes, so that the bits of a case do not depend on the number
    of cases in its block.

    Parameters
    ----------
    numbers : ndarray of int, shape (64,)
        Number of each case, unique in the campaign.
    draws : ndarray of int, shape (64,)
        Number by which the noise of each case is drawn; cases with equal numbers have equal noise.
    filler : ndarray of bool, shape (64,)
        Lanes that only fill the block.
    names : tuple of str
        Names of the k inputs that differ from case to case, among `CaseStage.case_inputs`.
    values : ndarray, shape (k, 64)
        Their values, SI.
    seed : int
        Root seed of the mission.
    stream : str
        Name of the campaign's random numbers. Together with `seed` and `draws` it determines all
        noise (`hillsphere.base.seeds.draws`).
    """

    numbers: Integers
    draws: Integers
    filler: Flags
    names: tuple[str, ...]
    values: Array
    seed: int
    stream: str

    def value(self, name: str, nominal: float) -> Array:
        """Return an input of every lane (64,), SI; `nominal` if the campaign does not change it."""
        if name in self.names:
            return np.ascontiguousarray(self.values[self.names.index(name)])
        return np.full(len(self.numbers), float(nominal))


@dataclass(frozen=True)
class Histories:
    """Time histories of cases, at common samples and at each case's end."""

    time_s: Annotated[Array, Shape("samples", "cases")]
    """Times; NaN after the end of a case."""
    names: Annotated[tuple[str, ...], Shape("quantities")]
    """Names of the quantities."""
    units: Annotated[tuple[str, ...], Shape("quantities")]
    """Their units."""
    values: Annotated[Array, Shape("quantities", "samples", "cases")]
    """Their values."""
    end_s: Annotated[Array | None, Shape("cases")] = None
    """Time of the end of each case, if it lies after the last sample; NaN where the last sample is
    the end. None if that is so for all cases."""
    end_values: Annotated[Array | None, Shape("quantities", "cases")] = None
    """Values at `end_s`; NaN for quantities that exist at samples only."""

    def of_cases(self, places: Integers) -> Histories:
        """Return the histories of some of the cases, by their indices."""
        return replace(
            self,
            time_s=np.asarray(self.time_s, dtype=np.float64)[:, places],
            values=np.asarray(self.values, dtype=np.float64)[:, :, places],
            end_s=None if self.end_s is None else self.end_s[places],
            end_values=None if self.end_values is None else self.end_values[:, places],
        )

    def of_quantities(self, rows: Sequence[int]) -> Histories:
        """Return the histories of some of the quantities, by their indices."""
        return replace(
            self,
            names=tuple(self.names[i] for i in rows),
            units=tuple(self.units[i] for i in rows),
            values=self.values[list(rows)],
            end_values=None if self.end_values is None else self.end_values[list(rows)],
        )


@dataclass(frozen=True)
class CaseResults:
    """Results of cases."""

    metrics: Annotated[tuple[str, ...], Shape("metrics")]
    """Names of the metrics; the same for every block of a stage."""
    units: Annotated[tuple[str, ...], Shape("metrics")]
    """Their units."""
    values: Annotated[Array, Shape("metrics", "cases")]
    """Their values; all must be finite for a case that did not fail."""
    status: Annotated[tuple[str, ...], Shape("cases")]
    """How each case ended, one of a few words. ``"requirement"``: the case was completed but missed
    a requirement on its metrics; these enter the statistics. A word of
    `hillsphere.cases.case_classes.UNDECIDED`: the case is undecided."""
    cause: Annotated[tuple[str, ...], Shape("cases")]
    """Event or limit that ended the case; ``""`` without one."""
    failed: Annotated[Flags, Shape("cases")]
    """Whether the case counts as a failure; ignored for undecided cases."""
    histories: Histories | None = None
    """Time histories, if requested."""
    step_error: Annotated[Array | None, Shape("cases")] = None
    """Estimate of each case's integration error per step, in units that the stage documents; None
    without an estimate."""


def histories_to_keep(history: bool | Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the histories that a call of ``run_cases`` must return.

    Parameters
    ----------
    history : bool or sequence of str
        Argument of ``run_cases``.
    names : sequence of str
        Names of all histories of the stage.

    Returns
    -------
    tuple of str
        In the order of `names`; all of them if a pattern matches none, so that the caller's
        message can list the valid names.
    """
    if isinstance(history, bool):
        return tuple(names) if history else ()
    try:
        chosen = frozenset(match_names(history, names, "the stage", "history"))
    except InputError:
        return tuple(names)
    return tuple(name for name in names if name in chosen)
