"""Large files: time and memory of the readers, beside other programs that read them.

Each file is generated in a temporary directory and read in a process of its own. The memory is the
largest that this process ever held (Linux), less what it holds after its imports. A reader of
another program is measured where it is installed: trimesh here, or ccsds-ndm by a Python whose path
is in ``HILLSPHERE_NDM_PYTHON``.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

import numpy as np

LIMIT_S = 600.0
"""Longest time that a reader is given."""
READERS = {
    "icgem_degree_2190": (
        "from hillsphere_gravity.icgem import read_icgem", "read_icgem(path, None, 20)"
    ),
    "obj_3e6_faces": ("from hillsphere.formats.plates import read_shape", "read_shape(path)"),
    "obj_3e6_faces_shape": (
        "from hillsphere.model.shapes.polyhedron import PolyhedronShape\n"
        "from hillsphere.model.shapes.specs import PolyhedronShapeSpec",
        "PolyhedronShape(PolyhedronShapeSpec(file=path, length_unit='m')).describe()",
    ),
    "plates_3e6_faces": ("from hillsphere.formats.plates import read_shape", "read_shape(path)"),
    "obj_3e6_faces_trimesh": ("import trimesh", "trimesh.load_mesh(path, process=False)"),
    "oem_100_mb": (
        "from pathlib import Path; from hillsphere.formats.oem import read_oem",
        "read_oem(Path(path).read_text('utf-8'), path)",
    ),
    "oem_100_mb_ccsds_ndm": (
        "from ccsds_ndm.ndm_io import NdmIo", "NdmIo().from_path(path)",
    ),
    "tdm_1e6_rows": (
        "from pathlib import Path; from hillsphere.formats.tdm import read_tdm",
        "read_tdm(Path(path).read_text('utf-8'), path)",
    ),
}  # fmt: skip
"""Name → imports and call. A shape is read, checked and described, as at the start of a mission."""
_PROGRAM = """
import json, re, sys, time
path = sys.argv[1]
{imports}
def largest():  # of this program; getrusage also counts what its parent held at its start
    with open("/proc/self/status") as status:
        return int(re.search(r"VmHWM:\\s+(\\d+) kB", status.read())[1])
before = largest()
begin = time.process_time()
content = {call}
seconds = time.process_time() - begin
peak = largest()
print(json.dumps([seconds, (peak - before) * 1024.0]))
"""


def measure(name: str, path: Path, python: str = sys.executable) -> tuple[float, float] | None:
    """Return CPU seconds and bytes that a reader takes; None if it fails or takes too long."""
    imports, call = READERS[name]
    program = _PROGRAM.format(imports=imports, call=call)
    try:
        done = subprocess.run(
            [python, "-c", program, str(path)], capture_output=True, text=True, timeout=LIMIT_S,
            env={**os.environ, "OMP_NUM_THREADS": "1"}, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None
    if done.returncode:
        print(f"{name}: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return None
    seconds, memory = json.loads(done.stdout.splitlines()[-1])
    return float(seconds), float(memory)


def write_icgem(file: TextIO, degree: int = 2190) -> None:
    """Write a field as large as EGM2008: 2.4 million rows, 190 MB."""
    rng = np.random.default_rng(1)
    file.write(
        "begin_of_head\nproduct_type gravity_field\nmodelname large\n"
        "earth_gravity_constant 3.986004415E+14\nradius 6378136.3\n"
        f"max_degree {degree}\nerrors formal\nnorm fully_normalized\ntide_system tide_free\n"
        "end_of_head\n"
    )
    for n in range(degree + 1):
        values = rng.normal(size=(n + 1, 2)) * 1e-6 / (n + 1)
        values[0, 1] = 0.0
        rows = zip(range(n + 1), *values.T.tolist(), strict=True)
        file.writelines(
            f"gfc {n:4d} {m:4d} {c:20.12E} {s:20.12E}  1.0000E-12  1.0000E-12\n" for m, c, s in rows
        )


def write_mesh(file: TextIO, of_plates: bool, columns: int = 1732, rows: int = 867) -> None:
    """Write a closed mesh of three million triangles, as OBJ or as a plate model, 130 MB."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rows + 1)[1:-1, None]
    longitude = np.arange(columns) * 2.0 * np.pi / columns
    radius = 1.0 + 0.1 * np.sin(3.0 * longitude) * np.cos(latitude)
    rings = radius * np.stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude),
         np.sin(latitude) + 0.0 * longitude]
    )  # fmt: skip
    vertices = np.vstack([[0.0, 0.0, -1.0], rings.reshape(3, -1).T, [0.0, 0.0, 1.0]])
    place = 2 + np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    east = np.roll(place, -1, axis=1)
    pole = np.ones(columns, dtype=int)
    faces = np.vstack(
        [
            np.stack([pole, east[0], place[0]], axis=1),
            np.stack([place[:-1], east[:-1], east[1:]], axis=-1).reshape(-1, 3),
            np.stack([place[:-1], east[1:], place[1:]], axis=-1).reshape(-1, 3),
            np.stack([place[-1], east[-1], len(vertices) * pole], axis=1),
        ]
    )
    if of_plates:
        file.write(f"{len(vertices)} {len(faces)}\n")
    v, f = ("", "") if of_plates else ("v ", "f ")
    file.writelines(f"{v}{x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in vertices.tolist())
    file.writelines(f"{f}{i} {j} {k}\n" for i, j, k in faces.tolist())


def write_oem(file: TextIO, states: int = 800_000) -> None:
    """Write an ephemeris of 100 MB."""
    file.write(
        "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-11-21T10:00:00\nORIGINATOR = TEST\n"
        "META_START\nOBJECT_NAME = LARGE\nOBJECT_ID = 2024-999A\nCENTER_NAME = EARTH\n"
        "REF_FRAME = ICRF\nTIME_SYSTEM = TDB\nSTART_TIME = 2027-01-01T00:00:00.000\n"
        f"STOP_TIME = {_time(states - 1)}\nMETA_STOP\n"
    )
    phase = np.arange(states) * 1e-3
    x, y = 7000.0 * np.cos(phase), 7000.0 * np.sin(phase)
    file.writelines(
        f"{_time(k)} {a:.9f} {b:.9f} {0.1 * b:.9f} {-b * 1e-3:.12f} {a * 1e-3:.12f} "
        f"{a * 1e-4:.12f}\n"
        for k, (a, b) in enumerate(zip(x.tolist(), y.tolist(), strict=True))
    )


def write_tdm(file: TextIO, records: int = 1_000_000) -> None:
    """Write a message of pairs of angles, 44 MB."""
    file.write(
        "CCSDS_TDM_VERS = 2.0\nCREATION_DATE = 2026-11-21T10:00:00\nORIGINATOR = TEST\n"
        "META_START\nTIME_SYSTEM = UTC\nPARTICIPANT_1 = STATION\nPARTICIPANT_2 = LARGE\n"
        "MODE = SEQUENTIAL\nPATH = 2,1\nANGLE_TYPE = AZEL\nMETA_STOP\nDATA_START\n"
    )
    for k in range(records // 2):
        time = _time(k)
        file.write(f"ANGLE_1 = {time} {k * 1e-3 % 360.0:.6f}\n")
        file.write(f"ANGLE_2 = {time} {k * 1e-4 % 90.0:.6f}\n")
    file.write("DATA_STOP\n")


def _time(second: int) -> str:
    day, rest = divmod(second, 86400)
    return f"2027-01-{1 + day:02d}T{rest // 3600:02d}:{rest // 60 % 60:02d}:{rest % 60:02d}.000"


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    others: dict[str, list[tuple[str, str | None]]] = {
        "obj_3e6_faces": [
            ("obj_3e6_faces_shape", sys.executable), ("obj_3e6_faces_trimesh", _trimesh_python())
        ],
        "oem_100_mb": [("oem_100_mb_ccsds_ndm", os.environ.get("HILLSPHERE_NDM_PYTHON"))],
    }  # fmt: skip
    files: dict[str, tuple[str, Callable[[TextIO], Any]]] = {
        "icgem_degree_2190": ("large.gfc", write_icgem),
        "obj_3e6_faces": ("large.obj", lambda file: write_mesh(file, False)),
        "plates_3e6_faces": ("large.plt", lambda file: write_mesh(file, True)),
        "oem_100_mb": ("large.oem", write_oem),
        "tdm_1e6_rows": ("large.tdm", write_tdm),
    }
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (file_name, write) in files.items():
            path = Path(folder) / file_name
            with path.open("w", encoding="utf-8") as file:
                write(file)
            size = path.stat().st_size
            found[f"{name}_file_mb"] = size / 1e6
            for reader, python in [(name, sys.executable), *others.get(name, [])]:
                measured = measure(reader, path, python) if python else None
                if measured is not None:
                    found[f"{reader}_cpu_s"] = measured[0]
                    found[f"{reader}_memory_per_file"] = measured[1] / size
            path.unlink()
    return found


def _trimesh_python() -> str | None:
    return sys.executable if importlib.util.find_spec("trimesh") else None


if __name__ == "__main__":
    for key, value in figures().items():
        print(f"{key:45} {value:10.3g}")
