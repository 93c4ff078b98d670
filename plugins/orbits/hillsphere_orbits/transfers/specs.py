"""Specs of the stages on transfers through swing orbits: the keys of a mission."""

from __future__ import annotations

from itertools import pairwise
from typing import Self

from pydantic import model_validator

from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    need,
    option,
    reference,
    rule,
)
from hillsphere_orbits.options import label

__all__ = ["SwingTransfersNeeds", "SwingTransfersSpec"]


class SwingTransfersNeeds(Spec):
    """Products of earlier stages that ``swing_transfers`` uses."""

    examples = ({"family": "family", "swing": "swing"},)

    family: Ref = need(
        "hillsphere_orbits.qso.products:QsoFamily", "the orbits where transfers begin and end"
    )
    swing: Ref = need(
        "hillsphere_orbits.swing_qso_families.products:SwingFamilies",
        "the families whose orbits carry the transfers",
    )


class SwingTransfersSpec(StageSpec):
    """Transfers in the plane through orbits of several revolutions that meet both ends.

    Every two orbits that follow one another in a route make a leg. For each leg and family the
    member of least cost is found exactly, and over all families the front of cost and time.
    """

    results = ResultNames(
        metrics=(
            "swing_transfers",
            "transfer_closure_max",
            "transfer_closure_speed_max",
            "min_above_energy_bound",
            "min_transfer_altitude",
        ),
        tables={
            "table_5": (),
            "swing_least": (),
            "swing_front": (),
            "swing_routes": (),
            "swing_ranks": (),
        },
    )
    produces = "hillsphere_orbits.swing_transfers.products:SwingTransfers"
    provides = ("hillsphere.products:FlightSet",)
    examples = (
        {
            "plant": "hill",
            "needs": {"family": "family", "swing": "swing"},
            "routes": [["x = 100 km", "x = 50 km"]],
        },
    )

    needs: SwingTransfersNeeds = option("products of earlier stages")
    plant: Ref = reference("plant", "equations of motion of the orbits")
    routes: tuple[tuple[str, ...], ...] = option(
        "sequences of orbits, by their names in the family's table, from departure to arrival"
    )
    dearest: float = option(
        "up to how many times the least cost of a leg its front of cost and time goes",
        default=2.0,
        ge=1,
    )
    reference: DataPath | None = data_path(
        "cited CSV of published costs, with the columns leg ('A to B') and dv_m_s", default=None
    )
    label: str = label()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        fault = ""
        if not self.routes:
            fault = "no route is asked for; give at least one, e.g. [['QSO-H', 'QSO-La']]"
        for route in self.routes:
            if len(route) < 2:
                fault = f"a route needs two orbits at least, got {list(route)}"
            elif any(a == b for a, b in pairwise(route)):
                fault = f"a leg must lead to another orbit, got {list(route)}"
        if len(set(self.routes)) < len(self.routes):
            fault = "a route is listed twice"
        if fault:
            raise rule("routes", fault)
        return self
