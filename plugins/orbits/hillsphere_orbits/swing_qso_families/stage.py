"""The stage ``swing_qso_families``: planar orbits of several revolutions about a moon."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.errors import ConvergenceError, InputError, PropagationError, StageError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import Bifurcations
from hillsphere.runs.workers import Workers
from hillsphere_orbits.flow import Compiled, Flow, flow_of
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.qso.specs import read_resonance
from hillsphere_orbits.stability import stability_indices
from hillsphere_orbits.survey import LockedMoon, Surveyor
from hillsphere_orbits.swing_qso_families.breaking import starts_of_breaking
from hillsphere_orbits.swing_qso_families.curves import at_positions
from hillsphere_orbits.swing_qso_families.description import (
    concatenate,
    errors,
    orbits_of,
    spectrum_of,
    stable,
    tracks_of,
)
from hillsphere_orbits.swing_qso_families.families import Limits, groups_of
from hillsphere_orbits.swing_qso_families.following import (
    FollowedGroup,
    Following,
    SurveyedFamily,
    surveyor_of,
)
from hillsphere_orbits.swing_qso_families.prescribed_members import orbits_asked
from hillsphere_orbits.swing_qso_families.presentation import present_swing
from hillsphere_orbits.swing_qso_families.products import SwingFamilies
from hillsphere_orbits.swing_qso_families.specs import SwingFamiliesSpec
from hillsphere_orbits.swing_qso_families.starts import Start, Symmetries, starts_at

__all__ = ["SwingFamiliesStage"]

_SAME_EQUATIONS = 1e-8
"""Largest closure, natural units, of bifurcating orbits that count as solutions of this plant's
equations. By default they are
computed to 1e-10 or better; other equations (another gravity model, say) give far more."""
_STATES = ("x", "y", "z", "vx", "vy", "vz")
_NEAR = 0.1  # natural units: where the families of a body without surface end by default


class SwingFamiliesStage:
    """Families of planar orbits of n revolutions from the planar bifurcations of others.

    Parameters
    ----------
    spec : SwingFamiliesSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant has other states than x, y, z, vx, vy, vz.
    """

    def __init__(self, spec: SwingFamiliesSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        names = tuple(v.name for v in self.plant.states)
        if names != _STATES:
            raise InputError(
                f"orbits of several revolutions need a plant with states {', '.join(_STATES)}; "
                f"{type(self.plant).__name__} has {', '.join(names)}"
            )

    def run(
        self, ctx: Context, bifurcations: Bifurcations, family: QsoFamily | None = None
    ) -> SwingFamilies:
        """Compute the families.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        bifurcations : Bifurcations
            Where they branch off.
        family : QsoFamily, optional
            Shown beside them only.

        Returns
        -------
        SwingFamilies
            Curves, members, secondary bifurcations.

        Raises
        ------
        InputError
            If a resonance is not among the bifurcations, no family has an orbit that is asked
            for, or the plant's equations do not keep the plane z = 0.
        StageError
            If the bifurcations belong to other equations.
        ConvergenceError
            If no family can be followed.
        """
        flow = flow_of(self.plant)
        symmetries = Symmetries.of(flow, _samples())
        if not symmetries.plane:
            raise InputError(
                "planar orbits of several revolutions need gravity with the mirror plane xy; this "
                "plant's has none (harmonics of odd degree minus order, a tilted body)"
            )
        chosen = self._select_bifurcations(bifurcations)
        there = set(symmetries.axes or ("asymmetric",))
        if not there & set(self.spec.symmetries):
            raise InputError(
                f"symmetries: this plant's gravity has families of {', '.join(sorted(there))} only "
                f"at its resonances, asked for {', '.join(self.spec.symmetries)}"
            )
        x, period = self._planar(flow, bifurcations, chosen)
        starts, notes = self._starts(ctx, flow, symmetries, bifurcations, chosen, x, period)
        asymmetric = "asymmetric" in self.spec.symmetries
        work = Following(
            Compiled(self.plant),
            self._limits(),
            self.spec.accuracy,
            self.spec.secondary or asymmetric,
        )
        with Workers(ctx, work) as workers:
            families, more = _follow_families(ctx, workers, starts, "followed")
            notes += more
            examined = 0
            while asymmetric and examined < len(families):
                children = self._children(ctx, flow, families, examined)
                examined = len(families)
                broken, more = _follow_families(ctx, workers, children, "without a mirror")
                families += broken
                notes += more
        if not families:
            raise ConvergenceError(
                "no family of several revolutions could be followed: " + "; ".join(notes)
                if notes
                else "no family of the symmetries asked for leaves these bifurcations"
            )
        for note in notes:
            ctx.info(note)
        return self._product(surveyor_of(self.plant, flow), families, notes)

    def present(
        self,
        product: SwingFamilies,
        bifurcations: Bifurcations,
        family: QsoFamily | None = None,
    ) -> Presentation:
        """Show members, ends, secondary bifurcations, orbits and the families in (C, x)."""
        return present_swing(product, family, self.spec.label)

    def _select_bifurcations(self, bifurcations: Bifurcations) -> list[int]:
        """Return the numbers of the bifurcations to start from, in the requested order."""
        pairs = list(zip(bifurcations.d, bifurcations.n, strict=True))
        planar = [
            i for i, plane in enumerate(bifurcations.plane)
            if plane == "planar" and pairs[i][1] >= 3
        ]  # fmt: skip
        wanted = [pair for text in self.spec.resonances if (pair := read_resonance(text))]
        there = ", ".join(dict.fromkeys(f"{pairs[i][0]}:{pairs[i][1]}" for i in planar)) or "none"
        if missing := [pair for pair in wanted if pair not in {pairs[i] for i in planar}]:
            names = ", ".join(f"{d}:{n}" for d, n in missing)
            raise InputError(
                f"resonances: no planar bifurcation {names} with n ≥ 3 was found (found: {there}); "
                "ask the bifurcations stage for it, or leave it out"
            )
        if not planar:
            raise InputError(
                "there is no planar bifurcation with n ≥ 3 to start from; ask the bifurcations "
                "stage for some with its key planar"
            )
        return [i for pair in wanted for i in planar if pairs[i] == pair] if wanted else planar

    def _planar(
        self, flow: Flow, bifurcations: Bifurcations, chosen: list[int]
    ) -> tuple[Array, Array]:
        """Return normalised states and periods of the orbits, tried on these equations."""
        system, orbits = flow.system, bifurcations.orbits
        x = orbits.x0[:, chosen] / system.unit[:, None]
        period = orbits.period_s[chosen] / system.time_unit_s
        end = flow.with_matrix(x, period, flow.steps_for(x, period))[0]
        error = float(np.max(np.abs(end - x)))
        if orbits.frame != system.frame or not error <= _SAME_EQUATIONS:
            raise StageError(
                f"the bifurcating orbits (frame {orbits.frame}) do not solve the equations of this "
                f"stage's plant (frame {system.frame}; closure {error:.1e}); give the plant with "
                "which they were computed"
            )
        return x, period

    def _starts(
        self,
        ctx: Context,
        flow: Flow,
        symmetries: Symmetries,
        bifurcations: Bifurcations,
        chosen: list[int],
        x: Array,
        period: Array,
    ) -> tuple[list[Start], list[str]]:
        starts: list[Start] = []
        notes: list[str] = []
        advance = ctx.track("orbits of several revolutions: first ones", len(chosen))
        for k, i in enumerate(chosen):
            at_resonance, lost = starts_at(
                flow, symmetries, x[:, k], float(period[k]), bifurcations.d[i], bifurcations.n[i]
            )
            starts += [start for start in at_resonance if self._has_listed_symmetry(start)]
            notes += lost
            advance(1)
        return starts, notes

    def _has_listed_symmetry(self, start: Start) -> bool:
        asked = self.spec.symmetries
        if start.symmetry == "none":
            return "asymmetric" in asked
        return any(axis in asked for axis in start.symmetry)

    def _limits(self) -> Limits:
        spec, unit = self.spec, self.plant.scales.length_m
        nearest = 0.0 if spec.x_min_m is None else spec.x_min_m / unit
        if spec.x_min_m is None and "impact" not in flow_of(self.plant).system.events:
            series = self.plant.series_radius_m if isinstance(self.plant, LockedMoon) else None
            nearest = max(_NEAR, (series or 0.0) / unit)
        farthest = None if spec.x_max_m is None else spec.x_max_m / unit
        return Limits(nearest, farthest, spec.curve_length)

    def _children(
        self, ctx: Context, flow: Flow, families: Sequence[SurveyedFamily], first: int
    ) -> list[Start]:
        """Return first members of families that begin where a mirror of a newer one breaks."""
        starts: list[Start] = []
        for number, family in list(enumerate(families))[first:]:
            if family.chain.start.symmetry == "none":
                continue
            for kind, plane, u in zip(
                family.events.kind, family.events.plane, family.events.position, strict=True
            ):
                if (kind, plane) == ("branching", "planar"):
                    name, why = family.chain.start.name, "nothing was found that leaves there"
                    try:
                        leaving = starts_of_breaking(flow, family.chain, number, float(u))
                    except (ConvergenceError, PropagationError) as error:
                        leaving, why = [], str(error)
                    starts += leaving
                    if not leaving:
                        ctx.info(f"branching of {name} at position {u:.4f} of its chain: {why}")
        return starts

    def _product(
        self, surveyor: Surveyor, families: Sequence[SurveyedFamily], notes: list[str]
    ) -> SwingFamilies:
        unit, flow = self.plant.scales.length_m, flow_of(self.plant)
        asked = orbits_asked(
            flow,
            [family.chain for family in families],
            self.spec.jacobi_constants,
            self.spec.periods_s,
            self.plant.scales.time_s,
        )
        number, labels, z, position = asked.family, asked.labels, asked.z, asked.position
        notes = [*notes, *asked.lost]
        all_problems = [family.chain.problem(flow) for family in families]
        problems = [all_problems[f] for f in number]
        members = orbits_of(surveyor, problems, z, labels)
        sizes = [family.chain.branch.size for family in families]
        curve = orbits_of(
            surveyor,
            all_problems,
            [family.chain.branch.z for family in families],
            [""] * sum(sizes),
            closure=[family.closure for family in families],
            monodromy=[family.monodromy for family in families],
        )
        origin = orbits_of(
            surveyor,
            all_problems,
            [family.chain.start.origin[:, None] for family in families],
            [family.chain.start.name for family in families],
        )
        event_z = [
            at_positions(
                family.chain.regular_problem(flow), family.chain.branch, family.events.position
            )
            for family in families
        ]
        count = [len(family.events.kind) for family in families]
        events = orbits_of(surveyor, all_problems, event_z, [""] * sum(count))
        middle = [f.chain.branch.z[:, [f.chain.branch.size // 2]] for f in families]
        half = [errors(surveyor, p, each)[0] for p, each in zip(problems, z, strict=True)]
        starts = [family.chain.start for family in families]
        moon = self.plant if isinstance(self.plant, LockedMoon) else None
        return SwingFamilies(
            d=tuple(start.d for start in starts),
            n=tuple(start.n for start in starts),
            axis=tuple(start.axis for start in starts),
            direction=tuple(start.direction for start in starts),
            symmetry=tuple(start.symmetry for start in starts),
            parent=tuple(start.parent for start in starts),
            origin=origin,
            ends=tuple(family.end for family in families),
            members=members,
            curve=curve,
            member_family=np.array(number, dtype=np.int64),
            curve_family=np.repeat(np.arange(len(families)), sizes).astype(np.int64),
            member_position=np.array(position, dtype=float),
            member_indices=np.array(stability_indices(members.monodromy)),
            curve_indices=np.array(stability_indices(curve.monodromy)),
            member_multipliers=spectrum_of(members.monodromy),
            member_stable=stable(members.monodromy),
            curve_stable=stable(curve.monodromy),
            member_half_residual=concatenate(half),
            curve_half_residual=concatenate([family.half for family in families]),
            curve_least_m=concatenate([family.nearest for family in families]) * unit,
            curve_largest_m=concatenate([family.farthest for family in families]) * unit,
            event_family=np.repeat(np.arange(len(families)), count).astype(np.int64),
            event_kind=tuple(kind for family in families for kind in family.events.kind),
            event_plane=tuple(plane for family in families for plane in family.events.plane),
            event_orbits=events,
            tracks_m=tracks_of(problems, z) * unit,
            family_tracks_m=tracks_of(all_problems, middle) * unit,
            family_jacobi=concatenate(
                [
                    surveyor.integral(p.state(each))
                    for p, each in zip(all_problems, middle, strict=True)
                ]
            ),
            method="half a period between perpendicular crossings of an axis (a full period where "
            "there is no mirror)",
            check=surveyor.check,
            notes=tuple(notes),
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
        )


def _follow_families(
    ctx: Context,
    workers: Workers[Sequence[Start], FollowedGroup],
    starts: Sequence[Start],
    what: str,
) -> tuple[list[SurveyedFamily], list[str]]:
    """Follow families; return them in the order of their starts, and remarks about them."""
    if not starts:
        return [], []
    advance = ctx.track(f"orbits of several revolutions: {what}", len(starts))
    groups = groups_of(starts)
    # the longest tasks go first, so that no worker ends up alone with one
    order = sorted(range(len(groups)), key=lambda g: -sum(starts[k].n for k in groups[g]))
    done: dict[int, FollowedGroup] = {}
    for g, one in zip(
        order, workers.map([[starts[k] for k in groups[g]] for g in order]), strict=True
    ):
        done[g] = one
        advance(len(groups[g]))
    families: dict[int, SurveyedFamily] = {}
    remarks: dict[int, str] = {}
    for g, group in enumerate(groups):
        families |= {group[place]: family for place, family in done[g].families.items()}
        remarks |= {group[place]: remark for place, remark in done[g].remarks.items()}
    notes = [fault for g in range(len(groups)) for fault in done[g].faults]
    notes += [remarks[k] for k in sorted(remarks)]
    return [families[k] for k in sorted(families)], notes


def _samples() -> Array:
    """States around the body at which symmetries are tried, shape (6, 48), normalised."""
    rng = np.random.default_rng(20)
    direction = rng.normal(size=(3, 48))
    place = np.geomspace(0.7, 4.0, 48) * direction / np.linalg.norm(direction, axis=0)
    return np.concatenate([place, rng.normal(size=(3, 48))])
