"""Verdict on a structured synthesis: which routes arrived at its γ, and its gap to full order.

The function that is minimised has several local minima, and the proportion of random starts that
agree on one says little: where a wrong minimum has the larger basin, nearly all of them agree on
it. Routes of different kinds fail for different reasons. A γ is therefore called confirmed only if
two different routes at least arrive at it, and best only if a proved lower bound says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape
from hillsphere_controllers.structured.records import SearchResult
from hillsphere_controllers.structured.route_names import RESTARTS, ROUTES, STARTS

__all__ = ["AGREED", "Verdict", "make_verdict"]

AGREED = 1e-3
"""Relative distance above the best γ up to which a route has arrived at it: what a design is
compared by, and ten times what searches of one minimum at infinite gain differ by."""


@dataclass(frozen=True)
class Verdict:
    """What is known of the γ of a structured synthesis.

    Parameters
    ----------
    routes : tuple of str, shape (routes,)
        Kinds of searches.
    searches : ndarray of int, shape (routes,)
        How many of each ended.
    gammas : ndarray, shape (routes,)
        The best γ of each; infinite where no allowed controller was found.
    remarks : tuple of str, shape (routes,)
        Why a route does not apply or found nothing; may be empty.
    gamma : float
        γ of the design.
    lower_bound : float
        No controller of any order or structure reaches less; 0 if nothing is proved.
    full_order : float
        γ that a controller of full order was found to reach, for the plant and channel that is
        hardest by itself: it proves nothing; infinite if there is none.
    confined : bool
        Whether the searches were confined near a given controller, or ended at a target.
    """

    routes: Annotated[tuple[str, ...], Shape("routes"), Label("route")]
    searches: Annotated[Integers, Shape("routes"), Label("searches")]
    gammas: Annotated[Array, Shape("routes"), Label("best γ", 6)]
    remarks: Annotated[tuple[str, ...], Shape("routes"), Label("remark")]
    gamma: float
    lower_bound: float
    full_order: float
    confined: bool

    @property
    def arrived(self) -> tuple[str, ...]:
        """Routes that arrived at γ; restarts near the best are none of their own."""
        return tuple(
            name
            for name, gamma in zip(self.routes, self.gammas.tolist(), strict=True)
            if name != RESTARTS and gamma <= self.gamma * (1.0 + AGREED)
        )

    @property
    def gap(self) -> float:
        """How far γ is above the lower bound, relative; infinite without a bound."""
        return self.gamma / self.lower_bound - 1.0 if self.lower_bound > 0.0 else np.inf

    @property
    def kind(self) -> Literal["best", "confirmed", "one route", "starts alone", "confined"]:
        """The verdict in a word.

        `best`: within the tolerance of a proved lower bound; `confirmed`: two different routes at
        least arrived; `one route`: one did, or only restarts near the best; `starts alone`: no
        other route was tried; `confined`: the searches were not to look elsewhere.
        """
        if self.gap <= AGREED:
            return "best"
        if self.confined:
            return "confined"
        if len(self.arrived) > 1:
            return "confirmed"
        tried = {
            name
            for name, count in zip(self.routes, self.searches.tolist(), strict=True)
            if count and name != RESTARTS
        }
        return "one route" if tried - {STARTS} else "starts alone"

    @property
    def sentences(self) -> tuple[str, str]:
        """The verdict in a sentence, and the gap to full order in another."""
        arrived = self.arrived
        named = ", ".join(arrived)
        told = {
            "best": f"γ is proved to be the best to {100.0 * max(self.gap, 0.0):.2g} %.",
            "confirmed": f"γ is confirmed by different routes ({named}) to "
            f"{100.0 * AGREED:g} %; this is no proof that nothing is lower.",
            "one route": f"γ was found by one route only ({named or RESTARTS}) and is not "
            "confirmed: another minimum may be lower; a larger effort searches on.",
            "starts alone": "γ was found from starts alone and is not confirmed, however many of "
            "them agree; a larger effort adds other routes.",
            "confined": "The searches were confined to a given controller's neighbourhood or "
            "ended at a target: nothing is known of other minima.",
        }[self.kind]
        if self.lower_bound > 0.0:
            gap = (
                f"It is {100.0 * max(self.gap, 0.0):.3g} % above the proved lower bound of "
                f"controllers of any order, {self.lower_bound:.6g}."
            )
        elif np.isfinite(self.full_order):
            gap = (
                f"No lower bound is proved; a controller of full order was found to reach "
                f"{self.full_order:.6g}, {_compare(self.gamma, self.full_order)}."
            )
        else:
            gap = "No lower bound is proved, and no controller of full order was found."
        return told, gap

    def __str__(self) -> str:
        """Return both sentences."""
        return " ".join(self.sentences)


def make_verdict(
    results: Sequence[SearchResult],
    remarks: dict[str, str],
    gamma: float,
    lower_bound: float,
    full_order: float,
    *,
    confined: bool = False,
) -> Verdict:
    """Return the verdict on a γ.

    Parameters
    ----------
    results : sequence of SearchResult
        All searches, each with the route it belongs to.
    remarks : dict of str to str
        Of routes that were not tried.
    gamma, lower_bound, full_order, confined
        As of `Verdict`.

    Returns
    -------
    Verdict
        With a row for each route.
    """
    own = {name: [one for one in results if one.start.route == name] for name in ROUTES}
    gammas = [
        min((one.gamma for one in own[name] if one.allowed), default=np.inf) for name in ROUTES
    ]
    said = []
    for name, least in zip(ROUTES, gammas, strict=True):
        note = next((one.note for one in own[name] if one.note), "")
        said.append("" if np.isfinite(least) else note or remarks.get(name, ""))
    return Verdict(
        ROUTES, np.array([len(own[name]) for name in ROUTES], dtype=np.int64), np.array(gammas),
        tuple(said), gamma, lower_bound, full_order, confined,
    )  # fmt: skip


def _compare(gamma: float, other: float) -> str:
    share = 100.0 * (other / gamma - 1.0)
    return f"{abs(share):.3g} % {'less' if share < 0.0 else 'more'} than this"
