"""What the stage ``orbit_fit`` says of data, stated noise and starts that do not fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plugins.estimators import tracking_simulation as sim
from tests.plugins.estimators.test_orbit_fit import stage

from hillsphere.base.paths import missions_directory
from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.formats.opm import read_opm
from hillsphere.testing import RecordingContext, check_presentation
from hillsphere_estimators.batch_least_squares import Fit
from hillsphere_estimators.orbit_fit.fitting import EditedFit
from hillsphere_estimators.orbit_fit.hints import explain_misfit
from hillsphere_estimators.orbit_fit.observables import Observable
from hillsphere_estimators.orbit_fit.records import Arc
from hillsphere_estimators.orbit_fit.residuals import Residuals

WIDTH = 138
"""Characters of a sentence that the terminal shows."""


def hints(change: Any, used: Any, scale: float = 1.0, correlation: float = 0.0) -> tuple[str, ...]:
    """Return the hints of a linear problem: ranges of two stations, 60 values each, six states.

    `change` (120,) is added to the values, in stated standard deviations of 5 m; true noise is
    `scale` times as large, and neighbours of it are correlated.
    """
    random = np.random.default_rng(17)
    t = np.tile(np.linspace(-1.0, 1.0, 60), 2)
    station = np.repeat([0, 1], 60)
    sign = np.where(station, 1.0, -0.6)
    rows = 1e3 * np.array([t**0, t, t**2, sign * t, sign * t**2, t**3]).T
    noise = random.normal(size=120)
    for k in range(1, 120):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1.0 - correlation**2) * noise[k]
    y = scale * noise + change
    mask = np.asarray(used, dtype=bool)
    solved = np.linalg.lstsq(rows[mask], y[mask], rcond=None)[0]
    about = Residuals(y - rows @ solved, rows, mask, np.ones(6, dtype=bool))
    prior = Belief(np.zeros((6, 1)), np.eye(6)[None], np.zeros(1))
    fit = Fit(Belief(solved[:, None], np.eye(6)[None], np.zeros(1)), np.zeros(1), np.ones(1, int),
              np.ones(1, int), np.ones(1, bool), np.zeros(1))  # fmt: skip
    arc = Arc(
        (), station, station, np.tile(np.arange(60), 2), np.arange(120), np.full(120, 5.0), {}
    )
    kinds = [Observable("range", (name, "S", name)) for name in ("GOOD", "BAD")]
    found = explain_misfit(EditedFit(fit, about, 1, True), arc, prior, kinds, 4.0, wanted=True)
    assert found.means.shape == (2,)
    return found.sentences


def test_what_explains_all_values_is_found_whatever_was_left_out() -> None:
    """A constant error of 40 m, though the fit has used the bad station alone; noise seven times.

    The estimated error may be off by 4.5 standard deviations, 5 m · 4.5/√60 and what the states
    take up. Errors that no constant makes and that are correlated get no hint.
    """
    bad = np.repeat([0.0, 8.0], 60)
    only = np.repeat([0, 1], 60)
    first, detail = hints(bad, only)
    assert "of BAD's range would explain it" in first
    assert 'biases = [{ station = "BAD", range_m = 80 }]' in first
    value = float(first.split("error of ")[1].split(" m")[0])
    sigma = float(detail.split("estimated to ")[1].split(" m")[0])
    assert abs(value - 40.0) < 4.5 * sigma < 10.0
    (sentence,) = hints(np.zeros(120), np.ones(120), scale=7.0)
    times = float(sentence.split("deviations of ")[1].split(" times")[0])
    assert times == pytest.approx(7.0, rel=0.35)
    assert hints(np.zeros(120), np.ones(120)) == ()
    assert hints(np.zeros(120), np.ones(120), scale=7.0, correlation=0.95) == ()


def shown(**keys: Any) -> tuple[Any, Any]:
    one = stage(**keys)
    product = one.run(RecordingContext())
    presentation = one.present(product)
    check_presentation(presentation)
    return product, presentation


def biased(directory: Path, station: str, km: float) -> str:
    """Return the packaged message with a constant error of the ranges of one station."""
    text = (missions_directory() / "data" / "orbit-fit-ranges.tdm").read_text("utf-8")
    names: list[str] = []
    lines = []
    for line in text.splitlines():
        if line == "META_START":
            names = []
        elif line.startswith("PARTICIPANT_"):
            names.append(line.split("=")[1].strip())
        elif line.startswith("RANGE = ") and station in names:
            *first, value = line.split(" ")
            line = " ".join([*first, f"{float(value) + km:.6f}"])
        lines.append(line)
    path = directory / "biased.tdm"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return str(path)


@pytest.mark.slow
@pytest.mark.parametrize(("station", "km"), [("CUIABA", 0.1), ("ALCANTARA", 1.5)])
def test_a_constant_error_that_explains_all_is_told(
    station: str, km: float, tmp_path: Path
) -> None:
    """20 and 300 standard deviations of one station's ranges: editing takes values of the other.

    With the error of 0.1 km the good station's values are left out too. The error is found to 4.5
    of its standard deviations, and the keys that are told make the data consistent.
    """
    path = biased(tmp_path, station, km)
    product, presentation = shown(data=[{"file": path}])
    assert product.answer == "inconsistent"
    first, hint, detail = presentation.verdict[:3]
    assert "values were left out" in first[:WIDTH]
    assert hint.startswith("A constant error of ")
    assert f'station = "{station}", range_m = {2e3 * km:.0f} }}]' in hint
    assert len(hint) <= WIDTH
    value = float(hint.split("error of ")[1].split(" m")[0])
    sigma = float(detail.split("estimated to ")[1].split(" m")[0])
    assert abs(value - 1e3 * km) < 4.5 * sigma
    assert sigma < 3.0
    if station == "CUIABA":
        # the good station suffered
        assert product.rows.edited[:2].sum() > 10
        assert np.abs(product.rows.mean).max() > 1.0
        return
    repaired, _ = shown(
        data=[{"file": path}], biases=[{"station": station, "range_m": 2e3 * km}]
    )  # fmt: skip
    assert repaired.answer == "consistent"
    assert repaired.hints == ()


@pytest.mark.slow
def test_noise_that_is_stated_too_small_is_told() -> None:
    """A tenth of the true standard deviations: 64 % are left out; scaled ones stand beside."""
    product, presentation = shown(noise=[{"range_m": 0.5, "range_rate_mm_s": 1}])
    assert product.answer == "inconsistent"
    assert product.rows.edited.sum() / product.rows.count.sum() > 0.5
    hint = presentation.verdict[1]
    assert hint.startswith("The residuals of all values are consistent with standard deviations")
    times = float(hint.split("deviations of ")[1].split(" times")[0])
    # a scale by medians of 152 values has an error of 1.17/√(2·152), 7 %
    assert times == pytest.approx(10.0, rel=0.2)
    scale = np.sqrt(product.squares)
    metrics = presentation.metrics
    assert metrics["fit_position_sigma_scaled"].value == pytest.approx(
        scale * metrics["fit_position_sigma"].value
    )
    assert any(f"they are {scale:.3g} times as large" in line for line in presentation.verdict)
    opm = read_opm(presentation.files["orbit-fit.opm"])
    assert any("not scaled by the residuals" in comment for comment in opm.comments)
    # the main values are not scaled
    assert opm.covariance is not None
    assert np.trace(opm.covariance[:3, :3]) == pytest.approx(
        metrics["fit_position_sigma"].value ** 2, rel=1e-6
    )
    assert "not scaled" in presentation.files["orbit-fit.oem"]


@pytest.mark.parametrize("place", [[0, 0, 0], [6000, 0, 0], [0, 0, -6356]])
def test_a_start_below_the_ground_is_refused(place: list[float]) -> None:
    """The polar radius of WGS 84 is 6356.752 km."""
    start = {"epoch": sim.DATE, "position_km": place, "velocity_km_s": [0, 7, 0]}
    with pytest.raises(InputError, match=r"^start.position: expected a position above the ground"):
        stage(start=start).run(RecordingContext())


HOPELESS = {
    "geostationary": ([42164, 0, 0], [0, 3.07, 0], "below the horizon of its station at 152 of"),
    "reversed": ([1040, 6375, -3401], [6.2, -2.5, -2.9], "give a nearer start"),
    "opposite": ([-1045, -6370, 3405], [6.264, -2.591, -2.941], "below the horizon"),
    "falling": ([1045, 6370, -3405], [0, 0, 0], "below the ground at"),
}


@pytest.mark.parametrize(
    "name",
    ["geostationary", *(pytest.param(n, marks=pytest.mark.slow) for n in list(HOPELESS)[1:])],
)
def test_a_hopeless_start_ends_soon_and_says_why(name: str) -> None:
    """Before: thirty steps of thirty halvings each, and no word of the trajectory."""
    position, velocity, reason = HOPELESS[name]
    start = {"epoch": sim.DATE, "position_km": position, "velocity_km_s": velocity}
    product, presentation = shown(start=start)
    assert product.answer == "undecided"
    assert product.rounds == 1
    assert "it has not converged in" in presentation.verdict[0][:WIDTH]
    assert any(reason.lower() in line.lower() for line in presentation.verdict)
    assert any("Give a nearer start" in line for line in presentation.verdict)
    steps = int(presentation.verdict[0].split("converged in ")[1].split(" ")[0])
    assert steps <= 20
