"""Speed of this commit against the merge base and the last release, measured in one job; exit code 1 if it is slower.

    python scripts/benchmarks/speed.py [BASE] [--release COMMIT] [--only WORKLOAD ...]

BASE is by default the merge base with origin/main or main; on main itself it is the parent commit. The last release is
the newest tag, or RELEASE. Each commit is checked out into a temporary folder with an environment of its own. Commands
run in fresh processes with one thread, in turns (A B C, C B A, ...), and their user and system times are compared in
pairs. A workload fails if its median log ratio exceeds the limit in 9 pairs, and the lower end of the 99 % interval in
18 new pairs. A commit that is missing, as in a shallow clone, is reported and not compared.

The interval is the distribution-free interval of the signed-rank test for the Hodges-Lehmann estimate (Hollander, Wolfe
and Chicken, Nonparametric Statistical Methods, 3rd ed. 2014, sections 3.2 and 3.3): pairs differ symmetrically.
"""

import argparse
import math
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
# Without a tag: the last state before the public names of format 10, which users have.
RELEASE = "aafe4fe1"
LIMITS = {"base": 1.05, "release": 1.15}
PAIRS, CONFIDENCE = (9, 18), 0.99
TEMPLATES = ("serial", "friction")
FRF = "import elastid as e; r = e.load('serial/run/records.h5'); [e.estimate(r, friction='none') for _ in range(10)]"
FIT = (
    "import elastid as e; r = e.read_robot('serial/robot.yml'); f = [*e.load('serial/run/frf.h5').values()];"
    "e.identify(f, r, starts=20, seed=1)"
)


def stage(template: str, *stages: str) -> list[str]:
    """Return arguments that run stages of a study again, or all unfinished ones."""
    return ["-m", "elastid", "run", f"{template}/study.yml", *stages, "--run", f"{template}/run", "--jobs", "1", "-q"]


# Arguments of Python, and how often they are run for one time.
WORKLOADS: dict[str, tuple[list[str], int]] = {
    "help": (["-m", "elastid", "--help"], 5),
    "check": (["-m", "elastid", "check", "serial/study.yml"], 2),
    **{each: (stage("serial", each), 1) for each in ("measure", "estimate", "fit", "validate", "report")},
    "friction": (stage("friction", "friction"), 1),
    "frf kernel": (["-c", FRF], 1),
    "fit kernel": (["-c", FIT], 1),
}


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Lower end, Hodges-Lehmann estimate and upper end of the interval of the median; 8 values or more."""
    n = len(values)
    walsh = sorted((values[i] + values[j]) / 2 for i in range(n) for j in range(i, n))
    counts = [1] + [0] * len(walsh)  # subsets of the ranks 1 to n by their sum: null distribution of the statistic
    for rank in range(1, n + 1):
        counts = [counts[s] + (counts[s - rank] if s >= rank else 0) for s in range(len(counts))]
    outside, tail = 0, 0
    while (tail + counts[outside]) / 2**n <= (1 - CONFIDENCE) / 2:
        tail, outside = tail + counts[outside], outside + 1
    return walsh[outside - 1], (walsh[(len(walsh) - 1) // 2] + walsh[len(walsh) // 2]) / 2, walsh[-outside]


def is_slower(samples: Iterable[Sequence[float]], limit: float, name: str) -> bool:
    """Return True if the median of the first sample of log ratios exceeds the limit, and the interval of the second."""
    for sample in samples:
        low, middle, high = (math.exp(end) for end in interval(sample))
        print(f"{name}: {middle:.3f} ({low:.3f} to {high:.3f}, {len(sample)} pairs), limit {limit}", flush=True)
        if (low if len(sample) == PAIRS[1] else middle) <= limit:
            return False
    return True


def git(*arguments: str) -> str:
    """Return output of a git command, empty if it fails."""
    process = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    return process.stdout.strip() if process.returncode == 0 else ""


def commits(base: str, release: str) -> dict[str, str]:
    """Return commits to compare by their role; those that this clone does not have are left out and reported."""
    head = git("rev-parse", "HEAD")
    bases = [git("merge-base", "HEAD", branch) for branch in ("origin/main", "main")]
    names = {
        "base": base or next((commit for commit in bases if commit not in ("", head)), "HEAD^"),
        "release": release or git("describe", "--tags", "--abbrev=0", "HEAD^") or RELEASE,
    }
    available = {"head": head}
    for role, name in names.items():
        commit = git("rev-parse", "--verify", "--quiet", f"{name}^{{commit}}")
        print(f"{role}: {name} {commit[:10] or 'is not in this clone: not compared'}", flush=True)
        if commit:
            available[role] = commit
    return available


class Checkout:
    """A commit in a folder of its own, with its environment, and its runs of the studies."""

    def __init__(self, folder: Path, commit: str) -> None:
        self.folder, self.python = folder, folder / ".venv" / "bin" / "python"
        environment = {
            name: value for name, value in os.environ.items() if name not in ("PYTHONDONTWRITEBYTECODE", "VIRTUAL_ENV")
        }
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        self.environment = environment | threads | {"PYTHONHASHSEED": "0"}
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", folder, commit], cwd=ROOT, check=True)
        subprocess.run(["uv", "sync", "--quiet"], cwd=folder, env=self.environment, check=True)
        for template in TEMPLATES:
            self.run(["-m", "elastid", "new", template, "--template", template])

    def run(self, command: Sequence[str]) -> bool:
        """Run a command of Python. Return True if it succeeds."""
        none = subprocess.DEVNULL
        return not subprocess.call(
            [self.python, *command], cwd=self.folder, env=self.environment, stdin=none, stdout=none, stderr=none
        )

    def work(self, name: str) -> bool:
        """Run a workload. Return True if it succeeds."""
        command, count = WORKLOADS[name]
        return all(self.run(command) for _ in range(count))

    def seconds(self, name: str) -> float:
        """Return user and system time of a workload in fresh processes."""
        start = resource.getrusage(resource.RUSAGE_CHILDREN)
        if not self.work(name):
            raise SystemExit(f"{name} fails in {self.folder.name}")
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
        return end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime


def prepare(folder: Path, revisions: Mapping[str, str], needs_results: bool) -> dict[str, Checkout]:
    """Make checkouts, with finished runs if needed; with the oldest commit's studies if all commits accept them."""
    sides = {role: Checkout(folder / role, commit) for role, commit in revisions.items()}
    oldest = [*sides.values()][-1]
    for template in TEMPLATES:
        study = oldest.folder / template
        is_common = all(side.run(["-m", "elastid", "check", f"{study}/study.yml"]) for side in sides.values())
        print(f"{template}: {'one study for all' if is_common else 'each commit runs its own study'}", flush=True)
        for side in sides.values():
            if is_common and side is not oldest:
                shutil.copytree(study, side.folder / template, dirs_exist_ok=True)
    for side in sides.values():
        for template in TEMPLATES if needs_results else ():
            side.run(stage(template))
    return sides


def log_ratios(sides: Mapping[str, Checkout], name: str, pairs: int) -> dict[str, list[float]]:
    """Log ratios of the head's time to the time of each other role, measured in turns."""
    ratios: dict[str, list[float]] = {role: [] for role in sides if role != "head"}
    for index in range(pairs):
        times = {role: sides[role].seconds(name) for role in [*sides][:: -1 if index % 2 else 1]}
        for role, values in ratios.items():
            values.append(math.log(times["head"] / times[role]))
    return ratios


def samples(sides: Mapping[str, Checkout], name: str, first: Sequence[float]) -> Iterator[Sequence[float]]:
    """Yield the log ratios `first`, then the log ratios of a repetition with more pairs."""
    yield first
    yield from log_ratios(sides, name, PAIRS[1]).values()


def slower(sides: Mapping[str, Checkout], name: str) -> list[str]:
    """Return workload and roles to which the head is slower, after one warm-up run of each."""
    able = {role: side for role, side in sides.items() if side.work(name) or role == "head"}
    results = []
    for role, first in log_ratios(able, name, PAIRS[0]).items():
        repeat = samples({each: able[each] for each in ("head", role)}, name, first)
        results += [f"{name} over {role}"] * is_slower(repeat, LIMITS[role], f"{name} over {role}")
    return results


def main() -> int:
    """Print a line for each workload and commit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", nargs="?", default="")
    parser.add_argument("--release", default="")
    parser.add_argument("--only", nargs="+", choices=list(WORKLOADS), default=list(WORKLOADS))
    arguments, begin = parser.parse_args(), time.monotonic()
    revisions = commits(arguments.base, arguments.release)
    with tempfile.TemporaryDirectory() as folder:
        try:
            needs_results = not {*arguments.only} <= {"help", "check"}
            sides = prepare(Path(folder), revisions, needs_results) if len(revisions) > 1 else {}
            slow = [each for name in arguments.only if sides for each in slower(sides, name)]
        finally:
            for role in revisions:
                git("worktree", "remove", "--force", f"{folder}/{role}")
    print(f"{len(slow)} slower{': ' * bool(slow)}{'; '.join(slow)}; {time.monotonic() - begin:.0f} s")
    return int(bool(slow))


if __name__ == "__main__":
    sys.exit(main())
