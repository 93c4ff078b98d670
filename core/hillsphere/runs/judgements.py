"""Judgement of a mission's requirements and claims, when its stages have ended."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from hillsphere.base.errors import StageError, describe_error
from hillsphere.base.problems import did_you_mean
from hillsphere.interfaces.outcomes import (
    CLAIM_STATES,
    FAILING_STATES,
    REQUIREMENT_STATES,
    Judge,
    Judgement,
    MissingResultError,
)
from hillsphere.mission.load import Mission
from hillsphere.plugins.registry import OUTCOME_KINDS
from hillsphere.show.presentation import Metric, Presentation, Table
from hillsphere.spec.base import Spec

__all__ = ["Judgements", "RunEvidence", "judge_run"]

_STATES = {"requirement": REQUIREMENT_STATES, "claim": CLAIM_STATES}


@dataclass(frozen=True)
class Judgements:
    """Outcomes of a mission's requirements and claims, by name, in the mission's order."""

    requirements: Mapping[str, Judgement] = field(default_factory=dict)
    claims: Mapping[str, Judgement] = field(default_factory=dict)

    def verdict(self, state: str, failures: int) -> str:
        """Return the verdict of a run in one line.

        Parameters
        ----------
        state : str
            ``"success"``, ``"failed"`` or ``"interrupted"``.
        failures : int
            Number of stages that did not finish.
        """
        parts = [
            _count(self.requirements.values(), "met", "requirement"),
            _count(self.claims.values(), "confirmed", "claim"),
        ]
        if state != "success":
            stages = f"{failures} stage{'s' * (failures != 1)} did not finish"
            parts.insert(0, f"{state}; {stages}")
        elif not any(parts):
            parts.append("every stage finished; the mission states no requirement")
        return ", ".join(filter(None, parts))

    def to_json(self) -> dict[str, Any]:
        """Return the two lists of ``summary.json``."""
        return {
            key: [{"name": name, **asdict(one)} for name, one in group.items()]
            for key, group in (("requirements", self.requirements), ("claims", self.claims))
        }

    @classmethod
    def from_json(cls, summary: Mapping[str, Any]) -> Judgements:
        """Return the outcomes of a checked ``summary.json``."""
        known = {field.name for field in fields(Judgement)}
        read = {
            key: {
                row["name"]: Judgement(**{k: v for k, v in row.items() if k in known})
                for row in summary.get(key, ())
            }
            for key in ("requirements", "claims")
        }
        return cls(**read)

    @property
    def are_met(self) -> bool:
        """Whether no requirement is missed or undecided."""
        return all(one.state not in FAILING_STATES for one in self.requirements.values())


@dataclass(frozen=True)
class RunEvidence:
    """Metrics and tables of the stages of a run that have finished, under their own names.

    Parameters
    ----------
    shown : mapping
        Stage → its presentation.
    """

    shown: Mapping[str, Presentation]

    def metric(self, stage: str, name: str) -> Metric:
        """Return a metric of a stage; `MissingResultError` says what the stage has instead."""
        metrics: Mapping[str, Metric] = self.shown[stage].metrics
        if name not in metrics:
            raise MissingResultError(_missing("metric", stage, name, list(metrics)))
        return metrics[name]

    def table(self, stage: str, name: str) -> Table:
        """Return a table of a stage; `MissingResultError` says what the stage has instead."""
        tables: Mapping[str, Table] = self.shown[stage].tables
        if name not in tables:
            raise MissingResultError(_missing("table", stage, name, list(tables)))
        return tables[name]


def _count(rows: Iterable[Judgement], state: str, word: str) -> str:
    """Return ``"3 of 4 requirements met"`` of the rows that could be judged, ``""`` for none."""
    states = [str(row.state) for row in rows]
    judged = [one for one in states if one not in ("not evaluated", "not derivable")]
    if not judged:
        return f"no {word} evaluated" if states else ""
    told = f"{judged.count(state)} of {len(judged)} {word}{'s' * (len(judged) != 1)} {state}"
    left = states.count("not evaluated")
    return f"{told} ({left} not evaluated)" if left else told


def judge_run(
    mission: Mission, judges: Mapping[tuple[str, str], Any], evidence: RunEvidence
) -> Judgements:
    """Judge every requirement and claim of a mission.

    Parameters
    ----------
    mission : Mission
        The mission.
    judges : mapping
        (kind, name) → component, of every requirement and claim.
    evidence : RunEvidence
        Results of the finished stages.

    Returns
    -------
    Judgements
        One outcome per table. A row is undecided if what it names is no result of its stage, or if
        its component fails; the reason gives the table's place in the mission file.
    """
    made: dict[str, dict[str, Judgement]] = {kind: {} for kind in OUTCOME_KINDS}
    for (kind, name), judge in judges.items():
        spec = mission.specs[kind][name]
        made[kind][name] = _judge(mission, kind, name, spec, judge, evidence)
    return Judgements(made["requirement"], made["claim"])


def _judge(
    mission: Mission, kind: str, name: str, spec: Spec, judge: Judge, evidence: RunEvidence
) -> Judgement:
    text, source = str(getattr(spec, "text", "")) or name, str(getattr(spec, "source", ""))
    missing = [stage for stage in _stages_of(spec) if stage not in evidence.shown]
    if missing:
        ran = mission.specs["stage"]
        why = "did not finish" if missing[0] in ran else "is no part of this run"
        return Judgement("not evaluated", text, reason=f"stage {missing[0]!r} {why}", source=source)
    try:
        judgement = judge.judge(evidence)
        if judgement.state not in _STATES[kind]:
            raise StageError(f"{judgement.state!r} is no state of a {kind}")
        return judgement
    except MissingResultError as error:
        reason = str(error)
    # The border to a plugin's own kind of requirement or claim.
    except Exception as error:
        reason = describe_error(error)
    # The name of the file alone: the directory is a matter of this machine.
    place = mission.places[kind, name].rpartition("/")[2]
    return Judgement("undecided", text, reason=f"{place}: {reason}", source=source)


def _stages_of(spec: Spec) -> Iterator[str]:
    return (ref.name for _, kind, ref in spec.references() if kind == "stage")


def _missing(what: str, stage: str, name: str, names: Sequence[str]) -> str:
    hint = did_you_mean(name, names, otherwise="it has") or "; it has none"
    return f"stage {stage!r} has no {what} {name!r}{hint}"
