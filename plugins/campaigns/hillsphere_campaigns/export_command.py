"""``hillsphere export``: the cases of a campaign as a file for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from hillsphere.cli.application import registry_of
from hillsphere.cli.output import write

__all__ = ["app"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)


class ExportFormat(StrEnum):
    """Formats of exported cases."""

    csv = "csv"
    netcdf = "netcdf"
    parquet = "parquet"


@app.command()
def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run directory.")],
    stage: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Campaign; needed if the mission has several."),
    ] = None,
    format_: Annotated[
        ExportFormat, typer.Option("--format", help="Text with every digit, netCDF, or Parquet.")
    ] = ExportFormat.csv,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="By default in the run directory, named by the stage."),
    ] = None,
) -> None:
    """Write the cases of a campaign to a file for other programs."""
    from hillsphere_campaigns.export import export_cases  # numerical, so only when it is needed

    registry = registry_of(strict=False)
    paths = export_cases(run, stage=stage, format_=format_.value, out=out, registry=registry)
    for path in paths:
        write(str(path))
