"""Bodies where a SPICE kernel says, by a kernel made here."""

from __future__ import annotations

import os
import random
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hillsphere import create
from hillsphere.base.constants import NOMINAL_SOLAR_GM_M3_S2 as GM
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.ephemeris import Ephemeris, KeplerOrbit
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


def refused(path: Path, message: str) -> None:
    with pytest.raises(InputError, match=message):
        create("body", "spice", kernel=str(path), target=str(BODY)).states(np.zeros(1))


def test_a_text_kernel_does_not_choose_what_is_read(kernel: Path, tmp_path: Path) -> None:
    """A meta-kernel named further files, and SPICE read them wherever they were."""
    meta = tmp_path / "body.bsp"
    meta.write_text(f"KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( '{kernel}' )\n", "utf-8")
    refused(meta, r"'body\.bsp' is no binary SPK kernel: it begins with b'KPL/MK")


@pytest.mark.parametrize("word", [b"DAF/PCK ", b"DAF/CK  ", b"DAS/DSK ", b"DAFETF N", b""])
def test_only_what_is_needed_is_let_through(kernel: Path, tmp_path: Path, word: bytes) -> None:
    other = tmp_path / "other.bsp"
    other.write_bytes(word + kernel.read_bytes()[8:] if word else b"")
    refused(other, "is no binary SPK kernel")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_a_fifo_or_a_device_is_not_opened(tmp_path: Path) -> None:
    pytest.importorskip("spiceypy")
    os.mkfifo(tmp_path / "pipe.bsp")
    refused(tmp_path / "pipe.bsp", "cannot be read as a SPICE kernel: it is a FIFO")
    (tmp_path / "zero.bsp").symlink_to("/dev/zero")
    refused(tmp_path / "zero.bsp", "cannot be read as a SPICE kernel: it is a device")


@pytest.mark.parametrize(
    ("at", "form", "value", "message"),
    [
        # The file record's pointer to the first summary record stands in its bytes 76 to 79; a
        # summary record begins with the next one's number, the former's, and how many it holds.
        (76, "<i", 0x7FFFFFFF, "said to be number 2147483647"),
        (None, "<d", None, "form a circle"),
        (16, "<d", 1e9, r"claims 1e\+09 summaries"),
        (24 + 36, "<i", 0x7FFFFFFF, "has an array from"),
    ],
)
def test_records_that_would_lead_spice_astray(
    kernel: Path, tmp_path: Path, at: int | None, form: str, value: float | None, message: str
) -> None:
    """A record that is its own successor is followed without end."""
    content = bytearray(kernel.read_bytes())
    (record,) = struct.unpack_from("<i", content, 76)
    begin = (record - 1) * 1024
    place = at if at == 76 else begin + (at or 0)
    struct.pack_into(form, content, place, record if value is None else value)
    path = tmp_path / "astray.bsp"
    path.write_bytes(content)
    refused(path, message)


# --- damage behind the records, which CSPICE believes


@pytest.fixture(scope="module")
def interpolated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make an SPK kernel of type 8, whose last numbers are start, step, window - 1 and count."""
    spice = pytest.importorskip("spiceypy")
    path = tmp_path_factory.mktemp("interpolated") / "body.bsp"
    times: Array = np.arange(0.0, 101.0) * DAY
    states = np.ascontiguousarray(1e-3 * orbit().states(times, J2000).T)
    handle = spice.spkopn(str(path), "made for a test", 0)
    spice.spkw08(
        handle, BODY, 10, "ECLIPJ2000", times[0], times[-1], "a planet", 7, len(times), states,
        times[0], DAY,
    )  # fmt: skip
    spice.spkcls(handle)
    return path


def end_of_array(content: bytes | bytearray) -> int:
    """Return the place of the last number of the first array, in bytes."""
    (record,) = struct.unpack_from("<i", content, 76)
    (end,) = struct.unpack_from("<i", content, (record - 1) * 1024 + 24 + 36)
    return int(8 * (end - 1))


@pytest.mark.parametrize("window", [100.0, 1e300])
def test_a_kernel_that_ends_spice_ends_nothing_else(
    interpolated: Path, tmp_path: Path, window: float
) -> None:
    """CSPICE read beyond its arrays, and the run ended with SIGSEGV or SIGABRT."""
    content = bytearray(interpolated.read_bytes())
    struct.pack_into("<d", content, end_of_array(content) - 8, window)
    path = tmp_path / "window.bsp"
    path.write_bytes(content)
    refused(path, r"kernel 'window\.bsp' is damaged: SPICE ended at it with signal \d+")


def test_a_kernel_that_keeps_spice_busy_is_refused(
    kernel: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hillsphere.model.spice._LIMIT_S", 1.0)
    monkeypatch.setattr("hillsphere.model.spice_calls._START", "import time; time.sleep(60)")
    refused(kernel, "SPICE did not come to an end in 1 s")


def flip_and_read(sound: Path, tmp_path: Path, count: int) -> None:
    content = sound.read_bytes()
    path = tmp_path / "flipped.bsp"
    times = np.array([0.0, 3.3, 77.7]) * DAY
    for seed in range(count):
        chance, changed = random.Random(seed), bytearray(content)
        for _ in range(chance.choice([1, 4, 32])):
            changed[chance.randrange(1024, len(content))] ^= 1 << chance.randrange(8)
        path.write_bytes(changed)
        body = create("body", "spice", kernel=str(path), target=str(BODY))
        assert isinstance(body, Ephemeris)
        said, states = "", np.zeros(0)
        try:
            states = body.states(times, J2000)
        except InputError as error:
            said = str(error)
        assert "flipped.bsp" in said if said else np.isfinite(states).all(), seed


def test_flipped_bits(interpolated: Path, tmp_path: Path) -> None:
    flip_and_read(interpolated, tmp_path, 12)


@pytest.mark.slow
def test_many_flipped_bits(interpolated: Path, kernel: Path, tmp_path: Path) -> None:
    for sound in (interpolated, kernel):
        flip_and_read(sound, tmp_path, 300)


PROGRAM = """
import os, sys
seen = []
sys.addaudithook(lambda event, given: seen.append((event, given)))
from hillsphere.model.spice_calls import spice_environment
os.environ.update(spice_environment('a test'))
import spiceypy
here = os.getcwd()
print([str(given[0]) for event, given in seen if event == "ctypes.dlopen" and given[0]
       and os.path.realpath(str(given[0])).startswith(here)])
print(sum(event == "subprocess.Popen" for event, given in seen))
"""


def test_no_library_is_taken_from_the_working_directory(tmp_path: Path) -> None:
    """Spiceypy asks the linker for libcspice.so, with the working directory before the others."""
    spice = pytest.importorskip("spiceypy")
    library = Path(spice.__file__).parent / "utils" / "libcspice.so"
    if not library.is_file():
        pytest.skip("spiceypy has its library elsewhere")
    shutil.copy(library, tmp_path)
    kept = {k: v for k, v in os.environ.items() if k != "CSPICE_SHARED_LIB"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", PROGRAM], cwd=tmp_path, env=kept, capture_output=True,
        text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["[]", "0"]


def test_a_kernel_of_before_1993_is_read(kernel: Path, tmp_path: Path) -> None:
    """As DE421 is: it begins with NAIF/DAF, and does not say how its numbers are written."""
    content = bytearray(kernel.read_bytes())
    content[:8] = b"NAIF/DAF"
    path = tmp_path / "old.bsp"
    path.write_bytes(content)
    body = create("body", "spice", kernel=str(path), target=str(BODY))
    assert isinstance(body, Ephemeris)
    np.testing.assert_allclose(
        body.states(np.zeros(1), J2000)[:3], orbit().states(np.zeros(1), J2000)[:3], atol=1e-2
    )
