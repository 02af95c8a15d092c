"""Page for developers: the packages of elastid by layer, their subjects and imports, as a drawing and a table."""

import ast
import tomllib
from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.patches import FancyArrowPatch
from plain_text import list_table

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "elastid"


def layers() -> list[list[str]]:
    """Return names of the packages by layer, the lowest last, from the import rules of pyproject.toml."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    return [layer.split(" | ") for layer in layers if layer != "__main__"]


def python_files(name: str) -> list[Path]:
    """Return files of a package, or the one file of a module."""
    file = PACKAGE / f"{name}.py"
    return [file] if file.exists() else sorted((PACKAGE / name).rglob("*.py"))


def imports() -> Counter[tuple[str, str]]:
    """Return number of import statements from one package to another: (importer, imported)."""
    count = Counter[tuple[str, str]]()
    for name in (name for layer in layers() for name in layer):
        for path in python_files(name):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("elastid."):
                    count[name, str(node.module).split(".")[1]] += 1
    return Counter({pair: n for pair, n in count.items() if pair[0] != pair[1]})


def draw(path: Path) -> None:
    """Draw the packages by layer without imports from base, the lowest; widths grow with the number of imports."""
    figure, axes = plt.subplots(figsize=(8, 9), layout="constrained")
    place = {name: ((k + 0.5) / len(layer), -y) for y, layer in enumerate(layers()) for k, name in enumerate(layer)}
    for (importer, imported), n in imports().items():
        if imported == "base":
            continue
        style = {"arrowstyle": "-|>", "mutation_scale": 8, "color": "C0", "alpha": 0.25, "linewidth": 0.3 + n / 12}
        curve = f"arc3,rad={0.15 if place[importer][0] <= place[imported][0] else -0.15}"
        axes.add_patch(FancyArrowPatch(place[importer], place[imported], connectionstyle=curve, **style))
    for name, (x, y) in place.items():
        box = {"boxstyle": "round", "facecolor": "white", "edgecolor": "0.3"}
        axes.text(x, y, name, ha="center", va="center", bbox=box, fontsize=9)
    axes.set(xlim=(0, 1), ylim=(0.6 - len(layers()), 0.6))
    axes.axis("off")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def page(pictures: Path) -> str:
    """Return page with drawing and table; a row for each package: subject, files, lines, packages that it imports."""
    draw(pictures / "packages.png")
    below, rows = imports(), [("package", "subject", "files", "lines", "imports")]
    for name in (name for layer in layers() for name in layer):
        files = python_files(name)
        first = PACKAGE / name / "__init__.py" if len(files) > 1 else files[0]
        docstring = ast.get_docstring(ast.parse(first.read_text(encoding="utf-8"))) or ""
        lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)
        used = ", ".join(imported for importer, imported in below if importer == name)
        rows.append((f"``{name}``", docstring.split("\n")[0], str(len(files)), str(lines), used))
    return f"""Packages
========

A package imports only from lower layers, without cycles. ``lint-imports`` checks this rule in every test run. An arrow
points from the importing to the imported package. Its width grows with the number of import statements. All packages
import ``base``, without an arrow.

.. image:: /pictures/packages.png
   :alt: The packages of elastid by layer, with an arrow for each import between two packages.

{list_table(rows)}"""
