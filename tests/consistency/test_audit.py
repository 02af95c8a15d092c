"""The audit of the dependencies: affected versions and forbidden licences are found, and uv.lock has none."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest

AUDIT = Path(__file__).parents[2] / "scripts" / "audit" / "audit.py"
ADVISORY = {"package": "jinja2", "id": "PYSEC-1", "aliases": ["CVE-1"], "summary": "A sandbox is left", "versions": []}


@pytest.fixture(scope="module")
def audit() -> ModuleType:
    spec = importlib.util.spec_from_file_location("audit", AUDIT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def lock_of(folder: Path, **versions: str) -> Path:
    path = folder / "uv.lock"
    packages = (
        f'[[package]]\nname = "{name}"\nversion = "{version}"\nsource = {{ registry = "x" }}\n'
        for name, version in versions.items()
    )
    path.write_text("\n".join([*packages, '[[package]]\nname = "elastid"\nsource = { editable = "." }\n']))
    return path


@pytest.mark.parametrize(
    ("version", "ranges", "is_hit"),
    [
        ("3.1.5", [{"introduced": "0", "fixed": "3.1.6"}], True),
        ("3.1.6", [{"introduced": "0", "fixed": "3.1.6"}], False),
        ("3.1.10", [{"introduced": "3.1.9", "fixed": "3.1.11"}], True),
        ("3.0", [{"introduced": "3.1"}], False),
        ("4.0", [{"introduced": "3.1"}], True),
        ("2.9", [{"introduced": "0", "last_affected": "2.9"}], True),
        ("2.9.1", [{"introduced": "0", "last_affected": "2.9"}], False),
        ("5.0rc1", [{"introduced": "0", "fixed": "2.0"}, {"introduced": "5.0rc1", "fixed": "5.0"}], True),
    ],
)
def test_an_affected_version_ends_the_check(
    version: str,
    ranges: list[dict[str, str]],
    is_hit: bool,
    audit: ModuleType,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Versions are compared as versions, not as texts; the snapshot's date is printed either way."""
    snapshot = tmp_path / "advisories.json"
    content = {"date": "2026-01-31", "source": "test", "packages": ["jinja2"]}
    snapshot.write_text(json.dumps(content | {"advisories": [ADVISORY | {"ranges": ranges}]}))
    assert audit.check(lock_of(tmp_path, jinja2=version, click="8.1"), snapshot) == int(is_hit)
    said = capsys.readouterr().out
    assert "2026-01-31" in said
    assert "not in that snapshot: click; refresh it" in said
    assert (f"jinja2 {version}: PYSEC-1, CVE-1: A sandbox is left" in said) == is_hit


@pytest.mark.parametrize(
    ("licence", "is_allowed"),
    [
        ("GPL-3.0-or-later", False),
        ("GNU General Public License v2 (GPLv2)", False),
        ("GNU Affero General Public License v3", False),
        ("AGPLv3", False),
        ("CC-BY-NC-4.0", False),
        ("free for non-commercial use", False),
        ("", False),
        ("LGPL-3.0-only", True),
        ("GNU Lesser General Public License v3 or later (LGPLv3+)", True),
        ("BSD-3-Clause AND MIT", True),
    ],
)
def test_licences_that_bind_a_user_are_refused(licence: str, is_allowed: bool, audit: ModuleType) -> None:
    assert audit.is_allowed("package", licence) == is_allowed


def test_the_locked_versions_and_what_is_installed_of_them_pass(
    audit: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    """Offline; CasADi's LGPL is among the licences."""
    assert audit.check() == 0
    assert audit.licences() == 0
    said = capsys.readouterr().out
    assert "advisories of 20" in said
    assert [line for line in said.splitlines() if line.startswith("casadi ") and "Lesser" in line]


def test_a_database_becomes_a_snapshot(audit: ModuleType) -> None:
    """Ranges of versions, not of commits; nothing of other packages, and nothing that was withdrawn."""
    text = """
id: PYSEC-2
details: See https://example.org/x for more.
aliases: [CVE-2]
affected:
- package: {ecosystem: PyPI, name: Jinja2}
  ranges:
  - {type: GIT, events: [{introduced: "0"}, {fixed: abcdef}]}
  - {type: ECOSYSTEM, events: [{introduced: "0"}, {fixed: "2.1"}, {introduced: "3.0"}]}
  versions: ["1.0"]
- package: {ecosystem: PyPI, name: other}
  versions: ["1.0"]
"""
    (found,) = audit._read(text, ["jinja2"])
    assert found["ranges"] == [{"introduced": "0", "fixed": "2.1"}, {"introduced": "3.0"}]
    assert found["summary"] == "See ... for more."
    assert audit.is_affected("3.0.1", found)
    assert not audit.is_affected("2.5", found)
    assert not list(audit._read(text + "withdrawn: 2025-01-01\n", ["jinja2"]))
