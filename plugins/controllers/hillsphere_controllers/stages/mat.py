"""``hillsphere mat``: the systems in a product of a run, as a .mat file for MATLAB."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from hillsphere.cli.output import write
from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere.products.product_codec import load_product
from hillsphere_controllers.linear_products import UncertainModel
from hillsphere_controllers.stages.uncertain import to_lft
from hillsphere_controllers.systems.exchange import Content, save_mat

__all__ = ["app", "collect_systems"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)


@app.command()
def mat(
    product: Annotated[
        Path, typer.Argument(metavar="PRODUCT", help="A stage's .npz file in a run directory.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="By default beside it, as .mat.")
    ] = None,
) -> None:
    """Write the systems in a product of a run to a file for MATLAB."""
    path = product.with_suffix(".mat") if out is None else out
    systems = collect_systems(load_product(product))
    if not systems:
        raise InputError(
            f"{product} holds no linear system; take the product of a stage linear_models, lft, "
            "synthesis or mu_analysis"
        )
    try:
        # Only a link that the user has named: one that lies beside a product may be anybody's.
        save_mat(path, systems, follow_links=out is not None)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from error
    write(str(path))


def collect_systems(product: Any) -> dict[str, Content]:
    """Return the systems and uncertain systems of a product, by their place in it.

    Parameters
    ----------
    product : object
        Of any stage. Its field ``controller`` becomes the variable ``controller``, the items of its
        field ``plants`` become ``plants_1``, ``plants_2``, …

    Returns
    -------
    dict of str to Content
        For `hillsphere_controllers.systems.exchange.save_mat`.
    """
    systems: dict[str, Content] = {}
    _collect(product, "", systems)
    return systems


def _collect(value: Any, name: str, systems: dict[str, Content]) -> None:
    if isinstance(value, LtiSystem):
        systems[name or "system"] = value
    elif isinstance(value, UncertainModel):
        lft = to_lft(value)
        systems[name or "model"] = (lft.system, lft.structure)
    elif isinstance(value, tuple):
        for k, item in enumerate(value, 1):
            _collect(item, f"{name}_{k}", systems)
    elif is_dataclass(value):
        for field in fields(value):
            _collect(
                getattr(value, field.name), f"{name}{'_' if name else ''}{field.name}", systems
            )
