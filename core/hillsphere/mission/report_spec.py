"""What a mission says about its own report: question, answer, numbers, sections."""

from __future__ import annotations

from hillsphere.spec.base import Spec, option

__all__ = ["ReportSpec", "SectionSpec"]


class SectionSpec(Spec):
    """A section of the report."""

    examples = (
        {"title": "The family", "text": "From far away to the surface.", "show": ["family.orbits"]},
    )

    title: str = option("heading of the section", min_length=1)
    text: str = option(
        "sentences for the reader; {requirement.NAME}, {claim.NAME} and {STAGE.METRIC} stand for "
        "the value, {requirement.NAME.state} for whether it is met",
        default="",
    )
    show: tuple[str, ...] = option(
        "what it shows, in this order: 'STAGE.NAME' is a table or figure of a stage, 'STAGE' all "
        "of them",
        default=(),
    )


class ReportSpec(Spec):
    """The report of a mission."""

    examples = (
        {
            "question": "Which orbits are stable?", "answer": "All up to {family.x0_largest}.",
            "numbers": ["closed"], "figure": "family.orbits",
        },
    )  # fmt: skip

    question: str = option(
        "heading: what the mission is to answer; by default its title", default=""
    )
    answer: str = option(
        "the answer in one sentence; {requirement.NAME}, {claim.NAME} and {STAGE.METRIC} stand "
        "for the value, {requirement.NAME.state} for whether it is met. By default the verdict",
        default="",
    )
    numbers: tuple[str, ...] = option(
        "requirements and claims that are shown as large numbers, 'NAME' or 'STAGE.METRIC'; by "
        "default the first four requirements",
        default=(), max_length=5,
    )  # fmt: skip
    figure: str = option(
        "the figure that carries the answer, 'STAGE.NAME'; by default the first of the run",
        default="",
    )
    section: tuple[SectionSpec, ...] = option(
        "sections in the order of the mission; by default one per stage", default=()
    )
