"""The stage ``pointing``: antenna mounts that follow passes, with a plan and without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np

from hillsphere.base.problems import did_you_mean
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Integers
from hillsphere.presentation import Presentation
from hillsphere.time import Epoch
from hillsphere_tracking.passes.products import PassList
from hillsphere_tracking.pointing.following import Course, follow_courses, naive_course
from hillsphere_tracking.pointing.interpolation import smooth, smooth_error_bound
from hillsphere_tracking.pointing.mounts import Mount, mount_of
from hillsphere_tracking.pointing.pass_plan import PassPlan, plan_pass
from hillsphere_tracking.pointing.presentation import present_pointing
from hillsphere_tracking.pointing.products import Pointing
from hillsphere_tracking.pointing.sight import LineOfSight
from hillsphere_tracking.pointing.sky import angles_of, separation
from hillsphere_tracking.pointing.specs import PointingSpec
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["PointingStage"]

_FEWEST_COMMANDS = 8
"""Commands of the shortest pass that is followed: `plan_pass` needs eight times."""
_BYTES = 200.0
"""Bytes of memory per command, pass and mount, about: angles, errors, marks and copies."""
_MOST_BYTES = 2e9
"""Bytes that a product and its making may take, so that a machine with 4 GB of memory still runs
it."""
_LISTED = 12
"""Passes that a message names at most; with more it cannot be read at a glance."""


@dataclass(frozen=True, eq=False)
class _PredictedPass:
    """A pass: true directions of the satellite, and interpolated predictions for the antenna."""

    sight: LineOfSight
    times_s: Array
    direction: Array
    azimuth_rad: Array
    elevation_rad: Array
    bound_rad: float

    @property
    def predicted_direction(self) -> Array:
        return direction_cosines(self.azimuth_rad, self.elevation_rad)


class PointingStage:
    """Stage in which mounts follow passes.

    Parameters
    ----------
    spec : PointingSpec
        Mounts, and the passes to be followed.
    """

    def __init__(self, spec: PointingSpec) -> None:
        self.spec = spec
        self.mounts: tuple[Mount, ...] = tuple(mount_of(mount) for mount in spec.mounts)

    def check_needs(self, passes: object) -> None:
        """Refuse stations that do not occur in the stage of the passes."""
        if sites := getattr(passes, "sites", None):  # as `PassesStage` has them
            self._check_stations([site.station.name for site in sites])

    def run(self, ctx: Context, passes: PassList) -> Pointing:
        """Plan each pass for each mount, and follow it with the plan and without.

        Parameters
        ----------
        ctx : Context
            Reports the progress.
        passes : PassList
            Passes with topocentric coordinates.

        Returns
        -------
        Pointing
            Commands and errors.

        Raises
        ------
        InputError
            If no pass is selected or long enough, or there are too many commands.
        """
        chosen, short = self._choose_passes(passes)
        predicted = [self._predict_pass(passes, int(k)) for k in chosen]
        count = np.array([one.times_s.size for one in predicted])
        advance = ctx.track("pointing", len(self.mounts) * len(predicted))
        columns: list[dict[str, Array]] = []
        ramp, flipped = np.zeros((2, int(count.max()), count.size, len(self.mounts)), dtype=bool)
        for m, mount in enumerate(self.mounts):
            plans: list[PassPlan] = []
            for k, one in enumerate(predicted):
                plan = plan_pass(one.times_s, one.azimuth_rad, one.elevation_rad, mount)
                ramp[: count[k], k, m], flipped[: count[k], k, m] = plan.ramp, plan.flipped
                plans.append(plan)
                advance(1)
            columns.append(self._follow_passes(predicted, plans, mount))
        error = [separation(one.predicted_direction, one.direction).max() for one in predicted]
        return Pointing(
            mounts=tuple(mount.name for mount in self.spec.mounts),
            kinds=tuple(mount.kind for mount in self.spec.mounts),
            axes=np.stack([mount.axes for mount in self.mounts], axis=-1),
            primary_limits=_limits(self.mounts, "primary"),
            secondary_limits=_limits(self.mounts, "secondary"),
            start=passes.start,
            stations=tuple(passes.stations[s] for s in passes.station[chosen]),
            satellites=tuple(passes.satellites[n] for n in passes.satellite[chosen]),
            revolution=passes.revolution[chosen],
            rise_s=passes.rise_s[chosen],
            elevation_max_rad=passes.elevation_max_rad[chosen],
            short=short,
            lock_angle_rad=self.spec.lock_angle_rad,
            period_s=self.spec.command_period_s,
            count=count,
            azimuth_rad=_pad_columns([angles_of(one.direction)[0] for one in predicted]),
            elevation_rad=_pad_columns([angles_of(one.direction)[1] for one in predicted]),
            **{key: np.stack([one[key] for one in columns], axis=-1) for key in columns[0]},
            ramp=ramp,
            flipped=flipped,
            primary_rate_on_target_rad_s=np.array(
                [[one.sight.peak_primary_rate(mount, one.times_s) for mount in self.mounts]
                 for one in predicted]
            ),
            sampling_error_rad=np.array([one.sight.sampling_error_rad for one in predicted]),
            interpolation_error_rad=np.array(error),
            interpolation_bound_rad=np.array([one.bound_rad for one in predicted]),
        )  # fmt: skip

    def present(self, product: Pointing, passes: PassList) -> Presentation:
        """Present errors, axis angles and rates, and the paths near the keyholes."""
        return present_pointing(product, Epoch.parse(passes.start, "UTC"))

    def _check_stations(self, known: Sequence[str]) -> None:
        for name in self.spec.stations:
            if name not in known:
                hint = did_you_mean(name, known, otherwise="there are")
                raise InputError(f"stations: no passes over {name!r}{hint}")

    def _choose_passes(self, passes: PassList) -> tuple[Integers, int]:
        """Return the indices of the selected passes, and the number of passes too short to plan."""
        spec = self.spec
        self._check_stations(passes.stations)
        names = np.array(passes.stations, dtype=np.str_)[passes.station]
        asked = passes.elevation_max_rad >= spec.culmination_min_rad
        if spec.stations:
            asked &= np.isin(names, spec.stations)
        if spec.revolutions:
            asked &= np.isin(passes.revolution, spec.revolutions)
        least = (_FEWEST_COMMANDS - 1) * spec.command_period_s
        duration = passes.set_s - passes.rise_s
        long = duration > least
        chosen = np.flatnonzero(asked & long)
        if not chosen.size:
            there = [
                f"{name} {number} ({np.degrees(top):.1f}°)"
                for name, number, top in zip(
                    names, passes.revolution, passes.elevation_max_rad, strict=True
                )
            ]
            more = " …" if len(there) > _LISTED else ""
            raise InputError(
                f"no pass to follow: none of {len(there)} passes belongs to the selected stations "
                f"and revolutions, reaches {np.degrees(spec.culmination_min_rad):g}° and lasts "
                f"longer than {least:g} s; there are (station, revolution, culmination): "
                f"{', '.join(there[:_LISTED]) or 'none'}{more}"
            )
        # the arrays of all passes have the length of the longest one
        longest = float(duration[chosen].max())
        total = len(self.mounts) * chosen.size * longest / spec.command_period_s
        if (part := _BYTES * total / _MOST_BYTES) > 1.0:
            period = spec.command_period_s * part
            raise InputError(
                f"{chosen.size} passes of up to {longest:.0f} s and {len(self.mounts)} mounts make "
                f"{total:.0f} commands, which need {_BYTES * total / 1e9:.1f} GB of memory, at "
                f"most {_MOST_BYTES / 1e9:g} GB; choose fewer passes (revolutions, stations, "
                f"culmination_min_deg) or mounts, or command_period_s = {_round_up(period):g}"
            )
        return chosen, int(np.count_nonzero(asked & ~long))

    def _predict_pass(self, passes: PassList, k: int) -> _PredictedPass:
        sight = LineOfSight(
            passes.t_s[:, k],
            passes.azimuth_rad[:, k],
            passes.elevation_rad[:, k],
            passes.range_m[:, k],
        )
        rise, period = float(passes.rise_s[k]), self.spec.command_period_s
        times = rise + period * np.arange(
            floor((passes.set_s[k] - rise) / period + 1e-9) + 1, dtype=float
        )
        # predictions at equal steps, at most a prediction period long
        steps = max(ceil((times[-1] - rise) / self.spec.prediction_period_s - 1e-9), 3)
        nodes = np.linspace(rise, times[-1], steps + 1)
        prediction = (nodes, *angles_of(sight.direction(nodes)))
        azimuth, elevation = smooth(*prediction, times)
        bound = float(smooth_error_bound(*prediction).max())
        return _PredictedPass(sight, times, sight.direction(times), azimuth, elevation, bound)

    def _follow_passes(
        self, predicted: list[_PredictedPass], plans: list[PassPlan], mount: Mount
    ) -> dict[str, Array]:
        """Return axis angles (K, P) and errors of a mount in all passes."""
        period, passes = self.spec.command_period_s, len(predicted)
        planned = [Course(plan.primary_rad, plan.secondary_rad) for plan in plans]
        naive = [naive_course(one.predicted_direction, mount) for one in predicted]
        unramped = [
            naive_course(one.predicted_direction, mount, float(plan.primary_rad[0]))
            for one, plan in zip(predicted, plans, strict=True)
        ]
        followed = follow_courses([*planned, *naive, *unramped], mount, period)
        error = [
            mount.error(one.direction, course.primary_rad, course.secondary_rad)
            for one, course in zip([*predicted, *predicted, *predicted], followed, strict=True)
        ]
        arrays: dict[str, Array] = {}
        for prefix, part in (("", slice(passes)), ("naive_", slice(passes, 2 * passes))):
            arrays[f"{prefix}primary_rad"] = _pad_columns([q.primary_rad for q in followed[part]])
            arrays[f"{prefix}secondary_rad"] = _pad_columns(
                [q.secondary_rad for q in followed[part]]
            )
            arrays[f"{prefix}error_rad"] = _pad_columns(error[part])
        rest = error[2 * passes :]
        arrays["unramped_error_max_rad"] = np.array([q.max() for q in rest])
        beyond = [np.count_nonzero(q > self.spec.lock_angle_rad) for q in rest]
        arrays["unramped_outside_s"] = period * np.array(beyond, dtype=float)
        return arrays


def _round_up(number: float) -> float:
    """Round a number up to two significant digits."""
    digit = 10.0 ** (floor(log10(number)) - 1)
    return digit * ceil(number / digit)


def _pad_columns(columns: list[Array]) -> Array:
    """Stack columns of different lengths into a table (K, P), with NaN after their ends."""
    table = np.full((max(q.size for q in columns), len(columns)), np.nan)
    for n, column in enumerate(columns):
        table[: column.size, n] = column
    return table


def _limits(mounts: tuple[Mount, ...], axis: str) -> Array:
    """Return stops, rates and accelerations of one axis of all mounts, shape (4, M)."""
    limits = [getattr(mount, axis) for mount in mounts]
    return np.array(
        [[q.lower_rad, q.upper_rad, q.rate_rad_s, q.acceleration_rad_s2] for q in limits]
    ).T
