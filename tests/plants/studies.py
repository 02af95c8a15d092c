"""Scripts of scripts/studies as modules, for the plants and measures that tests share with them."""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

STUDIES = Path(__file__).parents[2] / "scripts" / "studies"


@cache
def study(name: str) -> ModuleType:
    """scripts/studies/<name>.py."""
    found = importlib.util.spec_from_file_location(name, STUDIES / f"{name}.py")
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    # Its dataclasses look their module up.
    sys.modules[found.name] = module
    found.loader.exec_module(module)
    return module
