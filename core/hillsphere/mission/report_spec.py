"""What a mission says about its own report: question, answer, numbers, sections."""

from __future__ import annotations

import re
from collections.abc import Iterator

from hillsphere.spec.base import Spec, option

__all__ = ["PLACEHOLDER", "ReportSpec", "SectionSpec"]

PLACEHOLDER = re.compile(r"\{([a-z][a-z0-9_-]*(?:\.[a-z0-9_-]+)+)\}")
"""What a text has in place of a value: ``{requirement.NAME}``, ``{STAGE.METRIC}``."""


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

    def names(self) -> Iterator[tuple[tuple[str | int, ...], str, str]]:
        """Yield (place of the key, kind, name) of every table that the report refers to.

        The kind is ``"outcome"`` for a requirement or claim, and ``""`` for braces in a text that
        are no placeholder.
        """
        texts: list[tuple[tuple[str | int, ...], str]] = [(("answer",), self.answer)]
        for index, section in enumerate(self.section):
            texts.append((("section", index, "text"), section.text))
            for place, item in enumerate(section.show):
                yield ("section", index, "show", place), "stage", item.partition(".")[0]
        for key, text in texts:
            for found in re.findall(r"\{[^{}]*\}", text):
                if (match := PLACEHOLDER.fullmatch(found)) is None:
                    yield key, "", found
                    continue
                first, second, *_ = match[1].split(".")
                is_outcome = first in ("requirement", "claim")
                yield key, first if is_outcome else "stage", second if is_outcome else first
        for index, name in enumerate(self.numbers):
            stage, dot, _ = name.partition(".")
            yield ("numbers", index), "stage" if dot else "outcome", stage
        if self.figure:
            yield ("figure",), "stage", self.figure.partition(".")[0]

    def metrics(self) -> Iterator[tuple[tuple[str | int, ...], str, str]]:
        """Yield (place of the key, stage, metric) of every metric that the report refers to."""
        texts: list[tuple[tuple[str | int, ...], str]] = [(("answer",), self.answer)]
        texts += [(("section", k, "text"), section.text) for k, section in enumerate(self.section)]
        named = [(key, name) for key, text in texts for name in PLACEHOLDER.findall(text)]
        named += [(("numbers", k), name) for k, name in enumerate(self.numbers) if "." in name]
        for key, name in named:
            stage, _, metric = name.partition(".")
            if stage not in ("requirement", "claim"):
                yield key, stage, metric
