"""Fields that are parsed as a whole or line by line, cut to a degree, and told to be costly."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.core.mutations import damaged

from hillsphere import create
from hillsphere.engine.gravity import whole_gravity
from hillsphere.errors import InputError
from hillsphere_gravity import coefficient_rows, icgem, shadr
from hillsphere_gravity.coefficient_rows import read_coefficient_rows
from hillsphere_gravity.icgem import read_icgem
from hillsphere_gravity.shadr import read_shadr

DATA = Path(__file__).parents[2] / "data" / "gravity"


def _field(path: Path, degree: int) -> None:
    head = (
        "product_type gravity_field\nmodelname high\nearth_gravity_constant 3.9D+14\n"
        f"radius 6.4D+06\nmax_degree {degree}\nnorm fully_normalized\ntide_system tide_free\n"
        "end_of_head\n"
    )
    rows = [f"gfc {n} {m} {1e-6 / (n + 1)} {1e-7 * m}" for n in range(degree + 1)
            for m in range(n + 1)]  # fmt: skip
    path.write_text(head + "\n".join(rows) + "\n")


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("errors-both.gfc", read_icgem),
        ("errors-unstated.gfc", read_icgem),
        ("blanks.tab", read_shadr),
        ("commas.tab", read_shadr),
        ("rows.txt", read_coefficient_rows),
    ],
)
def test_whole_and_line_by_line_agree(
    name: str, read: Callable[[Path], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / name
    sound = (DATA / name).read_bytes()

    def result() -> Any:
        try:
            content = read(path)
        except InputError as error:
            return str(error)
        return content

    for seed in range(60):
        path.write_bytes(damaged(sound, seed) if seed else sound)
        whole = result()
        with monkeypatch.context() as patch:
            for module in (icgem, shadr, coefficient_rows):
                patch.setattr(module, "parse_series", lambda *_args, **_keys: None)
            assert result() == whole, f"seed {seed}"


def test_a_field_is_cut_to_the_degree_that_is_used(tmp_path: Path) -> None:
    path = tmp_path / "high.gfc"
    _field(path, 40)
    whole, cut = read_icgem(path), read_icgem(path, None, 3)
    assert len(whole.rows) == 41 * 42 // 2
    assert cut.rows == whole.rows[:10]
    assert cut.max_degree == 40
    # what is left out is checked all the same
    path.write_text(path.read_text().replace("gfc 39 7 ", "gfc 39 7 x"))
    with pytest.raises(InputError, match="got 'x"):
        read_icgem(path, None, 3)


def test_the_time_to_compile_is_told_before(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """0.02 s for each square of the degree: 72 s at 60, 5.6 min at 130."""
    path = tmp_path / "high.gfc"
    _field(path, 130)
    with pytest.raises(InputError, match=r"degree 130 takes about 6 min .* max_degree"):
        create("gravity", "harmonics", file=str(path))
    with caplog.at_level(logging.WARNING, "hillsphere"):
        cut: Any = create("gravity", "harmonics", file=str(path), max_degree=50)
        assert cut.degree == 50
        assert caplog.messages == []
        cut = create("gravity", "harmonics", file=str(path), max_degree=60)
        assert cut.degree == 60
    assert len(caplog.messages) == 1
    assert "degree 60 takes about 1 min and 1.26 GB of memory to compile" in caplog.messages[0]


CORNERS = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
FACES = [[1, 3, 5], [3, 2, 5], [2, 4, 5], [4, 1, 5], [3, 1, 6], [2, 3, 6], [4, 2, 6], [1, 4, 6]]


@pytest.mark.parametrize(
    ("unit", "gm", "suggestion"),
    [
        ("m", 2000 * 6.6743e-11 * 4 / 3 * 1e9, "vertices in km instead of m"),
        ("km", 2000 * 6.6743e-11 * 4 / 3, "vertices in m instead of km"),
        ("km", 50 * 6.6743e-11 * 4 / 3 * 1e9, "which no body has; check gm"),
    ],
)
def test_a_density_that_no_body_has_names_the_likely_unit(
    unit: str, gm: float, suggestion: str
) -> None:
    """An octahedron of semi-axes 1 has the volume 4/3."""
    shape = create("shape", "polyhedron", vertices=CORNERS, faces=FACES, length_unit=unit)
    with pytest.raises(InputError, match=suggestion) as caught:
        create("gravity", "polyhedron", shape=shape, gm_m3_s2=gm)
    assert ("2e+03 kg/m³" in str(caught.value)) == ("instead" in suggestion)


def test_a_surface_of_another_size_than_the_reference_sphere() -> None:
    field: Any = create("gravity", "harmonics", file=str(DATA / "errors-none.gfc"))
    radius = field.reference_radius_m
    assert whole_gravity(field, (radius, radius, 0.02 * radius)) is field
    for factor, unit in ((1e-3, "km instead of m"), (1e3, "m instead of km")):
        with pytest.raises(InputError, match=unit):
            whole_gravity(field, np.full(3, factor * radius).tolist())
