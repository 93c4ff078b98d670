"""Messages that we write, read by other programs in environments of their own.

The interpreters are named by the environment variable ``HILLSPHERE_MESSAGE_READERS``, separated by
colons: of environments with ``ccsds-ndm-py`` (MPL-2.0) and with ``ccsds-ndm`` (GPL-3.0), which
have the same import name. Neither is imported here.
"""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hillsphere.formats.oem import read_oem, write_oem
from hillsphere.formats.opm import read_opm, write_opm

PYTHONS = [path for path in os.environ.get("HILLSPHERE_MESSAGE_READERS", "").split(":") if path]
OPM = Path(__file__).parents[1] / "data" / "opm" / "valid"
OEM = Path(__file__).parents[1] / "plugins" / "orbits" / "data" / "oem" / "valid"
READ = """
import json, sys
import ccsds_ndm
AXES = ("x", "y", "z", "x_dot", "y_dot", "z_dot")
def number(one):
    return float(getattr(one, "value", one))
found = []
for path in sys.argv[1:]:
    if hasattr(ccsds_ndm, "from_file"):
        message = ccsds_ndm.from_file(path)
        if type(message).__name__ == "Opm":
            state = message.segment.data.state_vector
            rows = [[number(getattr(state, axis)) for axis in AXES]]
        else:
            rows = [list(map(float, row)) for one in message.segments
                    for row in one.data.state_vector_numpy]
    else:
        from ccsds_ndm.ndm_io import NdmIo
        message = NdmIo().from_path(path)
        segments = message.body.segment
        segments = segments if isinstance(segments, list) else [segments]
        rows = []
        for one in segments:
            states = one.data.state_vector
            for state in states if isinstance(states, list) else [states]:
                rows.append([number(getattr(state, axis)) for axis in AXES])
    found.append(rows)
print(json.dumps(found))
"""


@pytest.mark.slow
@pytest.mark.parametrize("python", PYTHONS or [""])
def test_other_programs_read_what_we_write(python: str, tmp_path: Path) -> None:
    if not python:
        pytest.skip("HILLSPHERE_MESSAGE_READERS names no interpreter")
    expected: dict[str, list[list[float]]] = {}
    for source in sorted(OPM.glob("*.opm")):
        opm = read_opm(source.read_bytes().decode("utf-8"))
        if opm.manoeuvres and opm.mass_kg is None:
            # ccsds-ndm-py asks for a mass where there is a manoeuvre
            opm = replace(opm, mass_kg=100.0)
        for encoding in ("kvn", "xml"):
            path = tmp_path / f"{source.stem}.opm.{encoding}"
            path.write_text(write_opm(opm, encoding=encoding), "utf-8")
            expected[str(path)] = [(opm.x / 1e3).tolist()]
    for source in sorted(OEM.glob("*.oem")):
        segments = read_oem(source.read_bytes().decode("utf-8"))
        rows = np.concatenate([one.x.T for one in segments]) / 1e3
        for encoding in ("kvn", "xml"):
            path = tmp_path / f"{source.stem}.oem.{encoding}"
            path.write_text(write_oem(segments, encoding=encoding), "utf-8")
            expected[str(path)] = rows.tolist()
    done = subprocess.run(
        [python, "-c", READ, *expected], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    got = json.loads(done.stdout)
    assert len(got) == len(expected) > 50
    for (name, states), other in zip(expected.items(), got, strict=True):
        columns = np.array(other)[:, :6]
        np.testing.assert_allclose(columns, states, rtol=1e-15, atol=0, err_msg=name)
