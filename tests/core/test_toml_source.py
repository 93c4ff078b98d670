"""The scanner finds every place, lets pass what tomllib accepts, and takes linear time."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hillsphere.base.problems import Key, MissionError
from hillsphere.mission.toml_scan import MAX_DEPTH, scan
from hillsphere.mission.toml_source import MAX_BYTES, Locations, parse_toml

TEXT = """\
a = 1
b.c = 2 # comment [ { "
"quoted key" = 'x'

[t.u]
array = [
  1, 2,
  3, # ] comment
  [4,
   5],
  { x = 1, y = [
    6 ] },
]
inline = { p = 1, q.r = { s = "}" } }
text = \"\"\"
[not.a.table]
\\\"\"\" = 1
\"\"\"
raw = '''
a = 1''' # after
empty = []
none = {}

[[list]]
k = 1
[list.sub]
z = 1
[[list]]
[list.sub]
z = 2
[t]
late = 2027-05-01 12:00:00+01:00
"""


def _locations(text: str) -> tuple[dict[str, Any], Locations]:
    tables, locations, _ = parse_toml(text.encode(), "f.toml")
    return tables, locations


def _paths(value: Any, key: Key = ()) -> Iterator[Key]:
    if key:
        yield key
    if isinstance(value, dict):
        for name, item in value.items():
            yield from _paths(item, (*key, name))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _paths(item, (*key, index))


@pytest.mark.parametrize(
    ("key", "span"),
    [
        (("a",), (1, 1)),
        (("b",), (2, 2)),
        (("b", "c"), (2, 2)),
        (("quoted key",), (3, 3)),
        (("t",), (29, 29)),
        (("t", "u"), (5, 5)),
        (("t", "u", "array"), (6, 13)),
        (("t", "u", "array", 0), (7, 7)),
        (("t", "u", "array", 2), (8, 8)),
        (("t", "u", "array", 3), (9, 10)),
        (("t", "u", "array", 3, 1), (10, 10)),
        (("t", "u", "array", 4), (11, 12)),
        (("t", "u", "array", 4, "y"), (11, 12)),
        (("t", "u", "array", 4, "y", 0), (12, 12)),
        (("t", "u", "inline", "q", "r", "s"), (14, 14)),
        (("t", "u", "text"), (15, 18)),
        (("t", "u", "raw"), (19, 20)),
        (("list",), (24, 24)),
        (("list", 0, "sub", "z"), (27, 27)),
        (("list", 1), (28, 28)),
        (("list", 1, "sub", "z"), (30, 30)),
        (("t", "late"), (32, 32)),
    ],
)
def test_span(key: Key, span: tuple[int, int]) -> None:
    _, locations = _locations(TEXT)
    # ("t",) has its own header below the deeper one that implied it.
    expected = (31, 31) if key == ("t",) else span
    assert locations.span(key) == expected


def test_every_path_has_a_line_and_no_place_is_invented() -> None:
    tables, locations = _locations(TEXT)
    paths = set(_paths(tables))
    assert all(locations.line(path) for path in paths)
    assert set(locations.scan.starts) <= paths


def test_unknown_path_takes_the_line_of_what_is_around_it() -> None:
    _, locations = _locations(TEXT)
    assert locations.line(("t", "u", "nothing", 3)) == 5
    assert locations.line(("nothing",)) is None
    assert locations.span(("nothing",)) is None
    assert locations.statement_at(17) is not None
    assert locations.statement_at(17).key == ("t", "u", "text")  # type: ignore[union-attr]
    assert locations.statement_at(0) is None


def test_crlf_and_byte_order_mark() -> None:
    plain = parse_toml(TEXT.encode(), "f")
    other = parse_toml(b"\xef\xbb\xbf" + TEXT.replace("\n", "\r\n").encode(), "f")
    assert other[0] == plain[0]
    assert other[1].scan.starts == plain[1].scan.starts


VALID = [
    "a=''''''''", 'a=""""b"""""', "a='''\n'''", 'a="""\\\n  x"""', "a=+1_000", "a=0xdead_beef",
    "a=0o17", "a=0b1", "a=-0.0e+1", "a=1e3", "a=2027-05-01t12:00:00.5z", 'a="\\u00e9\\U0001F600"',
    "a=[[],[{}],]", "a=[#x\n#y\n]", "a={b={}}", "'a'.\"b\" . c = 1", "1.2=3", "-=1",
    "[a]\n[a.b]\n[c]",
    "[a.b]\n[a]\nx=1", "a.b=1\na.c=2", "[[a]]\n[[a.b]]\n[[a.b]]\n[[a]]\n[[a.b]]", "\n\n#x", "",
    "  [ a . 'b' ]  # c", "\"\"=1", "a='\\'", 'a="\\\\"', "true=1\nfalse=2\ninf=3\n",
    "a = [1,2,3 ,4, -5.5,6 ]",
    "[[ a ]]", 'a="""x\\"""y"""', "a={ b = 1 , c.d=[\n1\n] }", "a=[1,\n\t2 # c\n\t,3]",
]  # fmt: skip


@pytest.mark.parametrize("text", VALID)
def test_valid_text_is_what_tomllib_says(text: str) -> None:
    tables, locations = _locations(text)
    assert tables == tomllib.loads(text)
    assert locations.scan.faults == []
    paths = set(_paths(tables))
    assert set(locations.scan.starts) <= paths
    assert all(locations.line(path) for path in paths)


INVALID = [
    ("a=1\nb", 2, ("b",), "expected '='"),
    ("[a]\n=1", 2, ("a",), "expected a key"),
    ("a=1 b=2", 1, ("a",), "expected the end of the line"),
    ("[a]]", 1, ("a",), "expected the end of the line"),
    ("[[a]", 1, ("a",), "expected ']]'"),
    ("[]", 1, (), "expected a key"),
    ("a=[1,,2]", 1, ("a", 1), "expected a value"),
    ("a=[\n1 2]", 2, ("a",), "array that begins on line 1"),
    ("a=[1 2]", 1, ("a",), "',' or ']' in the array, got '2'"),
    ("\na=[1", 2, ("a",), "not closed"),
    ("a={b=1", 1, ("a",), "not closed"),
    ("a={b=1,}", 1, ("a",), "no comma"),
    ("a={", 1, ("a",), "not closed"),
    ("a={b=1,\nc=2}", 1, ("a",), "end on the line"),
    ("a={b=1,b=2}", 1, ("a", "b"), "given twice, in this line"),
    ("a={b={},b.c=1}", 1, ("a",), "collides"),
    ("a={}\n[a.b]", 2, ("a", "b"), "collides"),
    ("[[a]]\n[a]", 2, ("a",), "collides"),
    ("a.b=1\n\n[a]", 3, ("a",), "collides"),
    ('"a=1', 1, (), "closing quote"),
    ('"\\q"=1', 1, (), "escape"),
    ('a="""x\n\n', 1, ("a",), "closing quote"),
    ("a='''x''", 1, ("a",), "closing quote"),
    ("a=\u00a01", 1, ("a",), "expected a value"),
    ("é=1", 1, (), "expected a key, got 'é'"),
    ("a=1__0", 1, ("a",), "not a value"),
    ("a=.5", 1, ("a",), "not a value"),
    ("a=+0x1", 1, ("a",), "not a value"),
    ("a=2027-05", 1, ("a",), "not a date"),
    ("a=12:00:00", 1, ("a",), "zone"),
    ('a="\\ud800"', 1, ("a",), "escape"),
    (f"a={2**63}", 1, ("a",), "64 bits"),
]


@pytest.mark.parametrize(("text", "line", "key", "fragment"), INVALID)
def test_invalid_text(text: str, line: int, key: Key, fragment: str) -> None:
    with pytest.raises(MissionError) as caught:
        parse_toml(text.encode(), "f.toml")
    assert [(p.line, p.key) for p in caught.value.problems] == [(line, key)]
    assert fragment in caught.value.problems[0].message


def test_fault_of_form_does_not_hide_an_earlier_one_of_tomllib() -> None:
    with pytest.raises(MissionError) as caught:
        parse_toml(b'a = "\\q"\nb = [1 2]\n', "f")
    assert [p.line for p in caught.value.problems] == [1, 2]


@pytest.mark.parametrize("levels", [MAX_DEPTH - 1, MAX_DEPTH])
def test_depth_limit_is_exact(levels: int) -> None:
    sound = {
        "array": "a = " + "[" * (MAX_DEPTH - 1) + "]" * (MAX_DEPTH - 1),
        "key": ".".join(["a"] * MAX_DEPTH) + " = 1",
        "header": "[" + ".".join(["a"] * MAX_DEPTH) + "]",
    }
    deep = {
        "array": "a = " + "[" * MAX_DEPTH + "]" * MAX_DEPTH,
        "key": ".".join(["a"] * (MAX_DEPTH + 1)) + " = 1",
        "header": "[" + ".".join(["a"] * (MAX_DEPTH + 1)) + "]",
    }
    for text in (sound if levels < MAX_DEPTH else deep).values():
        assert bool(scan(text).faults) is (levels == MAX_DEPTH)


def _statement(i: int) -> str:
    return f"k{i} = [1, 'x', {{ y = 2.5 }}]\n"


HOSTILE: dict[str, Callable[[int], str]] = {
    "brackets": lambda n: "[" * n,
    "array": lambda n: "a=" + "[" * n,
    "dots": lambda n: ".".join("a" * n) + "=1",
    "open basic": lambda n: 'a="' + "\\n" * n,
    "open long": lambda n: 'a="""' + '""x' * n,
    "open raw": lambda n: "a='''" + "''x" * n,
    "quotes": lambda n: '"' * n,
    "digits": lambda n: "a=" + "1" * n,
    "underscores": lambda n: "a=" + "1_" * n,
    "spaces": lambda n: "a=1" + " " * n + "x",
    "comment": lambda n: "#" * n,
    "numbers": lambda n: "a=[" + "1," * n + "x",
    "statements": lambda n: "".join(map(_statement, range(n // 20))),
    "tables": lambda n: "".join(f"[t.u{i}]\n" for i in range(n // 10)),
    "array tables": lambda n: "[[a]]\n" * (n // 6),
    "twice": lambda n: "a=1\n" * (n // 4),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_work_grows_no_faster_than_the_text(name: str) -> None:
    # Work is counted in traced lines, not in seconds: the same on every machine.
    small, large = (_traced_lines(HOSTILE[name](n)) for n in (2_000, 16_000))
    assert large <= 8 * small + 2_000


def _traced_lines(text: str) -> int:
    import sys

    count = 0

    def trace(frame: Any, event: str, argument: Any) -> Any:
        nonlocal count
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        scan(text)
    finally:
        sys.settrace(before)
    return count


@pytest.mark.slow
def test_largest_hostile_texts_end() -> None:
    for make in HOSTILE.values():
        text = make(MAX_BYTES)[:MAX_BYTES]
        problems: tuple[object, ...] = ()
        try:
            parse_toml(text.encode(), "f")
        except MissionError as error:
            problems = error.problems
        assert len(problems) <= 100


TOKENS = [
    "a", "b", "1", "=", " = ", ".", ",", "[", "]", "[[", "]]", "{", "}", "\n", "\n", "\n", '"',
    "'", '"""',
    "'''", "#", "\\", " ", "true", "1.5", "2027-05-01T12:00:00Z", "nan", '"x"', "\ra"[1:], "é",
    "\t", "a = 1\n",
]  # fmt: skip


@settings(max_examples=500, deadline=None)
@given(st.lists(st.sampled_from(TOKENS), max_size=30).map("".join))
def test_scanner_agrees_with_tomllib(text: str) -> None:
    found = scan(text)
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        with pytest.raises(MissionError):
            parse_toml(text.encode(), "f")
        return
    # What tomllib accepts, the scanner refuses only for values that a mission may not hold.
    assert all(
        re.search("finite|zone|64 bits|too large|characters", message)
        for _, _, message in found.faults
    )
    if not found.faults:
        paths = set(_paths(tables))
        assert set(found.starts) <= paths
        keyed = {path for path in paths if isinstance(path[-1], str)}
        assert keyed <= set(found.starts)
