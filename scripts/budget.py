"""Budget of the house: sizes that may only fall, counted and compared with scripts/budget.toml.

    python scripts/budget.py            exit code 1 where a number exceeds the budget
    python scripts/budget.py --lower    lower the file to what stands; it never raises a number

`lines` and `nodes` are counted in the Python files of elastid, tests and scripts; packing lines or cutting docstrings
does not reduce the nodes of the syntax tree. Other files of elastid have lines by kind. `thresholds` are the numbers in
module constants and in fields of classes called ...Limits or ...Thresholds, also in tuples and dicts. `names` are
public, `commands` are commands of `elastid`. `sentences` are texts of five words or more, docstrings apart, that end as
a sentence does or have holes for numbers. `prose` counts the sentences that scripts/prose.py flags.
"""

import ast
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

import prose

ROOT = Path(__file__).parents[1]
ROOMS = ("elastid", "tests", "scripts")
# Kinds of files of elastid beside Python, by the ends of their names.
FILE_KINDS = {"c": (".c", ".h"), "javascript": (".js",), "css": (".css",), "templates": (".j2", ".m", ".txt", ".yml")}
Budget = Mapping[str, Mapping[str, int]]


def measure_sizes(root: Path) -> dict[str, dict[str, int]]:
    """Measure all sizes of the repository at `root`."""
    sizes: dict[str, dict[str, int]] = {}
    for area in ROOMS:
        texts = [path.read_text(encoding="utf-8") for path in sorted((root / area).rglob("*.py"))]
        trees = [ast.parse(text) for text in texts]
        sizes[area] = {
            "lines": sum(len(text.splitlines()) for text in texts),
            "nodes": sum(1 for tree in trees for _ in ast.walk(tree)),
        }
        if area == "elastid":
            for kind in (sentences, commands):
                sizes[area][kind.__name__] = sum(1 for tree in trees for _ in kind(tree))
            sizes[area]["thresholds"] = sum(map(thresholds, trees))
            sizes[area] |= {f"{kind}_lines": lines(root / area, ends) for kind, ends in FILE_KINDS.items()}
    sizes["prose"] = prose.counted(root)
    sizes["elastid"]["names"] = public_names((root / "elastid" / "__init__.pyi").read_text(encoding="utf-8"))
    return sizes


def lines(folder: Path, ends: tuple[str, ...]) -> int:
    """Count the lines of files with these name endings, except minimised third-party libraries."""
    files = [path for path in folder.rglob("*") if path.name.endswith(ends) and ".min." not in path.name]
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


def thresholds(tree: ast.Module) -> int:
    """Count the numbers in constants of a module, and in defaults of fields of Limits and Thresholds."""
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    bodies = [tree.body, *(each.body for each in classes if each.name.endswith(("Limits", "Thresholds")))]
    statements = [each for body in bodies for each in body if isinstance(each, ast.Assign | ast.AnnAssign)]
    return sum(numbers(each.value) for each in statements)


def numbers(node: ast.expr | None) -> int:
    """Count one for a number or an arithmetic of numbers, and the numbers that a tuple, list, set or dict contains."""
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return sum(map(numbers, node.elts))
    if isinstance(node, ast.Dict):
        return sum(map(numbers, node.values))
    if isinstance(node, ast.BinOp):
        return numbers(node.left) * numbers(node.right)
    if isinstance(node, ast.UnaryOp):
        return numbers(node.operand)
    return int(isinstance(node, ast.Constant) and type(node.value) in (int, float))


def sentences(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield texts of at least five words that end like a sentence or contain placeholders."""
    nodes = [*ast.walk(tree)]
    apart = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    apart |= {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        holes = isinstance(node, ast.JoinedStr)
        parts = [node, *node.values] if isinstance(node, ast.JoinedStr) else [node]
        text = "".join(str(part.value) for part in parts if isinstance(part, ast.Constant) and part.value is not None)
        if id(node) not in apart and len(text.split()) > 4 and (holes or text.rstrip()[-1] in ".!?:;"):
            yield node


def commands(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield decorators that make a function a command, and stages that have a help of their own."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            yield from (each for each in node.decorator_list if ast.unparse(each).split("(")[0].endswith(".command"))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Stage":
            yield from (each for each in node.keywords if each.arg == "help")


def public_names(text: str) -> int:
    """Count the names that a stub file exports."""
    return sum(len(node.names) for node in ast.parse(text).body if isinstance(node, ast.ImportFrom))


def list_excesses(sizes: Budget, budget: Budget) -> list[str]:
    """Return a line for each size above its limit: area, name, size and excess."""
    over = []
    for area, numbers in sizes.items():
        for name, number in numbers.items():
            if number > (limit := budget.get(area, {}).get(name, 0)):
                over.append(f"{area}: {name}: {number}, {number - limit} more than the budget of {limit}")
    return over


def lowered_text(sizes: Budget, budget: Budget) -> str:
    """Return the text of the budget file with lower limits where sizes fell, and with the sizes of new entries."""
    text = "# Sizes that may only fall: `python scripts/budget.py --lower` writes those that did.\n"
    for area, numbers in sizes.items():
        lower = {name: min(number, budget.get(area, {}).get(name, number)) for name, number in numbers.items()}
        text += "".join([f"\n[{area}]\n", *(f"{name} = {number}\n" for name, number in lower.items())])
    return text


def main(arguments: list[str], root: Path = ROOT) -> int:
    """Compare the numbers with the file; with --lower, lower the file first. Return the exit code."""
    path = root / "scripts" / "budget.toml"
    budget = tomllib.loads(path.read_text(encoding="utf-8"))
    sizes = measure_sizes(root)
    if arguments == ["--lower"]:
        path.write_text(lowered_text(sizes, budget), encoding="utf-8")
    over = list_excesses(sizes, budget)
    print("\n".join([*over, *(["take away as much as you add: scripts/budget.toml only goes down"] if over else [])]))
    return int(bool(over))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
