"""Interconnection of systems by the names of their signals, with summing junctions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.algebra import append, close_with_gain, gain

__all__ = ["connect", "with_names"]

_NAME = r"[A-Za-z_][\w.]*(?:\[\d+\]|\(\d+\))?"
_SUM = re.compile(rf"\s*({_NAME})\s*=\s*([+-]?\s*{_NAME}(?:\s*[+-]\s*{_NAME})*)\s*")
_TERM = re.compile(rf"([+-]?)\s*({_NAME})")
_NUMBERED = re.compile(r"(.+?)(?:\[(\d+)\]|\((\d+)\))")


def with_names(
    system: LtiSystem, inputs: str | Sequence[str], outputs: str | Sequence[str]
) -> LtiSystem:
    """Return a system with names for its signals.

    Parameters
    ----------
    system : LtiSystem
        Any.
    inputs, outputs : str or sequence of str
        All names; or one, ``u``, which stays as it is for a single signal and becomes ``u[0]``,
        ``u[1]`` … for several.

    Returns
    -------
    LtiSystem
        The same system with names.

    Raises
    ------
    InputError
        If the names are not as many as the signals, or one is listed twice.
    """
    p, m = system.shape
    return replace(system, inputs=_all_names(inputs, m), outputs=_all_names(outputs, p))


def connect(
    systems: Sequence[LtiSystem],
    junctions: Sequence[str],
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> LtiSystem:
    """Connect every input to the signal of the same name.

    Parameters
    ----------
    systems : sequence of LtiSystem
        With names for inputs and outputs (`with_names`). An input may stand in several systems, an
        output in one.
    junctions : sequence of str
        Sums, ``"e = r - y"``. A name without a number means all signals that have it with one, in
        their order: with outputs ``y[0]``, ``y[1]`` (or ``y(1)``, ``y(2)``), that sum makes
        ``e[0]`` and ``e[1]`` of ``r[0]`` and ``r[1]``. Numbers count from 0 or 1 without a gap.
    inputs, outputs : sequence of str
        Signals that are the inputs and outputs of the whole, in this order; for a generalised
        plant, controls and measurements last. An input may be an output too.

    Returns
    -------
    LtiSystem
        Its states are those of the systems, in their order.

    Raises
    ------
    InputError
        If a signal is made twice or by nothing, an input of the whole is used nowhere, an output
        unknown, a sum cannot be read, the connection is not well posed, or numbered signals of one
        name are written in two ways, have one number twice, or a gap where that name is used.
    """
    for k, system in enumerate(systems):
        p, m = system.shape
        if len(system.inputs) != m or len(system.outputs) != p:
            raise InputError(f"system {k} has no names for its signals; give them by with_names")
    sums = [_Sum.read(text) for text in junctions]
    elsewhere = [*inputs, *outputs, *(name for one in sums for name in one.names)]
    names = _Names(
        [
            *(name for s in systems for name in (*s.inputs, *s.outputs)),
            # a sum or an input of the whole may give a bus one of its signals
            *(name for name in elsewhere if _NUMBERED.fullmatch(name)),
        ]
    )
    names.spread(sums)
    outside = [name for given in inputs for name in names.of(given)]
    parts, into, made = [gain(np.eye(len(outside)))], list[str](), list(outside)
    for system in systems:
        parts.append(replace(system, inputs=(), outputs=()))
        into += system.inputs
        made += system.outputs
    for one in sums:
        signals = names.of(one.output)
        width = len(signals)
        parts.append(gain(np.kron(np.array([[sign for sign, _ in one.terms]]), np.eye(width))))
        into += [name for _, term in one.terms for name in names.of(term)]
        made += signals
    _check(outside, into, made)
    wanted = [name for given in outputs for name in names.of(given)]
    place = {name: k for k, name in enumerate(made)}
    for name in wanted:
        if name not in place:
            raise InputError(f"nothing makes the output {name!r}; there are: {', '.join(made)}")
    if len(set(wanted)) < len(wanted):
        twice = next(name for name in wanted if wanted.count(name) > 1)
        raise InputError(
            f"the output {twice!r} is listed twice; add a junction '{twice}2 = {twice}'"
        )
    whole = append(*parts)
    f = np.zeros((whole.shape[1], whole.shape[0]))
    first = len(outside)
    for row, name in enumerate(into):
        # each input of a part is fed from the one output of its name
        f[first + row, place[name]] = 1.0
    closed = close_with_gain(whole, f)
    rows = [place[name] for name in wanted]
    return LtiSystem(
        closed.a, closed.b[:, :first], closed.c[rows], closed.d[rows, :first], closed.dt_s,
        tuple(outside), tuple(wanted), closed.states,
    )  # fmt: skip


@dataclass(frozen=True)
class _Sum:
    """A summing junction: its output, and the signs and names of its terms."""

    output: str
    terms: tuple[tuple[float, str], ...]

    @property
    def names(self) -> list[str]:
        """The output and the terms."""
        return [self.output, *(name for _, name in self.terms)]

    @classmethod
    def read(cls, text: str) -> _Sum:
        match = _SUM.fullmatch(text)
        if match is None:
            raise InputError(f"a junction reads 'e = r - y', with names and signs; got {text!r}")
        terms = tuple(
            (-1.0 if sign == "-" else 1.0, name) for sign, name in _TERM.findall(match[2])
        )
        return cls(match[1], terms)


class _Names:
    """Signals by name: a name means one signal, or all signals with this name and a number."""

    def __init__(self, signals: Iterable[str]) -> None:
        numbered: dict[str, dict[int, str]] = {}
        self._known: dict[str, list[str]] = {}
        self._gaps: set[str] = set()
        for signal in signals:
            self._known[signal] = [signal]
            match = _NUMBERED.fullmatch(signal)
            if match:
                group, number = numbered.setdefault(match[1], {}), int(match[2] or match[3])
                other = group.setdefault(number, signal)
                first = next(iter(group.values()))
                if other != signal or first.endswith(")") != signal.endswith(")"):
                    raise InputError(
                        f"{signal!r} and {other if other != signal else first!r} number signals "
                        f"of {match[1]!r} in two ways; write all as {match[1]}[0], {match[1]}[1] … "
                        f"or all as {match[1]}(1), {match[1]}(2) …"
                    )
        for name, group in numbered.items():
            if name in self._known:
                raise InputError(
                    f"{name!r} is a signal and the name of {', '.join(group.values())}"
                )
            places = sorted(group)
            self._known[name] = [group[k] for k in places]
            if places[0] > 1 or places[-1] - places[0] >= len(places):
                self._gaps.add(name)

    def of(self, name: str) -> list[str]:
        if name in self._gaps:
            raise InputError(
                f"{name!r} stands for {', '.join(self._known[name])}, whose numbers have a gap; "
                "number them from 0 or 1 on, or name each signal by itself"
            )
        return self._known.get(name, [name])

    def spread(self, sums: Sequence[_Sum]) -> None:
        """Give names that occur only in sums the width of the signals that they are added to."""
        settled = False
        while not settled:
            settled = True
            for one in sums:
                used = one.names
                widths = {name: len(self.of(name)) for name in used if name in self._known}
                if len(set(widths.values())) > 1:
                    each = ", ".join(f"{name} {width}" for name, width in widths.items())
                    raise InputError(
                        f"the junction of {one.output!r} adds what does not fit: {each}"
                    )
                if widths and len(widths) < len(set(used)):
                    settled = False
                    width = next(iter(widths.values()))
                    for name in used:
                        self._known.setdefault(name, list(_all_names(name, width)))


def _check(outside: list[str], into: list[str], made: list[str]) -> None:
    """Raise `InputError` for a signal made twice, by nothing, or for nothing."""
    for name in made:
        if made.count(name) > 1:
            raise InputError(
                f"the signal {name!r} is made twice; rename one, or add them by a junction"
            )
    for name in into:
        if name not in made:
            raise InputError(
                f"nothing makes the signal {name!r}; name it among the inputs, or see the spelling "
                f"of: {', '.join(made)}"
            )
    for name in outside:
        if name not in into:
            raise InputError(
                f"the input {name!r} is used nowhere; there are: {', '.join(sorted(set(into)))}"
            )


def _all_names(given: str | Sequence[str], count: int) -> tuple[str, ...]:
    if not isinstance(given, str):
        return tuple(given)
    return (given,) if count == 1 else tuple(f"{given}[{k}]" for k in range(count))
