"""The figures of an example in the gallery: every matplotlib Figure among its variables, drawn once."""

from typing import Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

_DRAWN: set[int] = set()


def drawn(_block: tuple[Any, ...], variables: dict[str, Any], gallery: dict[str, Any]) -> str:
    """Return the reStructuredText of the figures that a block of an example has made."""
    paths = []
    for value in variables["example_globals"].values():
        if isinstance(value, Figure) and id(value) not in _DRAWN:
            _DRAWN.add(id(value))
            paths.append(str(next(variables["image_path_iterator"])))
            value.savefig(paths[-1], dpi=100)
    return figure_rst(paths, gallery["src_dir"])


def _get_sg_image_scraper() -> Any:
    return drawn
