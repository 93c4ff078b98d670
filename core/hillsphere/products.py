"""What passes between stages: frozen dataclasses of arrays, numbers and strings.

Nothing compiled and no live object stands in a product, so that every product can be written to a
file and read back (`save_product`, `load_product`). A plugin may define its own product classes of
the same form.
"""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array
from hillsphere.product_codec import load_product, save_product

__all__ = [
    "Bifurcations",
    "FlightSet",
    "OrbitSet",
    "PeriodicOrbits",
    "Trajectories",
    "load_product",
    "save_product",
]


@dataclass(frozen=True)
class PeriodicOrbits:
    """Periodic orbits of one plant, members of one or more families.

    Parameters
    ----------
    frame : str
        Frame of the states, see `hillsphere.frames`.
    states : tuple of str
        Names of the n states.
    x0 : ndarray, shape (n, N)
        State at the start of each orbit, SI.
    period_s : ndarray, shape (N,)
        Full period.
    integral : ndarray, shape (N,)
        Conserved quantity in normalised units (NaN where the plant has none).
    monodromy : ndarray, shape (n, n, N)
        State transition matrix over one period, normalised units.
    residual : ndarray, shape (N,)
        Norm of x(T) − x(0), normalised units.
    labels : tuple of str
        One name per orbit.
    length_m, time_s : float
        Normalised unit of length and of time in SI.
    """

    frame: str
    states: tuple[str, ...]
    x0: Array
    period_s: Array
    integral: Array
    monodromy: Array
    residual: Array
    labels: tuple[str, ...]
    length_m: float
    time_s: float


@dataclass(frozen=True)
class OrbitSet:
    """A product with periodic orbits that were asked for.

    Products of families derive from it, so that any stage that judges orbits takes them, whatever
    the family and whoever wrote it.

    Parameters
    ----------
    members : PeriodicOrbits
        The orbits.
    """

    members: PeriodicOrbits


@dataclass(frozen=True)
class Trajectories:
    """Coasts, that is flights without manoeuvres, one or more making up each plan.

    Parameters
    ----------
    frame : str
        Frame of the states, see `hillsphere.frames`.
    states : tuple of str
        Names of the n states.
    plans : tuple of str
        Name of the plan that each of the N coasts belongs to; those of a plan follow each other.
    labels : tuple of str
        Name of each coast.
    t_s : ndarray, shape (K, N)
        Times since the beginning of the plan, rising; NaN beyond a coast's end.
    x : ndarray, shape (n, K, N)
        States, SI; NaN beyond a coast's end.
    """

    frame: str
    states: tuple[str, ...]
    plans: tuple[str, ...]
    labels: tuple[str, ...]
    t_s: Array
    x: Array


@dataclass(frozen=True)
class FlightSet:
    """A product with flights, for stages that write or judge them.

    Parameters
    ----------
    flights : Trajectories
        The flights.
    """

    flights: Trajectories


@dataclass(frozen=True)
class Bifurcations:
    """Members of a family at which another family branches off.

    Parameters
    ----------
    orbits : PeriodicOrbits
        The bifurcating members, labelled ``"vertical 1:17"`` and so on.
    plane : tuple of str
        ``"planar"`` or ``"vertical"``, per member.
    d, n : tuple of int
        Resonance d:n, per member: the stability index is 2 cos(2π d/n).
    index : ndarray, shape (N,)
        Stability index at the member.
    """

    orbits: PeriodicOrbits
    plane: tuple[str, ...]
    d: tuple[int, ...]
    n: tuple[int, ...]
    index: Array
