"""Time-variable coefficients of ICGEM files, evaluated at an epoch [1]_.

The columns of version 2.0 are those of EIGEN-6S4: ``t0[yyyymmdd.xxxx] t1[yyyymmdd.xxxx] period[y]``
after the standard deviations, the period last. The interval includes t0 and not t1. Its rows
``acos`` and ``asin`` may have another interval than the ``gfct`` that holds at the epoch; their
phase then counts from their own t0, which Orekit's classes allow [2]_. pyshtools counts all from
the t0 of the ``gfct`` [3]_, which differs for such models only.

References
----------
.. [1] Barthelmes, F., Förste, C., The ICGEM-format, GFZ Potsdam, 2011; International Centre for
   Global Earth Models, version 2.0.
.. [2] Orekit, org.orekit.forces.gravity.potential.TimeDependentHarmonic, since 11.1: each cosine
   and sine has its reference date; that of the trend is taken where a row has none (version 1.0).
.. [3] pyshtools, shio.read_icgem_gfc: intervals t0 ≤ t < t1, one reference epoch per coefficient.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import date
from itertools import pairwise
from math import cos, inf, pi, sin
from typing import NamedTuple

from hillsphere.base.errors import InputError
from hillsphere.formats.coefficients import Coefficient, LineReader

__all__ = ["TIME_VARIABLE", "Term", "evaluate_terms", "julian_date", "read_term"]

TIME_VARIABLE = ("gfct", "trnd", "dot", "acos", "asin")
"""Keywords of time-variable rows; ``dot`` is an older name of ``trnd``."""

_YEAR_D = 365.25
_JULIAN_OF_ORDINAL = 1721424.5
"""Julian date of midnight minus the ordinal of the day (1 for 0001-01-01)."""
_DATE = re.compile(r"(\d{4})(\d\d)(\d\d)(?:\.(\d\d)(\d\d)?)?", re.ASCII)


class Term(NamedTuple):
    """One time-variable row.

    Parameters
    ----------
    kind : str
        ``"gfct"``, ``"trnd"``, ``"acos"`` or ``"asin"``.
    row : Coefficient
        Degree, order and the values: of ``trnd`` for a year.
    begin, end : float or None
        Julian dates between which the term holds, the end excluded. Where the file gives only the
        reference epoch of a ``gfct``, `end` is infinite; a row without any has None.
    period_years : float
        Of ``acos`` and ``asin``; else 0.
    line : int
        Line of the file.
    """

    kind: str
    row: Coefficient
    begin: float | None
    end: float | None
    period_years: float
    line: int


def read_term(
    lines: LineReader, words: list[str], max_degree: int, sigmas: int | None, intervals: bool
) -> Term:
    """Read a time-variable row.

    Parameters
    ----------
    lines : LineReader
        At the row.
    words : list of str
        Its words, of which the first is in `TIME_VARIABLE`.
    max_degree : int
        Highest degree that may stand there.
    sigmas : int or None
        Columns of standard deviations; None if the head does not say, for 0, 2 or 4.
    intervals : bool
        Whether each row ends with the interval in which it holds (version 2.0 of the format);
        otherwise ``gfct`` ends with its reference epoch, and other rows have none.

    Returns
    -------
    Term
        The row.

    Raises
    ------
    InputError
        Names file and line: a malformed or doubled row.
    """
    kind = "trnd" if words[0] == "dot" else words[0]
    periodic = kind in ("acos", "asin")
    dates = 2 if intervals else int(kind == "gfct")
    tail = dates + periodic
    allowed = (0, 2, 4) if sigmas is None else (sigmas,)
    if len(words) - 1 - 4 - tail not in allowed:
        raise lines.fault(
            f"expected {' or '.join(str(4 + n + tail) for n in allowed)} columns after "
            f"{words[0]!r}, got {len(words) - 1}: degree, order, C, S, "
            + "standard deviations" * any(allowed)
            + (", beginning and end" if intervals else ", epoch" * dates)
            + ", period (years)" * periodic
        )
    begin = _read_date(lines, words[-tail]) if dates else None
    end = _read_date(lines, words[-tail + 1]) if intervals else (inf if dates else None)
    if begin is not None and end is not None and not begin < end:
        raise lines.fault(f"the interval must end after it begins, got {' '.join(words[-tail:])}")
    period = lines.positive(words[-1], "period") if periodic else 0.0
    columns = words[1 : len(words) - tail]
    row = lines.coefficient(columns, max_degree, (kind, begin, period))
    return Term(kind, row, begin, end, period, lines.number)


def evaluate_terms(
    lines: LineReader, terms: list[Term], epoch_jd: float, static: frozenset[tuple[int, int]]
) -> Iterator[Coefficient]:
    r"""Yield the time-variable coefficients at an epoch.

    Of the terms of a degree and order that hold at the epoch,

    .. math::

        C(t) = \mathrm{gfct} + \mathrm{trnd}\,\Delta t + \sum_T \mathrm{acos}_T
        \cos\frac{2\pi\Delta t}{T} + \mathrm{asin}_T \sin\frac{2\pi\Delta t}{T},

    with Δt in years of 365.25 days since the beginning of the term's own interval, or since the
    epoch of the ``gfct`` where the terms have no interval.

    Parameters
    ----------
    lines : LineReader
        Of the file, for messages.
    terms : list of Term
        All of the file.
    epoch_jd : float
        Julian date.
    static : frozenset of (int, int)
        Degrees and orders that have a static row.

    Yields
    ------
    Coefficient
        With the standard deviations of the ``gfct``.

    Raises
    ------
    InputError
        If terms of a kind overlap, one has no ``gfct``, the ``gfct`` do not cover the epoch, or a
        coefficient is static, too.
    """
    by_place: dict[tuple[int, int], list[Term]] = {}
    for term in terms:
        by_place.setdefault((term.row.n, term.row.m), []).append(term)
    for (n, m), group in by_place.items():
        if (n, m) in static:
            raise lines.fault(f"degree {n}, order {m} is given by a row 'gfc', too", group[0].line)
        _check_overlaps(lines, group)
        constants = [term for term in group if term.kind == "gfct"]
        if not constants:
            raise lines.fault(
                f"{group[0].kind!r} of degree {n}, order {m} has no row 'gfct'", group[0].line
            )
        # A reference epoch is no beginning: a trend also holds before it.
        constant = next((term for term in constants if _holds(term, epoch_jd)), None)
        if constant is None:
            raise lines.fault(
                f"no interval of degree {n}, order {m} holds at the epoch (Julian date "
                f"{epoch_jd:.5f}): {_describe_cover(constants)}",
                constants[0].line,
            )
        yield _sum(constant, [term for term in group if _holds(term, epoch_jd)], epoch_jd)


def _sum(constant: Term, terms: list[Term], epoch_jd: float) -> Coefficient:
    c, s = constant.row.c, constant.row.s
    for term in terms:
        begin = constant.begin if term.begin is None else term.begin
        years = (epoch_jd - (begin or 0.0)) / _YEAR_D
        if term.kind == "trnd":
            factor = years
        elif term.kind == "acos":
            factor = cos(2.0 * pi * years / term.period_years)
        elif term.kind == "asin":
            factor = sin(2.0 * pi * years / term.period_years)
        else:
            continue
        c += term.row.c * factor
        s += term.row.s * factor
    return constant.row._replace(c=c, s=s)


def _holds(term: Term, epoch_jd: float) -> bool:
    if term.begin is None or term.end is None or term.end == inf:
        return True
    return term.begin <= epoch_jd < term.end


def _check_overlaps(lines: LineReader, group: list[Term]) -> None:
    """Refuse two terms of one kind and period that hold at the same time."""
    ordered = sorted(group, key=lambda term: (term.kind, term.period_years, term.begin or 0.0))
    for one, other in pairwise(ordered):
        if (one.kind, one.period_years) != (other.kind, other.period_years):
            continue
        if one.end is None or other.begin is None or other.begin < one.end:
            first, second = sorted((one.line, other.line))
            raise lines.fault(
                f"this {other.kind!r} of degree {other.row.n}, order {other.row.m} holds at the "
                f"same time as that of line {first}",
                second,
            )


def _describe_cover(constants: list[Term]) -> str:
    first = min(term.begin or 0.0 for term in constants)
    last = max(term.end or 0.0 for term in constants)
    return f"they lie between {first:.5f} and {last:.5f}"


def _read_date(lines: LineReader, text: str) -> float:
    """Return the Julian date of ``yyyymmdd`` or ``yyyymmdd.hhmm``."""
    match = _DATE.fullmatch(text)
    if match is not None:
        year, month, day, hour, minute = (int(part or 0) for part in match.groups())
        try:
            ordinal = date(year, month, day).toordinal()
        except ValueError:
            ordinal = 0
        # 24:00 is written for the end of a day.
        minutes = 60 * hour + minute
        if ordinal and minute < 60 and minutes <= 1440:
            return ordinal + _JULIAN_OF_ORDINAL + minutes / 1440.0
    raise lines.fault(f"expected a date yyyymmdd or yyyymmdd.hhmm, got {text!r}")


def julian_date(epoch: str) -> float:
    """Return the Julian date of a text such as ``2020-01-01T00:00:00``.

    The format names no time scale. Scales differ by a minute, in which no term changes noticeably.

    Raises
    ------
    InputError
        If the text is no date.
    """
    from hillsphere.time import Epoch

    try:
        instant = Epoch.parse(epoch, "TT")
    except InputError as error:
        raise InputError(f"epoch: {error}") from error
    return instant.day + instant.fraction
