"""How Sphinx makes the pages; scripts/docs/build.py runs it on a copy with the generated pages beside the written."""

from __future__ import annotations

import os
import sys
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

sys.path.extend([str(Path(__file__).parent), str(Path(__file__).parents[1] / "examples")])
from plain_text import restructured

import elastid

project, author, version = "elastid", "the elastid authors", elastid.__version__
release, copyright = version, "the elastid authors, MIT licence"
extensions = ["sphinx.ext.autodoc", "sphinx.ext.mathjax", "sphinx_gallery.gen_gallery"]
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
    """Docstrings of the code are text with equations, not reStructuredText."""
    lines[:] = restructured("\n".join(lines)).splitlines()


def setup(app: Any) -> None:
    """Connect the conversion of docstrings."""
    app.connect("autodoc-process-docstring", _as_text)
