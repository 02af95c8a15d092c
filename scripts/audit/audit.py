"""Audit of the dependencies: known vulnerabilities of the versions in uv.lock, and their licences.

    python scripts/audit/audit.py check              compare uv.lock with scripts/audit/advisories.json; offline
    python scripts/audit/audit.py licences           list the licences of what is installed of uv.lock
    python scripts/audit/audit.py refresh FOLDER     make advisories.json from a clone of the PyPA advisory database

`check` ends with exit code 1 where a locked version is affected, `licences` where one is under the GPL or AGPL, forbids
commercial use, or is not stated. The snapshot is as old as its date, which both `check` and the file say; pip-audit
asks for the advisories of today (SECURITY.md).
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[2]
LOCK, SNAPSHOT = ROOT / "uv.lock", Path(__file__).with_name("advisories.json")
# Advisories that do not concern elastid, and why.
ACCEPTED: Mapping[str, str] = {}
FORBIDDEN = re.compile(r"\bA?GPL|(?<!LESSER )GENERAL PUBLIC|AFFERO|NON-?COMMERCIAL|\bNC\b", re.IGNORECASE)
# Licences that the metadata leave out, or state for more than what is installed; read in the packages themselves.
STATED = {
    "cmeel-qhull": "Qhull (free to use, with its notice)",
    "docutils": "public domain, BSD-2-Clause, PSF (the GPL is that of a mode for Emacs in its sources)",
    "fmpy": "BSD-2-Clause",
}


def locked(lock: Path = LOCK) -> list[tuple[str, str]]:
    """Name and version of every package of a lock file but elastid itself."""
    packages = tomllib.loads(lock.read_text(encoding="utf-8"))["package"]
    return sorted((each["name"], each["version"]) for each in packages if "registry" in each["source"])


def hits(packages: Iterable[tuple[str, str]], snapshot: Mapping[str, Any]) -> Iterator[str]:
    """A sentence for each advisory that affects a locked version, but for those that are accepted."""
    for name, version in packages:
        for advisory in snapshot["advisories"]:
            if advisory["package"] == name and advisory["id"] not in ACCEPTED and is_affected(version, advisory):
                fixed = sorted({each["fixed"] for each in advisory["ranges"] if "fixed" in each}, key=Version)
                known = ", ".join([advisory["id"], *advisory["aliases"]])
                remedy = f"fixed in {', '.join(fixed)}" if fixed else "no release without it is known"
                yield f"{name} {version}: {known}: {advisory['summary']} ({remedy})"


def is_affected(version: str, advisory: Mapping[str, Any]) -> bool:
    """True if a version is listed, or lies within a range from `introduced` to `fixed` or `last_affected`."""
    at = Version(version)
    return version in advisory["versions"] or any(
        Version(each["introduced"]) <= at
        and not ("fixed" in each and at >= Version(each["fixed"]))
        and not ("last_affected" in each and at > Version(each["last_affected"]))
        for each in advisory["ranges"]
    )


def check(lock: Path = LOCK, snapshot_file: Path = SNAPSHOT) -> int:
    """Print the date of the snapshot and the advisories that affect locked versions; 1 where there are any."""
    snapshot, packages = json.loads(snapshot_file.read_text(encoding="utf-8")), locked(lock)
    found = list(hits(packages, snapshot))
    new = sorted({name for name, _ in packages} - set(snapshot["packages"]))
    print(
        f"{len(packages)} locked packages, {len(found)} affected by the {len(snapshot['advisories'])} advisories of "
        f"{snapshot['date']} ({snapshot['source']})"
    )
    if new:
        print(f"not in that snapshot: {', '.join(new)}; refresh it")
    for sentence in found:
        print(sentence)
    return 1 if found else 0


def refresh(database: Path, lock: Path = LOCK, snapshot_file: Path = SNAPSHOT) -> None:
    """Write the advisories of all locked packages in a clone of the database, with the date of its last commit."""
    names = sorted({name for name, _ in locked(lock)})
    date, commit = _git(database, "log", "-1", "--format=%cs %h").split()
    files = _git(database, "ls-tree", "-r", "--name-only", "HEAD", "vulns").splitlines()
    wanted = [path for path in files if Path(path).suffix == ".yaml" and Path(path).parent.name in names]
    advisories = [each for path in wanted for each in _read(_git(database, "show", f"HEAD:{path}"), names)]
    snapshot = {
        "date": date,
        "source": f"PyPA advisory database, commit {commit}",
        "packages": names,
        "advisories": sorted(advisories, key=lambda each: (each["package"], each["id"])),
    }
    snapshot_file.write_text(json.dumps(snapshot, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{snapshot_file}: {len(advisories)} advisories of {date} for {len(names)} packages")


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, encoding="utf-8").stdout


def _read(text: str, names: Sequence[str]) -> Iterator[dict[str, Any]]:
    """The parts of an advisory (OSV schema) about the packages of those names; none of one that was withdrawn."""
    from ruamel.yaml import YAML

    content = YAML(typ="safe").load(text)
    text = re.sub(r"\S+://\S+", "...", str(content.get("summary") or content["details"]))
    for affected in content["affected"] if "withdrawn" not in content else ():
        name = canonicalize_name(affected["package"]["name"])
        events = [each["events"] for each in affected.get("ranges", ()) if each["type"] == "ECOSYSTEM"]
        if name in names:
            yield {
                "package": name,
                "id": content["id"],
                "aliases": list(content.get("aliases", ())),
                "summary": textwrap.shorten(text, 160, placeholder=" ..."),
                "ranges": [each for of in events for each in _ranges(of)],
                "versions": [] if events else list(map(str, affected.get("versions", ()))),
            }


def _ranges(events: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """Events in their order as ranges, each from one `introduced` to what ends it."""
    ranges: list[dict[str, str]] = []
    for event in events:
        if "introduced" in event:
            ranges.append({})
        if ranges:
            ranges[-1] |= {key: str(value) for key, value in event.items()}
    return ranges


def licence_of(distribution: Distribution) -> str:
    """The licence of an installed package: stated here, as an expression, as classifiers, or as a text."""
    metadata = distribution.metadata.json
    if stated := STATED.get(canonicalize_name(str(metadata["name"]))):
        return stated
    if expression := metadata.get("license_expression"):
        return str(expression)
    prefix = "License :: "
    classifiers = [each for each in metadata.get("classifier", ()) if each.startswith(prefix)]
    words = [each.rpartition(" :: ")[2] for each in classifiers if each.count(" :: ") > 1]
    text = str(metadata.get("license") or "").strip().splitlines()
    # A text of several lines is the licence itself, whose first line is a title or a copyright.
    return "; ".join(words or text[:1])


def is_allowed(name: str, licence: str) -> bool:
    """True for a licence that is stated and neither GPL, AGPL nor non-commercial; the LGPL is that of libraries."""
    return name in STATED or (bool(licence) and not FORBIDDEN.search(licence))


def licences(lock: Path = LOCK) -> int:
    """Print the licence of every locked package that is installed; 1 where one is forbidden or not stated."""
    installed = {str(canonicalize_name(each.metadata["Name"])): each for each in distributions()}
    refused, absent = [], []
    for name in dict.fromkeys(name for name, _ in locked(lock)):
        if name not in installed:
            absent.append(name)
            continue
        licence = licence_of(installed[name])
        print(f"{name:30} {installed[name].version:12} {licence}")
        if not is_allowed(name, licence):
            refused.append(f"{name}: {licence or 'no licence is stated'}")
    if absent:
        print(f"not installed here: {', '.join(absent)}")
    for sentence in refused:
        print(f"refused: {sentence}")
    return 1 if refused else 0


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("check")
    commands.add_parser("licences")
    commands.add_parser("refresh").add_argument("folder", type=Path, help="clone of the PyPA advisory database")
    options = parser.parse_args(arguments)
    if options.command == "refresh":
        refresh(options.folder)
        return 0
    return check() if options.command == "check" else licences()


if __name__ == "__main__":
    sys.exit(main())
