"""``hillsphere export``: the cases of a campaign as a file for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from hillsphere.atomic import output_place
from hillsphere.campaign.export import export_bands_csv, export_csv, export_netcdf
from hillsphere.cli.application import registry_of
from hillsphere.cli.output import write
from hillsphere.earlier_run import EarlierRun
from hillsphere.errors import InputError, UnknownComponentError
from hillsphere.plugins import Registry
from hillsphere.products import CaseTable
from hillsphere.rerun import one_campaign

__all__ = ["app", "export_cases"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)


class ExportFormat(StrEnum):
    """Formats of exported cases."""

    csv = "csv"
    netcdf = "netcdf"


_TABLE = f"{CaseTable.__module__}:{CaseTable.__qualname__}"
_SUFFIXES = {"csv": ".csv", "netcdf": ".nc"}


def export_cases(
    run: Path, *, stage: str | None, format_: str, out: Path | None, registry: Registry
) -> tuple[Path, ...]:
    """Write the cases of a campaign to a file.

    Parameters
    ----------
    run : Path
        Run directory.
    stage : str or None
        The campaign.
    format_ : str
        ``"csv"`` or ``"netcdf"``.
    out : Path or None
        The file; by default ``<stage>.csv`` or ``<stage>.nc`` in the run directory.
    registry : Registry
        Where the types of stages are found.

    Returns
    -------
    tuple of Path
        The file; as CSV a second one, ``<stage>-bands.csv``, if there are quantiles over time.

    Raises
    ------
    InputError
        If there is no such campaign, it is not finished, or the file cannot be written.
    """
    earlier = EarlierRun.open(run)
    stages: dict[str, Any] = earlier.manifest["mission"].get("stage", {})
    specs = {key: _spec_of(run, key, table["type"], registry) for key, table in stages.items()}
    tables = [
        key
        for key, spec in specs.items()
        if _TABLE in (getattr(spec, "produces", ""), *getattr(spec, "provides", ()))
    ]
    name = one_campaign(tables, stage, run)
    if not earlier.manifest["stages"].get(name, {}).get("product"):
        raise InputError(
            f"campaign {name!r} is not finished in run {str(run)!r}; hillsphere resume continues it"
        )
    path = run / f"{name}{_SUFFIXES[format_]}" if out is None else out
    paths = [path]
    try:
        output_place(path)  # before the table is read, which may take a while
        table = earlier.product(name, CaseTable)
        if format_ == "netcdf":
            export_netcdf(table, path)
        else:
            export_csv(table, path)
            if table.bands is not None:
                paths.append(path.with_name(f"{path.stem}-bands.csv"))
                export_bands_csv(table.bands, paths[-1])
    except OSError as error:
        raise InputError(
            f"{paths[-1]} cannot be written: {error.strerror or error}; choose another with --out"
        ) from error
    return tuple(paths)


def _spec_of(run: Path, key: str, type_: str, registry: Registry) -> Any:
    """Return the Spec of a stage of a run."""
    try:
        return registry.get("stage", type_).load_spec()
    except UnknownComponentError as error:
        raise InputError(f"{run / 'manifest.json'}: stage {key!r}: {error}") from error


@app.command()
def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run directory.")],
    stage: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Campaign; needed if the mission has several."),
    ] = None,
    format_: Annotated[
        ExportFormat, typer.Option("--format", help="Text with every digit, or netCDF.")
    ] = ExportFormat.csv,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="By default in the run directory, named by the stage."),
    ] = None,
) -> None:
    """Write the cases of a campaign to a file for other programs."""
    registry = registry_of(strict=False)
    paths = export_cases(run, stage=stage, format_=format_.value, out=out, registry=registry)
    for path in paths:
        write(str(path))
