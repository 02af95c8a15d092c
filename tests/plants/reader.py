"""A reader who follows a page: its commands and programs, one after the other in a folder."""

import os
import subprocess
import sys
from pathlib import Path

# `pip` and `uv` of a reader: the programs of this environment, without the network; the tests do not run themselves.
STAND_INS = {
    "pip": "exit 0",
    "uv": f'shift; [ "$1" != --group ] || shift 2; [ "$1" != pytest ] || exit 0; exec "{sys.executable}" -m "$@"',
}


class Reader:
    """Works in a folder; the stand-ins are in bin/ beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder, programs = folder, folder.parent / "bin"
        programs.mkdir()
        for name, line in STAND_INS.items():
            (programs / name).write_text(f"#!/bin/sh\n{line}\n")
            (programs / name).chmod(0o755)
        self.env = os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}

    def run(self, *command: str) -> str:
        """What a command prints; it ends well."""
        done = subprocess.run(command, cwd=self.folder, env=self.env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, (command, done.stdout[-2000:], done.stderr[-2000:])
        return done.stdout

    def run_shell(self, text: str) -> str:
        return self.run("bash", "-e", "-o", "pipefail", "-c", text)
