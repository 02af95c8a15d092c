"""Places of the project's own files."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs"
ROBOTS = CONFIGS / "robots"
TEMPLATES = ROOT / "elastid" / "app" / "templates"
