"""Short, dense pieces of families about places that a search has found.

Between members that are further apart the interpolation errs by some 1e-6, which the flow of an
unstable orbit magnifies; on a piece the same search is exact for all purposes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.correction import tangents
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.swing_qso_families.curves import at_positions
from hillsphere_orbits.swing_transfers.chains import Chains, Scan, scan
from hillsphere_orbits.swing_transfers.search import END, Minimum, minima
from hillsphere_orbits.swing_transfers.tangency import bracket_tangencies, tangent_members
from hillsphere_orbits.transfers.curves import PolarOrbit

__all__ = ["Pieces", "least_along", "search"]

_MEMBERS = 5
"""Members of a piece: it spans a quarter of the distance of two members of the chain, in which a
minimum that the coarse search found lies well inside."""
_SPACING = 1 / 16  # of the members of a piece, in positions on the family's chain
_MOVES = 4  # times that a piece is moved on if the minimum lies at its end
_CHAIN, _PIECE = (1e-2, 4), (1e-3, 2)
"""Width of a minimum in positions, and times fewer sub-steps, errors of 1e-7 and 3e-10."""


class Pieces:
    """Pieces of families as chains of their own; see `chains.Chains`.

    Parameters
    ----------
    chains : Chains
        The families.
    places : sequence of (int, float)
        Family and position about which each piece lies.
    """

    def __init__(self, chains: Chains, places: Sequence[tuple[int, float]]) -> None:
        self.flow: Flow = chains.flow
        self.families = range(len(places))
        self.whole = [family for family, _ in places]
        span = _SPACING * (_MEMBERS - 1)
        self._low = np.array(
            [
                min(max(u - 0.5 * span, 0.0), chains.branch(family).size - 1 - span)
                for family, u in places
            ]
        )
        self._problems = [chains.problem(family) for family in self.whole]
        self._branches: list[Branch] = [None] * len(places)  # type: ignore[list-item]
        steps = _SPACING * np.arange(_MEMBERS)
        for family in sorted(set(self.whole)):
            own = [k for k, other in enumerate(self.whole) if other == family]
            z = chains.at(family, np.concatenate([self._low[k] + steps for k in own]))
            lines = tangents(chains.problem(family), z, _sense(z))
            for i, k in enumerate(own):
                part = slice(i * _MEMBERS, (i + 1) * _MEMBERS)
                self._branches[k] = Branch(
                    np.ascontiguousarray(z[:, part]), np.ascontiguousarray(lines[:, part]), ("", "")
                )

    @property
    def problem(self) -> Callable[[int], Shooting]:
        """Piece → the equations of its orbits."""
        return self._problems.__getitem__

    @property
    def branch(self) -> Callable[[int], Branch]:
        """Piece → the chain of its orbits."""
        return self._branches.__getitem__

    def at(self, family: int, u: Array) -> Array:
        """Return corrected unknowns (m, N) at positions u (N,) of a piece."""
        return at_positions(self._problems[family], self._branches[family], u)

    def position(self, piece: int, u: float) -> float:
        """Return the position on the family's chain."""
        return float(self._low[piece] + _SPACING * u)


def _sense(z: Array) -> Array:
    """Return directions along chains of `_MEMBERS` members each, one after the other."""
    parts = np.split(z, z.shape[1] // _MEMBERS, axis=1)
    return np.concatenate([np.gradient(part, axis=1) for part in parts], axis=1)


def search(
    chains: Chains,
    scans: Sequence[Scan],
    names: tuple[str, str],
    orbits: Mapping[str, PolarOrbit],
    width: float = _CHAIN[0],
    coarse: int = _CHAIN[1],
) -> list[Minimum]:
    """Find the least cost of a leg along every family, on interpolated members.

    Parameters
    ----------
    chains : Chains
        The families.
    scans : sequence of Scan
        What their members meet.
    names : (str, str)
        Departure and arrival orbit.
    orbits : mapping of str to PolarOrbit
        Orbits by name.
    width, coarse : float, int
        See `minima`.

    Returns
    -------
    list of Minimum
        See `minima`.
    """
    touches = {
        one: tangent_members(
            chains,
            [t for s in scans for t in bracket_tangencies(s, one, other)],
            orbits[one],
            coarse,
        )
        for one, other in (names, names[::-1])
    }
    return minima(chains, scans, names, orbits, touches, width, coarse)


def least_along(
    chains: Chains,
    names: tuple[str, str],
    orbits: Mapping[str, PolarOrbit],
    coarse_minima: Sequence[Minimum],
) -> tuple[Pieces, list[Minimum]]:
    """Find the minima again on pieces about them, exactly.

    Parameters
    ----------
    chains : Chains
        The families.
    names : (str, str)
        Departure and arrival orbit.
    orbits : mapping of str to PolarOrbit
        Orbits by name.
    coarse_minima : sequence of Minimum
        What `search` found.

    Returns
    -------
    pieces : Pieces
        Where the minima are.
    minima : list of Minimum
        The least of every family; `Minimum.family` is the number of its piece.
    """
    pair = {name: orbits[name] for name in names}
    places = [(m.family, m.u) for m in coarse_minima]
    last = {m.family: chains.branch(m.family).size - 1.0 for m in coarse_minima}
    for _ in range(_MOVES):
        pieces = Pieces(chains, places)
        scans = [scan(pieces, k, pair, _PIECE[1]) for k in pieces.families]
        again = search(pieces, scans, names, pair, *_PIECE)
        moved = False
        for m in again:
            family, u = pieces.whole[m.family], pieces.position(m.family, m.u)
            # a minimum at the end of the piece, not of the family: centre the piece there and
            # repeat
            inside = 1e-6 < u < last[family] - 1e-6
            if m.kind == END and inside:
                places[m.family], moved = (family, u), True
        if not moved:
            break
    best: dict[int, Minimum] = {}
    for m in again:
        family = pieces.whole[m.family]
        if family not in best or m.dv < best[family].dv:
            best[family] = m
    return pieces, [best[family] for family in sorted(best)]
