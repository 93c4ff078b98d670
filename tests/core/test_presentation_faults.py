"""Faults of a presentation that a report could not show."""

from pathlib import Path
from typing import Any

import pytest

from hillsphere.errors import StageError
from hillsphere.presentation import (
    Axis,
    Chart,
    Cloud,
    Column,
    Panel,
    Points,
    Presentation,
    Space,
    Table,
    presentation_faults,
)
from hillsphere.runs.store import RunDirectory
from hillsphere.show.presentation import check_presentation


def faults(chart: Chart) -> list[str]:
    table = Table("T", [Column("a")], [{"a": 1.0}, {"a": 2.0}])
    return presentation_faults(Presentation(tables={"t": table}, figures={"f": chart}))


def flat(points: Points) -> Panel:
    return Panel(Axis(), Axis(), [points])


def test_marks_stand_for_rows_of_the_stages_own_table() -> None:
    space = Space([Cloud([[0.0]] * 3, rows=1)])
    assert faults(Chart("C", [flat(Points([0, 1], [0, 1], rows=[0, 1])), space], table="t")) == []
    assert faults(Chart("C", [], table="u")) == ["figure 'f': its table 'u' is not one of ['t']"]
    beyond = Chart("C", [flat(Points([0, 1], [0, 1], rows=range(1, 3)))], table="t")
    assert faults(beyond) == [
        "figure 'f': a Points stands for rows 1 to 2 of its table 't', which has 2"
    ]
    assert faults(Chart("C", [space])) == [
        "figure 'f': a Cloud stands for rows 1 to 1 of its table '', which has 0"
    ]


def test_marks_may_stand_for_rows_that_a_cut_table_does_not_list() -> None:
    whole = Table("T", [Column("a")], [{"a": 1.0}, {"a": 2.0}, {"a": 3.0}])
    cut = whole.first(2, "values")
    assert [row["a"] for row in cut.rows] == [1.0, 2.0]
    assert cut.notes == ["The first 2 of 3 values."]
    assert whole.first(3) is whole
    last = Chart("C", [flat(Points([0], [0], rows=[2]))], table="t")
    assert presentation_faults(Presentation(tables={"t": cut}, figures={"f": last})) == []
    beyond = Chart("C", [flat(Points([0], [0], rows=[3]))], table="t")
    assert presentation_faults(Presentation(tables={"t": cut}, figures={"f": beyond}))


def test_a_message_tells_the_first_faults_only() -> None:
    many = Chart("C", [flat(Points([0], [0], rows=[row])) for row in range(9)], table="t")
    table = Table("T", [Column("a")], [{"a": 1.0}])
    with pytest.raises(StageError, match=r"rows 3 to 3 of its table 't', which has 1; and 5 more$"):
        check_presentation(Presentation(tables={"t": table}, figures={"f": many}))


def test_files_hold_text_or_bytes(tmp_path: Path) -> None:
    """Bytes were written as if they were text; what is neither is named."""
    shown = Presentation(files={"a.bsp": b"\x00\xff\r\n", "a.oem": "é\r\n"})
    assert presentation_faults(shown) == []
    directory = RunDirectory(tmp_path)
    for name, content in shown.files.items():
        directory.put_file(f"files/{name}", content)
    assert (tmp_path / "files" / "a.bsp").read_bytes() == b"\x00\xff\r\n"
    assert (tmp_path / "files" / "a.oem").read_bytes() == "é\r\n".encode()
    wrong: Any = {"a.bsp": [1]}
    assert presentation_faults(Presentation(files=wrong)) == [
        "file 'a.bsp': its content must be text or bytes, got list"
    ]
