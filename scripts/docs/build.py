"""Build the documentation as HTML, offline; every warning of Sphinx is an error, and every link within it is followed.

    uv run --group docs python scripts/docs/build.py [--quick] [--to DIR]

--quick leaves the examples of the gallery unexecuted, so that their figures are absent.  The pages go to docs_html/,
which git ignores.  The last line is one JSON object with the numbers of pages and links.
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


class Page(HTMLParser):
    """The anchors of a page and the links on it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect ids, and what is linked or shown."""
        attributes = dict(attrs)
        self.anchors |= {attributes["id"]} if attributes.get("id") else set()
        self.links += [attributes[name] or "" for name in ("href", "src") if name in attributes]


def sources(folder: Path) -> Path:
    """Collect written pages, generated pages, pictures and examples in a new folder."""
    sys.path.insert(0, str(HERE))
    import generated
    import packages

    source = folder / "source"
    shutil.copytree(HERE / "pages", source)
    shutil.copytree(HERE / "pictures", source / "pictures")
    shutil.copytree(
        ROOT / "scripts" / "examples", source / "scripts" / "examples", ignore=shutil.ignore_patterns("__*")
    )
    (source / "configs").symlink_to(ROOT / "configs")
    pages = {"commands": generated.commands(), "equations": generated.equations()} | generated.names()
    (folder / "runs").mkdir()
    pages |= generated.keys() | {"files": generated.files(folder / "runs")}
    pages["targets"] = generated.export_targets()
    pages["open_benchmark"] = generated.open_benchmark(source / "pictures")
    pages["packages"] = packages.page(source / "pictures")
    for name, text in pages.items():
        path = source / "reference" / f"{name}.rst"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return source


def pages_of(html: Path) -> dict[Path, Page]:
    """Return the pages by their paths, without the files of the theme."""
    paths = (path for path in html.rglob("*.html") if "_static" not in path.parts)
    return {path: Page(path.read_text(encoding="utf-8")) for path in paths}


def dead_links(html: Path, pages: dict[Path, Page]) -> tuple[int, list[str]]:
    """Return the number of links between pages or to anchors, and the broken links."""
    count, dead = 0, []
    for path, page in pages.items():
        for link in page.links:
            if not link or ":" in link.split("/")[0] or link.startswith("//"):
                continue
            count += 1
            file, _, anchor = unquote(link).partition("#")
            target = (path.parent / file.split("?")[0]).resolve() if file else path
            anchors = pages.get(target)
            if not target.exists() or (anchor and anchors is not None and anchor not in anchors.anchors):
                dead.append(f"{path.relative_to(html)}: {link}")
    return count, dead


def build(html: Path, quick: bool) -> dict[str, int]:
    """Build the pages in the folder `html`; RuntimeError for a warning or a broken link."""
    from sphinx.cmd.build import build_main

    os.environ["ELASTID_DOCS_RUN"] = "0" if quick else "1"
    with tempfile.TemporaryDirectory() as folder:
        source = sources(Path(folder))
        code = build_main(["-W", "--keep-going", "-q", "-E", "-b", "html", "-c", str(HERE), str(source), str(html)])
    if code:
        raise RuntimeError("Sphinx reports the warnings above; correct the page or the docstring that each names")
    pages = pages_of(html.resolve())
    count, dead = dead_links(html.resolve(), pages)
    if dead:
        raise RuntimeError("links that lead nowhere:\n" + "\n".join(dead))
    return {"pages": len(pages), "links": count}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="do not execute the examples")
    parser.add_argument("--to", type=Path, default=ROOT / "docs_html", metavar="DIR", help="where the pages go")
    asked = parser.parse_args()
    numbers = build(asked.to, asked.quick)
    print(asked.to / "index.html")
    print(json.dumps(numbers))
