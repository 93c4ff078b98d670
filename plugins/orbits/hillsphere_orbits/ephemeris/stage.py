"""The stage ``ephemeris``: orbits and flights in inertial axes, as files for other programs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import ceil
from typing import Annotated

import numpy as np

from hillsphere.dynamics import Taylor
from hillsphere.errors import InputError, StageError
from hillsphere.formats.oem import OemSegment, states_csv, write_oem
from hillsphere.formats.opm import write_opm
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.model.frame_motion import epoch_of, frame_motion
from hillsphere.model.inertial import AboutMoon
from hillsphere.model.spice_calls import spice_environment
from hillsphere.presentation import Presentation
from hillsphere.products import Flown, OrbitSet, PeriodicOrbits
from hillsphere.products.fields import Shape
from hillsphere.products.flight_files import Coast, Craft, in_inertial_axes, opm_of
from hillsphere.show.tables import column, tabulate, text_column
from hillsphere_orbits.ephemeris.kernels import kernels_of
from hillsphere_orbits.ephemeris.specs import EphemerisSpec
from hillsphere_orbits.ephemeris.spk_files import body_code
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.qso.presentation import label_identifier
from hillsphere_orbits.sources import members_of

__all__ = ["Ephemerides", "EphemerisStage"]

_MOST_STATES = 2_000_000
"""Most states of one orbit, about 0.3 GB of text: a step that is too small by mistake is refused
before the disk is full."""


@dataclass(frozen=True)
class Ephemerides:
    """States in inertial axes, a coast per column."""

    frame: str
    """Inertial frame."""
    centre: str
    """Its origin."""
    epoch: str
    """Instant from which times count."""
    time_scale: str
    """Of the epoch."""
    plans: Annotated[tuple[str, ...], Shape("coasts")]
    """Flight that each coast belongs to."""
    labels: Annotated[tuple[str, ...], Shape("coasts")]
    """The coast's own name."""
    t_s: Annotated[Array, Shape("samples", "coasts")]
    """Times after the epoch; NaN beyond a coast's end."""
    x: Annotated[Array, Shape(6, "samples", "coasts")]
    """Positions, m, and velocities, m/s."""


class EphemerisStage:
    """Orbits and flights in inertial axes.

    Parameters
    ----------
    spec : EphemerisSpec
        With its references bound.

    Raises
    ------
    InputError
        If the epoch is no date, or the plant's body has no orientation.
    """

    def __init__(self, spec: EphemerisSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        self.epoch = epoch_of(self.plant, spec.epoch, spec.time_scale)
        self.axes, centres = self._frame()
        if spec.centre == "primary" and len(centres) < 2:
            raise InputError(
                f"centre: expected 'moon', the plant is about {centres[0]!r} alone, got 'primary'"
            )
        self.centre = centres[spec.centre == "primary"]
        if spec.format == "spk":
            spice_environment("format: 'spk'")
            if self.axes == "TEME":
                raise InputError(
                    "format: SPICE has no axes TEME, in which the plant is written; expected a "
                    "plant of frame = 'gcrs'"
                )

    def _frame(self) -> tuple[str, list[str]]:
        """Return the inertial axes and the bodies; refuse a plant that lacks what they need."""
        motion = frame_motion(self.plant, self.epoch, np.zeros(1), _still(self.plant))
        return motion.axes_name, list(motion.centres)

    def run(
        self,
        ctx: Context,
        orbits: tuple[OrbitSet, ...] = (),
        flights: tuple[Flown, ...] = (),
        closed_loops: tuple[Flown, ...] = (),
    ) -> Ephemerides:
        """Propagate the orbits and turn every state.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        orbits : tuple of OrbitSet
            Their members are flown from their start.
        flights, closed_loops : tuple of Flown
            Taken as they are.

        Returns
        -------
        Ephemerides
            In inertial axes.

        Raises
        ------
        InputError
            If the interval asks for more states than can be written, or a kernel is wanted and the
            centre has no NAIF number.
        StageError
            If an orbit or flight is given in another frame than the plant's.
        """
        if self.spec.format == "spk":
            body_code(self.centre, self.spec.body_id)
        crafts: list[Craft] = []
        given_names: set[str] = set()
        if orbits:
            members = members_of(*orbits)
            self._same_frame(members.frame)
            advance = ctx.track("ephemerides", len(members.labels))
            for i, label in enumerate(members.labels):
                coast = Coast(label, *self._propagate_member(members, i))
                crafts += self._turn([coast], members.states, _different(label, given_names))
                advance(1)
        for product in (*flights, *closed_loops):
            given = product.to_trajectories()
            self._same_frame(given.frame)
            for plan in dict.fromkeys(given.plans):
                coasts = []
                for i in [i for i, other in enumerate(given.plans) if other == plan]:
                    there = np.isfinite(given.t_s[:, i])
                    t, x = given.t_s[there, i], given.x[:, there, i]
                    if t.size:
                        coasts.append(Coast(given.labels[i], t, x))
                if not coasts:
                    raise StageError(f"flight {plan!r} has no state to write")
                crafts += self._turn(coasts, given.states, _different(plan, given_names))
        times = [coast.t_s for craft in crafts for coast in craft.coasts]
        most = max(t.size for t in times)
        t_s, x_s = np.full((most, len(times)), np.nan), np.full((6, most, len(times)), np.nan)
        for i, coast in enumerate(coast for craft in crafts for coast in craft.coasts):
            t_s[: coast.t_s.size, i], x_s[:, : coast.t_s.size, i] = coast.t_s, coast.x
        return Ephemerides(
            frame=self.axes,
            centre=self.centre,
            epoch=self.epoch.isot(np.zeros(1), 9)[0],
            time_scale=self.epoch.scale,
            plans=tuple(craft.name for craft in crafts for _ in craft.coasts),
            labels=tuple(coast.label for craft in crafts for coast in craft.coasts),
            t_s=t_s,
            x=x_s,
        )

    def _turn(self, coasts: list[Coast], states: tuple[str, ...], plan: str) -> list[Craft]:
        return in_inertial_axes(
            coasts, frame=self.plant.frame, states=states, name=plan, epoch=self.epoch,
            plant=self.plant, centre=self.centre,
        )  # fmt: skip

    def present(
        self,
        product: Ephemerides,
        orbits: tuple[OrbitSet, ...] = (),
        flights: tuple[Flown, ...] = (),
        closed_loops: tuple[Flown, ...] = (),
    ) -> Presentation:
        """List the files: one message and one CSV, or one kernel, for each orbit or flight."""
        plans = list(dict.fromkeys(product.plans))
        flown = [
            [self._segment(product, plan, i) for i, of in enumerate(product.plans) if of == plan]
            for plan in plans
        ]
        names = _file_names(plans)
        about = f"Frame {product.frame}, centre {product.centre}, times {product.time_scale}. " + (
            "The axes turn with the mean motion of the model from the body's orientation at "
            "the epoch; periodic and secular terms of that orientation (all but the constant "
            "rate of W), and the eccentricity of its orbit, are not in them."
            if isinstance(self.plant, AboutMoon)
            else "The plant's frame is turned as its own equations say."
        )
        begins = [coasts[0].epoch.isot(coasts[0].t_s[:1], 3)[0] for coasts in flown]
        ends = [coasts[-1].epoch.isot(coasts[-1].t_s[-1:], 3)[0] for coasts in flown]
        suffix = "bsp" if self.spec.format == "spk" else "oem"
        columns = [
            text_column("file", [f"{name}.{suffix}" for name in names], "file"),
            text_column("begins", begins, "begins"),
            text_column("ends", ends, "ends"),
            column("states", [sum(c.t_s.size for c in coasts) for coasts in flown], "states"),
            column("segments", [len(coasts) for coasts in flown], "segments"),
        ]
        notes: list[str] = [about]
        verdict: tuple[str, ...] = ()
        files: dict[str, str | bytes] = {}
        if self.spec.format == "spk":
            kernels = kernels_of(self.spec, self.plant, product.centre, flown, names, about)
            files |= kernels.files
            verdict = kernels.verdict
            columns += kernels.columns
            notes += kernels.notes
            title = "Ephemerides (SPK of SPICE)"
        else:
            for plan, name, segments in zip(plans, names, flown, strict=True):
                files[f"{name}.oem"] = write_oem(segments)
                files[f"{name}.csv"] = states_csv(segments)
                flight = Craft(
                    plan, product.centre, product.frame,
                    [Coast(one.comment, one.t_s, one.x) for one in segments],
                )  # fmt: skip
                if (opm := opm_of(flight, self.epoch, self.spec.object_id)) is not None:
                    files[f"{name}.opm"] = write_opm(opm)
            title = "Ephemerides (CCSDS OEM and CSV)"
        return Presentation(
            tables={
                label_identifier("ephemerides", self.spec.label): tabulate(title, columns, notes)
            },
            verdict=verdict,
            files=files,
        )

    def _propagate_member(self, members: PeriodicOrbits, i: int) -> tuple[Array, Array]:
        """Return times (K,) and states (6, K), SI, along one member from its start."""
        duration = self.spec.duration_s or float(members.period_s[i])
        count = ceil(duration / self.spec.step_s - 1e-9)
        if count > _MOST_STATES:
            raise InputError(
                f"step_s: {count} states of orbit {members.labels[i]!r}; at most {_MOST_STATES}"
            )
        t = np.append(np.arange(count) * self.spec.step_s, duration)
        system = flow_of(self.plant).system
        x0 = members.x0[:, i : i + 1] / system.unit[:, None]
        if system.external is None:
            x = Taylor(system).sample(x0, t / system.time_unit_s)[:, :, 0]
        else:
            # steps choose their length by their error: one from each time to the next
            fly = flow_of(self.plant).adaptive
            ahead = x0[:, None]
            if count > 1:
                ahead = fly.trajectory(x0, t[-2] / system.time_unit_s, count - 1)
            last = fly.step(ahead[:, -1], (t[-1] - t[-2]) / system.time_unit_s)
            x = np.concatenate([ahead[:, :, 0], last], axis=1)
        return t, x * system.unit[:, None]

    def _same_frame(self, frame: str) -> None:
        if frame != self.plant.frame:
            raise StageError(
                f"the orbits are given in {frame}, the plant is written in {self.plant.frame}"
            )

    def _segment(self, product: Ephemerides, plan: str, i: int) -> OemSegment:
        there = np.isfinite(product.t_s[:, i])
        return OemSegment(
            object_name=plan.upper().replace("=", " "),
            object_id=self.spec.object_id,
            center_name=product.centre.upper(),
            ref_frame=product.frame,
            epoch=self.epoch,
            t_s=product.t_s[there, i],
            x=product.x[:, there, i],
            comment=product.labels[i],
        )


def _still(plant: Plant) -> dict[str, Array]:
    """Return states that are neither position nor velocity, at zero."""
    return {v.name: np.zeros(1) for v in plant.states if v.unit == "rad"}


def _different(name: str, given: set[str]) -> str:
    """Return a name that was not given yet, numbered if need be, and note it."""
    number, different = 1, name
    while different in given:
        number += 1
        different = f"{name} #{number}"
    given.add(different)
    return different


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60] or "orbit"


def _file_names(plans: list[str]) -> list[str]:
    """Return names of files without suffix, numbered where two would be the same."""
    names: list[str] = []
    for plan in plans:
        name = free = _slug(plan)
        number = 1
        while free in names:
            number += 1
            free = f"{name}-{number}"
        names.append(free)
    return names
