"""Sentences that a control engineer has to read twice, found by rules, in pages, docstrings and messages.

    python scripts/prose.py [--show [RULE]] [PATH ...]

Prints the number of sentences, of flagged sentences and of sentences that break each rule, for the pages and for the
package, or for PATH. --show prints flagged sentences as `path:line: rules: sentence`; RULE is a name or its number.
scripts/budget.py compares the numbers of flagged sentences with scripts/budget.toml. A sentence has five words or more.
In Python files the rules apply to first paragraphs of docstrings and to texts of errors, warnings, notes and keys.
"""

import argparse
import ast
import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
AREAS = {"pages": ("scripts/docs/pages", "README.md", "CHANGELOG.md", "CONTRIBUTING.md"), "package": ("elastid",)}
LONGEST, MOST_JOINTS, MESSAGES = 35, 2, ("Error", "Note", "Key", "warn")
THINGS = "(?:data|record|log|fit|model|file|law|response|residual|number)s?"
OWN_WORDS = (
    "taken out|left in|worked out|laid open|no matter how|as it stands|brought (?:in|on)to|mended|parts? each|"
    "given (?:another|by)|standstill|turns? unevenly|(?:is|are) off by|goes? over into|stands? (?:for|in|beside|there)|"
    r"how (?:good|sure) the numbers|by chance once in|says more in|run-downs?|rehears\w+|lateness|shaken"
)
# Rules: 1 name the thing, 2 repeat the noun, 3 name the quantity, 4 the subject first, 5 one statement a sentence,
# 6 things do not speak, 7 positively and in full, 8 the field's word.
PATTERNS = {
    "1-pronoun": r"^(?:It|They|Its|Their|Both|Each|All of (?:it|them)|Another|Others|One|Those|These) "
    r"(?:is|are|has|have|may|then|takes?|holds?|needs?|says?|counts?|acts?|reads?|leaves?|in|of|by)\b",
    "2-that-of": r"\b(?:that|those|ones|the one) (?:of|which|by|from|in|behind|before|at|with|without)\b",
    "3-what": r"\bwhat\b(?![^.?]*\?)",
    "4-of-first": r"(?:^|[;:] )of (?:an?|the|such|this|these|each|all|any|one|\w+s)\b",
    "6-speaks": r"\bsays? (?:so|that|how|why|what|where|which|nothing)\b|\b(?:is|are|be) believed\b|\bdoubts\b|"
    rf"\b{THINGS} (?:carr(?:y|ies)|knows?|tells?|says?|promises?|hides?)\b",
    "7-none": r"\b(?:is|are|has|have|takes?|in|of|to|gives?|with) (?:none|neither)\b|\bnone (?:is|are|where|any)\b",
    "8-word": rf"\b(?:{OWN_WORDS})\b",
}
RULES: dict[str, Callable[[str], object]] = {
    **{name: re.compile(text, 0 if name == "1-pronoun" else re.IGNORECASE).search for name, text in PATTERNS.items()},
    "5-long": lambda text: len(text.split()) > LONGEST,
    "5-packed": lambda text: len(JOINT.findall(text)) > MOST_JOINTS,
}
JOINT = re.compile(r";|: |, (?:which|whose|of which|where|so that)\b")
FIRST = re.compile(r"[A-Z`*:\"(\[_]|elastid\b")
ITEM = re.compile(r"\s*(?:[-*] (?:- )?|\d+\. |#+ )")
LITERAL = re.compile(r"``[^`]*``|:\w+:`[^`]*`|`[^`]*`|\$[^$]*\$")
NOT_PROSE = re.compile(r"\s*(\.\. (?:code-block|math|image|toctree|literalinclude|figure|raw)::)|(?!\s*\.\. ).*::$")
MARKUP = re.compile(r"\s*(?::[\w-]+:(?!`)|\.\. [\w-]+::|[=~^-]{4,}$)")


def rules(sentence: str) -> list[str]:
    text = re.sub(r"^\*\*[^*]+\*\* ", "", LITERAL.sub("X", sentence))
    return [name for name, is_broken in RULES.items() if is_broken(text)]


def sentences(lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Yield sentences with the numbers of their first lines; a blank line and an item of a list end one, too."""
    words: list[tuple[int, str]] = []
    for number, line in [*lines, (0, "")]:
        item = ITEM.match(line)
        for index, text in enumerate(line[item.end() if item else 0 :].split() or [""]):
            is_next = words and words[-1][1][-1] in ".!?" and FIRST.match(text)
            if is_next or not text or (item and index == 0):
                if len(words) >= 5:
                    yield words[0][0], " ".join(word for _, word in words)
                words = []
            words += [(number, text)] * bool(text)


def of_page(text: str) -> Iterator[tuple[int, str]]:
    """Yield lines of a page; code, formulas, figures and tables of Markdown are blank."""
    indent, in_code = -1, False  # indent of a directive whose content is skipped, -1 without one
    for number, line in enumerate(text.splitlines(), start=1):
        depth, is_fence = len(line) - len(line.lstrip()), line.startswith("```")
        in_code ^= is_fence
        if line.strip() and depth <= indent:
            indent = -1
        is_skipped = in_code or is_fence or indent >= 0 or line.lstrip().startswith((">>> ", "... ", "!", "|"))
        if not is_skipped and (opens := NOT_PROSE.match(line)):
            indent, is_skipped = depth, opens[1] is not None
        if not MARKUP.match(line):
            yield number, "" if is_skipped else line


def of_module(text: str) -> Iterator[tuple[int, str]]:
    """Yield sentences of a Python file: first paragraphs of docstrings, texts of errors, warnings, notes, keys."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module) and (words := ast.get_docstring(node)):
            first = itertools.takewhile(str.strip, words.splitlines())
            yield from sentences(enumerate(first, start=node.body[0].lineno))
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")).endswith(MESSAGES):
            for value in [*node.args, *(keyword.value for keyword in node.keywords)]:
                parts = value.values if isinstance(value, ast.JoinedStr) else [value]
                texts = [p.value if isinstance(p, ast.Constant) and isinstance(p.value, str) else "X" for p in parts]
                yield from sentences((value.lineno, line) for line in "".join(texts).splitlines())


def flagged(paths: Iterable[Path]) -> Iterator[tuple[Path, int, str, list[str]]]:
    """Yield path, line, text and broken rules of every sentence of files and folders."""
    files = [file for path in paths for file in (sorted(path.rglob("*")) if path.is_dir() else [path])]
    for file in [file for file in files if file.suffix in (".py", ".rst", ".md") and file.is_file()]:
        text = file.read_text(encoding="utf-8")
        for line, sentence in of_module(text) if file.suffix == ".py" else sentences(of_page(text)):
            yield file, line, sentence, rules(sentence)


def counted(root: Path) -> dict[str, int]:
    return {area: sum(bool(broken) for *_, broken in flagged(root / name for name in AREAS[area])) for area in AREAS}


def main() -> None:
    parser = argparse.ArgumentParser(description="Print sentences that break a rule, and the number for each rule.")
    parser.add_argument("paths", nargs="*", type=Path, metavar="PATH")
    parser.add_argument("--show", nargs="?", const="", metavar="RULE")
    arguments = parser.parse_args()
    base, areas = (Path.cwd(), {"": arguments.paths}) if arguments.paths else (ROOT, AREAS)
    for area, names in areas.items():
        counts = Counter[str]()
        for file, line, sentence, broken in flagged(base / name for name in names):
            counts.update(["sentences", *["flagged"] * bool(broken), *broken])
            if arguments.show is not None and any(name.startswith(arguments.show) for name in broken):
                print(f"{file}:{line}: {', '.join(broken)}: {sentence}")
        print(area, ", ".join(f"{name} {counts[name]}" for name in ("sentences", "flagged", *RULES)))


if __name__ == "__main__":
    main()
