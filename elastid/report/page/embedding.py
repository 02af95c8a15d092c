"""Scripts and style sheets in a page, and the policy that lets only the page's own scripts run."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable
from importlib.resources import files


def asset(*path: str) -> str:
    """A file of this package as text, without indentation and lines that are comments, CSS without spaces."""
    text = (files("elastid.report") / "page").joinpath(*path).read_text(encoding="utf-8")
    if path[-1].endswith(".css"):
        return re.sub(r"\s*([{};,])\s*|(?<=:) ", r"\1", text).strip()
    lines = (line.strip() for line in text.splitlines())
    return "\n".join(line for line in lines if line and not line.startswith("//"))


def script_policy(scripts: Iterable[str]) -> str:
    """The hashes of the scripts, as script-src of a content security policy lists them."""
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    return " ".join(f"'sha256-{digest}'" for digest in digests)
