"""Products that an earlier version wrote under other names of modules and fields are read."""

import importlib
import json
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.products import moved_classes
from hillsphere.products.product_codec import load_product, save_product


@dataclass(frozen=True)
class Orbit:
    """A product."""

    min_altitude_m: Array
    name: str


def rewrite_header(path: Path, old: str, new: str) -> None:
    """Replace a text in the header of a product file."""
    with np.load(path) as file:
        parts = dict(file)
    text = parts["__product__"].tobytes().decode("ascii")
    assert old in text
    header = json.dumps(json.loads(text.replace(old, new))).encode("ascii")
    np.savez(path, **{**parts, "__product__": np.frombuffer(header, dtype=np.uint8)})


def test_field_under_its_earlier_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "orbit.npz"
    save_product(path, Orbit(np.array([1.5, 2.5]), "a"))
    rewrite_header(path, '"min_altitude_m": {', '"altitude_min_m": {')
    with pytest.raises(InputError, match="has other fields now"):
        load_product(path)
    names = {f"{__name__}:Orbit": {"altitude_min_m": "min_altitude_m"}}
    monkeypatch.setattr(moved_classes, "_RENAMED_FIELDS", names)
    read = load_product(path)
    assert read.name == "a"
    np.testing.assert_array_equal(read.min_altitude_m, [1.5, 2.5])


def test_field_of_a_class_that_has_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moved_classes, "_MOVED", {"old.products": "new.products"})
    monkeypatch.setattr(moved_classes, "_RENAMED_FIELDS", {"new.products:A": {"x_min": "min_x"}})
    assert moved_classes.current_field("old.products:A", "x_min") == "min_x"
    assert moved_classes.current_field("old.products:A", "y") == "y"
    assert moved_classes.current_field("old.products:B", "x_min") == "x_min"


@pytest.mark.parametrize("path", moved_classes._RENAMED_CLASSES)
def test_class_under_its_earlier_name(path: str) -> None:
    module, _, name = moved_classes.current_class(path).partition(":")
    assert isinstance(getattr(importlib.import_module(module), name), type)
    assert not hasattr(importlib.import_module(path.partition(":")[0]), path.partition(":")[2])


@pytest.mark.parametrize("path", moved_classes._RENAMED_FIELDS)
def test_renamed_fields_exist(path: str) -> None:
    module, _, name = path.partition(":")
    today = {field.name for field in fields(getattr(importlib.import_module(module), name))}
    renamed = moved_classes._RENAMED_FIELDS[path]
    assert set(renamed.values()) <= today
    assert not set(renamed) & today
