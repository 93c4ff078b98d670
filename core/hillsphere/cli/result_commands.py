"""Commands that show results of runs: ``runs``, ``report``, ``compare``, ``papers``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer

from hillsphere.cli.application import Json, app
from hillsphere.cli.completion import complete_mission
from hillsphere.cli.exit_codes import ExitCode
from hillsphere.cli.output import number, write, write_json, write_table

_MOST_LINES = 20
"""Differences that are listed without ``-v``; further ones are counted."""
RECORD = "record.json"
"""Outcomes of recorded runs of the packaged missions, beside these."""
_MOST_BYTES = 4 << 20
"""Largest size of the record; a mission's claims take some 20 kB."""
CLAIM_WORDS = {"confirmed": "reproduced", "refuted": "deviates"}
"""What a list of published results calls these states of a claim; others keep their word."""
_Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show everything.")]


@app.command()
def runs(
    folder: Annotated[Path, typer.Argument(metavar="[FOLDER]", help="Folder of runs.")] = Path(
        "runs"
    ),
    json: Json = False,
) -> None:
    """List the runs in a folder with their verdicts, the latest first."""
    from hillsphere.runs.run_summary import list_runs

    listed = [
        {
            "run": str(run.path), "mission": run.mission,
            "profile": run.manifest.get("profile") or "",
            "started": run.manifest.get("started_utc", ""), "state": run.manifest.get("state", ""),
            "verdict": run.summary.get("verdict", {}).get("text", ""),
        }
        for run in list_runs(folder)
    ]  # fmt: skip
    if json:
        write_json(listed)
    elif listed:
        write_table([list(row.values()) for row in listed], list(listed[0]))
    else:
        write(f"no runs in {folder}")


@app.command()
def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run directory.")],
    verbose: _Verbose = False,
    json: Json = False,
) -> int:
    """Show the verdict of a finished run, and where its report is."""
    from hillsphere.cli.verdict import exit_code, show_verdict
    from hillsphere.runs.run_summary import RunSummary

    summary = RunSummary.read(run).summary
    if json:
        write_json(summary)
    else:
        show_verdict(summary, run / "report.html", verbose=verbose)
    return exit_code(summary)


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="Run directory.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Run directory.")],
    tolerance: Annotated[
        float | None,
        typer.Option(
            min=0.0, metavar="REL",
            help="Largest relative difference of equal numbers; by default the declared digits.",
        ),
    ] = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the comparison as a page.")
    ] = None,
    verbose: _Verbose = False,
    json: Json = False,
) -> int:  # fmt: skip
    """Compare two runs: configuration, outcomes, metrics, and tables row by row.

    Exit codes: 0 all results are equal, 4 some differ, 2 they cannot be compared.
    """
    from hillsphere.runs.run_comparison import compare_runs
    from hillsphere.runs.run_summary import RunSummary

    one, other = RunSummary.read(first), RunSummary.read(second)
    found = compare_runs(one, other, tolerance)
    if html is not None:
        from hillsphere.base.atomic import write_text
        from hillsphere.show.comparison_page import render_comparison

        write_text(html, render_comparison(one, other, found))
    if json:
        write_json(found.to_json())
    else:
        different = len(found.results)
        write(f"{different} of {found.compared} results differ" if different
              else f"all {found.compared} results are equal")  # fmt: skip
        most = None if verbose else _MOST_LINES
        for line in found.configuration[:most]:
            write(f"  {line}")
        if not verbose and len(found.configuration) > _MOST_LINES:
            write(f"  and {len(found.configuration) - _MOST_LINES} more changes (-v shows them)")
        rows = [(d.where, d.name, _text(d.first), _text(d.second)) for d in found.results[:most]]
        if rows:
            write("")
            write_table([(f"  {where}", *rest) for where, *rest in rows],
                        ("  where", "what", first.name or "A", second.name or "B"))  # fmt: skip
        hidden = 0 if verbose else max(different - _MOST_LINES, 0)
        if hidden:
            write(f"  and {hidden} more (-v shows them)")
        if html is not None:
            write(f"page: {html}")
    return ExitCode.NOT_MET if found.results else ExitCode.SUCCESS


@app.command()
def papers(
    mission: Annotated[
        str | None,
        typer.Argument(
            metavar="MISSION",
            help="A packaged mission; by default all.",
            autocompletion=complete_mission,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Show every published claim that the packaged missions examine, ours beside the paper's.

    The outcomes are those of recorded runs of the whole missions; each names its command, commit
    and date. `hillsphere run` examines them again.
    """
    from hillsphere.base.errors import InputError
    from hillsphere.base.json_files import read_json
    from hillsphere.base.paths import missions_directory
    from hillsphere.base.problems import did_you_mean

    recorded = read_json(missions_directory() / RECORD, _MOST_BYTES)
    if mission is not None:
        if mission not in recorded:
            hint = did_you_mean(mission, recorded, otherwise="recorded missions")
            raise InputError(f"no recorded run of mission {mission!r}{hint}")
        recorded = {mission: recorded[mission]}
    if json:
        write_json(recorded)
        return
    for name, run in recorded.items():
        counts = Counter(CLAIM_WORDS.get(row["state"], row["state"]) for row in run["claims"])
        told = ", ".join(f"{count} {word}" for word, count in counts.items())
        write(f"{name}: {told}")
        write(f"  {run['command']}, commit {run['commit']}, {run['date']}")
        write_table(
            [f"  {row['source'] or '–'}", row["text"], row["got"] or row["reason"], row["asked"],
             CLAIM_WORDS.get(row["state"], row["state"])]
            for row in run["claims"]
        )  # fmt: skip
        write("")


def _text(value: Any) -> str:
    return "–" if value is None else number(value)
