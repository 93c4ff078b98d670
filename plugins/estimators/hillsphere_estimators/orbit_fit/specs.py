"""Specs of the stage ``orbit_fit``."""

from __future__ import annotations

from math import pi
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.engine.start_specs import StartFormsSpec
from hillsphere.model.earth.specs import GroundStationSpec
from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    Vector3,
    data_path,
    option,
    quantity,
    reference,
    rule,
)

__all__ = ["BiasSpec", "DataSpec", "FitStartSpec", "NoiseSpec", "ObserverSpec", "OrbitFitSpec"]

_ROWS = ("angle_rad", "range_m", "range_rate_m_s", "frequency_hz")


class DataSpec(Spec):
    """One file of tracking data."""

    examples = (
        {"file": "orbit-fit-ranges.tdm"},
        {"file": "orbit-fit-angles.csv", "station": "Alcantara"},
    )

    file: DataPath = data_path(
        "tracking data message (CCSDS TDM, text or XML), or a table of angles (CSV with the "
        "columns utc or time_s, azimuth_deg, elevation_deg and optionally sigma_deg)"
    )
    station: str = option(
        "of a table: the station that measured; left out: the only one", default="", max_length=60
    )


class ObserverSpec(Spec):
    """A participant that is no station on the ground."""

    examples = (
        {"name": "CRUISER", "file": "cruiser.oem"},
        {"name": "EARTH", "geocentre": True},
    )

    name: str = option("name of the participant", min_length=1, max_length=60)
    file: DataPath | None = data_path(
        "its trajectory about the centre of the plant (CCSDS OEM in ICRF, GCRF or EME2000)",
        default=None,
    )
    geocentre: bool = option(
        "whether it stands for the centre of the Earth, to which measurements were reduced",
        default=False,
    )

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.file is None) != self.geocentre:
            raise rule("file", "an observer has a trajectory or is the geocentre; give one of both")
        return self


class FitStartSpec(StartFormsSpec):
    """First guess of the state, and its date: at that date the state is fitted."""

    examples = (
        {
            "epoch": "2026-03-01T00:00:00",
            "position_km": [7000, 0, 0],
            "velocity_km_s": [0, 5.3, 5.3],
        },
        {"epoch": "2026-03-01T00:00:00", "elements": {"semi_major_axis_km": 7000,
                                                      "true_anomaly_deg": 0}},
        {"file": "first-guess.oem"},
        {"message": {"file": "catalogue.tle", "object": "25544"}},
    )  # fmt: skip

    epoch: str = option(
        "date and time of the state; with a file: left out for that of its first state or of its "
        "elements; with message: left out, message.epoch says it",
        default="",
        max_length=40,
    )
    time_scale: Literal["UTC", "TAI", "TT", "TDB"] = option("time scale of the date", default="UTC")
    position_m: Vector3 | None = quantity(
        "length", "position in the plant's frame", default=None
    )  # fmt: skip
    velocity_m_s: Vector3 | None = quantity("speed", "velocity in the plant's frame", default=None)
    file: DataPath | None = data_path(
        "file of one object about the centre of the plant: state or ephemeris (CCSDS OPM or OEM), "
        "or about the Earth elements for SGP4 (TLE or OMM); of several objects: message",
        default=None,
    )
    lenient: bool = option(
        "whether harmless departures of the file from the standard are warnings, not errors",
        default=False,
    )

    @model_validator(mode="after")
    def _one_start(self) -> Self:
        vectors = self.position_m is not None, self.velocity_m_s is not None
        if vectors[0] != vectors[1]:
            raise rule("position_m", "position and velocity belong together; give both")
        forms = [self.inertial, self.elements, self.message, self.file]
        if vectors[0] + sum(form is not None for form in forms) != 1:
            text = (
                "give the start once: position and velocity, inertial, elements, a file, or a "
                "message"
            )
            raise rule("file" if self.file else "position_m", text)
        if self.message is not None and self.epoch:
            raise rule("epoch", "the message says it; give message.epoch for another date (TDB)")
        form = self.inertial or self.elements
        dated = self.epoch or self.file or self.message or (form and form.epoch)
        if not dated:
            raise rule("epoch", "at which date is the start? give epoch")
        return self


class NoiseSpec(Spec):
    """Standard deviations of the random errors of what one participant receives, or of all."""

    examples = (
        {"angle_arcsec": 20, "range_m": 10, "range_rate_mm_s": 1},
        {"station": "Alcantara", "frequency_hz": 0.05},
    )

    station: str = option(
        "participant that measures; left out: every one without an entry of its own",
        default="", max_length=60,
    )  # fmt: skip
    angle_rad: float | None = quantity(
        "angle", "of angles on the sky; of the first angle it is this over the cosine of the "
        "second; a table's own column comes first",
        default=None, gt=0, lt=pi,
    )  # fmt: skip
    range_m: float | None = quantity(
        "length", "of ranges, as the data count them", default=None, gt=0
    )
    range_rate_m_s: float | None = quantity(
        "speed", "of range rates, as the data count them", default=None, gt=0
    )
    frequency_hz: float | None = quantity(
        "frequency", "of received frequencies", default=None, gt=0
    )

    @model_validator(mode="after")
    def _some(self) -> Self:
        if all(getattr(self, key) is None for key in _ROWS):
            raise rule("range_m", "states no standard deviation; give one at least")
        return self


class BiasSpec(Spec):
    """Constant errors of what one participant receives, each with its prior."""

    examples = (
        {"station": "Alcantara", "range_m": 30},
        {"station": "Cuiaba", "angle_1_deg": 0.1, "angle_2_deg": 0.1, "considered": True},
    )

    station: str = option("participant that measures", min_length=1, max_length=60)
    angle_1_rad: float | None = quantity(
        "angle", "standard deviation of the first angle's error: azimuth, X, right ascension",
        default=None, gt=0, lt=pi,
    )  # fmt: skip
    angle_2_rad: float | None = quantity(
        "angle", "of the second angle's: elevation, Y, declination", default=None, gt=0, lt=pi
    )
    range_m: float | None = quantity("length", "of the range's", default=None, gt=0)
    range_rate_m_s: float | None = quantity("speed", "of the range rate's", default=None, gt=0)
    frequency_hz: float | None = quantity(
        "frequency", "of the received frequency's", default=None, gt=0
    )
    considered: bool = option(
        "whether the errors are not estimated: the uncertainty that they bring is counted alone",
        default=False,
    )

    @model_validator(mode="after")
    def _some(self) -> Self:
        if all(getattr(self, key) is None for key in ("angle_1_rad", "angle_2_rad", *_ROWS[1:])):
            raise rule("range_m", "states no error; give one at least, or remove the table")
        return self


class OrbitFitSpec(StageSpec):
    """An orbit from recorded tracking data: by least squares, and by a filter."""

    results = ResultNames(
        metrics=(
            "fit_consistent",
            "fit_squares_per_dof",
            "fit_position_sigma",
            "fit_position_sigma_scaled",
            "fit_velocity_sigma",
            "fit_values_used",
            "fit_values_edited",
            "fit_filter_distance",
        ),
        tables={
            "fit_state": ("state", "value", "sigma", "change"),
            "fit_biases": (),
            "fit_residuals": (),
            "fit_left_out": (),
        },
    )
    produces = "hillsphere_estimators.orbit_fit.products:OrbitFit"
    examples = (
        # of any plant about the Earth: data so coarse that the prior decides
        {
            "plant": "earth_orbit",
            "data": [{"file": "orbit-fit-ranges.tdm"}],
            "stations": [
                {"name": "ALCANTARA", "latitude_deg": -2.2, "longitude_deg": -44.3,
                 "height_m": 39},
                {"name": "CUIABA", "latitude_deg": -15.5, "longitude_deg": -56.1,
                 "height_m": 277},
            ],
            "start": {"epoch": "2024-03-01T00:00:00", "position_km": [1045, 6370, -3405],
                      "velocity_km_s": [-6.264, 2.591, 2.941]},
            "noise": [{"range_km": 1000, "range_rate_km_s": 10}],
            "position_sigma_km": 1,
            "velocity_sigma_m_s": 1,
            "two_way_range": "half",
            "two_way_range_rate": "half",
        },
        {
            "plant": "earth_orbit",
            "data": [{"file": "orbit-fit-ranges.tdm"}],
            "stations": [
                {"name": "ALCANTARA", "latitude_deg": -2.2, "longitude_deg": -44.3,
                 "height_m": 39},
                {"name": "CUIABA", "latitude_deg": -15.5, "longitude_deg": -56.1,
                 "height_m": 277},
            ],
            "start": {"epoch": "2024-03-01T00:00:00", "position_km": [1045, 6370, -3405],
                      "velocity_km_s": [-6.264, 2.591, 2.941]},
            "noise": [{"range_m": 5, "range_rate_cm_s": 1}],
            "two_way_range": "half",
            "two_way_range_rate": "half",
        },
    )  # fmt: skip

    plant: Ref = reference("plant", "motion of the spacecraft, six states")
    data: tuple[DataSpec, ...] = option("files of tracking data", min_length=1, max_length=200)
    spacecraft: str = option(
        "name of the plant's spacecraft among the participants; left out: the only participant "
        "that is neither station nor observer",
        default="", max_length=80,
    )  # fmt: skip
    stations: tuple[GroundStationSpec, ...] = option(
        "stations by the names of the participants", default=(), max_length=200
    )
    observers: tuple[ObserverSpec, ...] = option(
        "other participants that measure", default=(), max_length=50
    )
    body: Ref | None = reference(
        "body",
        "the Earth, a body of type planet, with ellipsoid and rotation; left out: that of the "
        "plant, or WGS 84 and the tables of the IERS",
        default=None,
    )
    centre: DataPath | None = data_path(
        "trajectory of the plant's centre relative to the Earth (CCSDS OEM in ICRF, GCRF or "
        "EME2000), for stations where the plant is not about the Earth",
        default=None,
    )
    start: FitStartSpec = option("first guess of the state, and its date")
    position_sigma_m: float | None = quantity(
        "length", "prior standard deviation of the start, each axis; left out: no prior",
        default=None, gt=0,
    )  # fmt: skip
    velocity_sigma_m_s: float | None = quantity(
        "speed", "prior standard deviation of the start's velocity, each axis", default=None, gt=0
    )
    prior: Literal["stated", "message"] = option(
        "'stated': by position_sigma and velocity_sigma, none without them; 'message': the "
        "covariance that the message of the start states",
        default="stated",
    )
    noise: tuple[NoiseSpec, ...] = option(
        "standard deviations of the random errors", default=(), max_length=200
    )
    biases: tuple[BiasSpec, ...] = option("constant errors", default=(), max_length=100)
    two_way_range: Literal["whole", "half"] | None = option(
        "whether ranges of round trips count the whole way or half of it: the messages do not say; "
        "needed where there are any",
        default=None,
    )
    two_way_range_rate: Literal["whole", "half"] | None = option(
        "the same of range rates", default=None
    )
    range_unit_m: float | None = quantity(
        "length", "length of a range unit, where ranges are given in them", default=None, gt=0
    )
    reference_frame: str = option(
        "frame of right ascension and declination where a message does not name it: ICRF, GCRF, "
        "EME2000, TOD or TEME",
        default="", max_length=20,
    )  # fmt: skip
    aberration: Literal["none", "observer", "stars", "instantaneous"] = option(
        "of directions: 'none', geometric lines to where the light left; 'observer', with the "
        "aberration by the observer's velocity; 'stars', of right ascensions and declinations "
        "that were measured against the places of stars in a catalogue; 'instantaneous', lines to "
        "where the spacecraft is at the time tag, without light time, as in textbooks",
        default="none",
    )
    use_degraded: bool = option("whether data marked as degraded are used", default=False)
    editing_sigmas: float = option(
        "residuals beyond this many standard deviations are left out, and the fit is repeated; 0: "
        "none are",
        default=4.0, ge=0, le=100,
    )  # fmt: skip
    editing_rounds: int = option("fits at most", default=12, ge=1, le=100)
    estimator: Ref | None = reference(
        "estimator", "filter that runs over the values that the fit has used; needs a prior",
        default=None,
    )  # fmt: skip
    acceleration_noise_m_s2: float = quantity(
        "acceleration",
        "standard deviation, each axis, of random accelerations in the filter, held over a step; "
        "the fit has none",
        default=0.0, ge=0,
    )  # fmt: skip
    noise_step_s: float = quantity(
        "time", "step over which these accelerations are held", default=60.0, gt=0
    )
    step_s: float = quantity("time", "longest step of the motion", default=60.0, gt=0)
    ephemeris_interval_s: float = quantity(
        "time", "time between the states of the ephemeris that is written", default=60.0, gt=0
    )
    object_id: str = option(
        "international designator for the files; left out: the spacecraft's name",
        default="", max_length=60,
    )  # fmt: skip

    @property
    def has_prior(self) -> bool:
        """Whether something is known of the start before the data."""
        return self.position_sigma_m is not None or self.prior == "message"

    @model_validator(mode="after")
    def _names_and_pairs(self) -> Self:
        names = [s.name for s in self.stations] + [o.name for o in self.observers]
        if not names:
            raise rule("stations", "who measured? give stations or observers")
        for key, given in (("stations", names), ("noise", [n.station for n in self.noise])):
            if len(set(given)) < len(given):
                twice = next(name for name in given if given.count(name) > 1)
                raise rule(key, f"{twice or 'all others'} is given twice")
        for key, given in (("noise", [n.station for n in self.noise if n.station]),
                           ("biases", [b.station for b in self.biases])):  # fmt: skip
            unknown = [name for name in given if name not in names]
            if unknown:
                raise rule(key, f"no station or observer {unknown[0]!r}; known: {', '.join(names)}")
        if (self.position_sigma_m is None) != (self.velocity_sigma_m_s is None):
            key = "velocity_sigma_m_s" if self.velocity_sigma_m_s is None else "position_sigma_m"
            raise rule(key, "a prior needs position_sigma and velocity_sigma; give both or neither")
        if self.prior == "message":
            if self.position_sigma_m is not None:
                raise rule("prior", "the message states the prior; leave position_sigma out")
            if self.start.message is None and self.start.file is None:
                raise rule("prior", "'message' needs start.message or start.file")
        if self.estimator is not None and not self.has_prior:
            text = "a filter needs a prior: give position_sigma and velocity_sigma"
            raise rule("estimator", text)
        if self.acceleration_noise_m_s2 and self.estimator is None:
            raise rule("acceleration_noise_m_s2", "acts in a filter only; give an estimator")
        return self
