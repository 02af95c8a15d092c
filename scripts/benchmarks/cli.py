"""What the command line costs: loading, a report, and the demo with one process and two, as ratios.

    python scripts/benchmarks/cli.py [--quick | --loading] [--other PYTHON] [STUDY]

Loading: user and system time of fresh processes, with compiled byte code as after a first start, over that of a bare
Python. Imports of estimate: the sum that `python -X importtime` shows while it estimates the demo's responses. Report
and demo: the wall clock, since workers' times are not counted with their parent's; they want a machine with two quiet
cores and take some minutes, and --quick leaves them out. PYTHON is that of another checkout's environment
(`.venv/bin/python`): everything is then run by both in turns, and its medians over these are given. The last
line is JSON.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

# CPU time in s that a user does not notice.
LIMIT_S = {"elastid --help": 0.15, "elastid check": 0.5}


def cpu_s(command: Sequence[str], environment: dict[str, str], folder: Path) -> float:
    """User and system time of one process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment, cwd=folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def wall_s(command: Sequence[str], environment: dict[str, str], folder: Path) -> float:
    """The time of one process and its workers on the wall clock."""
    begin = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment, cwd=folder)
    return time.perf_counter() - begin


def imports_s(command: Sequence[str], environment: dict[str, str], folder: Path) -> float:
    """The time of all imports of one process."""
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment, cwd=folder)
    lines = [line.split("|") for line in done.stderr.splitlines() if line.startswith("import time:")]
    return sum(int(line[0].split()[-1]) for line in lines[1:]) / 1e6


def medians(
    measure: Callable[[Sequence[str], dict[str, str], Path], float],
    commands: dict[str, list[str]],
    folder: Path,
    rounds: int,
    begin: int = 1,
) -> dict[str, float]:
    """Median of each command, run in turns, after `begin` rounds that count for nothing and fill the caches."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(folder / "caches")
    times: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(rounds + begin):
        for name, command in commands.items():
            times[name].append(measure(command, environment, folder))
    return {name: statistics.median(values[begin:]) for name, values in times.items()}


def loading(python: str, study: Path) -> dict[str, list[str]]:
    """Commands that do little but load."""
    return {
        "python -c pass": [python, "-c", "pass"],
        "elastid --help": [python, "-m", "elastid", "--help"],
        "elastid check": [python, "-m", "elastid", "check", str(study)],
    }


def working(python: str, folder: Path) -> dict[str, list[str]]:
    """The demo, and its report again."""
    commands: dict[str, list[str]] = {}
    for jobs in ("1", "2"):
        run = folder / f"jobs-{jobs}"
        common = ["--run", str(run), "--jobs", jobs, "-q"]
        # A folder of its own each time: what is finished is kept.
        fresh = f"import shutil, sys; shutil.rmtree({str(run)!r}, True); from elastid.app.cli import main; main()"
        commands[f"demo --jobs {jobs}"] = [python, "-c", fresh, "demo", *common]
        commands[f"report --jobs {jobs}"] = [python, "-m", "elastid", "run", str(run / "study.yml"), "report", *common]
    return commands


def importing(python: str, folder: Path) -> dict[str, list[str]]:
    """Estimation of the demo's responses, import by import."""
    run = folder / "jobs-1"
    asked = ["run", str(run / "study.yml"), "estimate", "--run", str(run), "--jobs", "1", "-q"]
    return {"imports of estimate": [python, "-X", "importtime", "-m", "elastid", *asked]}


def main() -> None:
    """The table, then the JSON line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="one round of loading, to see that it runs")
    parser.add_argument("--loading", action="store_true", help="leave out the report and the demo")
    parser.add_argument("--other", help="the Python of another checkout")
    parser.add_argument("study", nargs="?", type=Path, help="default: the template of `elastid new`")
    arguments = parser.parse_args()
    pythons = {"": sys.executable, **({"other, ": arguments.other} if arguments.other else {})}
    with tempfile.TemporaryDirectory() as folder:
        study = arguments.study.resolve() if arguments.study else Path(folder) / "new" / "study.yml"
        if arguments.study is None:
            subprocess.run([sys.executable, "-m", "elastid", "new", str(study.parent)], check=True, capture_output=True)
        empty, rounds = Path(folder), 1 if arguments.quick else 15
        loads = {who + name: line for who, p in pythons.items() for name, line in loading(p, study).items()}
        cpu = medians(cpu_s, loads, empty, rounds)
        wall = {}
        if not (arguments.quick or arguments.loading):
            demos = {who: Path(folder) / f"demo-{number}" for number, who in enumerate(pythons)}
            works, estimates = (
                {who + name: line for who, p in pythons.items() for name, line in commands(p, demos[who]).items()}
                for commands in (working, importing)
            )
            wall = medians(wall_s, works, empty, 3, begin=0) | medians(imports_s, estimates, empty, 3)
    report(cpu, wall)


def report(cpu: dict[str, float], wall: dict[str, float]) -> None:
    """Times, ratios and limits."""
    bare = cpu["python -c pass"]
    over_bare = {name: round(value / bare, 2) for name, value in cpu.items()}
    both = cpu | wall
    over_this = {
        name: round(both[f"other, {name}"] / value, 2) for name, value in both.items() if f"other, {name}" in both
    }
    print(f"{'command':28s} {'s':>8s} {'x python':>9s} {'other x':>8s}")
    for name, value in both.items():
        print(f"{name:28s} {value:8.3f} {over_bare.get(name, ''):>9} {over_this.get(name, ''):>8}")
    for who in ("", "other, "):
        if f"{who}demo --jobs 2" in wall:
            ratio = wall[f"{who}demo --jobs 1"] / wall[f"{who}demo --jobs 2"]
            print(f"{who}demo: one process takes {ratio:.2f} times as long as two")
    assert over_bare["elastid --help"] < over_bare["elastid check"]
    print(
        json.dumps(
            {
                "cpu_s": {name: round(value, 4) for name, value in cpu.items()},
                "wall_s": {name: round(value, 2) for name, value in wall.items()},
                "ratio": over_bare,
                "other_over_this": over_this,
                "limit_s": LIMIT_S,
                "within_limits": all(cpu[name] <= limit for name, limit in LIMIT_S.items()),
            }
        )
    )


if __name__ == "__main__":
    main()
