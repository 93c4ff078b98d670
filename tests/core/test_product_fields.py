"""Shapes of fields that a product's class declares are checked when it is saved and loaded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.products.fields import Label, Shape, declared_fields, dimension_sizes
from hillsphere.products.product_codec import canonical, load_product, save_product

if TYPE_CHECKING:
    from decimal import Decimal


@dataclass(frozen=True)
class Bands:
    """A product with declared shapes."""

    labels: Annotated[tuple[str, ...], Shape("orbits"), Label("orbit")]
    edge_rad: Annotated[Array, Shape("bands + 1")]
    time: Annotated[Array, Shape("bands", "orbits"), Label("time", 4)]
    position_m: Annotated[Array | None, Shape(3, "orbits")] = None
    count: int = 0


@dataclass(frozen=True)
class WiderBands(Bands):
    """A product that inherits declarations and adds one."""

    slope: Annotated[Array, Shape("orbits")] | None = None


@dataclass(frozen=True)
class Undeclared:
    """A product as before, with a name that only a type checker knows."""

    values: Any
    other: Decimal | None = None


@dataclass(frozen=True)
class HalfDeclared:
    """A product whose declarations cannot be read."""

    values: Annotated[Array, Shape("orbits")]
    other: Decimal | None = None


@dataclass(frozen=True)
class Outer:
    """A product that holds another."""

    inner: Bands


@pytest.fixture
def bands() -> Bands:
    return Bands(("a", "b"), np.zeros(4), np.ones((3, 2)), np.zeros((3, 2)))


def test_dimensions_of_a_sound_product(bands: Bands) -> None:
    assert dimension_sizes(bands) == {"orbits": 2, "bands": 3}
    assert dimension_sizes(replace(bands, position_m=None)) == {"orbits": 2, "bands": 3}


def test_a_sound_product_is_saved_and_loaded(bands: Bands, tmp_path: Path) -> None:
    save_product(tmp_path / "bands.npz", bands)
    assert load_product(tmp_path / "bands.npz").labels == bands.labels


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        (
            "edge_rad",
            np.zeros((4, 1)),
            r"edge_rad must have the shape \(bands \+ 1,\), got \(4, 1\)",
        ),
        ("edge_rad", np.zeros(0), r"edge_rad must have the shape \(bands \+ 1,\), got \(0,\)"),
        (
            "time",
            np.ones((2, 3)),
            r"time must have the shape \(bands, orbits\) with bands = 3 by edge_rad, "
            r"orbits = 2 by labels, got \(2, 3\)",
        ),
        ("time", np.ones(6), r"time must have the shape \(bands, orbits\) .*, got \(6,\)"),
        ("position_m", np.ones((2, 2)), r"position_m must have the shape \(3, orbits\)"),
        ("labels", ("a",), r"time must have the shape .* orbits = 1 by labels, got \(3, 2\)"),
    ],
)
def test_another_shape_is_refused(
    bands: Bands, tmp_path: Path, field: str, value: Any, message: str
) -> None:
    poor = replace(bands, **{field: value})
    with pytest.raises(InputError, match=rf"^Bands\.{message}"):
        save_product(tmp_path / "bands.npz", poor)
    assert not (tmp_path / "bands.npz").exists()
    with pytest.raises(InputError, match=rf"^Bands\.{message}"):
        canonical(poor)
    with pytest.raises(InputError, match=rf"^Bands\.{message}"):
        canonical(Outer(poor))


def test_a_file_of_another_shape_is_refused(bands: Bands, tmp_path: Path) -> None:
    """The file was written by other code; its arrays are sound."""
    save_product(tmp_path / "bands.npz", bands)
    with np.load(tmp_path / "bands.npz") as stored:
        arrays = dict(stored)
    arrays["time"] = arrays["time"].T
    np.savez(tmp_path / "bands.npz", **arrays)
    message = r"^bands\.npz: Bands\.time must have .* got \(2, 3\); run the mission again"
    with pytest.raises(InputError, match=message):
        load_product(tmp_path / "bands.npz")


def test_inherited_declarations(bands: Bands) -> None:
    wider = WiderBands(bands.labels, bands.edge_rad, bands.time, slope=np.zeros(2))
    assert dimension_sizes(wider) == {"orbits": 2, "bands": 3}
    with pytest.raises(InputError, match=r"^WiderBands\.slope must have the shape \(orbits,\)"):
        dimension_sizes(replace(wider, slope=np.zeros(3)))


def test_a_product_without_declarations_stays_as_it_was(tmp_path: Path) -> None:
    save_product(tmp_path / "old.npz", Undeclared(np.ones((2, 3))))
    assert load_product(tmp_path / "old.npz").values.shape == (2, 3)


def test_declarations_that_cannot_be_read_are_not_ignored() -> None:
    with pytest.raises(InputError, match="HalfDeclared cannot be read: name 'Decimal'"):
        dimension_sizes(HalfDeclared(np.ones(2)))


def test_declared_fields() -> None:
    fields = declared_fields(Bands)
    assert list(fields) == ["labels", "edge_rad", "time", "position_m", "count"]
    assert fields["time"].shape == Shape("bands", "orbits")
    assert fields["time"].label == Label("time", 4)
    assert (fields["labels"].is_text, fields["time"].is_text) == (True, False)
    assert (fields["count"].shape, fields["count"].label) == (None, None)


@pytest.mark.parametrize("dimension", ["", "3", "a b", "a - 1", "a + b"])
def test_a_dimension_is_a_number_or_a_name(dimension: str) -> None:
    with pytest.raises(ValueError, match="a dimension is a number, a name"):
        Shape(dimension)
