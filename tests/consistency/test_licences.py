"""Licences of the dependencies: those that bind a user are refused, and none of what is installed is."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
from licences import FORBIDDEN, main


@pytest.mark.parametrize(
    ("licence", "is_allowed"),
    [
        ("GPL-3.0-or-later", False),
        ("GNU Affero General Public License v3", False),
        ("CC-BY-NC-4.0", False),
        ("LGPL-3.0-only", True),
        ("GNU Lesser General Public License v3 or later (LGPLv3+)", True),
        ("BSD-3-Clause AND MIT", True),
    ],
)
def test_licences_that_bind_a_user_are_refused(licence: str, is_allowed: bool) -> None:
    assert (FORBIDDEN.search(licence) is None) == is_allowed


def test_what_is_installed_passes(capsys: pytest.CaptureFixture[str]) -> None:
    """CasADi's LGPL is among the licences."""
    assert main() == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("casadi ") and "Lesser" in line]
