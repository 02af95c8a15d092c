"""Ratios of the benchmarks against the committed ones, by what the processor has; none may be half as large again.

    python scripts/benchmarks/watch.py [--write] [--only NAME ...]

Every benchmark of WATCHED measures its ratios to a floor or a peer in the same process. `ratios.toml` has the ratio of
each for processors with AVX-512, AVX2 and any other; one that has no ratio yet is held to the largest of the others.
--write takes the ratios of this machine. Exit code 1 where one is above LIMIT times the committed one.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

LIMIT = 1.5
HERE = Path(__file__).parent
COMMITTED = HERE / "ratios.toml"
# Benchmark: options of a run that is short and whose ratios are those of a long one, and the ratios. The floor of
# a fit is bare solves: products of large matrices are twice as fast on one processor with AVX-512 as on another.
WATCHED = {
    "cli": (("--loading",), ("ratio.elastid --help", "ratio.elastid check")),
    "fit": (("--passes",), ("evaluation_over_solve", "inertial_evaluation_over_solve")),
    "frf": (("--no-peers",), ("A_over_floor", "B_over_floor", "B_log_over_floor")),
    "simulation": ((), ("six_axes.time_over_mujoco",)),
    "study": (("--quick",), ("all_over_work",)),
    "large_fit": (("--configurations", "40"), ("cpu_over_work",)),
}
Ratios = Mapping[str, Mapping[str, float]]


def feature() -> str:
    """What the processor has: avx512, avx2 or other."""
    cpuinfo = Path("/proc/cpuinfo")
    flags = set(cpuinfo.read_text(encoding="utf-8").split()) if cpuinfo.is_file() else set()
    return "avx512" if "avx512f" in flags else "avx2" if "avx2" in flags else "other"


def measured(name: str) -> dict[str, float]:
    """The watched ratios of a benchmark; those to a peer that is not installed are left out."""
    options, ratios = WATCHED[name]
    command = [sys.executable, str(HERE / f"{name}.py"), *options]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    content, found = json.loads(said[-1]), {}
    for ratio in ratios:
        value = content
        for key in ratio.split("."):
            value = value.get(key, {})
        if value:
            found[f"{name}: {ratio}"] = round(float(value), 2)
    return found


def allowed(ratio: str, committed: Ratios, own: str) -> float | None:
    """The committed ratio of these processors, else the largest of the others."""
    others = [each[ratio] for each in committed.values() if ratio in each]
    return committed.get(own, {}).get(ratio, max(others, default=None))


def written(committed: Ratios) -> str:
    """The file."""
    text = "# Ratios of scripts/benchmarks/watch.py, by what the processor has; `--write` takes those of a machine.\n"
    for name, ratios in sorted(committed.items()):
        text += "".join([f"\n[{name}]\n", *(f'"{ratio}" = {value}\n' for ratio, value in ratios.items())])
    return text


def main() -> int:
    """A line for each ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="take the ratios of this machine into ratios.toml")
    parser.add_argument("--only", nargs="+", choices=list(WATCHED), default=list(WATCHED))
    given, own = parser.parse_args(), feature()
    committed = tomllib.loads(COMMITTED.read_text(encoding="utf-8")) if COMMITTED.exists() else {}
    found, over = dict[str, float](), 0
    for name in given.only:
        for ratio, value in measured(name).items():
            limit = allowed(ratio, committed, own)
            found[ratio], is_over = value, limit is not None and value > LIMIT * limit
            over += is_over
            print(f"{ratio:42} {value:8.2f}, committed {limit}{', TOO LARGE' * is_over}", flush=True)
    if given.write:
        COMMITTED.write_text(written(committed | {own: {**committed.get(own, {}), **found}}), encoding="utf-8")
    return int(over > 0 and not given.write)


if __name__ == "__main__":
    sys.exit(main())
