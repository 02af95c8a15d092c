"""A Sphinx extension: equations as MathML, so that a page needs no script of another host."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _display(writer: Any, node: nodes.math_block) -> None:
    latex = node.astext()
    lines = [rf"\begin{{aligned}}{latex}\end{{aligned}}"] if "\\\\" in latex else [latex]
    writer.body += [f'<div class="equation">{convert(line, display="block")}</div>' for line in lines]
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, Any]:
    """The renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    return {"version": "1", "parallel_read_safe": True}
