"""Record the outcomes of claims and requirements of finished runs of packaged missions.

``python benchmarks/record_claims.py RUN...`` writes them to ``missions/record.json``, from which
``hillsphere papers`` and the documentation take them. A run must be one of a whole mission (no
profile, no settings), on a commit without changes.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from hillsphere.runs.run_comparison import RunSummary

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "missions" / "record.json"
_KEYS = ("name", "text", "source", "asked", "got", "state", "reason")


def record(paths: list[str]) -> None:
    """Add the outcomes of runs to the record, and sort it by mission."""
    recorded = json.loads(RECORD.read_text("utf-8")) if RECORD.exists() else {}
    commit = subprocess.run(
        ["git", "rev-parse", "--short=12", "HEAD"], cwd=ROOT, capture_output=True, text=True,
        check=True,
    ).stdout.strip()  # fmt: skip
    for path in paths:
        run = RunSummary.read(path)
        manifest, summary = run.manifest, run.summary
        if manifest.get("profile") or manifest.get("sets") or manifest["state"] != "finished":
            raise SystemExit(f"{path}: not a finished run of a whole mission")
        recorded[run.mission] = {
            "command": manifest["command"], "commit": commit, "date": manifest["started_utc"][:10],
            **{
                key: [{k: row[k] for k in _KEYS} for row in summary[key]]
                for key in ("requirements", "claims")
            },
        }  # fmt: skip
    text = json.dumps(dict(sorted(recorded.items())), indent=1, ensure_ascii=False)
    RECORD.write_text(text + "\n", "utf-8")


if __name__ == "__main__":
    record(sys.argv[1:])
