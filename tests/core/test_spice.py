"""Bodies where a SPICE kernel says, by a kernel made here."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from hillsphere import create
from hillsphere.bodies import NOMINAL_SOLAR_GM_M3_S2 as GM
from hillsphere.ephemeris import Ephemeris, KeplerOrbit
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.testing import example
from hillsphere.time import J2000, Epoch

BODY = 20099942
DAY = 86400.0


def orbit() -> KeplerOrbit:
    made = example("body", "solar_orbit")
    assert isinstance(made, KeplerOrbit)
    return made


@pytest.fixture(scope="module")
def kernel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make an SPK kernel (type 5: two-body between states) of 100 days from J2000."""
    spice = pytest.importorskip("spiceypy")
    path = tmp_path_factory.mktemp("kernels") / "body.bsp"
    times: Array = np.arange(0.0, 101.0) * DAY
    states = np.ascontiguousarray(1e-3 * orbit().states(times, J2000).T)
    handle = spice.spkopn(str(path), "made for a test", 0)
    spice.spkw05(
        handle, BODY, 10, "ECLIPJ2000", times[0], times[-1], "a planet", 1e-9 * GM, len(times),
        states, times,
    )  # fmt: skip
    spice.spkcls(handle)
    return path


def test_states_of_a_kernel(kernel: Path) -> None:
    body = create("body", "spice", kernel=str(kernel), target=str(BODY))
    assert isinstance(body, Ephemeris)
    epoch = Epoch.parse("2000-02-01T00:00:00", "TDB")
    t = np.array([0.0, 0.3, 20.7]) * DAY
    found, want = body.states(t, epoch), orbit().states(t, epoch)
    # doubles of kilometres: 3e-5 m
    np.testing.assert_allclose(found[:3], want[:3], rtol=0, atol=1e-2)
    np.testing.assert_allclose(found[3:], want[3:], rtol=0, atol=1e-8)


def test_kernels_do_not_stay_loaded(kernel: Path) -> None:
    spice = pytest.importorskip("spiceypy")
    before = spice.ktotal("ALL")
    create("body", "spice", kernel=str(kernel), target=str(BODY)).states(np.zeros(1))
    assert spice.ktotal("ALL") == before


def test_refusals(kernel: Path, tmp_path: Path) -> None:
    body = create("body", "spice", kernel=str(kernel), target=str(BODY))
    with pytest.raises(InputError, match=r"does not cover 2000-04-1.* covers 2000-01-01T12"):
        body.states(np.array([101.0 * DAY]), J2000)
    with pytest.raises(InputError, match=rf"does not hold the body '399'; it holds {BODY}"):
        create("body", "spice", kernel=str(kernel), target="399").states(np.zeros(1))
    with pytest.raises(InputError, match="SPICE knows no body 'nowhere'"):
        create("body", "spice", kernel=str(kernel), target="nowhere").states(np.zeros(1))
    away = create("body", "spice", kernel=str(kernel), target=str(BODY), centre="399")
    with pytest.raises(InputError, match="does not lead from '399'"):
        away.states(np.zeros(1), J2000)
    other = tmp_path / "text.bsp"
    other.write_text("no kernel", "utf-8")
    with pytest.raises(InputError, match=r"SPK|SPICE"):
        create("body", "spice", kernel=str(other), target=str(BODY)).states(np.zeros(1))
    absent = create("body", "spice", kernel=str(tmp_path / "absent.bsp"), target=str(BODY))
    with pytest.raises(InputError, match="SPICE kernel"):
        absent.states(np.zeros(1))


def test_without_spiceypy(kernel: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "spiceypy", None)
    with pytest.raises(InputError, match=r"pip install 'hillsphere\[spice\]'"):
        create("body", "spice", kernel=str(kernel), target=str(BODY)).states(np.zeros(1))
