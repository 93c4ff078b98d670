"""Signals of systems by their names."""

from __future__ import annotations

from collections.abc import Sequence

from hillsphere.base.problems import did_you_mean
from hillsphere.errors import InputError

__all__ = ["find_signals"]


def find_signals(known: Sequence[str], wanted: Sequence[str], key: str) -> list[int]:
    """Return the indices of signals by their names.

    Parameters
    ----------
    known : sequence of str
        Signals, as a system names them.
    wanted : sequence of str
        Names; one without a number, ``u``, stands for all that have it with one, ``u[0]`` …
    key : str
        What asks for them, for the message.

    Raises
    ------
    InputError
        If there is no such signal.
    """
    indices: list[int] = []
    for name in wanted:
        here = [
            k
            for k, signal in enumerate(known)
            if name in (signal, signal.partition("[")[0].partition("(")[0])
        ]
        if not here:
            hint = did_you_mean(name, known, otherwise="there are") or "; the signals have no names"
            raise InputError(f"{key}: no signal {name!r}{hint}")
        indices += here
    return indices
