"""A block of cases, and what comes of it: what the campaign and the stage it repeats exchange."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.base.matching import match_names

__all__ = ["LANES", "CaseBatch", "CaseResults", "Histories", "histories_to_keep"]

Flags = NDArray[np.bool_]

LANES = 64
"""Cases that are computed together, always: another width would give other last bits."""


@dataclass(frozen=True)
class CaseBatch:
    """A block of 64 lanes, one case each.

    Lanes without a case of their own repeat another case of the block and are `filler`: a stage
    whose cases share no arrays may leave them out (any result will do); one that computes on arrays
    computes all lanes, so that the bits of a case never depend on how full its block is.

    Parameters
    ----------
    numbers : ndarray of int, shape (64,)
        Number of each case, unique in the campaign.
    draws : ndarray of int, shape (64,)
        Number by which the stage draws the noise of each case; cases that are to see the same
        noise share it.
    filler : ndarray of bool, shape (64,)
        Lanes that only fill the block.
    names : tuple of str
        Names of the k inputs that differ from case to case, of those that the stage offers
        (`CaseStage.case_inputs`).
    values : ndarray, shape (k, 64)
        Their values, SI.
    seed : int
        Root seed of the mission.
    stream : str
        Name of the campaign's random numbers: with `seed` and `draws` it fixes all noise
        (`hillsphere.base.seeds.draws`).
    """

    numbers: Integers
    draws: Integers
    filler: Flags
    names: tuple[str, ...]
    values: Array
    seed: int
    stream: str

    def value(self, name: str, nominal: float) -> Array:
        """Return an input of every lane (64,), SI; `nominal` where it does not differ."""
        if name in self.names:
            return np.ascontiguousarray(self.values[self.names.index(name)])
        return np.full(len(self.numbers), float(nominal))


@dataclass(frozen=True)
class Histories:
    """Cases sample by sample.

    Parameters
    ----------
    time_s : ndarray, shape (K, N)
        Times; NaN after the end of a case.
    names, units : tuple of str
        Of the q quantities.
    values : ndarray, shape (q, K, N)
        Their values.
    end_s : ndarray, shape (N,), or None
        When a case ended that did so after its last sample; NaN where the last sample was the end.
        None: it was so of all. Samples are at common times, ends are not.
    end_values : ndarray, shape (q, N), or None
        The values then; NaN for what only samples have.
    """

    time_s: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    end_s: Array | None = None
    end_values: Array | None = None

    def of_cases(self, places: Integers) -> Histories:
        """Return those of some of the cases, by their places."""
        return replace(
            self,
            time_s=np.asarray(self.time_s, dtype=np.float64)[:, places],
            values=np.asarray(self.values, dtype=np.float64)[:, :, places],
            end_s=None if self.end_s is None else self.end_s[places],
            end_values=None if self.end_values is None else self.end_values[:, places],
        )

    def of_quantities(self, rows: Sequence[int]) -> Histories:
        """Return those of some of the quantities, by their places."""
        return replace(
            self,
            names=tuple(self.names[i] for i in rows),
            units=tuple(self.units[i] for i in rows),
            values=self.values[list(rows)],
            end_values=None if self.end_values is None else self.end_values[list(rows)],
        )


@dataclass(frozen=True)
class CaseResults:
    """What came of N cases.

    Parameters
    ----------
    metrics, units : tuple of str
        Names and units of the m metrics; the same for every block of a stage.
    values : ndarray, shape (m, N)
        Their values; of a case that did not fail all must be finite.
    status : tuple of str
        How each case ended, one of a few words. A case that came to its end but missed what is
        required of its metrics is said to be ``"requirement"``: its metrics enter the statistics.
        One of `hillsphere.cases.case_classes.UNDECIDED` says that the case is undecided.
    cause : tuple of str
        What ended it (name of an event, of a limit); ``""`` for none.
    failed : ndarray of bool, shape (N,)
        Whether that counts as a failure; of undecided cases it is not looked at.
    histories : Histories or None
        The way there, if it was asked for.
    step_error : ndarray, shape (N,), or None
        Estimate of each case's step error, in units that the stage documents; None for none.
    """

    metrics: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    status: tuple[str, ...]
    cause: tuple[str, ...]
    failed: Flags
    histories: Histories | None = None
    step_error: Array | None = None


def histories_to_keep(history: bool | Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the histories that a call of ``run_cases`` has to keep.

    Parameters
    ----------
    history : bool or sequence of str
        As ``run_cases`` is given it.
    names : sequence of str
        All that the stage can keep.

    Returns
    -------
    tuple of str
        In the order of `names`; all of them if a pattern finds none, so that whoever asks can say
        what there is.
    """
    if isinstance(history, bool):
        return tuple(names) if history else ()
    try:
        found = frozenset(match_names(history, names, "the stage", "history"))
    except InputError:
        return tuple(names)
    return tuple(name for name in names if name in found)
