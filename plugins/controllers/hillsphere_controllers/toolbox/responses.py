"""Responses of systems in time and frequency as arrays, with charts of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Axis, Chart, Curve, Panel, Rule
from hillsphere.show.drawing import Drawing, draw
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.analysis.hinf_norm import HinfNorm, hinf_norm
from hillsphere_controllers.analysis.margins import LoopMargins, loop_margins
from hillsphere_controllers.delays.loop_margins import loop_margins as margins_with_delays
from hillsphere_controllers.delays.norms import h2_norm as h2_norm_with_delays
from hillsphere_controllers.delays.norms import hinf_norm as hinf_norm_with_delays
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.stages.step_responses import step_responses
from hillsphere_controllers.systems.conversion import as_lti
from hillsphere_controllers.toolbox.results import Readable

__all__ = [
    "Bode", "Margins", "SingularValues", "StepResponse", "bode", "h2norm", "hinfnorm", "margins",
    "sigma", "step",
]  # fmt: skip

_POINTS = 400
"""Frequencies of a curve: a printed figure shows no corners."""
_WITHOUT_DELAYS, _WITH_DELAYS = 1e-9, 1e-4
"""Tolerances of the H∞ norm by default, those of the functions that compute it."""
_TURN, _MOST_TURNS = np.pi / 4.0, 20_000
"""Turn of the phase of all delays together from one frequency of a curve to the next at most, so
that it is followed; and the number of such steps, beyond which a curve shows nothing."""
_BEYOND = 100.0
"""Factor by which the default frequencies go beyond the slowest and the fastest pole: two decades
show the asymptotes."""


class _Plotted(Readable):
    """A result with a chart."""

    def chart(self) -> Chart:
        """Return the chart as data."""
        raise NotImplementedError

    def plot(self, path: str | Path | None = None) -> Drawing:
        """Draw the chart; notebooks show what is returned.

        Parameters
        ----------
        path : str or Path, optional
            File to write, ``.svg`` or ``.png``.

        Raises
        ------
        InputError
            If the file has another ending.
        """
        kind = "" if path is None else Path(path).suffix
        if path is not None and kind not in (".svg", ".png"):
            raise InputError(f"a plot is written to a .svg or .png file, got {path}")
        drawing = draw(self.chart(), png=kind == ".png")
        if path is not None:
            content = drawing.svg if kind == ".svg" else drawing.png
            Path(path).write_bytes(content or b"")
        return drawing


@dataclass(frozen=True, eq=False, repr=False)
class StepResponse(_Plotted):
    """Responses to unit steps.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times.
    outputs : ndarray, shape (K, p, m)
        Of all outputs to a step of each input.
    names : tuple of str
        Of the p · m transfers, the inputs of the first output first.
    """

    times_s: Array
    outputs: Array
    names: tuple[str, ...]

    def chart(self) -> Chart:
        """Return the responses over time."""
        curves = [
            Curve(self.times_s, self.outputs[:, i, j], name)
            for (i, j), name in zip(np.ndindex(self.outputs.shape[1:]), self.names, strict=True)
        ]
        panel = Panel(Axis("time", "s"), Axis("output"), curves)
        return Chart("Step response", [panel], alt="Outputs over time after a unit step.")


@dataclass(frozen=True, eq=False, repr=False)
class Bode(_Plotted):
    """Magnitude and phase over frequency.

    Parameters
    ----------
    omega_rad_s : ndarray, shape (K,)
        Frequencies.
    magnitude : ndarray, shape (K, p, m)
        Gains, not in decibels.
    phase_rad : ndarray, shape (K, p, m)
        Phases, continuous over frequency.
    names : tuple of str
        As of `StepResponse`.
    """

    omega_rad_s: Array
    magnitude: Array
    phase_rad: Array
    names: tuple[str, ...]

    def chart(self) -> Chart:
        """Return magnitude and phase in two panels."""
        omega = Axis("frequency", "rad/s", "log")
        gain, phase = [], []
        for (i, j), name in zip(np.ndindex(self.magnitude.shape[1:]), self.names, strict=True):
            gain.append(Curve(self.omega_rad_s, _decibels(self.magnitude[:, i, j]), name))
            phase.append(Curve(self.omega_rad_s, np.degrees(self.phase_rad[:, i, j]), name))
        panels = [
            Panel(omega, Axis("magnitude", "dB"), gain),
            Panel(omega, Axis("phase", "°"), phase, legend="none"),
        ]
        return Chart(
            "Bode diagram", panels, alt="Magnitude and phase over frequency.", share_x=True
        )


@dataclass(frozen=True, eq=False, repr=False)
class SingularValues(_Plotted):
    """Singular values over frequency.

    Parameters
    ----------
    omega_rad_s : ndarray, shape (K,)
        Frequencies.
    values : ndarray, shape (K, min(p, m))
        The largest first.
    """

    omega_rad_s: Array
    values: Array

    def chart(self) -> Chart:
        """Return the singular values in decibels."""
        curves = [
            Curve(self.omega_rad_s, _decibels(row), f"σ{k + 1}")
            for k, row in enumerate(self.values.T)
        ]
        panel = Panel(Axis("frequency", "rad/s", "log"), Axis("singular value", "dB"), curves)
        return Chart("Singular values", [panel], alt="Singular values over frequency.")


@dataclass(frozen=True, eq=False, repr=False)
class Margins(_Plotted):
    """Margins of a loop closed by negative feedback, each channel with the others closed.

    Parameters
    ----------
    stable : bool
        Whether the closed loop is stable.
    loops : tuple of LoopMargins
        One per channel.
    response : Bode
        Of the loop, for the chart.
    """

    stable: bool
    loops: tuple[LoopMargins, ...]
    response: Bode

    def __repr__(self) -> str:
        """Return the margins of each channel in words."""
        state = "stable" if self.stable else "not stable: it has no margins"
        lines = [f"Margins: the closed loop is {state}"]
        for k, one in enumerate(self.loops):
            if not self.stable:
                break
            if len(self.loops) > 1:
                lines.append(f"  channel {k + 1}, the others closed")
            gains = f"{one.gain_lower:.5g} to {one.gain_upper:.5g}"
            low, high = (_one_decibel(g) for g in (one.gain_lower, one.gain_upper))
            lines += [
                f"  gain margin   factors from {gains} ({low} to {high})"
                + _at(one.gain_lower_rad_s, one.gain_upper_rad_s),
                f"  phase margin  {np.degrees(one.phase_rad):.5g}°" + _at(one.phase_rad_s),
                f"  delay margin  {one.delay_s:.5g} s" + _at(one.delay_rad_s),
            ]
        return "\n".join(lines)

    def __iter__(self) -> Iterator[LoopMargins]:
        """Iterate over the channels."""
        return iter(self.loops)

    def chart(self) -> Chart:
        """Return the Bode diagram of the loop, with lines at the crossings."""
        bode_chart = self.response.chart()
        gain, phase = (one for one in bode_chart.panels if isinstance(one, Panel))
        crossings = [one.phase_rad_s for one in self.loops if np.isfinite(one.phase_rad_s)]
        marks = [Rule("x", omega, "gain crossing") for omega in crossings]
        panels = [
            Panel(gain.x, gain.y, [*gain.marks, Rule("y", 0.0), *marks]),
            Panel(phase.x, phase.y, [*phase.marks, Rule("y", -180.0), *marks], legend="none"),
        ]
        return Chart("Loop and its margins", panels, alt=bode_chart.alt, share_x=True)


def hinfnorm(G: LtiSystem | DelaySystem, *, tolerance: float | None = None) -> HinfNorm:
    """Return the H∞ norm of a system, where it is reached, and an upper bound.

    Parameters
    ----------
    G : LtiSystem, DelaySystem or system of python-control
        The system.
    tolerance : float, optional
        Relative distance between the bounds; by default 1e-9, and 1e-4 with delays.

    Returns
    -------
    HinfNorm
        The norm, the frequency where it is reached, and an upper bound.

    Raises
    ------
    InputError, ConvergenceError
        As `hillsphere_controllers.delays.norms.hinf_norm`.
    """
    if isinstance(G, DelaySystem):
        return hinf_norm_with_delays(G, _WITH_DELAYS if tolerance is None else tolerance)
    tolerance = _WITHOUT_DELAYS if tolerance is None else tolerance
    return hinf_norm(as_lti(G, "the system G"), tolerance)


def h2norm(G: LtiSystem | DelaySystem) -> float:
    """Return the H2 norm of a system of this library or of python-control.

    Parameters
    ----------
    G : LtiSystem, DelaySystem or system of python-control
        Stable, in continuous time strictly proper; the norm is infinite otherwise. Delays at its
        inputs or outputs alone.

    Returns
    -------
    float
        The norm.

    Raises
    ------
    InputError
        If a delay is inside the system.
    """
    if isinstance(G, DelaySystem):
        return h2_norm_with_delays(G)
    return h2_norm(as_lti(G, "the system G"))


def step(G: LtiSystem, duration_s: float | None = None) -> StepResponse:
    """Return the responses to unit steps, exact at the times.

    Parameters
    ----------
    G : LtiSystem or system of python-control
        Stable, unless a duration is given.
    duration_s : float, optional
        How long; by default until all has settled.

    Returns
    -------
    StepResponse
        Times, and the response of every output to every input.

    Raises
    ------
    InputError
        If the system is not stable and no duration is given, the duration is not positive, or the
        system has delays.
    """
    if isinstance(G, DelaySystem):
        raise InputError(
            "the step response of a system with delays is not computed; step(pade(G, order)) gives "
            "that of an approximation"
        )
    system = as_lti(G, "the system G")
    if duration_s is None and not system.is_stable:
        raise InputError("the system is not stable: give the duration of its step response")
    if duration_s is not None and not 0.0 < duration_s < np.inf:
        raise InputError(f"a duration must be > 0 s and finite, got {duration_s}")
    times, (outputs,) = step_responses([system], duration_s)
    return StepResponse(times, outputs, _names(system))


def bode(G: LtiSystem | DelaySystem, omega_rad_s: Array | None = None) -> Bode:
    """Return magnitude and phase over frequency.

    Parameters
    ----------
    G : LtiSystem, DelaySystem or system of python-control
        The system.
    omega_rad_s : ndarray, shape (K,), optional
        Frequencies, rising; by default two decades beyond the poles, or to half the sampling rate.
        The phase is continued from one to the next: for delays of together T s, they must be nearer
        to each other than π/T.

    Returns
    -------
    Bode
        Magnitude and phase of every channel.

    Raises
    ------
    InputError
        If a frequency is that of a pole.
    """
    system = G if isinstance(G, DelaySystem) else as_lti(G, "the system G")
    omega, made = _response(system, omega_rad_s)
    phase = np.unwrap(np.angle(made), axis=0)
    return Bode(omega, np.abs(made), phase, _names(system))


def sigma(G: LtiSystem | DelaySystem, omega_rad_s: Array | None = None) -> SingularValues:
    """Return the singular values over frequency.

    Parameters
    ----------
    G : LtiSystem, DelaySystem or system of python-control
        The system.
    omega_rad_s : ndarray, shape (K,), optional
        Frequencies, rising; by default as of `bode`.

    Returns
    -------
    SingularValues
        The frequencies and the singular values there.
    """
    system = G if isinstance(G, DelaySystem) else as_lti(G, "the system G")
    omega, made = _response(system, omega_rad_s)
    values: Array = np.asarray(np.linalg.svd(made, compute_uv=False), dtype=float)
    return SingularValues(omega, values)


def margins(L: LtiSystem | DelaySystem) -> Margins:
    """Return gain, phase and delay margins of a loop closed by negative feedback.

    Parameters
    ----------
    L : LtiSystem, DelaySystem or system of python-control
        The loop, as many outputs as inputs; with delays in continuous time, without direct terms.

    Returns
    -------
    Margins
        The margins and the frequencies where they are reached.

    Raises
    ------
    InputError, ConvergenceError
        As `hillsphere_controllers.analysis.margins.loop_margins`, and
        `hillsphere_controllers.delays.loop_margins.loop_margins` with delays.
    """
    loop = L if isinstance(L, DelaySystem) else as_lti(L, "the loop L")
    found = margins_with_delays(loop) if isinstance(loop, DelaySystem) else loop_margins(loop)
    return Margins(all(one.stable for one in found), found, bode(loop))


def _response(
    system: LtiSystem | DelaySystem, omega_rad_s: Array | None
) -> tuple[Array, NDArray[np.complex128]]:
    omega = _grid(system) if omega_rad_s is None else np.asarray(omega_rad_s, dtype=float)
    return omega, system.response(omega)


def _grid(system: LtiSystem | DelaySystem) -> Array:
    if isinstance(system, DelaySystem):
        together = sum(system.delays_s)
        coarse = _grid(system.system)
        if not together:
            return coarse
        low, high = min(coarse[0], 0.1 / together), max(coarse[-1], _BEYOND / together)
        step = _TURN / together
        high = min(high, _MOST_TURNS * step)
        fine = np.arange(step, high, step)
        return np.union1d(np.geomspace(low, high, _POINTS), fine)
    poles = system.poles
    if system.dt_s is not None:
        poles = np.asarray(np.log(poles[np.abs(poles) > 0.0]) / system.dt_s)
    sizes = np.abs(poles)
    sizes = sizes[sizes > 1e-9 * sizes.max(initial=0.0)]
    low, high = (float(sizes.min()), float(sizes.max())) if sizes.size else (1.0, 1.0)
    if system.dt_s is None:
        return np.geomspace(low / _BEYOND, high * _BEYOND, _POINTS)
    top = np.pi / system.dt_s
    return np.geomspace(min(low, top) / _BEYOND, top, _POINTS)


def _names(system: LtiSystem | DelaySystem) -> tuple[str, ...]:
    p, m = system.shape
    outputs = system.outputs or tuple(f"y{i + 1}" for i in range(p))
    inputs = system.inputs or tuple(f"u{j + 1}" for j in range(m))
    return tuple(f"{y} from {u}" for y in outputs for u in inputs)


def _one_decibel(factor: float) -> str:
    if factor == 0.0 or factor == np.inf:
        return "−∞ dB" if factor == 0.0 else "∞ dB"
    return f"{20.0 * np.log10(factor):.4g} dB".replace("-", "−")


def _at(*omega_rad_s: float) -> str:
    """Return the frequencies at which margins are reached; NaN where nothing bounds them."""
    there = [f"{one:.5g}" for one in omega_rad_s if np.isfinite(one)]
    return f", at {' and '.join(there)} rad/s" if there else ""


def _decibels(gains: Array) -> Array:
    with np.errstate(divide="ignore"):
        made = 20.0 * np.log10(gains)
    return np.where(np.isfinite(made), made, np.nan)
