"""What a page carries within itself: data in script elements, and the policy that lets only its own scripts run."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterable
from importlib.resources import files
from typing import Any


def embedded(content: Any) -> str:
    """JSON that may stand in a script element, which a `<` could end."""
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def asset(*path: str) -> str:
    """A file of this package as text."""
    return (files("elastid.report") / "page").joinpath(*path).read_text(encoding="utf-8").strip()


def script_policy(scripts: Iterable[str]) -> str:
    """The hashes of the scripts, as a content security policy names them in script-src."""
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    return " ".join(f"'sha256-{digest}'" for digest in digests)
