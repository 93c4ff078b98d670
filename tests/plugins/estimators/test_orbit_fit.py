"""The fit of the stage ``orbit_fit`` to tracking data that other code has simulated."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, kstest
from tests.plugins.estimators import tracking_simulation as sim

import hillsphere as hs
from hillsphere import create
from hillsphere.base.geodetic import Station
from hillsphere.base.paths import missions_directory
from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.formats.oem import OemSegment, read_oem, write_oem
from hillsphere.formats.opm import read_opm
from hillsphere.formats.tdm import Series, TdmMeta, TdmSegment, write_tdm
from hillsphere.interfaces import Array
from hillsphere.testing import RecordingContext, check_presentation
from hillsphere.time import Epoch
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.bias_states import BiasAugmentedModel, BiasStates
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.fixed_steps import FixedStepModel
from hillsphere_estimators.orbit_fit.fitting import TOLERANCE_SIGMAS
from hillsphere_estimators.orbit_fit.observables import Observable
from hillsphere_estimators.orbit_fit.reading import read_tracking_data
from hillsphere_estimators.orbit_fit.records import Record, arrange
from hillsphere_estimators.orbit_fit.residuals import Residuals
from hillsphere_estimators.orbit_fit.stage import fit_records
from hillsphere_estimators.orbit_fit.surroundings import Surroundings
from hillsphere_estimators.orbit_fit.tracking_model import TrackingModel
from hillsphere_estimators.orbit_fit.trajectory import Trajectory

ARCSECOND = np.pi / 648000.0
KINDS = ("angles", "ranges", "small body")


class Problem:
    """True values of a kind of tracking, and the model that fits them."""

    def __init__(self, kind: str) -> None:
        self.records: list[Record] = []
        if kind == "small body":
            self._small_body()
        else:
            self._earth(kind)

    def _add(self, observable: Observable, t: Array, values: Array, sigma: Array) -> None:
        self.records.append(Record(observable, t, values[:, :, None], sigma))

    def _earth(self, kind: str) -> None:
        craft = sim.satellite()
        self.truth, self.sigma = sim.START, np.repeat([2e3, 2.0], 3)
        stations = {n: Station(n, np.radians(a), np.radians(b), h)
                    for n, (a, b, h) in sim.PLACES.items()}  # fmt: skip
        self.plant = sim.earth_plant()
        zero = Epoch.parse(sim.DATE, "UTC")
        self.surroundings = Surroundings(
            self.plant, zero, self.plant.planet.orientation, stations, {}, None, (0.0, 7600.0)
        )
        if kind == "angles":
            t = np.concatenate([np.arange(420.0, 1150.0, 30.0), np.arange(7050.0, 7550.0, 50.0)])
            lines = [craft(sim.sent_at(craft, sim.station("A")(s), s)) - sim.station("A")(s)
                     for s in t]  # fmt: skip
            values = np.array([sim.horizon("A", line, s) for line, s in zip(lines, t, strict=True)])
            sigma = 20.0 * ARCSECOND * np.array([1.0 / np.cos(values[:, 1]), np.ones(len(t))])
            self._add(Observable("angles", ("S", "A"), "AZEL"), t, values.T, sigma)
            return
        for name, t in (("A", np.arange(440.0, 1150.0, 50.0)), ("B", np.arange(60.0, 850.0, 50.0))):
            path = [sim.station(name), craft, sim.station(name)]
            ranges = np.array([sim.elapsed(path, s) for s in t]) * sim.C / 2.0
            self._add(Observable("range", (name, "S", name), share=0.5), t, ranges[None],
                      np.full((1, len(t)), 5.0))  # fmt: skip
            ends = [[sim.elapsed(path, s + d) for s in t] for d in (-5.0, 5.0)]
            rates = (np.array(ends[1]) - ends[0]) * sim.C / 20.0
            self._add(
                Observable("range_rate", (name, "S", name), share=0.5, interval_s=10.0), t,
                rates[None], np.full((1, len(t)), 0.01),
            )  # fmt: skip

    def _small_body(self) -> None:
        craft = sim.prober(2.2e5)
        self.plant = sim.small_body_plant()
        zero = Epoch.parse(sim.DATE, "TDB")
        nodes = np.linspace(-6e4, 2.4e5, 101)

        def trajectory(name: str, motion: sim.Motion, h: float) -> Trajectory:
            x = [np.concatenate([motion(s), sim.derivative(motion, s, h)]) for s in nodes]
            return Trajectory(name, nodes, np.array(x).T)

        self.surroundings = Surroundings(
            self.plant, zero, sim.earth_plant().planet.orientation, {},
            {"O": trajectory("O", sim.observer, 10.0), "E": None},
            trajectory("centre", sim.centre_from_earth, 1000.0), (0.0, 2.2e5),
        )  # fmt: skip
        self.truth = self.surroundings.from_inertial(sim.NEAR[:, None], np.zeros(1))[:, 0]
        self.sigma = np.repeat([200.0, 0.005], 3)
        t = np.arange(0.0, 2.1e5, 2e4)
        lines = [craft(sim.sent_at(craft, sim.observer(s), s)) - sim.observer(s) for s in t]
        angles = np.array([[np.arctan2(y, x) % (2 * np.pi), np.arctan2(z, np.hypot(x, y))]
                           for x, y, z in lines])  # fmt: skip
        sigma = 1.0 * ARCSECOND * np.array([1.0 / np.cos(angles[:, 1]), np.ones(len(t))])
        self._add(Observable("angles", ("S", "O"), "RADEC", "ICRF"), t, angles.T, sigma)

        def probe(s: float) -> Array:
            return np.asarray(sim.earth(s) + sim.centre_from_earth(s) + craft(s))

        t = np.arange(5e3, 2.1e5, 4e4)
        ranges = np.array([sim.elapsed([sim.earth, probe, sim.earth], s) for s in t]) * sim.C
        self._add(Observable("range", ("E", "S", "E")), t, ranges[None], np.full((1, len(t)), 10.0))

    def model(self, biases: BiasStates | None = None) -> FixedStepModel:
        arc = arrange(self.records)
        motion = TrackingModel(
            self.plant, [r.observable for r in self.records], self.surroundings, "S", "none", {},
            arc.active, step_s=50.0 if self.truth[0] > 1e5 else 2000.0,
        )  # fmt: skip
        rows = sum(len(r.observable.names) for r in self.records)
        if biases is None:
            biases = BiasStates(np.empty(0), np.empty(0), np.zeros((rows, 0)), np.zeros((0, 0)),
                                np.zeros(0, dtype=bool))  # fmt: skip
        whole = BiasAugmentedModel(motion, 6, biases)
        size = [np.linalg.norm(self.truth[:3]), np.linalg.norm(self.truth[3:])]
        steps = np.concatenate([np.repeat(1e-3 * np.array(size), 3), biases.sigma])
        return FixedStepModel(whole, motion.blocks, steps)

    def measured(self, cases: int, seed: int) -> list[Record]:
        """Return the records with random errors, of independent cases."""
        random = np.random.default_rng(seed)
        return [
            replace(
                r, values=r.values
                + r.sigma[:, :, None] * random.normal(size=(*r.values.shape[:2], cases)),
            )
            for r in self.records
        ]  # fmt: skip

    def prior(self, cases: int, seed: int) -> Belief:
        random = np.random.default_rng(seed)
        off = self.sigma[:, None] * random.normal(size=(6, cases))
        root = np.repeat(np.diag(self.sigma)[None], cases, axis=0)
        return Belief(self.truth[:, None] + off, root, np.zeros(cases))


def fitted(kind: str, cases: int, seed: int) -> tuple[Problem, Any]:
    problem = Problem(kind)
    arc = arrange(problem.measured(cases, seed))
    return problem, batch_least_squares(
        problem.model(),
        problem.prior(cases, seed + 1),
        arc.sets,
        iterations=10,
        tolerance_sigmas=TOLERANCE_SIGMAS,
    )


def check(kind: str, cases: int, seed: int) -> float:
    """Fit cases and return the mean NEES after a check of its band and of the squares."""
    problem, fit = fitted(kind, cases, seed)
    assert fit.settled.all()
    errors = nees(fit.belief, np.repeat(problem.truth[:, None], cases, axis=1))
    low, high = chi_square_band(6, cases)
    assert low <= errors.mean() <= high
    low, high = chi_square_band(int(fit.rows[0]), cases)
    assert low <= fit.squares.mean() <= high

    # the data say far more than the prior
    assert (fit.belief.sigma[:, 0] < 0.5 * problem.sigma).all()
    if cases >= 100:
        assert kstest(errors, chi2(6).cdf).pvalue > 1e-3
    return float(errors.mean())


@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_as_large_as_the_covariance_says(kind: str) -> None:
    """Ten fits of each kind: mean NEES of six states in its 99.9 % band."""
    check(kind, 10, 20240302)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_errors_of_200_fits_are_as_large_as_the_covariance_says(kind: str) -> None:
    check(kind, 200, 7)


def with_change(record: Record, change: Array) -> Record:
    """Return a record with values that are off by some standard deviations (K,)."""
    return replace(record, values=record.values + (record.sigma * change)[:, :, None])


@pytest.fixture(scope="module")
def ranges() -> Problem:
    return Problem("ranges")


def test_an_outlier_of_30_sigma_is_left_out(ranges: Problem) -> None:
    """And the values beside it are not; the state is that of the data without it."""
    records = ranges.measured(1, 11)
    off = np.zeros(len(records[0].t_s))
    off[4] = 30.0
    wild = [with_change(records[0], off), *records[1:]]
    fit, judged = fit_records(ranges.model(), ranges.prior(1, 12), wild)
    arc = arrange(wild)
    out = ~fit.residuals.used
    assert [(int(arc.record[k]), int(arc.number[k])) for k in np.flatnonzero(out)] == [(0, 4)]
    assert judged.answer == "consistent"
    sound = replace(records[0], values=np.where(off[:, None] > 0.0, np.nan, records[0].values))
    alone, _ = fit_records(ranges.model(), ranges.prior(1, 12), [sound, *records[1:]])
    moved = fit.fit.belief.x - alone.fit.belief.x
    assert (np.abs(moved[:, 0]) < 1e-3 * fit.fit.belief.sigma[:, 0]).all()


SLOW = pytest.mark.slow
"""Of cases that take several seconds."""


@pytest.mark.parametrize(
    "threshold", [pytest.param(3.0, marks=SLOW), 4.0, pytest.param(None, marks=SLOW)]
)
def test_an_unmodelled_bias_of_5_sigma_is_told(ranges: Problem, threshold: float | None) -> None:
    """Of one station's ranges, which editing must not hide; modelled, all is well."""
    records = ranges.measured(1, 21)
    wrong = [with_change(records[0], np.full(len(records[0].t_s), 5.0)), *records[1:]]
    prior = ranges.prior(1, 22)
    _, judged = fit_records(ranges.model(), prior, wrong, threshold=threshold)
    assert judged.answer == "inconsistent", judged.reasons
    shown = np.array([[1.0], [0.0], [0.0], [0.0]])
    biases = BiasStates(np.array([50.0]), np.array([np.inf]), shown, np.zeros((0, 1)),
                        np.zeros(1, dtype=bool))  # fmt: skip
    model = ranges.model(biases)
    whole: Any = model.model
    fit, judged = fit_records(model, whole.append_biases(prior), wrong, threshold=threshold)
    assert judged.answer == "consistent", judged.reasons
    found, sigma = fit.fit.belief.x[6, 0], fit.fit.belief.sigma[6, 0]
    assert abs(found - 25.0) < 3.5 * sigma < 25.0


def test_sigmas_that_are_too_large_are_told(ranges: Problem) -> None:
    records = [replace(r, sigma=2.0 * r.sigma) for r in ranges.measured(1, 31)]
    _, judged = fit_records(ranges.model(), ranges.prior(1, 32), records)
    assert judged.answer == "noise overstated"


def test_residuals_have_the_variance_that_is_said() -> None:
    """Twelve values, one of them not used, of four unknowns, one of them considered.

    Over 8000 draws, each standard deviation to 4.5 of its own.
    """
    random = np.random.default_rng(41)
    rows, count = 2.0 * random.normal(size=(12, 4)), 8000
    used, free = np.arange(12) != 5, np.arange(4) != 2
    gain = np.linalg.solve(np.eye(4) + rows[used].T @ rows[used], rows[used].T)[free]
    z = random.normal(size=(4, count))
    y = rows @ z + random.normal(size=(12, count))
    residual = y - rows[:, free] @ (gain @ y[used])
    about = Residuals(residual[:, 0], rows, used, free)
    bound = 4.5 / np.sqrt(2.0 * count)
    assert (np.abs(np.std(residual, axis=1) / about.sigma() - 1.0) < bound).all()
    direction = np.where(np.arange(12) < 4, 1.0, 0.0)
    score, sigma = about.constant_error(direction)
    assert score == pytest.approx(direction @ residual[:, 0])
    assert abs(np.std(direction @ residual) / sigma - 1.0) < bound
    # an error that an estimated state takes up, with a prior so wide, leaves nothing
    wide = Residuals(residual[:, 0], rows * 1e6, used, np.ones(4, dtype=bool))
    assert wide.constant_error(rows[:, 0]) == (0.0, 0.0)


def stage(**keys: Any) -> Any:
    given: dict[str, Any] = {
        "plant": sim.earth_plant(),
        "data": [{"file": "orbit-fit-ranges.tdm"}],
        "stations": [
            {"name": "ALCANTARA", "latitude_deg": -2.2, "longitude_deg": -44.3, "height_m": 39},
            {"name": "CUIABA", "latitude_deg": -15.5, "longitude_deg": -56.1, "height_m": 277},
        ],
        "start": {"epoch": sim.DATE, "position_km": [1045, 6370, -3405],
                  "velocity_km_s": [-6.264, 2.591, 2.941]},
        "noise": [{"range_m": 5, "range_rate_cm_s": 1}],
        "two_way_range": "half", "two_way_range_rate": "half",
    }  # fmt: skip
    return create("stage", "orbit_fit", **{**given, **keys})


@pytest.mark.slow  # the contracts run the same data in the short suite
def test_a_message_is_fitted_and_written() -> None:
    """Packaged data: the true state within 4 σ without any prior; OPM and OEM read back."""
    one = stage()
    product = one.run(RecordingContext())
    assert product.answer == "consistent", product.reasons
    assert product.rows.edited.tolist() == [0, 0, 0, 1]
    assert product.rows.count.tolist() == [36, 36, 40, 40]
    sigma = np.sqrt(np.diag(product.covariance))
    assert (np.abs(product.mean - sim.START) < 4.0 * sigma).all()
    shown = one.present(product)
    check_presentation(shown)
    opm = read_opm(shown.files["orbit-fit.opm"])
    assert np.allclose(opm.x, product.mean, rtol=1e-12)
    assert opm.covariance is not None
    assert np.allclose(np.sqrt(np.diag(opm.covariance)), sigma, rtol=1e-6)
    (segment,) = read_oem(shown.files["orbit-fit.oem"])
    craft = sim.satellite()
    off = [segment.x[:3, k] - craft(t) for k, t in enumerate(product.ephemeris_t_s)]
    assert np.max(np.linalg.norm(off, axis=1)) < 30.0


@pytest.mark.slow  # two fits
def test_a_written_state_is_a_start(tmp_path: Path) -> None:
    one = stage()
    product = one.run(RecordingContext())
    (tmp_path / "start.opm").write_text(one.present(product).files["orbit-fit.opm"], "utf-8")
    again = stage(start={"file": str(tmp_path / "start.opm")}).run(RecordingContext())
    sigma = np.sqrt(np.diag(product.covariance))
    assert (np.abs(again.mean - product.mean) < 1e-3 * sigma).all()


def test_a_table_of_angles_is_fitted() -> None:
    one = stage(data=[{"file": "orbit-fit-angles.csv", "station": "ALCANTARA"}], noise=[])
    product = one.run(RecordingContext())
    assert product.answer == "consistent", product.reasons
    sigma = np.sqrt(np.diag(product.covariance))
    assert (np.abs(product.mean - sim.START) < 4.0 * sigma).all()
    assert product.rows.labels[0] == "spacecraft → ALCANTARA, azimuth"
    shown = one.present(product)
    check_presentation(shown)
    assert np.allclose(read_opm(shown.files["orbit-fit.opm"]).x, product.mean, rtol=1e-12)


def message(tmp_path: Path, *changes: tuple[str, str]) -> str:
    """Return the path of the packaged message with other texts."""
    text = (missions_directory() / "data" / "orbit-fit-ranges.tdm").read_text("utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "changed.tdm"
    path.write_text(text, "utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("changes", "keys", "expected"),
    [
        ((), {"two_way_range": None}, "two_way_range: .*whole way or half"),
        ((), {"noise": [{"range_m": 5}]}, "noise: ALCANTARA measures range rate"),
        ((), {"stations": [{"name": "CUIABA", "latitude_deg": 0, "longitude_deg": 0}]},
         "spacecraft: the participants of .* ALCANTARA and SAT are"),
        ((), {"spacecraft": "SAT", "stations": [
            {"name": "CUIABA", "latitude_deg": 0, "longitude_deg": 0}]},
         "stations: .*'ALCANTARA'"),
        ((("RANGE_UNITS = km", "RANGE_UNITS = RU"),), {}, "range_unit: "),
        ((("RANGE_UNITS = km", "RANGE_MODULUS = 100\nRANGE_UNITS = km"),), {}, "position_sigma: "),
        ((("PATH = 1,2,1", "PATH = 1,2"),), {}, "received by SAT itself"),
        ((("DATA_QUALITY = VALIDATED", "DATA_QUALITY = DEGRADED"),), {},
         "nothing that can be fitted.*degraded"),
        ((), {"centre": "orbit-fit-ranges.tdm"}, "centre: the plant is about the Earth"),
        ((), {"start": {"file": "orbit-fit-ranges.tdm"}}, "orbit-fit-ranges.tdm"),
        ((), {"data": [{"file": "orbit-fit-angles.csv"}]}, "which of ALCANTARA, CUIABA"),
    ],
)  # fmt: skip
def test_what_is_not_said_is_asked_for(
    tmp_path: Path, changes: Any, keys: dict[str, Any], expected: str
) -> None:
    """Each refusal names the key or the file."""
    data = {"data": [{"file": message(tmp_path, *changes)}]} if changes else {}
    with pytest.raises(InputError, match=expected):
        stage(**{**data, **keys}).run(RecordingContext())


def test_corrections_are_applied_once(tmp_path: Path) -> None:
    """A correction that is not applied shifts the data, one that is applied does not."""
    quality = "DATA_QUALITY = VALIDATED"
    spec = stage().spec
    zero = Epoch.parse(sim.DATE, "UTC")
    plain = read_tracking_data(spec, zero)
    for applied, shift in (("YES", 0.0), ("NO", 0.5e3)):
        words = f"{quality}\nCORRECTION_RANGE = 0.5\nCORRECTIONS_APPLIED = {applied}"
        path = message(tmp_path, (quality, words))
        other = read_tracking_data(stage(data=[{"file": path}]).spec, zero)
        ours, theirs = (d.records[1].values for d in (other, plain))
        assert np.allclose(ours - theirs, shift, atol=1e-6)


@pytest.mark.slow  # three fits
def test_an_ambiguous_range_is_resolved_by_the_prior(tmp_path: Path) -> None:
    """Modulo 100 km: the same state; with a prior too wide for that, undecided."""
    text = (missions_directory() / "data" / "orbit-fit-ranges.tdm").read_text("utf-8")
    lines = []
    for line in text.splitlines():
        if line.startswith("RANGE = "):
            *first, value = line.split(" ")
            line = " ".join([*first, f"{float(value) % 100.0:.6f}"])
        lines.append(line.replace("RANGE_UNITS = km", "RANGE_MODULUS = 100\nRANGE_UNITS = km"))
    path = tmp_path / "ambiguous.tdm"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    prior = {"position_sigma_km": 5, "velocity_sigma_m_s": 2}
    data = [{"file": str(path)}]
    found = stage(data=data, **prior).run(RecordingContext())
    same = stage(**prior).run(RecordingContext())
    assert found.answer == "consistent"
    assert np.allclose(found.mean, same.mean, rtol=0, atol=1e-2)
    wide = stage(data=data, position_sigma_km=100, velocity_sigma_m_s=2).run(RecordingContext())
    assert wide.answer == "undecided"
    assert "too wide for the ambiguity" in wide.reasons[0]


@pytest.mark.slow  # ten passes of a filter
def test_a_filter_agrees_with_the_fit() -> None:
    """From a prior so narrow that updates are linear.

    200 m across a line of 1000 km change its length by 200²/(2·10⁶) = 0.02 m, a hundredth of its
    noise.
    """
    start = {"epoch": sim.DATE, "position_m": (sim.START[:3] + 100.0).tolist(),
             "velocity_m_s": (sim.START[3:] - 0.1).tolist()}  # fmt: skip
    one = stage(
        start=start, position_sigma_m=200, velocity_sigma_m_s=0.2,
        estimator=create("estimator", "unscented"),
    )  # fmt: skip
    product = one.run(RecordingContext())
    assert product.filter.answer == "consistent"
    assert product.filter.distance < 0.1
    check_presentation(one.present(product))


@pytest.mark.slow  # two missions of the guide
@pytest.mark.parametrize("stage_name", ["ranges", "angles"])
def test_the_mission_of_the_guide_runs(
    stage_name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = Path(__file__).parents[3] / "docs" / "how-to" / "fit-an-orbit.md"
    text = "\n".join(re.findall(r"```toml\n(.*?)```\n", page.read_text("utf-8"), re.DOTALL))
    (tmp_path / "fit.toml").write_text(text, "utf-8")
    monkeypatch.chdir(tmp_path)
    result = hs.run("fit.toml", executor="serial")
    assert result.product(stage_name).answer == "consistent"


FREQUENCIES = """CCSDS_TDM_VERS = 2.0
CREATION_DATE = 2026-11-28T00:00:00
ORIGINATOR = TEST

META_START
TIME_SYSTEM = UTC
PARTICIPANT_1 = A
PARTICIPANT_2 = SAT
MODE = SEQUENTIAL
PATH = 1,2,1
TIMETAG_REF = TRANSMIT
META_STOP
DATA_START
TRANSMIT_FREQ_1 = 2024-03-01T00:00:00.000 2.1E9
TRANSMIT_FREQ_RATE_1 = 2024-03-01T00:00:00.000 2.0E2
DATA_STOP

META_START
TIME_SYSTEM = UTC
PARTICIPANT_1 = A
PARTICIPANT_2 = SAT
MODE = SEQUENTIAL
PATH = 1,2,1
TIMETAG_REF = RECEIVE
INTEGRATION_INTERVAL = 10.0
INTEGRATION_REF = END
FREQ_OFFSET = 2.28E9
TURNAROUND_NUMERATOR = 240
TURNAROUND_DENOMINATOR = 221
META_STOP
DATA_START
{rows}
DATA_STOP
"""


def received(t: float) -> float:
    """Return the mean frequency over ten seconds before t, by the cycles that were sent."""
    path = [sim.station("A"), sim.satellite(), sim.station("A")]
    first, last = (s - sim.elapsed(path, s) for s in (t - 10.0, t))
    return 240.0 / 221.0 * (last - first) * (2.1e9 + 100.0 * (first + last)) / 10.0


def test_received_frequencies_of_a_message_are_expected(tmp_path: Path) -> None:
    """Ramp, turnaround, offset and interval of the message, against counted cycles.

    Differences of Earth orientation of 1e-9 rad turn a range rate by 1e-5 m/s, 2e-4 Hz.
    """
    times = (520.0, 640.0, 760.0)
    zero = Epoch.parse(sim.DATE, "UTC")
    rows = [f"RECEIVE_FREQ_1 = {zero.isot(np.array([t]), 3)[0]} {received(t) - 2.28e9:.6f}"
            for t in times]  # fmt: skip
    path = tmp_path / "frequencies.tdm"
    path.write_text(FREQUENCIES.format(rows="\n".join(rows)), "utf-8")
    place = sim.PLACES["A"]
    one = stage(
        data=[{"file": str(path)}], noise=[{"frequency_hz": 0.05}], spacecraft="SAT",
        stations=[{"name": "A", "latitude_deg": place[0], "longitude_deg": place[1],
                   "height_m": place[2]}],
        start={"epoch": sim.DATE, "position_m": sim.START[:3].tolist(),
               "velocity_m_s": sim.START[3:].tolist()},
        position_sigma_m=1e-3, velocity_sigma_m_s=1e-6, editing_sigmas=0,
    )  # fmt: skip
    product = one.run(RecordingContext())
    assert np.abs(product.rows.residual).max() < 1e-3
    # without the message's offset all would be off by 2.28 GHz, and the start of the ramp matters
    late = FREQUENCIES.replace("01T00:00:00.000 2", "01T00:10:00.000 2")
    path.write_text(late.format(rows="\n".join(rows)), "utf-8")
    with pytest.raises(InputError, match="before the first TRANSMIT_FREQ"):
        one.run(RecordingContext())


@pytest.mark.slow  # thirty steps that are halved
def test_a_hopeless_start_is_undecided_or_refused() -> None:
    """Flown the other way round: no solution is claimed, and no raw error is shown."""
    start = {"epoch": sim.DATE, "position_km": [1040, 6375, -3401],
             "velocity_km_s": [6.2, -2.5, -2.9]}  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            answer = stage(start=start).run(RecordingContext()).answer
        except InputError as error:
            answer = str(error).partition(" (")[0]
    assert answer in ("undecided", "start: the fit diverges from this start")


@pytest.mark.slow  # six states from files of three kinds
def test_a_spacecraft_at_an_asteroid_is_fitted_from_messages(tmp_path: Path) -> None:
    """Directions from another spacecraft and ranges from the Earth's centre, all from files."""
    zero, nodes = Epoch.parse(sim.DATE, "TDB"), np.linspace(-6e4, 2.6e5, 81)
    for name, motion, h in (("o", sim.observer, 10.0), ("centre", sim.centre_from_earth, 1000.0)):
        x = np.array([np.concatenate([motion(t), sim.derivative(motion, t, h)]) for t in nodes]).T
        segment = OemSegment(name.upper(), "1", "STONE", "ICRF", zero, nodes, x)
        (tmp_path / f"{name}.oem").write_text(write_oem([segment]), "utf-8")
    angles, ranges = (
        replace(r, values=made.values) for r, made in zip(
            Problem("small body").records, Problem("small body").measured(1, 3), strict=True)
    )  # fmt: skip
    first = TdmMeta(("O", "S"), (2, 1), "TDB", mode="SEQUENTIAL", angle_type="RADEC",
                    reference_frame="ICRF")  # fmt: skip
    second = TdmMeta(("E", "S"), (1, 2, 1), "TDB", mode="SEQUENTIAL", range_units="s")
    seconds = ranges.values[0, :, 0] / sim.C
    message = write_tdm([
        TdmSegment(first, zero, {
            "ANGLE_1": Series(angles.t_s, angles.values[0, :, 0] % (2 * np.pi)),
            "ANGLE_2": Series(angles.t_s, angles.values[1, :, 0])}),
        TdmSegment(second, zero, {"RANGE": Series(ranges.t_s, seconds)}),
    ])  # fmt: skip
    (tmp_path / "all.tdm").write_text(message, "utf-8")
    truth = Problem("small body").truth
    keys: dict[str, Any] = {
        "plant": sim.small_body_plant(), "data": [{"file": str(tmp_path / "all.tdm")}],
        "observers": [{"name": "O", "file": str(tmp_path / "o.oem")},
                      {"name": "E", "geocentre": True}],
        "start": {"epoch": sim.DATE, "time_scale": "TDB", "position_m": (truth[:3] + 50).tolist(),
                  "velocity_m_s": (truth[3:] * 1.01).tolist()},
        "noise": [{"angle_arcsec": 1, "range_m": 10}], "two_way_range": "whole",
        "step_s": 2000, "ephemeris_interval_s": 20000,
    }  # fmt: skip
    with pytest.raises(InputError, match="centre: 'E' is at the Earth"):
        create("stage", "orbit_fit", **keys).run(RecordingContext())
    one = create("stage", "orbit_fit", **keys, centre=str(tmp_path / "centre.oem"))
    product = one.run(RecordingContext())
    assert product.answer == "consistent", product.reasons
    assert (np.abs(product.mean - truth) < 4.0 * np.sqrt(np.diag(product.covariance))).all()
    craft = sim.prober(2.2e5)
    off = [x[:3] - craft(t) for t, x in zip(product.ephemeris_t_s, product.ephemeris.T, strict=True)
           if t < 2.2e5]  # fmt: skip
    assert np.max(np.linalg.norm(off, axis=1)) < 40.0
    shown = one.present(product)
    check_presentation(shown)
    assert "CENTER_NAME = STONE" in shown.files["orbit-fit.oem"]
