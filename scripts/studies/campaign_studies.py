"""Does every damaged study end in sentences with file, line and column?

    python scripts/studies/campaign_studies.py [--quick] [--mutants 100000] [--seed 0] [--jobs 1]

Mutants of all shipped studies, templates and robots, and of fleets by members and by a table: characters, lines and
numbers exchanged, removed, repeated and put instead of others; tags, anchors, aliases, escapes, huge and odd numbers,
deep nesting, bytes that are not UTF-8. Each is read and checked as `elastid check` does. It is taken, or refused with
file, line and column; anything else, and anything above 10 s, is a finding and fails the campaign. The last line is one
JSON object.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from random import Random

from elastid.base.errors import ElastidError
from elastid.base.execution import ordered
from elastid.study import load
from elastid.study.fleet import load_fleet

ROOT = Path(__file__).resolve().parents[2]
MAX_S = 10.0
MAX_TEXT = 20_000
WORDS = (
    "!!bool maybe", "!!float x", "!!python/object:os.system", "!!binary aGk=", '"\\ud800"', '"\\e[31m"', "1e400",
    "-.inf", ".nan", "99999999999999999999", "0x1F", "1_000", "2026-01-01", "~", "null", "yes", "[]", "{}", "[[[]]]",
    "&a [*a]", "*nobody", "<<: *x", "|", ">", "'", '"', "? x", "- -", "%TAG ! tag:x", "---", "...", "\t", "\ufeff",
    "\u202e", "1 mm/s", "5 %", "3 kg*m^2", "-1", "0", "1e-300", "/etc/hostname", "../..", "a" * 300, "🤖",
    "'\x1b[2J'", "k_1", "[1, 2, 3]",
)  # fmt: skip
PLACED = re.compile(r"^[^\n]*?:\d+:\d+: ")


@dataclass(frozen=True)
class Seed:
    """A folder with a study, and the files of it that are damaged."""

    folder: Path
    study: str
    texts: tuple[str, ...]


FLEETS = {
    "study.yml": "name: line\n",
    "fleet.yml": "name: line\nstudy: study.yml\nfalse_discovery_rate: 0.05\nset: {fit.starts: 3}\nmembers:\n"
    "  - {robot: r ä, date: '2026-01-31', set: {seed: 1}}\n  - {robot: '2 [b]', date: '2026-02-28'}\n",
    "fleet_by_table.yml": "name: line\nstudy: study.yml\ntable: members.csv\n",
    "members.csv": "robot,date,seed\nr1,2026-01-31,1\nr2,2026-01-31,2\n",
}


def seeds(folder: Path) -> tuple[Seed, ...]:
    """All studies that are shipped, each with its robot's file; and a fleet, which is written into a folder."""
    for name, text in FLEETS.items():
        (folder / name).write_text(text, encoding="utf-8")
    templates = Path(str(files("elastid") / "app" / "templates"))
    found = []
    for study in sorted([*templates.rglob("*.yml"), *(ROOT / "configs").rglob("*.yml")]):
        text = study.read_text(encoding="utf-8")
        if not re.search(r"^(robot|experiment):", text, re.MULTILINE) or re.search(r"^bodies:|^joints:", text, re.M):
            continue
        robot = re.search(r"^robot: *(\S+\.yml)", text, re.MULTILINE)
        there = robot is not None and (study.parent / robot[1]).is_file()
        found.append(Seed(study.parent, study.name, (study.name, robot[1]) if there and robot else (study.name,)))
    by_table = Seed(folder, "fleet_by_table.yml", ("fleet_by_table.yml", "members.csv", "study.yml"))
    return (*found, Seed(folder, "fleet.yml", ("fleet.yml", "study.yml")), by_table)


def mutated(text: str, random: Random) -> bytes:
    """One to three changes of a text."""
    for _ in range(random.randint(1, 3)):
        text = random.choice(CHANGES)(text, random)[:MAX_TEXT]
    raw = bytearray(text.encode("utf-8", "surrogatepass"))
    if random.random() < 0.05 and raw:
        raw[random.randrange(len(raw))] = random.randrange(256)
    return bytes(raw)


def _word(text: str, random: Random) -> str:
    """A value is exchanged for an odd one."""
    values = list(re.finditer(r"(?<=: )[^\n#\[{]+|(?<=[\[,] )?[\d.e+-]+", text))
    at = random.choice(values) if values else re.match("", text)
    assert at is not None
    return text[: at.start()] + random.choice(WORDS) + text[at.end() :]


def _insertion(text: str, random: Random) -> str:
    i = random.randrange(len(text) + 1)
    return text[:i] + random.choice(WORDS) + text[i:]


def _character(text: str, random: Random) -> str:
    i = random.randrange(len(text) + 1)
    return text[:i] + random.choice("{}[]:,#&*!|>'\"%@`- \n\t\x00\x07\u2028é0a") + text[i + random.randint(0, 1) :]


def _line(text: str, random: Random) -> str:
    """A line is removed, repeated, moved or indented otherwise."""
    lines = text.splitlines(keepends=True) or [""]
    i, j = random.randrange(len(lines)), random.randrange(len(lines))
    match random.randrange(4):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines[i])
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case _:
            lines[i] = " " * random.randint(0, 6) + lines[i].lstrip(" ")
    return "".join(lines)


def _key(text: str, random: Random) -> str:
    """A key is misspelt or exchanged for another of the text."""
    keys = list(re.finditer(r"[\w.-]+(?=:)", text))
    if not keys:
        return text
    at, other = random.choice(keys), random.choice(keys)[0]
    return text[: at.start()] + random.choice([other, other[::-1], other + "x", ""]) + text[at.end() :]


def _nesting(text: str, random: Random) -> str:
    i, depth = random.randrange(len(text) + 1), random.choice([3, 50, 2000])
    return text[:i] + random.choice("[{") * depth + text[i:]


def _cut(text: str, random: Random) -> str:
    return text[: random.randrange(len(text) + 1)]


CHANGES = (_word, _word, _word, _insertion, _character, _line, _key, _key, _nesting, _cut)


def judged(number: int, seed: int, chosen: tuple[Seed, ...]) -> tuple[str, str]:
    """How the reading of a mutant ended: a word to count, and what is wrong with it, empty where nothing is."""
    random = Random(f"{seed}/{number}")
    source = random.choice(chosen)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "study"
        folder.mkdir()
        for each in source.texts:
            (folder / each).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source.folder / each, folder / each)
        is_fleet = source.study.startswith("fleet")
        damaged = folder / random.choice(source.texts[:-1] if is_fleet else source.texts)
        damaged.write_bytes(mutated(damaged.read_text(encoding="utf-8"), random))
        began = time.process_time()
        try:
            (load_fleet if is_fleet else load)(folder / source.study)
        except ElastidError as error:
            word, wrong = "refused", _faults(str(error), folder)
        except Exception as error:
            word, wrong = "exception", f"{type(error).__name__}: {error}"
        else:
            word, wrong = "taken", ""
        took = time.process_time() - began
    if took > MAX_S:
        wrong = f"took {took:.1f} s"
    return word, f"mutant {number} of {source.study}: {wrong}" if wrong else ""


def _faults(message: str, folder: Path) -> str:
    """What a refusal lacks."""
    lines = message.splitlines()
    if not lines or not PLACED.match(lines[0]):
        return f"no place: {message[:300]!r}"
    if not lines[0].startswith((str(folder), "/etc/hostname:")):  # which a mutant may name as its table
        return f"a place elsewhere: {lines[0][:200]!r}"
    return f"{len(message)} characters" if len(message) > 20_000 else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--mutants", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    count = 60 if given.quick else given.mutants
    with tempfile.TemporaryDirectory() as folder:
        chosen = seeds(Path(folder))
        found = ordered(partial(judged, seed=given.seed, chosen=chosen), range(count), given.jobs)
    ended = Counter(word for word, _ in found)
    findings = [wrong for _, wrong in found if wrong]
    for each in findings[:40]:
        print(each)
    print(f"{count} mutants of {len(set(chosen))} studies: {dict(ended)}, {len(findings)} findings")
    print(json.dumps({"mutants": count, "ended": dict(ended), "findings": len(findings)}))
    assert not findings
    assert ended["refused"] > count / 4
    assert ended["taken"] > count / 100


if __name__ == "__main__":
    main()
