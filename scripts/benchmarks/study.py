"""A whole six-axis study from its file to its page, in CPU seconds by stage: where a user waits.

    python scripts/benchmarks/study.py [--quick]

The KR 300 with twelve springs (18 coordinates) in ten postures: 120 records of 8 s at 500 Hz with Coulomb friction, a
carrier and noise, 116 lines, 30 unknowns from 20 starts, one posture left out, by one process. CPU time of its children
is included, and all of it over a fixed mixture of FFT, products of matrices, copies and Python (all_over_work). The
last line is one JSON object; last_run.json has that of the last run.

Measured, in CPU seconds on two cores: 33 (all_s) in all; design 2.5 (design_s), measure 9.1 (measure_s), estimate 9.1
(estimate_s), fit 6.3 (fit_s), validate 3.2 (validate_s), report 2.5 (report_s).
"""

import json
import os
import random
import tempfile
from pathlib import Path

import timing

from elastid.app.console import Console
from elastid.app.run import Run, run_all
from elastid.study import load

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "kr300_twelve_springs.yml"
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
validation: {configurations: [c1]}
"""
# Postures are drawn about the middle, within these angles to either side, in degrees.
MIDDLE, REACH = (0, -80, 90, 0, 30, 0), (60, 30, 40, 80, 70, 90)


def cpu_s() -> float:
    """Return the CPU time, s, of this process and of its finished child processes."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def study(postures: int, realisations: int, starts: int) -> str:
    """Return the text of the study."""
    draw, ranges = random.Random(3), list(zip(MIDDLE, REACH, strict=True))
    rows = [
        ", ".join(f"{round(middle + draw.uniform(-reach, reach))} deg" for middle, reach in ranges)
        for _ in range(postures)
    ]
    text = STUDY.replace("ROBOT", str(ROBOT)).replace("REALISATIONS", str(realisations)).replace("STARTS", str(starts))
    return text.replace("CONFIGURATIONS", ", ".join(f"c{i + 1}: [{row}]" for i, row in enumerate(rows)))


def main() -> None:
    """Run the study. Print each stage when it ends, then one JSON line."""
    text = study(2, 2, 1) if timing.options(__doc__, "two postures, one start").quick else study(10, 2, 20)
    print(timing.machine(), flush=True)
    seconds = dict[str, float]()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "study.yml").write_text(text, encoding="utf-8")
        run = Run(load(folder / "study.yml"), folder / "run", 1, Console(-2))
        for stage in run.stages:
            begun = cpu_s()
            run_all(run, [stage])
            seconds[f"{stage}_s"] = cpu_s() - begun
            print(f"{stage:10s} {seconds[f'{stage}_s']:6.1f}", flush=True)
    seconds["all_s"] = sum(seconds.values())
    seconds["all_over_work"] = seconds["all_s"] / timing.bare_work_s()
    print(json.dumps({name: round(value, 1) for name, value in seconds.items()}))


if __name__ == "__main__":
    main()
