"""Spec of the stage ``manifold_transfers``: the keys of a mission."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from hillsphere.base.constants import DAY_S
from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    need,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere_orbits.options import label

__all__ = ["ManifoldTransferNeeds", "ManifoldTransfersSpec"]


class ManifoldTransferNeeds(Spec):
    """Products of earlier stages that ``manifold_transfers`` uses."""

    planar: Ref = need(
        "hillsphere_orbits.qso.products:QsoFamily", "has the orbits of departure and arrival"
    )
    orbits: tuple[Ref, ...] = need(
        "hillsphere.products:OrbitSet", "families to search for transfers", min_length=1
    )


class ManifoldTransfersSpec(StageSpec):
    """Transfers between two planar orbits through an unstable one, along its manifolds.

    A leg begins or ends at the last moment at which its trajectory is `distance` away from the
    unstable orbit (Euclidean norm of the difference of normalised states, both at the same time),
    and takes `leg_limit` at most. How long the unstable orbit is flown in between is free and not
    counted.
    """

    results = ResultNames(
        metrics=(
            "connected_orbits",
            "legs",
            "leg_impacts",
            "trajectories",
            "legs_too_sensitive",
            "min_energy_margin_m_s",
            "closure_max_km",
            "closure_max_m_s",
            "least_dv_m_s",
            "least_tof_d",
            "convergence_moved_m_s",
        ),
        tables={
            "table_4": (),
            "legs": (),
            "ladder_*": (),
            "transfer_convergence": (),
        },
    )
    produces = "hillsphere_orbits.manifold_transfers.products:ManifoldTransfers"
    provides = ("hillsphere.products:FlightSet",)
    examples = (
        {
            "plant": "hill",
            "needs": {"planar": "family", "orbits": ["families"]},
            "departure": "x = 100 km",
            "arrival": "x = 50 km",
            "leg_limit_d": 0.5,
            "samples": 8,
        },
        {
            "plant": "hill",
            "needs": {"planar": "family", "orbits": ["families"]},
            "departure": "QSO-H",
            "arrival": "QSO-La",
            "members": ["1:17, 70 km"],
            "check": ["1:17, 70 km"],
        },
    )

    needs: ManifoldTransferNeeds = option("products of earlier stages")
    plant: Ref = reference("plant", "equations of motion of the orbits")
    departure: str = option("name of the planar orbit that is left", min_length=1)
    arrival: str = option("name of the planar orbit that is reached", min_length=1)
    members: tuple[str, ...] = option(
        "names of the orbits to go through; left out: all", default=()
    )
    leg_limit_s: float = quantity(
        "time", "longest time of flight of each leg", default=5 * DAY_S, gt=0
    )
    distance: float = option(
        "distance from the unstable orbit where times of flight begin and end; normalised",
        default=1e-3,
        ge=1e-6,
        le=0.1,
    )
    start_distance: float = option(
        "largest distance from the orbit at which trajectories start, normalised",
        default=1e-4,
        ge=1e-9,
        le=1e-3,
    )
    samples: int = option(
        "trajectories of the first mesh, per side of a manifold; it is refined where needed",
        default=64,
        ge=4,
        le=100_000,
    )
    least_gain_m_s: float = quantity(
        "speed",
        "an entry of a ladder betters all quicker ones by this at least",
        default=0.01,
        gt=0,
    )
    closure_limit_m: float = quantity(
        "length",
        "a leg that misses its end by more when it is flown anew is too sensitive to be flown at "
        "all: it is listed, but makes no transfer",
        default=1000.0,
        gt=0,
    )
    check: tuple[str, ...] = option(
        "names of orbits for which the search is repeated with twice the samples, to show that it "
        "has converged",
        default=(),
    )
    reference: DataPath | None = data_path(
        "cited CSV of published transfers with the columns n, Az_km, total_m_s, v_cm_m_s, dv_m_s "
        "and tof_d, shown beside ours; an empty total stands for a blank cell",
        default=None,
    )
    label: str = label()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for key in ("members", "check"):
            values = getattr(self, key)
            if len(set(values)) < len(values):
                raise rule(key, "a name is listed twice")
        if self.members and (extra := sorted(set(self.check) - set(self.members))):
            raise rule("check", f"not among members: {', '.join(extra)}")
        if self.departure == self.arrival:
            raise rule("arrival", "must be another orbit than that of departure")
        if self.start_distance >= self.distance:
            text = "must be smaller than distance, at which times of flight begin"
            raise rule("start_distance", text)
        return self
