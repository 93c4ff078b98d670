"""Interpolation between the states of an ephemeris, by Hermite's or Lagrange's polynomials.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 5.2.4 (useable span,
   interpolation).
.. [2] J. Stoer, R. Bulirsch (2002), Introduction to Numerical Analysis, 3rd ed., sections 2.1.3
   (divided differences) and 2.1.5 (Hermite).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch
from hillsphere.formats.oem_segments import OemSegment, states_needed

__all__ = ["OemInterpolant", "interpolant_of", "segment_at"]

_DEFAULT_DEGREE = 7
"""Degree of Hermite's polynomial through four states, where a message recommends none."""
_AT_ONCE = 20_000
"""Times that are interpolated together: 10 MB of divided differences of degree 7."""


@dataclass(frozen=True)
class OemInterpolant:
    """States of one segment at any time of its useable span.

    Parameters
    ----------
    segment : OemSegment
        The segment; no state of another one is used, since a manoeuvre may lie between them.
    method : str
        ``"HERMITE"``, which passes through positions and velocities, or ``"LAGRANGE"``, which
        interpolates each component by itself.
    degree : int
        Of the polynomials.
    is_stated : bool
        Whether the message recommends this, or a comparison with the kernel chose it.
    """

    segment: OemSegment
    method: str
    degree: int
    is_stated: bool

    def __str__(self) -> str:
        """Return method, degree and whose choice they are."""
        whose = "given with the states" if self.is_stated else "the default"
        return f"{self.method.title()} interpolation of degree {self.degree} ({whose})"

    @property
    def span_s(self) -> tuple[float, float]:
        """Return the first and last time at which there are states, s after `segment.epoch`."""
        t = self.segment.t_s
        start, stop = self.segment.useable_start_s, self.segment.useable_stop_s
        first = t[0] if start is None else max(t[0], start)
        last = t[-1] if stop is None else min(t[-1], stop)
        return float(first), float(last)

    def __call__(self, t_s: Array | float) -> Array:
        """Return states.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            Times, s after `segment.epoch`.

        Returns
        -------
        ndarray, shape (6, N)
            Positions, m, and velocities, m/s, in the frame of the segment.

        Raises
        ------
        InputError
            If a time lies outside the useable span.
        """
        times = np.atleast_1d(np.asarray(t_s, dtype=float))
        first, last = self.span_s
        inside = (times >= first) & (times <= last)
        if not inside.all():
            raise InputError(
                f"t_s: {self.segment.object_name} has useable states from {first!r} s to {last!r} "
                f"s after its epoch, got {float(times[np.argmin(inside)])!r} s"
            )
        nodes = self.segment.t_s
        count = states_needed(self.method, self.degree)
        # The interval of each time is put into the middle of its window, as far as there are
        # states on both sides: there the error of a polynomial is least.
        interval = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, nodes.size - 1)
        begin = np.clip(interval - (count - 1) // 2, 0, nodes.size - count)
        states = np.empty((6, times.size))
        order = np.argsort(begin, kind="stable")
        for first_one in range(0, times.size, _AT_ONCE):
            some = order[first_one : first_one + _AT_ONCE]
            windows, of_time = np.unique(begin[some], return_inverse=True)
            chosen = windows + np.arange(count)[:, None]
            t, x = nodes[chosen], self.segment.x[:, chosen]
            # Times in units of the window keep the divided differences within range.
            middle, unit = 0.5 * (t[0] + t[-1]), np.maximum(0.5 * (t[-1] - t[0]), 1e-9)
            tau, at = (t - middle) / unit, (times[some] - middle[of_time]) / unit[of_time]
            if self.method == "HERMITE":
                tau = np.repeat(tau, 2, axis=0)
                table = _differences(tau, np.repeat(x[:3], 2, axis=1), x[3:] * unit)
                place, slope = _evaluate(tau[:, of_time], table[:, :, of_time], at)
                states[:, some] = np.concatenate([place, slope / unit[of_time]])
            else:
                table = _differences(tau, x)
                states[:, some] = _evaluate(tau[:, of_time], table[:, :, of_time], at)[0]
        return states


def interpolant_of(
    segment: OemSegment, method: str | None = None, degree: int | None = None
) -> OemInterpolant:
    """Return the interpolation of a segment.

    Parameters
    ----------
    segment : OemSegment
        With as many states as the polynomials need.
    method : str, optional
        ``"HERMITE"`` or ``"LAGRANGE"``; by default what the segment recommends, else Hermite's.
    degree : int, optional
        By default what the segment recommends for the method, else 7, less where the segment has
        too few states. An even degree of Hermite's polynomials is raised by one, since each state
        gives two conditions.

    Raises
    ------
    InputError
        If the method is unknown or the segment has too few states.
    """
    stated, stated_degree = segment.interpolation or "", segment.interpolation_degree
    if stated == "PROPAGATE" and method is None:
        raise InputError(
            f"{segment.object_name}: the message recommends that the states are propagated, not "
            "interpolated; choose a method to interpolate them nevertheless"
        )
    is_stated = bool(stated) and method in (None, stated) and degree in (None, stated_degree)
    chosen = method or stated or "HERMITE"
    if degree is None:
        degree = stated_degree if chosen == stated else None
    if chosen == "LINEAR":
        chosen, degree = "LAGRANGE", 1
    if chosen not in ("HERMITE", "LAGRANGE"):
        raise InputError(f"method must be 'HERMITE' or 'LAGRANGE', got {chosen[:40]!r}")
    count = segment.t_s.size
    if degree is None:
        most = 2 * count - 1 if chosen == "HERMITE" else count - 1
        degree = min(_DEFAULT_DEGREE, most)
    least = 1 if chosen == "HERMITE" else 0
    if degree < least or states_needed(chosen, degree) > count:
        raise InputError(
            f"degree: {degree} of {chosen} needs at least {states_needed(chosen, max(degree, 1))} "
            f"states, {segment.object_name} has {count}"
        )
    if chosen == "HERMITE":
        degree += 1 - degree % 2
    return OemInterpolant(segment, chosen, degree, is_stated)


def segment_at(segments: Sequence[OemSegment], epoch: Epoch) -> OemSegment:
    """Return the segment within whose useable span an instant lies.

    At the common end of two segments the later one is meant: it holds after a manoeuvre.

    Raises
    ------
    InputError
        If there is none.
    """
    for segment in reversed(segments):
        first, last = interpolant_of(segment, "HERMITE").span_s
        if first <= epoch.seconds_since(segment.epoch) <= last:
            return segment
    (when,) = epoch.isot(np.zeros(1), 3)
    raise InputError(f"no segment of the ephemeris has useable states at {when} {epoch.scale}")


def _differences(nodes: Array, values: Array, slopes: Array | None = None) -> Array:
    """Return the divided differences of Newton's polynomials [2]_, one for each of W windows.

    Parameters
    ----------
    nodes : ndarray, shape (M, W)
        Abscissas; of Hermite's polynomials each stands twice.
    values : ndarray, shape (C, M, W)
        Values of C components there.
    slopes : ndarray, shape (C, M / 2, W), optional
        Derivatives at the doubled nodes, which stand for the difference of a node from itself.
    """
    table = values.copy()
    for order in range(1, len(nodes)):
        gap = nodes[order:] - nodes[:-order]
        rise = table[:, order:] - table[:, order - 1 : -1]
        if order == 1 and slopes is not None:
            step = np.where(gap > 0.0, rise / np.where(gap > 0.0, gap, 1.0), 0.0)
            step[:, ::2] = slopes
        else:
            step = rise / gap
        table[:, order:] = step
    return table


def _evaluate(nodes: Array, table: Array, at: Array) -> tuple[Array, Array]:
    """Return values and derivatives, each (C, N), of N polynomials at (N,) by Horner's scheme."""
    value = table[:, -1].copy()
    slope = np.zeros_like(value)
    for order in range(len(nodes) - 2, -1, -1):
        step = at - nodes[order]
        slope = slope * step + value
        value = value * step + table[:, order]
    return value, slope
