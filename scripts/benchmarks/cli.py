"""CPU time of `elastid --help` and `elastid check`, as ratios to a bare Python.

    python scripts/benchmarks/cli.py [--quick] [STUDY]

Each command runs in fresh processes, in turns with the others, with compiled byte code as after a first start; the
median of user and system time counts. The last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

LIMIT_S = {"elastid --help": 0.15, "elastid check": 0.5}


def cpu_s(command: list[str], environment: dict[str, str]) -> float:
    """User and system time of one process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(study: Path, caches: Path, rounds: int) -> dict[str, float]:
    """Median CPU seconds of each command, after one warm-up that fills the byte-code caches."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(caches)
    elastid = [sys.executable, "-m", "elastid"]
    commands = {
        "python -c pass": [sys.executable, "-c", "pass"],
        "elastid --help": [*elastid, "--help"],
        "elastid check": [*elastid, "check", str(study)],
    }
    times: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(rounds + 1):
        for name, command in commands.items():
            times[name].append(cpu_s(command, environment))
    return {name: statistics.median(values[1:]) for name, values in times.items()}


def main() -> None:
    """The table, then the JSON line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="one round, to see that it runs")
    parser.add_argument("study", nargs="?", type=Path, help="default: the template of `elastid new`")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        study = arguments.study or Path(folder) / "new" / "study.yml"
        if arguments.study is None:
            subprocess.run([sys.executable, "-m", "elastid", "new", str(study.parent)], check=True, capture_output=True)
        seconds = measured(study, Path(folder) / "caches", 1 if arguments.quick else 15)
    bare = seconds["python -c pass"]
    print(f"{'command':16s} {'CPU s':>8s} {'ratio':>7s} {'limit s':>8s}")
    for name, value in seconds.items():
        limit = f"{LIMIT_S[name]:.2f}" if name in LIMIT_S else ""
        print(f"{name:16s} {value:8.3f} {value / bare:7.1f} {limit:>8s}")
    print(
        json.dumps(
            {
                "cpu_s": {name: round(value, 4) for name, value in seconds.items()},
                "ratio": {name: round(value / bare, 2) for name, value in seconds.items()},
                "limit_s": LIMIT_S,
                "within_limits": all(seconds[name] <= limit for name, limit in LIMIT_S.items()),
            }
        )
    )


if __name__ == "__main__":
    main()
