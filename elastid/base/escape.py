"""Escapes of texts by target (terminal, YAML, C, XML, CSV, HDF5 ...), so that no program interprets a text.

Every text of a study is written through the escape of its target, also free texts and texts of other programs. (Names
are printable lines, see `base.names`.) ElementTree and Jinja2 escape the markup of whole XML and HTML documents.
"""

import json
import re
from collections.abc import Iterable
from typing import Any

# CasADi allows neither double underscores nor keywords in names of functions; the prefix `joint` prevents keywords.
_NOT_IN_IDENTIFIER = re.compile(r"[\W_]+", re.ASCII)


def printable(text: str) -> str:
    r"""Escape control characters and marks of writing direction for a terminal; tabs and line feeds stay.

    >>> printable("red \x1b[31m")
    'red \\x1b[31m'
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\t\n" else c.encode("unicode_escape").decode() for c in text)


def one_line(text: str) -> str:
    r"""Escape as `printable`, and tabs and line feeds as well: a cell of a table, a row of a comment.

    >>> one_line("1\nevil: 1")
    '1\\nevil: 1'
    """
    return printable(text).replace("\n", "\\n").replace("\t", "\\t")


def comment_lines(text: str) -> str:
    """Return a YAML comment: each row of the text after `# `."""
    return "".join(f"# {one_line(line)}\n" for line in text.split("\n"))


def c_comment(lines: Iterable[str]) -> str:
    r"""Return a comment of C and C++ of several rows; no text within ends the comment or nests another.

    >>> print(c_comment(["x*/ #error"]), end="")
    /* x* / #error
     */
    """
    safe = (_separate_pairs(one_line(line), "*/", "/*") for line in lines)
    return "/* " + "\n * ".join(safe).replace(" * \n", " *\n") + "\n */\n"


def xml_comment(text: str) -> str:
    """Return the content of an XML comment, without double hyphens and without a hyphen at the end.

    >>> xml_comment("a---b")
    'a- - -b'
    """
    return _separate_pairs(printable(text), "--").rstrip("-")


def xml_text(root: Any) -> str:
    """Return an element of ElementTree, which escapes all texts, as indented XML."""
    from xml.etree import ElementTree  # a slow import

    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _separate_pairs(text: str, *pairs: str) -> str:
    """Insert a blank into each of these pairs of characters, also if they overlap."""
    for pair in pairs:
        text = re.sub(f"{re.escape(pair[0])}(?={re.escape(pair[1])})", f"{pair[0]} ", text)
    return text


def c_identifiers(joints: Iterable[str]) -> dict[str, str]:
    """Return an identifier of C and CasADi for each joint; no two differ in case alone.

    >>> c_identifiers(["axis - 1", "axis 1", "é"])
    {'axis - 1': 'joint_axis_1', 'axis 1': 'joint_axis_1_2', 'é': 'joint'}
    """
    identifiers: dict[str, str] = {}
    for name in joints:
        base = "_".join(filter(None, ("joint", *_NOT_IN_IDENTIFIER.split(name))))
        identifiers[name] = unique_name(base, identifiers.values(), "_")
    return identifiers


def unique_name(name: str, names: Iterable[str], separator: str = " ") -> str:
    """Return the name, with a number behind it if another name differs from it at most in case."""
    lower_names = {name.casefold() for name in names}
    number = 1
    while (candidate := name if number == 1 else f"{name}{separator}{number}").casefold() in lower_names:
        number += 1
    return candidate


def file_name(name: str) -> str:
    """Escape a name for file names: separators and characters that Windows rejects are replaced by their codes.

    >>> file_name("../x"), file_name("bench 1")
    ('%2E.%2Fx', 'bench 1')
    """
    text = re.sub(r'[%/\\:*?"<>|]', lambda match: f"%{ord(match[0]):02X}", one_line(name))
    return f"%2E{text[1:]}" if text.startswith(".") else text


def group_name(name: str) -> str:
    """Escape a name for HDF5 groups, in which / and single dots have a meaning."""
    text = name.replace("%", "%25").replace("/", "%2F").replace("\0", "%00")
    return text.replace(".", "%2E") if not text.strip(".") else text


def csv_cell(value: Any) -> Any:
    """Format a cell of a spreadsheet: a text that starts like a formula gets an apostrophe, line breaks are escaped.

    >>> csv_cell("=1+1"), csv_cell("k_1"), csv_cell(-1.0)
    ("'=1+1", 'k_1', -1.0)
    """
    if not isinstance(value, str):
        return value
    return f"'{one_line(value)}" if value.startswith(tuple("=+-@\t\r")) else one_line(value)


def uff_text(text: str) -> str:
    """Return at most 80 ASCII characters for a universal file, never the -1 that ends a data set.

    >>> uff_text("    -1")
    '-1 .'
    """
    line = re.sub(" +", " ", one_line(text).encode("ascii", "backslashreplace").decode()).strip()[:78].strip()
    return f"{line} ." if line in ("", "-1") else line


def docstring(text: str) -> str:
    r"""Escape a text for a docstring of Python; without the characters of str.format.

    >>> print(docstring('say "x"'))
    say \"x\"
    """
    return one_line(text).replace("\\", "\\\\").replace('"', '\\"')


def control_labels(name: str, inputs: Iterable[str], outputs: Iterable[str]) -> dict[str, Any]:
    """Return names of a system and of its signals without dots, which python-control refuses."""
    inside, out = ([location.replace(".", "_") for location in locations] for locations in (inputs, outputs))
    return {"name": name.replace(".", "_"), "inputs": inside, "outputs": out}


def embedded_json(content: Any) -> str:
    """Return JSON for a script element of HTML, its `<` escaped so that no text can end the element."""
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
