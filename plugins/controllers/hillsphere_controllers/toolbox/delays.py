"""Systems with delays under usual names, and functions that take systems with delays or without."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.delays.algebra import approximate_delays, delay, with_delays
from hillsphere_controllers.delays.algebra import connect as connect_late
from hillsphere_controllers.delays.algebra import with_names as name_late
from hillsphere_controllers.delays.cover import pade_cover
from hillsphere_controllers.delays.margin import DelayMargin, delay_margin
from hillsphere_controllers.delays.stability import judge_stability
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.systems.conversion import as_lti
from hillsphere_controllers.systems.delay import pade_delay
from hillsphere_controllers.systems.interconnection import connect as connect_certain
from hillsphere_controllers.systems.interconnection import with_names as name_certain

__all__ = [
    "DelayMargin", "DelaySystem", "connect", "delay", "delaymargin", "freqresp", "isstable", "pade",
    "padecover", "with_delays", "with_names",
]  # fmt: skip


def isstable(G: LtiSystem | DelaySystem) -> bool:
    """Return whether a system is stable; with delays, by a proved count of its poles.

    Parameters
    ----------
    G : LtiSystem, DelaySystem or system of python-control
        The system.

    Returns
    -------
    bool
        Whether all poles are on the left of the axis, or in the unit disc.

    Raises
    ------
    ConvergenceError
        If it is undecided: `hillsphere_controllers.delays.stability.judge_stability` returns None
        then.
    """
    if not isinstance(G, DelaySystem):
        return as_lti(G, "the system G").is_stable
    made = judge_stability(G)
    if made.stable is None:
        raise ConvergenceError(f"whether the system is stable is undecided: {made.reason}")
    return made.stable


def delaymargin(
    L: LtiSystem | DelaySystem, longest_s: float, *, tolerance: float = 1e-3
) -> DelayMargin:
    """Return bounds of the extra delay that a loop closed by negative feedback tolerates.

    Parameters
    ----------
    L : LtiSystem, DelaySystem or system of python-control
        The loop, as many outputs as inputs; every channel gets the extra delay at once.
    longest_s, tolerance
        As of `hillsphere_controllers.delays.margin.delay_margin`.

    Returns
    -------
    DelayMargin
        Proved bounds; `hillsphere_controllers.margins` has the delay of each channel alone.

    Raises
    ------
    InputError
        As that function.
    """
    return delay_margin(L, longest_s, tolerance=tolerance)


def freqresp(G: LtiSystem | DelaySystem, omega_rad_s: Array) -> NDArray[np.complex128]:
    """Return the frequency response, exact with delays too.

    Parameters
    ----------
    G : LtiSystem, DelaySystem or system of python-control
        The system.
    omega_rad_s : ndarray, shape (K,)
        Frequencies, rad/s.

    Returns
    -------
    ndarray, shape (K, p, m)
        G(jω).

    Raises
    ------
    InputError
        If a frequency is no real number or that of a pole.
    """
    system = G if isinstance(G, DelaySystem) else as_lti(G, "the system G")
    return system.response(np.asarray(omega_rad_s))


def pade(G: DelaySystem | float, order: int = 1) -> LtiSystem:
    """Return a system with Padé approximations in the place of its delays.

    Parameters
    ----------
    G : DelaySystem or float
        The system, or the length of one delay, s.
    order : int
        Of each approximation, from 1 to 8.

    Returns
    -------
    LtiSystem
        Its approximation.

    Raises
    ------
    InputError
        If the order is out of range, or the loops with the approximations are not well posed.
    """
    return approximate_delays(G, order) if isinstance(G, DelaySystem) else pade_delay(G, order)


def padecover(
    G: DelaySystem,
    order: int = 1,
    *,
    weight_order: int | None = None,
    spread_s: float | Sequence[float] = 0.0,
) -> Lft:
    """Return an uncertain system without delays that contains the system with delays.

    Parameters
    ----------
    G, order, weight_order, spread_s
        As of `hillsphere_controllers.delays.cover.pade_cover`.

    Returns
    -------
    Lft
        With one uncertain dynamics per delay, for `musyn`, `robstab` and `wcgain`.

    Raises
    ------
    InputError
        As that function.
    """
    return pade_cover(G, order, weight_order=weight_order, spread_s=spread_s)


@overload
def with_names(
    system: LtiSystem, inputs: str | Sequence[str], outputs: str | Sequence[str]
) -> LtiSystem: ...
@overload
def with_names(
    system: DelaySystem, inputs: str | Sequence[str], outputs: str | Sequence[str]
) -> DelaySystem: ...
def with_names(system: Any, inputs: str | Sequence[str], outputs: str | Sequence[str]) -> Any:
    """Return a system with names for its signals, as `hillsphere_controllers.systems.with_names`.

    Parameters
    ----------
    system : LtiSystem or DelaySystem
        Any.
    inputs, outputs : str or sequence of str
        All names; or one, which is numbered for several signals.

    Returns
    -------
    LtiSystem or DelaySystem
        The same system with names.

    Raises
    ------
    InputError
        If the names are not as many as the signals, or one is listed twice.
    """
    if isinstance(system, DelaySystem):
        return name_late(system, inputs, outputs)
    return name_certain(system, inputs, outputs)


@overload
def connect(
    systems: Sequence[LtiSystem],
    junctions: Sequence[str],
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> LtiSystem: ...
@overload
def connect(
    systems: Sequence[LtiSystem | DelaySystem],
    junctions: Sequence[str],
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> LtiSystem | DelaySystem: ...
def connect(
    systems: Sequence[Any], junctions: Sequence[str], inputs: Sequence[str], outputs: Sequence[str]
) -> Any:
    """Connect every input to the signal of the same name, with delays or without.

    Parameters
    ----------
    systems : sequence of LtiSystem or DelaySystem
        With names for inputs and outputs.
    junctions, inputs, outputs : sequence of str
        As of `hillsphere_controllers.systems.interconnection.connect`.

    Returns
    -------
    LtiSystem or DelaySystem
        One with delays if one of the systems has some.

    Raises
    ------
    InputError
        As that function.
    """
    if any(isinstance(one, DelaySystem) for one in systems):
        return connect_late(systems, junctions, inputs, outputs)
    return connect_certain(systems, junctions, inputs, outputs)
