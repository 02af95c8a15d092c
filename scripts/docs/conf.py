"""How Sphinx makes the pages; scripts/docs/build.py runs it on a copy with the generated pages beside the written."""

import os
import re
import sys
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

sys.path.extend([str(Path(__file__).parent), str(Path(__file__).parents[1] / "examples")])
from docutils import nodes
from plain_text import to_rst

import elastid

project, author, version = "elastid", "the elastid authors", elastid.__version__
release, copyright = version, "the elastid authors, MIT licence"
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax", "sphinx_gallery.gen_gallery"]
html_theme = "pydata_sphinx_theme"
html_title = f"elastid {version}"
# MathJax is one file beside the pages, so that equations look alike in every browser and need no other host.
MATHJAX = "sphinx-mathjax-offline/static/mathjax/tex-svg.js"
mathjax_path = Path(MATHJAX).name
html_static_path = ["_static", str(distribution("sphinx-mathjax-offline").locate_file(MATHJAX))]
html_css_files = ["style.css"]
html_show_sourcelink = False
html_context = {"default_mode": "auto"}  # without one the theme complains in the console
html_theme_options = {
    "header_links_before_dropdown": 6,
    "footer_start": ["copyright"],
    "footer_end": [],
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
}
exclude_patterns = ["scripts"]  # the gallery has its own pages of them
highlight_language = "none"
html_sidebars = {"index": []}  # it has no pages beside it
nitpicky = True  # of links that are written; types in signatures are no links
nitpick_ignore_regex = [("py:.*", ".*")]
autodoc_default_options = {"members": True, "inherited-members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_preserve_defaults = True  # `EstimatorSpec()` and not all of its fields
sphinx_gallery_conf = {
    "examples_dirs": "scripts/examples",
    "gallery_dirs": "gallery",
    "ignore_pattern": r"__init__|exact_responses|two_axis_study",
    # All but the one that reads the folder of a run.
    "filename_pattern": r"/ex(?!05)\d\d_",
    "image_scrapers": ("example_figures",),
    "plot_gallery": os.environ.get("ELASTID_DOCS_RUN") == "1",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 1e9,
    "within_subsection_order": "FileNameSortKey",
}


def _as_text(_app: Any, _what: str, _name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    """Convert a docstring to reStructuredText in place; a docstring with underlined sections stays unchanged."""
    if "--------" not in lines:
        lines[:] = ["", *to_rst("\n".join(lines)).splitlines()]


# Text within these is no prose, or a link already.
NO_PROSE = (nodes.title, nodes.literal, nodes.reference, nodes.literal_block, nodes.math, nodes.term, nodes.rubric)


def _link_terms(app: Any, page: nodes.document, name: str) -> None:
    """Link the first use of each term of the glossary on a written page."""
    if name == "glossary" or name.startswith(("gallery", "reference")):
        return
    objects = app.env.get_domain("std").objects.items()
    anchors = {term.lower(): anchor for (kind, term), (_, anchor) in objects if kind == "term"}
    words = "|".join(re.escape(term) for term in sorted(anchors, key=len, reverse=True))
    glossary = app.builder.get_relative_uri(name, "glossary")
    for text in [text for text in page.findall(nodes.Text) if not _is_within(text, NO_PROSE)]:
        pieces, end = [], 0
        for match in re.finditer(rf"(?<![\w-])({words})s?(?![\w-])", text, re.IGNORECASE):
            if anchor := anchors.pop(match[1].lower(), None):
                link = nodes.reference("", match[0], refuri=f"{glossary}#{anchor}", internal=True, classes=["term"])
                pieces += [nodes.Text(text[end : match.start()]), link]
                end = match.end()
        if pieces:
            text.parent.replace(text, [*pieces, nodes.Text(text[end:])])


def _is_within(node: nodes.Node, kinds: tuple[type[nodes.Node], ...]) -> bool:
    while (node := node.parent) is not None:
        if isinstance(node, kinds):
            return True
    return False


def setup(app: Any) -> None:
    """Connect the conversion of docstrings and the links to the glossary."""
    app.connect("autodoc-process-docstring", _as_text, 400)  # before napoleon
    app.connect("doctree-resolved", _link_terms)
