"""Checks of stages: their products can be stored, and their presentations can be written."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from hillsphere.plugins.registry import Registry, default_registry, load_object, validate
from hillsphere.products.products import load_product, save_product
from hillsphere.show.charts import Chart
from hillsphere.show.drawing import draw
from hillsphere.show.presentation import AnyFigure, Presentation, Table, presentation_faults
from hillsphere.spec.base import Spec, StageSpec
from hillsphere.spec.result_names import PUBLISHED, is_named
from hillsphere.testing.context import RecordingContext
from hillsphere.testing.contract import require
from hillsphere.testing.examples import bound_example, example_inputs, example_repeated

__all__ = ["check_presentation", "check_product", "check_stage", "unlisted_names"]


def check_stage(
    type_: str,
    keys: Mapping[str, Any] | None = None,
    inputs: Mapping[str, Any] | None = None,
    *,
    registry: Registry | None = None,
) -> Any:
    """Run a stage and check its product and its presentation.

    Parameters
    ----------
    type_ : str
        Type of the stage.
    keys : mapping, optional
        Keys as in a mission, with references given as objects; by default the first example of its
        Spec.
    inputs : mapping, optional
        Products of earlier stages by name; by default those of the examples of other stages.
    registry : Registry, optional
        Registry with the stage; by default of all installed plugins.

    Returns
    -------
    object
        The product, for further tests.

    Raises
    ------
    ContractViolation
        If the product is not of the class that the Spec names, or violates `check_product`; if the
        presentation violates `check_presentation`, or has names that the Spec does not list.
    """
    registry = registry or default_registry()
    record = registry.get("stage", type_)
    if keys is None:
        spec = bound_example(record, registry)
    else:
        spec = validate(record.load_spec(), keys, where=f"stage {type_!r}")
    given = dict(example_inputs(spec, registry) if inputs is None else inputs)
    stage = record.load_target()(spec)
    product = stage.run(RecordingContext(), **given, **example_repeated(spec, registry))
    expected = load_object(getattr(spec, "produces", ""))
    require(
        isinstance(product, expected),
        f"stage {type_!r} must yield {expected.__name__}, got {type(product).__name__}",
    )
    check_product(product)
    shown = stage.present(product, **given)
    check_presentation(shown)
    unlisted = unlisted_names(spec, shown)
    require(not unlisted, f"its Spec's `results` lacks {', '.join(unlisted)}")
    return product


def unlisted_names(spec: Spec, shown: Presentation) -> list[str]:
    """Return the metrics, tables and columns that a stage presents and its Spec does not list.

    Parameters
    ----------
    spec : Spec
        Spec of the stage.
    shown : Presentation
        What it presents.
    """
    names = spec.result_names() if isinstance(spec, StageSpec) else None
    if names is None:
        return []
    unlisted = [f"metric {name!r}" for name in shown.metrics if not is_named(name, names.metrics)]
    for name, table in shown.tables.items():
        if not is_named(name, names.tables):
            unlisted.append(f"table {name!r}")
        elif known := names.columns_of(name):
            unlisted += [
                f"column {one.name!r} of table {name!r}"
                for one in table.columns
                if not is_named(one.name.removesuffix(PUBLISHED), known)
            ]
    return unlisted


def check_product(product: Any) -> None:
    """Check that a product is equal after writing to and reading from a file.

    Parameters
    ----------
    product : object
        A frozen dataclass of arrays, numbers, strings, None, tuples of these and products.

    Raises
    ------
    ContractViolation
        If a field differs; the message names it.
    InputError
        If the product holds something that cannot be stored.
    """
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "product.npz"
        save_product(path, product)
        _require_equal(type(product).__name__, load_product(path), product)


def _require_equal(where: str, got: Any, expected: Any) -> None:
    same_type = type(got) is type(expected)
    require(same_type, f"{where}: a {type(expected).__name__} comes back as {type(got).__name__}")
    if is_dataclass(expected):
        for field in fields(expected):
            name = field.name
            _require_equal(f"{where}.{name}", getattr(got, name), getattr(expected, name))
    elif isinstance(expected, tuple):
        require(len(got) == len(expected), f"{where}: comes back with another length")
        for i, (a, b) in enumerate(zip(got, expected, strict=True)):
            _require_equal(f"{where}[{i}]", a, b)
    elif isinstance(expected, np.ndarray):
        same = got.dtype == expected.dtype and got.shape == expected.shape
        require(same and got.tobytes() == expected.tobytes(), f"{where}: comes back changed")
    else:
        unordered = isinstance(expected, float) and expected != expected
        require(unordered or got == expected, f"{where}: {expected!r} comes back as {got!r}")


def check_presentation(shown: Presentation) -> None:
    """Check the presentation of a stage.

    Parameters
    ----------
    shown : Presentation
        Its metrics, tables and figures.

    Raises
    ------
    ContractViolation
        Unless identifiers are lower case; rows hold declared columns and plain cells only; a
        column ``NAME_paper`` stands beside ``NAME``; every figure draws axes that are labelled.
    """
    require(isinstance(shown, Presentation), f"must be a Presentation, got {type(shown).__name__}")
    faults = presentation_faults(shown)
    require(not faults, "; ".join(faults))
    for name, table in shown.tables.items():
        _check_table(name, table)
    for name, figure in shown.figures.items():
        _check_figure(name, figure)
    for sentence in shown.verdict:
        require(isinstance(sentence, str) and sentence, "a verdict is made of sentences")


def _check_table(name: str, table: Table) -> None:
    columns = [column.name for column in table.columns]
    require(table.title, f"table {name!r} has no title")
    for column in columns:
        beside = column.removesuffix("_paper")
        require(beside in columns, f"table {name!r}: {column} stands beside no {beside}")


def _check_figure(name: str, figure: AnyFigure) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    require(figure.title, f"figure {name!r} has no title")
    if isinstance(figure, Chart):
        require(figure.panels, f"figure {name!r} has no panels")
        draw(figure)
        return
    canvas = Canvas(figsize=figure.size_in, dpi=60)
    figure.draw(canvas)
    require(canvas.axes, f"figure {name!r} draws no axes")
    for axes in canvas.axes:
        labelled = axes.get_xlabel() or axes.get_ylabel() or not axes.axison
        require(labelled, f"figure {name!r}: axes without labels; name quantity and unit")
    FigureCanvasAgg(canvas)
    canvas.savefig(BytesIO(), format="png")
