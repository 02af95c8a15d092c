"""Keys, options and commands that messages of elastid name exist."""

import ast
import re
from functools import cache

import click
from plants.paths import ROOT

from elastid.app import cli
from elastid.study.reference import list_keys

PACKAGE = ROOT / "elastid"
COMMANDS = cli.cli.commands
OPTIONS = {
    option
    for command in (cli.cli, *COMMANDS.values())
    for parameter in command.params
    if isinstance(parameter, click.Option)
    for option in (*parameter.opts, *parameter.secondary_opts)
}
# Of uv, which installs what an extra brings.
OTHERS = {"--extra", "--reinstall-package", "--group", "--help"}


@cache
def messages() -> tuple[tuple[str, str], ...]:
    """Module and text of each string with blanks that is no docstring; its holes are ‹›."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        nodes = [*ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
        apart = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        apart |= {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
        for node in nodes:
            parts = node.values if isinstance(node, ast.JoinedStr) else [node]
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "‹›" for part in parts)
            if " " in text.strip() and id(node) not in apart:
                found.append((path.relative_to(PACKAGE).as_posix(), text))
    return tuple(found)


def test_commands_and_options_that_messages_name_exist() -> None:
    commands = {word for _, text in messages() for word in re.findall(r"`elastid ([a-z]+)\b", text)}
    assert len(commands) > 5
    assert commands <= {*COMMANDS}
    options = {(module, each) for module, text in messages() for each in re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)}
    compilers = {each for each in options if each[0].startswith(("targets", "base/kernels", "simulation"))}
    assert len(options) > 15
    assert {option for _, option in options - compilers} <= OPTIONS | OTHERS


def test_keys_that_messages_name_exist() -> None:
    """Dotted paths that begin with a section of a study; patterns, names and numbers in them stand for any."""
    paths = [re.sub(r"\[\]|\.?<[^>]*>", "", key.path) for key in list_keys()]
    sections = {path.partition(".")[0] for path in paths if "." in path}
    splits = [path.split(".") for path in paths]
    known = {".".join(s[a:b]) for s in splits for a in range(len(s)) for b in range(a + 1, len(s) + 1)}
    named = re.compile(rf"(?<![\w./‹›])(?:{'|'.join(sorted(sections))})(?:\.[a-z_]+)+(?![\w(./*@])")
    unknown = {
        (module, path)
        for module, text in messages()
        for path in named.findall(text)
        if path not in known and not path.endswith((".h", ".h5", ".yml", ".csv", ".json", ".html", ".pdf"))
    }
    assert not unknown
