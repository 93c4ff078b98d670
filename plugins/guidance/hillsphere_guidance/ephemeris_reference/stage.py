"""The stage ``ephemeris_reference``: trajectories of an ephemeris file in the frame of a plant."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from hillsphere.errors import InputError
from hillsphere.formats.ephemeris_files import common_axes, object_segments, segments_of_object
from hillsphere.formats.oem_interpolation import OemInterpolant, interpolant_of
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.model.frame_motion import craft_rows, epoch_of, frame_motion
from hillsphere.presentation import Presentation
from hillsphere.products import Trajectories
from hillsphere.show.tables import column, tabulate, text_column
from hillsphere.time import J2000, Epoch
from hillsphere_guidance.ephemeris_reference.products import EphemerisReference
from hillsphere_guidance.ephemeris_reference.specs import EphemerisReferenceSpec

__all__ = ["EphemerisReferenceStage"]

_MOST_STATES = 1_000_000
"""Most states of a trajectory: 60 MB, more than any closed loop has samples."""


class EphemerisReferenceStage:
    """Trajectories of an ephemeris file as references.

    Parameters
    ----------
    spec : EphemerisReferenceSpec
        With its references bound; the file is read by `run`.

    Raises
    ------
    InputError
        If the plant has several spacecraft or does not know its frame among the stars.
    """

    def __init__(self, spec: EphemerisReferenceSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        self.states = tuple(v.name for v in self.plant.states)
        rows = craft_rows(self.states)
        if len(rows) != 1:
            raise InputError(
                f"plant: expected one spacecraft, whose ephemeris the file is, got {len(rows)}"
            )
        (self._rows,) = rows
        values = self._others(np.zeros(1))
        frame_motion(self.plant, J2000, np.zeros(1), values)  # refuses a plant without a pole
        if spec.epoch is not None:
            epoch_of(self.plant, spec.epoch)

    @cached_property
    def interpolants(self) -> list[OemInterpolant]:
        """The segments of the object; the file is read when they are first needed."""
        spec = self.spec
        if spec.file is None:
            segments = object_segments(spec.text, "text", spec.object, lenient=spec.lenient)
        else:
            motion = frame_motion(self.plant, J2000, np.zeros(1), self._others(np.zeros(1)))
            segments = segments_of_object(
                Path(spec.file), spec.object, lenient=spec.lenient, centres=list(motion.centres),
                kernels=spec.kernels,
            )  # fmt: skip
        return [interpolant_of(one) for one in segments]

    @cached_property
    def epoch(self) -> Epoch:
        """Time 0 of the trajectories."""
        if self.spec.epoch is None and getattr(self.plant, "epoch", None) is None:
            first = self.interpolants[0]
            return first.segment.epoch.after(first.span_s[0]).to("TDB")
        return epoch_of(self.plant, self.spec.epoch)

    def run(self, ctx: Context) -> EphemerisReference:
        """Convert the states.

        Parameters
        ----------
        ctx : Context
            Log.

        Returns
        -------
        EphemerisReference
            A coast for each segment.

        Raises
        ------
        InputError
            If the file cannot be read, departs from the standard, or is about a body or in a frame
            that the plant does not know; if the interval asks for too many states.
        """
        times, states, deviation = [], [], 0.0
        for one in self.interpolants:
            t = self._times(one)
            x = self._convert(one, t)
            middle = 0.5 * (t[1:] + t[:-1])
            rows = self._rows
            cubic = CubicHermiteSpline(t, x[rows[:3]], x[rows[3:]], axis=1)(middle)
            # the frame turns from the first of the times given
            between = self._convert(one, np.append(t[0], middle))[rows[:3], 1:]
            deviation = max(deviation, float(np.linalg.norm(cubic - between, axis=0).max()))
            times.append(self._since(one, t))
            states.append(x)
        most = max(t.size for t in times)
        t_s = np.full((most, len(times)), np.nan)
        x_s = np.full((len(self.states), most, len(times)), np.nan)
        for k, (t, x) in enumerate(zip(times, states, strict=True)):
            t_s[: t.size, k], x_s[:, : t.size, k] = t, x
        name = self.interpolants[0].segment.object_name
        several = len(times) > 1
        labels = [f"segment {k + 1}" if several else name for k in range(len(times))]
        flights = Trajectories(
            self.plant.frame, self.states, (name,) * len(times), tuple(labels), t_s, x_s
        )
        return EphemerisReference(
            flights=flights,
            interpolation=" and ".join(dict.fromkeys(map(str, self.interpolants))),
            epoch=self.epoch.isot(np.zeros(1), 9)[0],
            deviation_m=deviation,
            warnings=tuple(
                dict.fromkeys(told for one in self.interpolants for told in one.segment.warnings)
            ),
        )

    def present(self, product: EphemerisReference) -> Presentation:
        """List the trajectories."""
        flights = product.flights
        columns = [
            text_column("trajectory", flights.labels, "trajectory"),
            column("begins_s", np.nanmin(flights.t_s, axis=0), "begins", 9, unit="s"),
            column("ends_s", np.nanmax(flights.t_s, axis=0), "ends", 9, unit="s"),
            column("states", np.sum(np.isfinite(flights.t_s), axis=0), "states"),
        ]
        notes = (
            f"Times count from {product.epoch} TDB. {product.interpolation}.",
            "Between two states a closed loop follows a cubic polynomial through positions and "
            f"velocities, which differs from the interpolation of the file by "
            f"{product.deviation_m:.3g} m at most in the middles; interval_s makes it smaller.",
        )
        return Presentation(
            tables={"ephemeris_reference": tabulate("Trajectories of the file", columns, notes)},
            verdict=product.warnings,
        )

    def _times(self, one: OemInterpolant) -> Array:
        """Return the times of the reference's states, s after the segment's epoch."""
        first, last = one.span_s
        if self.spec.interval_s is None:
            inside = one.segment.t_s[(one.segment.t_s > first) & (one.segment.t_s < last)]
            return np.concatenate([[first], inside, [last]])
        count = int(np.ceil((last - first) / self.spec.interval_s - 1e-9))
        if count >= _MOST_STATES:
            raise InputError(
                f"interval_s: expected one that gives at most {_MOST_STATES} states, got {count}"
            )
        return np.linspace(first, last, count + 1)

    def _since(self, one: OemInterpolant, t: Array) -> Array:
        """Return times after the epoch of the reference, s of TDB.

        The ends are converted, and times between them linearly: a second of another scale differs
        by parts in 1e10.
        """
        first, last = (one.segment.epoch.after(s).to("TDB") for s in t[[0, -1]])
        begin, end = first.seconds_since(self.epoch), last.seconds_since(self.epoch)
        return np.asarray(np.interp(t, t[[0, -1]], [begin, end]))

    def _convert(self, one: OemInterpolant, t: Array) -> Array:
        """Return states (n, K) of the plant at times (K,) after the segment's epoch."""
        where = "text" if self.spec.file is None else Path(self.spec.file).name
        since = self._since(one, t)
        begin, _ = one.span_s
        start = self._since(one, np.array([begin]))[0]
        values = self._others(np.append(start, since))
        motion = frame_motion(self.plant, self.epoch, np.append(start, since), values)
        segment = one.segment
        x = common_axes(
            segment.ref_frame, one(t), motion.axes_name, where, segment.epoch, np.atleast_1d(t)
        )
        if one.segment.center_name.lower() not in [name.lower() for name in motion.centres]:
            raise InputError(
                f"{where}: CENTER_NAME: expected {' or '.join(map(str.upper, motion.centres))}, "
                f"which the plant knows, got {one.segment.center_name}"
            )
        states = np.empty((len(self.states), t.size))
        for name, value in values.items():
            states[self.states.index(name)] = value[1:]
        whole = motion.from_inertial(np.concatenate([x[:, :1], x], axis=1), one.segment.center_name)
        states[self._rows] = whole[:, 1:]
        return states

    def _others(self, since: Array) -> dict[str, Array]:
        """Return the states that are neither position nor velocity at times (K,), by name."""
        missing = [
            name for k, name in enumerate(self.states)
            if k not in self._rows and name not in self.spec.others
        ]  # fmt: skip
        if missing:
            raise InputError(
                f"others.{missing[0]}: expected its value at the first state, SI, got none"
            )
        over: dict[str, Array] = dict(
            self.plant.others_over_time(self.spec.others, since)  # type: ignore[attr-defined]
        )
        return over
