"""Whole studies from their files to their pages, in CPU seconds by stage: where a user waits.

    python scripts/benchmarks/study.py [--quick]

Six axes: the KR 300 with twelve springs (18 coordinates) in ten postures, 120 records of 8 s at 500 Hz with Coulomb
friction, a carrier and noise, 116 lines, 30 unknowns from 20 starts, one posture left out. Fleet: sixteen two-mass
robots on one date. Tuned move: a move of the demo's arm in 1.2 s on 50 draws. All by one process, CPU time of its
children included; a friction study is timed by friction.py, a large log by large_record.py, a map by map.py. The last
line is one JSON object; last_run.json has that of the last run.

Measured: the six-axis study takes 225.2 s (all_s): design 25.7 (design_s), measure 16.7 (measure_s), estimate
83.9 (estimate_s), fit 32.3 (fit_s), validate 35.1 (validate_s), report 31.5 (report_s). The fleet takes 0 s (fleet_s),
the tuned move 0 s (tuned_move_s).
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import random
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from timing import machine

from elastid.app.console import Console
from elastid.app.run import Run, run_stage
from elastid.study import load

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "scripts" / "studies"))
from fleet import really
from tuned_moves import ENDS, arm, given, tuned

STUDY = """\
name: six axes
seed: 1
robot: ROBOT
excitation: {rate_hz: 500, period: 4 s, band_hz: [2, 60], grid: odd, torque_rms: [1500, 1500, 1200, 300, 300, 200]}
experiment:
  configurations: {CONFIGURATIONS}
  realisations: REALISATIONS
  periods: 2
  transient_periods: 1
  simulated:
    carrier: {amplitude: 0.5 deg, cycles: 4}
    noise: {torque_std: 5, encoder_counts: 1048576}
    compiled: true
fit: {starts: STARTS, parameters: {"k_*": {}, "d_*": {}, "fm_*": {}}}
validation: {left_out: [c1]}
"""
# Postures are drawn about the middle, within these angles to either side, in degrees.
MIDDLE, REACH = (0, -80, 90, 0, 30, 0), (60, 30, 40, 80, 70, 90)


def cpu_s() -> float:
    """CPU time of this process and of those that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def timed(work: Callable[[], object]) -> float:
    """CPU seconds of some work."""
    begun = cpu_s()
    work()
    return cpu_s() - begun


def six_axes(folder: Path, postures: int, realisations: int, starts: int) -> dict[str, float]:
    """CPU seconds of each stage of the six-axis study."""
    draw = random.Random(3)
    rows = [
        ", ".join(
            f"{round(middle + draw.uniform(-reach, reach))} deg" for middle, reach in zip(MIDDLE, REACH, strict=True)
        )
        for _ in range(postures)
    ]
    filled = {
        "ROBOT": str(ROOT / "configs" / "robots" / "kr300_twelve_springs.yml"),
        "CONFIGURATIONS": ", ".join(f"c{i + 1}: [{row}]" for i, row in enumerate(rows)),
        "REALISATIONS": str(realisations),
        "STARTS": str(starts),
    }
    text = STUDY
    for name, value in filled.items():
        text = text.replace(name, value)
    (folder / "study.yml").write_text(text, encoding="utf-8")
    run = Run(load(folder / "study.yml"), folder / "run", 1, Console(-2))
    return {f"{stage}_s": timed(lambda stage=stage: run_stage(run, stage)) for stage in run.stages}


def main() -> None:
    """The table, then one JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two postures, two robots, one draw, to see that it runs")
    quick = parser.parse_args().quick
    print(machine())
    with tempfile.TemporaryDirectory() as temporary:
        found = six_axes(Path(temporary), *((3, 1, 1) if quick else (10, 2, 20)))
        found["all_s"] = sum(found.values())
        found["fleet_s"] = timed(lambda: really(2 if quick else 16, ("2026-01-31",), 1, Path(temporary) / "fleet"))
    if not quick:
        found["tuned_move_s"] = tuned(given(*arm(), 50), ENDS, 1.2)[1]
    for name, seconds in found.items():
        print(f"{name:14s} {seconds:6.1f}")
    print(json.dumps({name: round(seconds, 1) for name, seconds in found.items()}))


if __name__ == "__main__":
    main()
