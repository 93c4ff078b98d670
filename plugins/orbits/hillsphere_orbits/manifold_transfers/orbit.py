"""The search through one unstable orbit, as pieces for the workers of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Compiled, Flow, flow_of
from hillsphere_orbits.invariant_manifolds.flight import Watch
from hillsphere_orbits.invariant_manifolds.sampling import LocalManifold, sides_are_images
from hillsphere_orbits.invariant_manifolds.stage import enders, period_steps, trial_places
from hillsphere_orbits.manifold_transfers.assembly import OrbitTransfers
from hillsphere_orbits.manifold_transfers.flights import Coasts, LegFlights, VerifiedFlights, Waits
from hillsphere_orbits.manifold_transfers.search import Legs, Search, join_legs, ladder
from hillsphere_orbits.transfers.curves import PolarOrbit

__all__ = ["OrbitSearch", "UnstableOrbit", "mirror_of"]

_ACCURACY = 1e-11  # see `period_steps`; legs magnify errors as they do the first state
_SAME = 1e-9  # of an orbit and its mirror image
_SIGNS = tuple(
    (i, j, k) for i in (1, -1) for j in (1, -1) for k in (1, -1) if (i, j, k) != (1, 1, 1)
)


@dataclass(frozen=True, eq=False)
class UnstableOrbit:
    """An orbit through which transfers are searched, normalised.

    Parameters
    ----------
    x0 : ndarray, shape (6,)
        A state of it.
    period : float
        Its period.
    monodromy : ndarray, shape (6, 6)
        Matrix of one revolution.
    kind : str
        Kind of its manifold, see `classify_manifolds`; without an unstable one nothing is searched.
    check : bool
        Whether to search again with twice the samples.
    """

    x0: Array
    period: float
    monodromy: Array
    kind: str
    check: bool


@dataclass(frozen=True, eq=False)
class OrbitSearch:
    """Data common to the searches through all orbits; see `hillsphere.runs.workers.Divisible`.

    Its pieces are orbits, and then the legs that were found through them, to be flown anew.

    Parameters
    ----------
    compiled : Compiled
        Equations of motion.
    departure, arrival : tuple of (str, ndarray, float)
        Name, state (6,) and period of the planar orbits, normalised.
    limit : float
        Longest time of flight of a leg, normalised.
    gain : float
        Speed by which a leg must better all quicker ones to count, normalised.
    start, distance : float
        See `hillsphere_orbits.invariant_manifolds.sampling.leaves`.
    samples : int
        Trajectories of the first mesh.
    """

    compiled: Compiled
    departure: tuple[str, Array, float]
    arrival: tuple[str, Array, float]
    limit: float
    gain: float
    start: float
    distance: float
    samples: int

    def prepare(
        self,
    ) -> Callable[[UnstableOrbit | Coasts | Waits], OrbitTransfers | VerifiedFlights]:
        """Return the function that does a piece.

        Raises
        ------
        InputError
            If a planar orbit is no closed curve.
        """
        flow = flow_of(self.compiled.plant)
        targets = [PolarOrbit(flow, x0, t, name) for name, x0, t in (self.departure, self.arrival)]
        return _Searching(self, flow, targets[0], targets[1])


class _Searching:
    """Searches through orbits and flies their legs with one compiled flow."""

    def __init__(
        self, work: OrbitSearch, flow: Flow, departure: PolarOrbit, arrival: PolarOrbit
    ) -> None:
        self._work, self._flow = work, flow
        self._departure, self._arrival = departure, arrival
        self._ends = enders(flow)
        events = {name: flow.system.events[name] for name in self._ends}
        self._watch = Watch(flow.system, {"plane": flow.system.x[2], **events})
        self._mirror = mirror_of(flow, [departure, arrival])
        self._flights = LegFlights(work.compiled.plant, flow, (departure, arrival))

    def __call__(self, piece: UnstableOrbit | Coasts | Waits) -> OrbitTransfers | VerifiedFlights:
        return (
            self._search_orbit(piece) if isinstance(piece, UnstableOrbit) else self._flights(piece)
        )

    def _search_orbit(self, orbit: UnstableOrbit) -> OrbitTransfers:
        nothing = Legs.none()
        if orbit.kind != "unstable":
            return OrbitTransfers(orbit.kind, float("nan"), nothing, nothing, 0)
        samples = self._work.samples
        try:
            steps = period_steps(self._flow, orbit.x0, orbit.period, orbit.monodromy, _ACCURACY)
            multiplier, departure, arrival, count = self._legs(orbit, steps, samples)
            again = self._legs(orbit, steps, 2 * samples)[1:3] if orbit.check else None
        except HillsphereError as error:
            return OrbitTransfers(f"not searched: {error}", float("nan"), nothing, nothing, 0)
        missing = [
            name
            for name, legs in (("departure", departure), ("arrival", arrival))
            if not legs.p.size
        ]
        status = f"no {missing[0]} leg" if len(missing) == 1 else "no leg"
        return OrbitTransfers(
            status if missing else "connected", multiplier, departure, arrival, int(count[0]),
            again, int(count[1]),
        )  # fmt: skip

    def _legs(
        self, orbit: UnstableOrbit, steps: int, samples: int
    ) -> tuple[float, Legs, Legs, NDArray[np.int64]]:
        """Return the multiplier, the ladders of departure and arrival, and counts of trajectories.

        The counts (2,) are those of `Search.legs`.
        """
        flow, mirror, x0 = self._flow, self._mirror, orbit.x0
        image = mirror is not None and bool(
            np.max(np.abs(mirror * x0 - x0)) <= _SAME * np.max(np.abs(x0))
        )
        local = LocalManifold.of(flow, x0, orbit.period, steps)
        if not local.orbit[[2, 5]].any() and not local.mode[[2, 5]].any():
            raise InputError(
                "the orbit and its manifold lie in the plane z = 0, which they do not pass through"
            )
        wanted = [self._arrival, self._departure] if image else [self._arrival]
        ladders, count = self._sides(local, wanted, samples)
        arrival = ladders[0]
        if image and mirror is not None:
            return local.multiplier, ladders[1].mirror(mirror), arrival, count
        backwards = LocalManifold.of(flow, x0, orbit.period, steps, stable=True)
        (departure,), more = self._sides(backwards, [self._departure], samples)
        return local.multiplier, departure, arrival, count + more

    def _sides(
        self, local: LocalManifold, targets: list[PolarOrbit], samples: int
    ) -> tuple[list[Legs], NDArray[np.int64]]:
        """Return the ladders to the targets over both sides of a manifold, and the counts."""
        work = self._work
        # a symmetry that maps one side on the other must map the planar orbits on themselves
        kept = tuple(signs for signs in _SIGNS if all(_keeps(t, signs) for t in targets))
        alike = bool(kept) and sides_are_images(local, trial_places(), kept)
        parts: list[list[Legs]] = []
        count = np.zeros(2, dtype=np.int64)
        for side in local.sides[:1] if alike else local.sides:
            search = Search(
                local, self._watch, side, start=work.start, distance=work.distance,
                limit=work.limit, ends=self._ends, samples=samples, gain=work.gain,
            )  # fmt: skip
            legs, flown = search.legs(targets)
            parts.append(legs)
            count += flown
        return [
            ladder(join_legs([p[k] for p in parts]), work.gain) for k in range(len(targets))
        ], count


def mirror_of(flow: Flow, targets: list[PolarOrbit]) -> Array | None:
    """Return the signs of a time reversal that the equations and the planar orbits keep."""
    for signs in flow.system.mirrors.values():
        i, j, k = signs[:3]
        if flow.keeps(signs, trial_places(), reverses_time=True) and all(
            _keeps(target, (i, j, k), reverses=True) for target in targets
        ):
            return np.array(signs, dtype=float)
    return None


def _keeps(orbit: PolarOrbit, signs: tuple[int, int, int], *, reverses: bool = False) -> bool:
    """Whether a sign change of the axes maps a planar orbit on itself."""
    angle = np.linspace(0.1, 6.1, 25)
    mirror = np.array([*signs, *(s * (-1 if reverses else 1) for s in signs)])[:, None]
    image = mirror * orbit.state(angle)
    there = orbit.state(np.arctan2(image[1], image[0]))
    return bool(np.max(np.abs(image - there)) <= _SAME * np.max(np.abs(there)))
