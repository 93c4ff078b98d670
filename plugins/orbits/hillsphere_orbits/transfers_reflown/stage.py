"""The stage ``transfers_reflown``: transfers flown again on higher-fidelity equations."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import FlightSet, OrbitSet, Trajectories
from hillsphere_orbits.fidelity_ladder.rung import describe_plant, name_rungs
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.transfers_reflown.plans import Plan, Stays, plans_of
from hillsphere_orbits.transfers_reflown.presentation import present_reflown
from hillsphere_orbits.transfers_reflown.products import TransfersReflown
from hillsphere_orbits.transfers_reflown.rungs import Reflier, Reflight
from hillsphere_orbits.transfers_reflown.specs import TransfersReflownSpec

__all__ = ["TransfersReflownStage"]

_PLACE = "place of the plan"


class TransfersReflownStage:
    """Transfers flown again on higher-fidelity equations.

    Parameters
    ----------
    spec : TransfersReflownSpec
        With its references bound.
    """

    def __init__(self, spec: TransfersReflownSpec) -> None:
        self.spec = spec
        self.plants: list[Plant] = [ref.get() for ref in spec.rungs]

    def run(
        self,
        ctx: Context,
        flights: tuple[FlightSet, ...],
        orbits: tuple[OrbitSet, ...] = (),
    ) -> TransfersReflown:
        """Fly plans again on every plant.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        flights : tuple of FlightSet
            Products with the plans.
        orbits : tuple of OrbitSet
            Families with the orbits where plans begin, stay and end.

        Returns
        -------
        TransfersReflown
            Plans that fail on a plant are classified.

        Raises
        ------
        InputError
            If a plan is unknown, or a plant has other states.
        StageError
            If flights or orbits do not solve the equations of the first rung.
        """
        spec = self.spec
        first, anomaly = self.plants[0], spec.start_true_anomaly_rad
        # compiled outside the interpreter's lock, while the plans are made
        with ThreadPoolExecutor() as threads:
            flows = [threads.submit(flow_of, plant) for plant in self.plants]
            flows[0].result()
            stays = Stays(first, members_of(*orbits) if orbits else None)
            plans = self._select_plans(
                [plans_of(first, one.flights, stays, spec.revolutions) for one in flights]
            )
            for flow in flows:
                flow.result()
        refliers = [Reflier(plant, first, anomaly) for plant in self.plants]
        names = name_rungs([ref.name for ref in spec.rungs], self.plants)
        advance = ctx.track("transfers reflown", len(plans) * len(refliers))
        reflights: list[list[Reflight]] = []
        for name, reflier in zip(names, refliers, strict=True):
            reflights.append([])
            for plan in plans:
                reflights[-1].append(reflier(plan))
                if not reflights[-1][-1].good:
                    ctx.info(f"{plan.name} on {name}: {reflights[-1][-1].status}")
                advance(1)
        return self._product(names, plans, reflights)

    def present(
        self,
        product: TransfersReflown,
        flights: tuple[FlightSet, ...] = (),
        orbits: tuple[OrbitSet, ...] = (),
    ) -> Presentation:
        """Show a row per plan and plant, the patch points, and the impulses side by side."""
        return present_reflown(product, self.spec.label)

    def _select_plans(self, products: list[list[Plan]]) -> list[Plan]:
        """Return the plans that are asked for."""
        every = [plan for plans in products for plan in plans]
        if self.spec.plans:
            known = [plan.name for plan in every]
            if unknown := [name for name in self.spec.plans if name not in known]:
                raise InputError(
                    f"plans: no plan is called {unknown[0]!r}; there are: {', '.join(known)}"
                )
            return [every[known.index(name)] for name in self.spec.plans]
        chosen: list[Plan] = []
        for plans in products:
            # a product may have plans between several pairs of orbits
            pairs: dict[tuple[str, ...], list[Plan]] = {}
            for plan in plans:
                pairs.setdefault(plan.ends, []).append(plan)
            for alike in pairs.values():
                alike.sort(key=lambda p: (bool(p.fault), float(np.sum(p.dv_m_s))))
                chosen += alike[: self.spec.cheapest]
        return chosen

    def _product(
        self, names: tuple[str, ...], plans: list[Plan], reflights: list[list[Reflight]]
    ) -> TransfersReflown:
        """Lay everything out in arrays."""

        def table(name: str) -> Array:
            rows = [[float(getattr(one, name)) for one in rung] for rung in reflights]
            return np.array(rows, dtype=float).reshape(len(reflights), len(plans)).T.copy()

        patches = [
            f"{a.name} → {b.name}"
            for plan in plans
            for a, b in zip(plan.pieces, plan.pieces[1:], strict=False)
        ]
        planned = [plan.dv_m_s for plan in plans]
        dv = [np.concatenate([np.empty(0), *[one.dv_m_s for one in rung]]) for rung in reflights]
        coasts = [(q, piece) for q, plan in enumerate(plans) for piece in plan.coasts]
        tracks = [one.track_m for rung in reflights for one in rung]
        most = max((track.shape[1] for given in tracks for track in given), default=0)
        paths = np.full((3, most, len(coasts), len(reflights)), np.nan)
        for r, rung in enumerate(reflights):
            c = 0
            for plan, one in zip(plans, rung, strict=True):
                for k, track in enumerate(one.track_m):
                    paths[:, : track.shape[1], c + k, r] = track
                c += len(plan.coasts)
        return TransfersReflown(
            flights=_flights(self.plants[-1], plans, reflights[-1]),
            rungs=names,
            rung_plants=tuple(describe_plant(plant) for plant in self.plants),
            plans=tuple(plan.name for plan in plans),
            tof_s=np.array([plan.tof_s for plan in plans]),
            stay_s=np.array([plan.stay_s for plan in plans]),
            plan_dv_m_s=np.array(
                [np.nan if p.fault else np.sum(dv) for p, dv in zip(plans, planned, strict=True)]
            ),
            dv_m_s=table("total_m_s"),
            displacement_m=table("displacement_m"),
            closure_m=table("closure_m"),
            closure_m_s=table("closure_m_s"),
            min_altitude_m=table("altitude_m"),
            gap=table("gap"),
            iterations=table("iterations").astype(np.int64),
            status=tuple(one.status for rung in reflights for one in rung),
            patch_plan=np.repeat(np.arange(len(plans)), [dv.size for dv in planned]),
            patches=tuple(patches),
            patch_held=tuple(orbit or _PLACE for plan in plans for orbit in plan.patch_orbits),
            patch_plan_dv_m_s=np.concatenate([np.empty(0), *planned]),
            patch_dv_m_s=np.stack(dv, axis=1),
            coast_plan=np.array([q for q, _ in coasts], dtype=np.int64),
            coast_m=paths,
            start_true_anomaly_rad=self.spec.start_true_anomaly_rad,
        )


def _flights(plant: Plant, plans: Sequence[Plan], reflights: Sequence[Reflight]) -> Trajectories:
    """Return the coasts of the plans that were found on a plant."""
    coasts = [
        (plan.name, piece, x)
        for plan, one in zip(plans, reflights, strict=True)
        if one.good
        for piece, x in zip(plan.coasts, one.coasts, strict=True)
    ]
    most = max((piece.t_s.size for _, piece, _ in coasts), default=0)
    t = np.full((most, len(coasts)), np.nan)
    states = np.full((len(plant.states), most, len(coasts)), np.nan)
    for c, (_, piece, x) in enumerate(coasts):
        t[: piece.t_s.size, c] = piece.t_s
        states[:, : piece.t_s.size, c] = x
    return Trajectories(
        frame=plant.frame,
        states=tuple(v.name for v in plant.states),
        plans=tuple(name for name, _, _ in coasts),
        labels=tuple(piece.name for _, piece, _ in coasts),
        t_s=t,
        x=states,
    )
