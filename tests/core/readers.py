"""Every reader of the framework and its plugins, each with a sound file: one table for tests.

Whatever opens a file that a user, another program or an earlier run wrote stands here. A test
looks for modules that open or parse files and are not named in `Reader.modules` or `NO_READERS`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from hillsphere import create
from hillsphere.base.orientation import OrientationTable
from hillsphere.base.paths import missions_directory
from hillsphere.formats.ephemeris_files import segments_of_object
from hillsphere.formats.mesh_files import read_mesh_file
from hillsphere.formats.ndm import read_ndm
from hillsphere.formats.obj import read_obj
from hillsphere.formats.ocm import read_ocm
from hillsphere.formats.oem import OemSegment, read_oem, write_oem
from hillsphere.formats.opm import read_opm
from hillsphere.formats.plates import read_plates, read_shape
from hillsphere.formats.shape_harmonics import read_shape_harmonics
from hillsphere.formats.tdm import read_tdm
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere.mission import load_mission
from hillsphere.products import PeriodicOrbits, load_product, save_product
from hillsphere.products.columns import ColumnFile, write_columns
from hillsphere.show.reference import ReferenceTable
from hillsphere.time import Epoch
from hillsphere.uncertainty.samples import read_columns
from hillsphere_controllers.stages.linear_models.systems import system_from_file
from hillsphere_estimators.navigation_comparison.stage import read_published_errors
from hillsphere_estimators.orbit_fit.reading import read_tracking_data
from hillsphere_estimators.orbit_fit.specs import OrbitFitSpec
from hillsphere_gravity.coefficient_rows import read_coefficient_rows
from hillsphere_gravity.cof import read_cof
from hillsphere_gravity.icgem import read_icgem
from hillsphere_gravity.shadr import read_shadr
from hillsphere_tracking.live.feed import ReplayFeed
from hillsphere_tracking.live.inputs import input_of
from hillsphere_tracking.memory import read_memory
from hillsphere_tracking.passes.sources import orbits_of_file
from hillsphere_tracking.pointing.pass_log import read_pass_log

__all__ = ["NO_READERS", "READERS", "Reader"]


@dataclass(frozen=True)
class Reader:
    """One way in.

    Parameters
    ----------
    name : str
        Of the test case.
    file : str
        Name of the file.
    sound : callable
        Path → a sound file is written there.
    read : callable
        Path → reads it.
    modules : tuple of str
        The modules that open or parse it.
    binary : bool
        Whether it has no lines.
    of_text : bool
        Whether the reader is given the text, not the path: messages then name the line.
    """

    name: str
    file: str
    sound: Callable[[Path], object]
    read: Callable[[Path], object]
    modules: tuple[str, ...]
    binary: bool = False
    of_text: bool = False


DATA = missions_directory() / "data"


def _copy(name: str) -> Callable[[Path], object]:
    return lambda path: path.write_bytes((DATA / name).read_bytes())


def _shape(name: str) -> Callable[[Path], object]:
    return lambda path: path.write_bytes((_FILES / "shapes" / name).read_bytes())


def _text(text: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(text, "utf-8")


def _of_text(read: Callable[[str], object]) -> Callable[[Path], object]:
    """Read as a caller of a reader of text does: bytes that are no UTF-8 are replaced."""
    return lambda path: read(path.read_text("utf-8", "replace"))


MISSION = """format = 1
name = "small"
title = "Small"
seed = 5
[body.moon]
type = "moon"
name = "phobos"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377
[gravity.field]
type = "ellipsoid"
axes_km = [13.03, 11.40, 9.14]
density_g_cm3 = 1.86
[plant.hill]
type = "hill"
body = "moon"
gravity = "field"
[dispersions.field]
type = "normal"
of = "gravity.field"
parameters = ["C*"]
sigma_relative = 0.05
[stage.family]
type = "qso_family"
plant = "hill"
x_amplitudes_km = [60, 30, 20]
"""
COLUMNS = "# drawn elsewhere\ngravity.phobos.gm,state.x\n7.1e5,20.1\n7.0e5,19.9\n"
SHADR = """ 1.11000000E+01, 7.08750000E-04, 1.0E-08,   3,   3,   1, 0.0, 0.0
    2,    0,-4.698E-02, 0.0, 1.0E-04, 0.0
    2,    2, 2.276E-02,-2.02E-04, 2.0E-04, 3.0E-04
    3,    1,-3.09E-03, 1.81E-03, 0.0, 0.0
"""
_FILES = Path(__file__).parents[1] / "data"
PLATES = (_FILES / "shapes" / "one-count.plt").read_text("utf-8")
COF = (_FILES / "gravity" / "small.cof").read_text("utf-8")
OPM = (_FILES / "opm" / "valid" / "full.opm").read_text("utf-8")
OPM_XML = (_FILES / "opm" / "valid" / "full.xml").read_text("utf-8")
OCM = (_FILES / "ocm" / "valid" / "full.ocm").read_text("utf-8")
OCM_XML = (_FILES / "ocm" / "valid" / "full.xml").read_text("utf-8")
NDM = (_FILES / "ndm" / "valid" / "prefixed.xml").read_text("utf-8")
ROWS = (_FILES / "gravity" / "rows.txt").read_text("utf-8")
TERMS = (_FILES / "gravity" / "time-1.gfc").read_text("utf-8")
OCTAHEDRON = """o body
v 10 0 0
v -9 0 0
v 0 9 0
v 0 -9 0
v 0 0 8
v 0 0 -8
f 1 3 5
f 3 2 5
f 2 4 5
f 4 1 5
f 3 1 6
f 2 3 6
f 4 2 6
f 1 4 6
"""
GRID = """# radii
9.1 9.1 9.1 9.1
11.0, 10.1, 11.1, 10.0
13.0 11.4 13.0 11.4
11.0 10.1 11.1 10.0
9.1 9.1 9.1 9.1
"""
# CCSDS 502.0-B, the example of an OMM with TLE-related data
OMM = """CCSDS_OMM_VERS = 2.0
CREATION_DATE = 2007-065T16:00:00
ORIGINATOR = NOAA/USA
OBJECT_NAME = GOES 9
OBJECT_ID = 1995-025A
CENTER_NAME = EARTH
REF_FRAME = TEME
TIME_SYSTEM = UTC
MEAN_ELEMENT_THEORY = SGP/SGP4
EPOCH = 2007-064T10:34:41.4264
MEAN_MOTION = 1.00273272 [rev/day]
ECCENTRICITY = 0.0005013
INCLINATION = 3.0539 [deg]
RA_OF_ASC_NODE = 81.7939
ARG_OF_PERICENTER = 249.2363
MEAN_ANOMALY = 150.1602
NORAD_CAT_ID = 23581
BSTAR = 0.0001
"""
OMM_XML = "<ndm><omm><body>" + "".join(
    f"<{key.strip()}>{value.split('[')[0].strip()}</{key.strip()}>"
    for key, _, value in (line.partition("=") for line in OMM.splitlines())
) + "</body></omm></ndm>"  # fmt: skip
# Vallado, Revisiting Spacetrack Report #3, catalogue number 5
_PAIRS = [
    (key.strip(), value.partition("[")[0].strip())
    for key, sign, value in (line.partition("=") for line in OMM.splitlines())
    if sign
]
OMM_JSON = json.dumps([dict(_PAIRS)])
OMM_CSV = "\n".join(",".join(row) for row in zip(*_PAIRS, strict=True)) + "\n"
TLE = """VANGUARD 1
1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753
2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667
"""
TDM = """CCSDS_TDM_VERS = 2.0
CREATION_DATE = 2026-11-21T10:00:00
ORIGINATOR = TEST
META_START
TIME_SYSTEM = UTC
PARTICIPANT_1 = ALCANTARA
PARTICIPANT_2 = SCD1
MODE = SEQUENTIAL
PATH = 2,1
RANGE_UNITS = km
ANGLE_TYPE = AZEL
META_STOP
DATA_START
ANGLE_1 = 2026-11-21T09:00:00.000Z 359.5
ANGLE_2 = 2026-11-21T09:00:00.000Z 5.25
RANGE = 2026-11-21T09:00:00.000Z 2500.125
ANGLE_1 = 2026-325T09:00:01.5 -0.25
ANGLE_2 = 2026-325T09:00:01.5 90
DATA_STOP
"""
TDM_XML = """<?xml version="1.0" encoding="UTF-8"?>
<ndm:tdm xmlns:ndm="urn:ccsds:schema:ndmxml" id="CCSDS_TDM_VERS" version="2.0">
<header><CREATION_DATE>2026-11-21T10:00:00</CREATION_DATE><ORIGINATOR>TEST</ORIGINATOR></header>
<body><segment>
<metadata><TIME_SYSTEM>UTC</TIME_SYSTEM>
<PARTICIPANT_1>ALCANTARA</PARTICIPANT_1><PARTICIPANT_2>SCD1</PARTICIPANT_2>
<MODE>SEQUENTIAL</MODE><PATH>2,1</PATH><ANGLE_TYPE>AZEL</ANGLE_TYPE></metadata>
<data>
<observation><EPOCH>2026-11-21T09:00:00</EPOCH><ANGLE_1>359.5</ANGLE_1></observation>
<observation><EPOCH>2026-11-21T09:00:00</EPOCH><ANGLE_2>5.25</ANGLE_2></observation>
<observation><EPOCH>2026-11-21T09:00:01.5</EPOCH><ANGLE_1>-0.25</ANGLE_1></observation>
<observation><EPOCH>2026-11-21T09:00:01.5</EPOCH><ANGLE_2>90</ANGLE_2></observation>
</data></segment></body></ndm:tdm>
"""
ANGLES = """utc,azimuth_deg,elevation_deg,sigma_deg
2026-11-21T09:00:00Z,359.5,5.25,0.1
2026-11-21T09:00:01Z,0.5,6.25,0.1
2026-11-21T09:00:02Z,1.5,7.25,
"""


def _oem(path: Path) -> None:
    rng = np.random.default_rng(3)
    segment = OemSegment(
        object_name="QSO-H",
        object_id="2024-999A",
        center_name="MARS",
        ref_frame="ICRF",
        epoch=Epoch.parse("2027-06-01T06:30:00.5", "TDB"),
        t_s=np.arange(12.0) * 600.0,
        x=np.concatenate([rng.normal(0, 9e6, (3, 12)), rng.normal(0, 2e3, (3, 12))]),
    )
    encoding = "xml" if path.suffix == ".xml" else "kvn"
    path.write_text(write_oem([segment], encoding=encoding), "utf-8")


def _orientation(path: Path) -> None:
    import astropy_iers_data

    text = Path(astropy_iers_data.IERS_A_FILE).read_text("ascii")
    path.write_text("".join(text.splitlines(keepends=True)[-500:-330]), "ascii")


def _product(path: Path) -> None:
    rng = np.random.default_rng(7)
    orbits = PeriodicOrbits(
        frame="hill:phobos",
        states=("x", "y", "z", "vx", "vy", "vz"),
        x0=rng.normal(size=(6, 3)),
        period_s=rng.normal(size=3),
        integral=np.full(3, np.nan),
        monodromy=np.asfortranarray(rng.normal(size=(6, 6, 3))),
        residual=np.zeros(3),
        labels=("1", "2", "3"),
        length_m=23864.25,
        time_s=4387.63,
    )
    save_product(path, orbits)


def _matrices() -> dict[str, Array]:
    a = np.array([[-1.0, 0.5], [0.0, -2.0]])
    return {"a": a, "b": np.eye(2), "c": np.eye(2), "d": np.zeros((2, 2))}


def _npz(path: Path) -> None:
    buffer = BytesIO()
    np.savez(buffer, dt_s=np.array(0.1), **_matrices())  # type: ignore[arg-type]
    path.write_bytes(buffer.getvalue())


def _system_product(path: Path) -> None:
    save_product(path, LtiSystem(**_matrices()))  # type: ignore[arg-type]


def _columns(path: Path) -> None:
    columns = {"case": np.arange(3), "values": np.linspace(0.0, 1.0, 6).reshape(2, 3)}
    write_columns(path, columns, {"stage": "cases"})


def _all_columns(path: Path) -> None:
    with ColumnFile(path) as file:
        for name in ("case", "values"):
            file.read(name)


def _memory(path: Path) -> None:
    from hillsphere_tracking.memory import Calibration, write_memory

    calibration = Calibration(
        Epoch.parse("2026-11-21T09:00:00", "UTC"), np.array([1e-3, 2e-3, 0.01]),
        np.diag([1e-8, 4e-8, 1e-6]), 3,
    )  # fmt: skip
    write_memory(path, {"Alcântara": calibration})


def _pass_log(path: Path) -> None:
    from hillsphere_tracking.pointing.pass_log import PassLog, write_pass_log

    times = np.arange(5.0)
    angles = 0.01 * times
    write_pass_log(
        path,
        PassLog(
            Epoch.parse("2026-11-21T09:00:00", "UTC"), times, angles, angles, np.full(5, 1e-3),
            np.array([True, True, False, True, True]), angles, angles, angles, angles,
        ),
    )  # fmt: skip


def _measured(path: Path) -> None:
    with ExitStack() as stack:
        feed, _ = input_of(stack, str(path), None, True, 1.0)
        assert isinstance(feed, ReplayFeed)
        feed.until(feed.first.epoch, 1e6)


def _fitted(path: Path) -> None:
    """Read as the stage ``orbit_fit`` does."""
    keys = {
        "plant": "none", "data": [{"file": str(path)}], "noise": [{"angle_deg": 0.1, "range_m": 9}],
        "stations": [{"name": "ALCANTARA", "latitude_deg": -2, "longitude_deg": -44}],
        "start": {"epoch": "2026-11-21", "position_m": [1, 0, 0], "velocity_m_s": [0, 0, 0]},
    }  # fmt: skip
    read_tracking_data(OrbitFitSpec.model_validate(keys), Epoch.parse("2026-11-21", "UTC"))


FORMATS = "hillsphere.formats."
READERS = (
    Reader("mission", "small.toml", _text(MISSION), load_mission,
           ("hillsphere.mission.toml_source", "hillsphere.mission.toml_scan")),
    Reader("reference", "table.csv", _copy("phobos-3d-qso-table3.csv"), ReferenceTable.read,
           ("hillsphere.show.reference",)),
    Reader("columns", "rows.csv", _text(COLUMNS), read_columns,
           ("hillsphere.uncertainty.samples",)),
    Reader("orientation", "finals.data", _orientation, OrientationTable.read,
           ("hillsphere.base.orientation",)),
    Reader("icgem", "field.gfc", _copy("phobos-gravity-degree4.gfc"), read_icgem,
           (FORMATS + "icgem", FORMATS + "coefficients")),
    Reader("shadr", "field.tab", _text(SHADR), read_shadr, (FORMATS + "shadr",)),
    Reader("harmonics", "field.gfc", _copy("phobos-gravity-degree4.gfc"),
           lambda path: create("gravity", "harmonics", file=str(path)),
           ("hillsphere_gravity.harmonics",)),
    Reader("obj", "mesh.obj", _text(OCTAHEDRON), read_obj, (FORMATS + "obj",)),
    Reader("stl", "mesh.stl", _shape("octahedron.stl"), read_mesh_file, (FORMATS + "mesh_files",)),
    Reader("stl_binary", "mesh.stl", _shape("binary.stl"), read_mesh_file,
           (FORMATS + "mesh_files",), True),
    Reader("ply", "mesh.ply", _shape("octahedron.ply"), read_mesh_file, (FORMATS + "mesh_files",)),
    Reader("ply_binary", "mesh.ply", _shape("little.ply"), read_mesh_file,
           (FORMATS + "mesh_files",), True),
    Reader("plates", "mesh.plt", _text(PLATES), read_plates, (FORMATS + "plates",)),
    Reader("shape", "mesh.tab", _text(PLATES), read_shape, (FORMATS + "plates",)),
    Reader("cof", "field.cof", _text(COF), read_cof, ("hillsphere_gravity.cof",)),
    Reader("rows", "field.txt", _text(ROWS), read_coefficient_rows,
           ("hillsphere_gravity.coefficient_rows",)),
    Reader("time_variable", "field.gfc", _text(TERMS),
           lambda path: read_icgem(path, "2014-01-01"), ("hillsphere_gravity.icgem_terms",)),
    Reader("polyhedron", "mesh.obj", _text(OCTAHEDRON),
           lambda path: create("shape", "polyhedron", file=str(path), length_unit="km"),
           ("hillsphere.model.shapes.polyhedron",)),
    Reader("shape_harmonics", "shape.tab", _copy("eros-shape-degree8.tab"), read_shape_harmonics,
           (FORMATS + "shape_harmonics",)),
    Reader("harmonic_shape", "shape.tab", _copy("eros-shape-degree8.tab"),
           lambda path: create("shape", "harmonics", file=str(path), length_unit="km"),
           ("hillsphere.model.shapes.harmonic",)),
    Reader("grid", "grid.txt", _text(GRID),
           lambda path: create("shape", "grid", file=str(path), length_unit="km"),
           ("hillsphere.model.shapes.grid",)),
    Reader("oem", "flight.oem", _oem, _of_text(read_oem),
           (FORMATS + "oem", FORMATS + "oem_encodings", FORMATS + "oem_reading"), of_text=True),
    Reader("oem_xml", "flight.xml", _oem, _of_text(read_oem), (FORMATS + "ccsds_xml",),
           of_text=True),
    Reader("opm", "state.opm", _text(OPM), _of_text(read_opm),
           (FORMATS + "opm", FORMATS + "opm_encodings", FORMATS + "opm_reading",
            FORMATS + "ccsds_values"), of_text=True),
    Reader("opm_xml", "state.xml", _text(OPM_XML), _of_text(read_opm), (FORMATS + "ccsds_tree",),
           of_text=True),
    Reader("ocm", "orbit.ocm", _text(OCM), _of_text(read_ocm),
           (FORMATS + "ocm", FORMATS + "ocm_encodings", FORMATS + "ocm_reading"), of_text=True),
    Reader("ocm_xml", "orbit.xml", _text(OCM_XML), _of_text(read_ocm), (FORMATS + "ccsds_tree",),
           of_text=True),
    Reader("ndm", "all.xml", _text(NDM), _of_text(read_ndm),
           (FORMATS + "ndm", FORMATS + "ndm_parts"), of_text=True),
    Reader("format_opm", "state.opm", _text(OPM), lambda path: create("format", "opm").read(path),
           ("hillsphere_orbits.ephemeris.state_formats",)),
    Reader("tdm", "pass.tdm", _text(TDM), _of_text(read_tdm),
           (FORMATS + "tdm", FORMATS + "tdm_reading", FORMATS + "tdm_entries"), of_text=True),
    Reader("tdm_xml", "pass.xml", _text(TDM_XML), _of_text(read_tdm), (FORMATS + "tdm_entries",),
           of_text=True),
    Reader("tdm_lenient", "pass.tdm", _text(TDM),
           _of_text(lambda text: read_tdm(text, lenient=True, warn=len)),
           (FORMATS + "tdm_columns",), of_text=True),
    Reader("product", "family.npz", _product, load_product, ("hillsphere.products.product_codec",),
    True),
    Reader("column_file", "cases-0000000.npy", _columns, _all_columns,
           ("hillsphere.products.columns",), True),
    Reader("system_npz", "system.npz", _npz, system_from_file,
           ("hillsphere_controllers.stages.linear_models.systems",), True),
    Reader("system_product", "design.npz", _system_product, system_from_file,
           ("hillsphere_controllers.stages.linear_models.systems",), True),
    Reader("published", "table4.csv", _copy("apophis-formation-table4.csv"),
           lambda path: read_published_errors(path, 9, 9),
           ("hillsphere_estimators.navigation_comparison.stage",)),
    Reader("oem_object", "flight.oem", _oem, segments_of_object, (FORMATS + "ephemeris_files",)),
    Reader("tle", "two-line.txt", _text(TLE), orbits_of_file,
           ("hillsphere_tracking.passes.sources", "hillsphere_tracking.tle")),
    Reader("omm", "orbit.omm", _text(OMM), orbits_of_file, ("hillsphere_tracking.omm",)),
    Reader("omm_xml", "orbit.xml", _text(OMM_XML), orbits_of_file,
           ("hillsphere_tracking.omm_encodings",)),
    Reader("omm_json", "orbit.json", _text(OMM_JSON), orbits_of_file,
           ("hillsphere_tracking.omm_encodings",)),
    Reader("omm_csv", "orbit.csv", _text(OMM_CSV), orbits_of_file,
           ("hillsphere_tracking.omm_encodings",)),
    Reader("format_tle", "two-line.txt", _text(TLE),
           lambda path: create("format", "tle").read(path),
           ("hillsphere_tracking.element_formats",)),
    Reader("format_omm", "orbit.omm", _text(OMM), lambda path: create("format", "omm").read(path),
           ("hillsphere_tracking.element_formats",)),
    Reader("format_oem", "flight.oem", _oem, lambda path: create("format", "oem").read(path),
           ("hillsphere_orbits.ephemeris.state_formats",)),
    Reader("format_oem_xml", "flight.xml", _oem,
           lambda path: create("format", "oem_xml").read(path),
           ("hillsphere_orbits.ephemeris.state_formats",)),
    Reader("fit_angles", "angles.csv", _text(ANGLES), _fitted,
           ("hillsphere_estimators.orbit_fit.reading", FORMATS + "angle_table")),
    Reader("fit_tdm", "pass.tdm", _text(TDM), _fitted,
           ("hillsphere_estimators.orbit_fit.reading",)),
    Reader("memory", "stations.json", _memory, read_memory, ("hillsphere_tracking.memory",)),
    Reader("pass_log", "pass.csv", _pass_log, read_pass_log,
           ("hillsphere_tracking.pointing.pass_log",)),
    Reader("angles", "angles.csv", _text(ANGLES), _measured, ("hillsphere_tracking.live.inputs",)),
    Reader("angles_tdm", "angles.tdm", _text(TDM), _measured,
           ("hillsphere_tracking.live.measurements",)),
)  # fmt: skip

RUN_DIRECTORY = "a run directory, not a single file: test_resume.py, test_store.py"
NO_READERS = {
    "hillsphere.base.atomic": "writes",
    "hillsphere_tracking.live.logbook": "writes",
    "hillsphere.base.cached_files": "takes digests, parses nothing",
    "hillsphere.cli.endings": "writes the log of an internal error",
    "hillsphere.base.json_files": RUN_DIRECTORY,
    "hillsphere.base.npz": "read through product_codec, which stands in the table",
    "hillsphere.base.regular_files": "opens files for the readers, parses nothing",
    "hillsphere.cases.executors.pool": "pipes to its own processes",
    "hillsphere.cases.executors.worker": "pipes from its own process",
    "hillsphere_campaigns.export": RUN_DIRECTORY + "; writes",
    "hillsphere.cli.running": RUN_DIRECTORY,
    "hillsphere.cli.streams": "/dev/null",
    "hillsphere.symbolic.compile_cache": "own entries, owner checked; test_compile_cache.py",
    "hillsphere.formats.bulk": "parses rows for the readers, each of which stands in the table",
    "hillsphere.model.shapes.dsk": "starts the process that reads DSK files; test_mesh_files.py",
    "hillsphere.model.shapes.dsk_process": "CSPICE, may end its process; test_mesh_files.py",
    "hillsphere.cli.doctor": "the system's list of mounts",
    "hillsphere.runs.earlier_run": RUN_DIRECTORY,
    "hillsphere.runs.pipeline": RUN_DIRECTORY,
    "hillsphere.show.report": "the package's own style sheet and script, plotly.js",
    "hillsphere.show.comparison_page": "the package's own style sheet",
    "hillsphere.cli.author_commands": "writes copies of packaged missions, and plugins",
    "hillsphere.cli.messages_command": "opens a file for the readers of messages",
    "hillsphere.cli.convert_command": "the beginning of a file, by which its format is told",
    "hillsphere.cli.plugin_template": "the package's own templates",
    "hillsphere.plugins.plugin_files": "a program that the user names; test_plugin_files.py",
    "hillsphere.runs.run_calls": RUN_DIRECTORY,
    "hillsphere.runs.run_summary": RUN_DIRECTORY,
    "hillsphere.runs.rerun": RUN_DIRECTORY,
    "hillsphere.runs.run_figures": RUN_DIRECTORY,
    "hillsphere.model.spice_kernel": "judges the head and the records of a kernel; test_spice.py",
    "hillsphere.model.spice_calls": "starts the processes of SPICE; test_spice.py",
    "hillsphere.model.spice_process": "CSPICE, ends its process at some kernels; test_spice.py",
    "hillsphere.model.spk": "starts the process that reads trajectories; test_spk.py",
    "hillsphere.model.spk_process": "CSPICE, may end its process; test_spk.py",
    "hillsphere_orbits.ephemeris.spk_process": "writes; reads back what SPICE wrote",
    "hillsphere.runs.store": "appends to the log",
    "hillsphere_controllers.systems.exchange": "MATLAB's files; test_mat_file.py",
    "hillsphere.runs.workers": "copies an error of its own",
}
"""Modules that open or parse something which is no single input file, and what it is."""
