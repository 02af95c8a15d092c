"""Licences of the installed dependencies in uv.lock; exit code 1 where one binds a user, or is not stated.

    python scripts/licences.py

Refused are GPL, AGPL and non-commercial ones; the LGPL is that of libraries.
"""

import re
import sys
import tomllib
from importlib.metadata import Distribution, distributions
from pathlib import Path

from packaging.utils import canonicalize_name

LOCK = Path(__file__).parents[1] / "uv.lock"
FORBIDDEN = re.compile(r"\bA?GPL|(?<!LESSER )GENERAL PUBLIC|AFFERO|NON-?COMMERCIAL|\bNC\b", re.IGNORECASE)
# Licences that the metadata leave out, or state for more than what is installed; read in the packages themselves.
STATED_LICENCES = {
    "cmeel-qhull": "Qhull (free to use, with its notice)",
    "docutils": "public domain, BSD-2-Clause, PSF (the GPL is that of a mode for Emacs in its sources)",
    "fmpy": "BSD-2-Clause",
}


def licence_of(distribution: Distribution) -> str:
    """Return the licence of an installed package: as an expression, as classifiers, or as the first line of a text."""
    metadata = distribution.metadata.json
    if expression := metadata.get("license_expression"):
        return str(expression)
    classifiers = [each for each in metadata.get("classifier", ()) if each.startswith("License :: ")]
    names = [each.rpartition(" :: ")[2] for each in classifiers if each.count(" :: ") > 1]
    return "; ".join(names or str(metadata.get("license") or "").strip().splitlines()[:1])


def main() -> int:
    packages = tomllib.loads(LOCK.read_text(encoding="utf-8"))["package"]
    installed, rejections = {str(canonicalize_name(each.metadata["Name"])): each for each in distributions()}, []
    for name in sorted({each["name"] for each in packages if "registry" in each["source"]} & set(installed)):
        licence = STATED_LICENCES.get(name) or licence_of(installed[name])
        print(f"{name:30} {installed[name].version:12} {licence}")
        if name not in STATED_LICENCES and (not licence or FORBIDDEN.search(licence)):
            rejections.append(f"refused: {name}: {licence or 'no licence is stated'}")
    print(*rejections, sep="\n", end="\n" if rejections else "")
    return 1 if rejections else 0


if __name__ == "__main__":
    sys.exit(main())
