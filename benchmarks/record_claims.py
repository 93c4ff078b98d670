"""Record the outcomes of claims and requirements of finished runs of packaged missions.

``python benchmarks/record_claims.py [--commit HASH] [RUN...]`` writes them to
``missions/record.json``, from which ``hillsphere papers`` takes them, and writes
``docs/papers.md`` and the README's table from it. A run must be one of a whole mission (no profile,
no settings), on a commit without changes, which is the present one without ``--commit``. The stored
results are judged again, by the requirements and claims that the mission states now; no stage is
computed. Without a run only the pages are written.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hillsphere.cli.result_commands import CLAIM_WORDS
from hillsphere.mission import load_mission
from hillsphere.runs.assembly import Assembly
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.judgements import Judgements, RunEvidence, judge_run
from hillsphere.runs.stored_results import present_again

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "missions" / "record.json"
PAGE = ROOT / "docs" / "papers.md"
README = ROOT / "README.md"
_TABLE = re.compile(
    r"(?<=<!-- begin of the record -->\n).*?(?=<!-- end of the record -->\n)", re.DOTALL
)
_HEAD = """# What the packaged missions found

Each packaged mission states what it requires and which statements of a paper it examines. The
outcomes below are those of runs of the whole missions; `hillsphere papers` shows them on the
terminal, `hillsphere run MISSION` examines them again. A claim is *reproduced* if the computed
values agree with the printed ones or the stated relation holds, it *deviates* if they do not, it is
*undecided* if a confidence interval contains both answers, and it is *not derivable* if the paper
does not print what a computation of it needs."""
_KEYS = ("name", "text", "source", "asked", "got", "state", "reason")


def judge_again(earlier: EarlierRun) -> Judgements:
    """Return the outcomes of a finished run, by its mission as it is packaged now."""
    mission = load_mission(str(earlier.manifest["mission"]["name"]))
    assembly = Assembly(mission)
    judges = {
        (kind, name): assembly.get(kind, name)
        for kind in ("requirement", "claim")
        for name in mission.specs.get(kind, {})
    }
    shown = dict(present_again(earlier, mission, list(mission.specs["stage"])))
    return judge_run(mission, judges, RunEvidence(shown))


def record(paths: list[str], commit: str) -> None:
    """Add the outcomes of runs to the record, and sort it by mission."""
    recorded: dict[str, Any] = json.loads(RECORD.read_text("utf-8")) if RECORD.exists() else {}
    for path in paths:
        earlier = EarlierRun.open(path)
        manifest = earlier.manifest
        if manifest.get("profile") or manifest.get("sets") or earlier.state != "finished":
            raise SystemExit(f"{path}: not a finished run of a whole mission")
        outcomes = judge_again(earlier).to_json()
        recorded[str(manifest["mission"]["name"])] = {
            "command": manifest["command"], "commit": commit, "date": manifest["started_utc"][:10],
            **{key: [{k: row[k] for k in _KEYS} for row in rows] for key, rows in outcomes.items()},
        }  # fmt: skip
    text = json.dumps(dict(sorted(recorded.items())), indent=1, ensure_ascii=False)
    RECORD.write_text(text + "\n", "utf-8")


def papers_page(recorded: Mapping[str, Any]) -> str:
    """Return the page of all recorded outcomes, as Markdown."""
    lines = [_HEAD]
    for name, run in recorded.items():
        lines += [f"\n## {name}\n", f"`{run['command']}`, commit {run['commit']}, {run['date']}."]
        for key, heads in _COLUMNS.items():
            if rows := run[key]:
                cells = [_cells(row, key) for row in rows]
                lines += ["", *_markdown(heads, cells)]
    return "\n".join(lines).rstrip() + "\n"


def readme_table(recorded: Mapping[str, Any]) -> str:
    """Return the README's table of outcomes, one row per mission."""
    rows = []
    for name, run in recorded.items():
        met = [row["state"] for row in run["requirements"]]
        claims = Counter(CLAIM_WORDS.get(row["state"], row["state"]) for row in run["claims"])
        told = ", ".join(f"{count} {word}" for word, count in claims.items())
        rows.append([f"`{name}`", f"{met.count('met')} of {len(met)}", told or "–"])
    return "\n".join(_markdown(["mission", "requirements met", "claims of its paper"], rows)) + "\n"


_COLUMNS = {
    "claims": ["source", "claim", "published", "computed", "outcome"],
    "requirements": ["requirement", "asked", "computed", "outcome"],
}


def _cells(row: Mapping[str, str], key: str) -> list[str]:
    first = [row["source"] or "–"] if key == "claims" else []
    state = CLAIM_WORDS.get(row["state"], row["state"])
    told = f"{state}: {row['reason']}" if row["reason"] else state
    return [*first, row["text"], row["asked"], row["got"], told]


def _markdown(heads: list[str], rows: list[list[str]]) -> Iterator[str]:
    for cells in (heads, ["---"] * len(heads), *rows):
        yield "| " + " | ".join(cell.replace("|", "\\|") or "–" for cell in cells) + " |"


def write_pages() -> None:
    """Write ``docs/papers.md`` and the README's table from the record."""
    recorded = json.loads(RECORD.read_text("utf-8"))
    PAGE.write_text(papers_page(recorded), "utf-8")
    text = README.read_text("utf-8")
    README.write_text(_TABLE.sub(lambda _: readme_table(recorded), text), "utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", metavar="RUN", nargs="*", help="run directory")
    parser.add_argument("--commit", help="the commit on which the runs were made")
    given = parser.parse_args()
    head = ["git", "rev-parse", "--short=12", "HEAD"]
    made = subprocess.run(head, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    record(given.runs, given.commit or made)
    write_pages()
