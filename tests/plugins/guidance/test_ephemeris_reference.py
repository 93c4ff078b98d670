"""A flight in a plant's frame, written as an ephemeris and read back as a reference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import Motion, create
from hillsphere.errors import InputError
from hillsphere.formats.oem import read_oem, write_oem
from hillsphere.products import FlightSet, Trajectories
from hillsphere.testing import RecordingContext

EPOCH = "2027-06-01T00:00:00"
POLE = {"pole_right_ascension_deg": 317.67, "pole_declination_deg": 52.88,
        "prime_meridian_deg": 35.18}  # fmt: skip


def plant(kind: str = "hill", **keys: Any) -> Any:
    pole = keys.pop("pole", POLE)
    body = create("body", "moon", name="phobos", primary_name="mars", primary_gm_km3_s2=42828.37,
                  semi_major_axis_km=9376, eccentricity=0.0151, **pole)  # fmt: skip
    gravity = create("gravity", "point_mass", gm_m3_s2=7.06e5)
    return create("plant", kind, body=body, gravity=gravity, **keys)


def flown(which: Any, others: tuple[float, ...] = ()) -> FlightSet:
    names = tuple(v.name for v in which.states)
    x0 = np.array([3e4, -5e4, 2e4, 3.0, 8.0, -2.0, *others])
    path = Motion(which).propagate(x0, 6000.0, times_s=61)
    flights = Trajectories(
        which.frame, names, ("go",), ("go",), path.t_s[:, None], path.x[:, :, None]
    )
    return FlightSet(flights)


def written(which: Any, given: FlightSet, path: Path, centre: str = "moon") -> None:
    stage = create("stage", "ephemeris", plant=which, epoch=EPOCH, centre=centre,
                   needs={"flights": ["a"]})  # fmt: skip
    product = stage.run(RecordingContext(), flights=(given,))
    text = stage.present(product, flights=(given,)).files["go.oem"]
    assert isinstance(text, str)
    path.write_text(text)


@pytest.mark.parametrize("centre", ["moon", "primary"])
@pytest.mark.parametrize(
    ("which", "others"),
    [(plant(), {}), (plant("three_body", orbit="elliptic"), {"true_anomaly": 0.7})],
    ids=["hill", "ellipse"],
)
def test_a_flight_comes_back(
    which: Any, others: dict[str, float], centre: str, tmp_path: Path
) -> None:
    """To the digits of the message: 1 µm (about Mars, 9e6 m, 2e-9 of them by rounding) and nm/s."""
    path = tmp_path / "go.oem"
    given = flown(which, tuple(others.values()))
    written(which, given, path, centre)
    stage = create("stage", "ephemeris_reference", plant=which, file=str(path), epoch=EPOCH,
                   others=others)  # fmt: skip
    back = stage.run(RecordingContext())
    np.testing.assert_allclose(back.flights.t_s, given.flights.t_s, atol=1e-6)
    off = back.flights.x - given.flights.x
    assert np.linalg.norm(off[:3], axis=0).max() < 1e-6
    assert np.abs(off[3:6]).max() < 2e-9
    if others:
        assert np.abs(off[6]).max() < 1e-9
    shown = stage.present(back)
    assert "ephemeris_reference" in shown.tables
    assert back.deviation_m < 1e-3


def test_states_are_interpolated_as_the_message_says(tmp_path: Path) -> None:
    """Against the flight itself at other times: Lagrange's polynomials of degree 7 at 100 s."""
    which, path = plant(), tmp_path / "go.oem"
    given = flown(which)
    written(which, given, path)
    stage = create("stage", "ephemeris_reference", plant=which, file=str(path), epoch=EPOCH,
                   interval_s=37.0)  # fmt: skip
    back = stage.run(RecordingContext()).flights
    exact = Motion(which).propagate(given.flights.x[:, 0, 0], 6000.0, times_s=back.t_s[:, 0]).x
    assert np.abs(back.x[:3, :, 0] - exact[:3]).max() < 1e-4
    assert back.t_s.shape == (164, 1)


def test_a_closed_loop_follows_it(tmp_path: Path) -> None:
    which, path = plant(), tmp_path / "go.oem"
    written(which, flown(which), path)
    stage = create("stage", "ephemeris_reference", plant=which, file=str(path), epoch=EPOCH)
    reference = stage.run(RecordingContext())
    loop = create("stage", "closed_loop", plant=which, needs={"reference": "r"},
                  law=create("compensator", "open_loop", period_s=100.0),
                  samples=60, substeps=10)  # fmt: skip
    product = loop.run(RecordingContext(), reference=reference)
    assert np.nanmax(product.position_error_m) < 1e-3
    again = product.to_trajectories()
    assert again.x.shape == (6, 61, 1)
    np.testing.assert_allclose(again.x[:3, -1, 0], reference.flights.x[:3, -1, 0], atol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"center_name": "EARTH"}, "go.oem: CENTER_NAME: expected PHOBOS or MARS.* got EARTH"),
        (
            {"ref_frame": "ITRF"},
            "go.oem: REF_FRAME: expected EME2000, ICRF, GCRF or TEME, got ITRF",
        ),
    ],
)
def test_what_cannot_be_used_is_named(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    which, path = plant(), tmp_path / "go.oem"
    written(which, flown(which), path)
    (segment,) = read_oem(path.read_text())
    path.write_text(write_oem([replace(segment, **change)]))
    with pytest.raises(InputError, match=message):
        create("stage", "ephemeris_reference", plant=which, file=str(path), epoch=EPOCH).run(
            RecordingContext()
        )


def test_a_missing_pole_or_anomaly_is_named(tmp_path: Path) -> None:
    which, path = plant(), tmp_path / "go.oem"
    written(which, flown(which), path)
    with pytest.raises(InputError, match="pole_right_ascension_deg"):
        create("stage", "ephemeris_reference", plant=plant(pole={}), file=str(path), epoch=EPOCH)
    with pytest.raises(InputError, match=r"others.true_anomaly: expected"):
        create("stage", "ephemeris_reference", plant=plant("three_body", orbit="elliptic"),
               file=str(path), epoch=EPOCH)  # fmt: skip
