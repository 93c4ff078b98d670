"""Formulas as MathML, which browsers show without a script, by the converter of docutils."""

from __future__ import annotations

from html import escape
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError, pick_math_environment
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger

__all__ = ["setup"]

logger = getLogger(__name__)

_REPLACED = (
    ("\\Big", ""),
    ("\\big", ""),
    ("\\dots", "\\ldots"),
    ("≈", "\\approx "),
    ("·", "\\cdot "),
)
"""LaTeX that the converter does not know → what it knows; delimiters grow by themselves there."""


def to_mathml(text: str, *, block: bool) -> str:
    """Return a formula in LaTeX as MathML; `MathError` if it cannot be converted."""
    for old, new in _REPLACED:
        text = text.replace(old, new)
    if block and pick_math_environment(text).startswith("align"):
        text = f"\\begin{{aligned}}{text}\\end{{aligned}}"
    return str(tex2mathml(text, as_block=block))


def _convert(node: nodes.Element, *, block: bool) -> str:
    """Return the MathML of a node; a formula that cannot be converted is shown as code."""
    text = node.astext().strip()
    try:
        return to_mathml(text, block=block)
    except MathError as error:
        logger.warning("no MathML for the formula %r: %s", text, error, location=node)
        return f"<code>{escape(text)}</code>"


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(_convert(node, block=False))
    raise nodes.SkipNode


def _display(writer: Any, node: nodes.math_block) -> None:
    number = f'<span class="eqno">({node["number"]})</span>' if node["number"] else ""
    identifier = f' id="{node["ids"][0]}"' if node["ids"] else ""
    writer.body.append(f'<div class="math"{identifier}>{_convert(node, block=True)}{number}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
