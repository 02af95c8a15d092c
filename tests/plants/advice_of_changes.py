"""Cases of advice to lower or to raise a number: too large or too small it is refused, changed it is not."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elastid.excitation.grids import grid_lines
from elastid.experiment.specs.recorded import FileSpec
from elastid.robot.friction import LoadDependence
from elastid.study import load
from plants.advice import Case, Desk, case, refusal, rendered
from plants.advice_of_logs import estimated, lab_log, noise, said_of
from plants.lab_logs import N, save_csv
from plants.two_axes import ROBOT, STUDY

MOTOR = "robot.bodies.0.joints.0.motor"
LUGRE = (f"{MOTOR}.friction={{coulomb: 1, stiction: 2, stribeck_velocity: 0.1, "
         "lugre: {stiffness: 1e4, damping: 10}}")  # fmt: skip
# (module, advice): overrides that provoke the message at `check`, the change.
AT_CHECK: dict[tuple[str, str], tuple[Sequence[str], str]] = {
    ("excitation/spec.py", "lower rate_hz"): (["excitation.rate_hz=1e9"], "excitation.rate_hz=500"),
    ("excitation/spec.py", "lower band_hz"): (["excitation.band_hz=[2, 300]"], "excitation.band_hz=[2, 200]"),
    ("excitation/spec.py", "raise rate_hz"): (["excitation.band_hz=[2, 300]"], "excitation.rate_hz=1000"),
    ("robot/friction.py", "lower damping"): ([LUGRE], f"{MOTOR}.friction.lugre.damping=0.01"),
    ("robot/friction.py", "raise viscous"): ([LUGRE], f"{MOTOR}.viscous=20"),
}
# Messages of rehearsals, of designs and of searches, whose changes no case makes: only that their keys exist is tried.
NOT_FOLLOWED = {
    ("recorded/planned_run.py", "lower excitation.torque_rms"),
    ("design/choice.py", "lower robust.factor"),
    ("design/choice.py", "lower singular"),
    ("design/design.py", "lower count"),
    ("design/design.py", "lower excitation.torque_rms"),
    ("design/design.py", "raise excitation.torque_rms"),
    ("design/friction.py", "widen friction.passes.window"),
    ("design/friction_axis.py", "lower limits.acceleration"),
    ("design/friction_axis.py", "raise experiment.simulated.controller.bandwidth_hz"),
    ("design/limits.py", "lower excitation.torque_rms"),
    ("design/limits.py", "raise excitation.margin"),
    ("experiment/simulated/friction_rig.py", "Raise experiment.simulated.controller.bandwidth_hz"),
    ("experiment/simulated/rig.py", "Lower excitation.torque_rms"),
    ("experiment/simulated/rig.py", "lower excitation.torque_rms"),
    ("experiment/simulated/rig.py", "raise experiment.simulated.controller.bandwidth_hz"),
    ("fit/diagnosis/status.py", "lower fit.start_factor"),
    ("fit/diagnosis/status.py", "raise fit.starts"),
    ("fit/result.py", "raise fit.starts"),
    ("use/command/moves.py", "widen robot.bodies.joints.limits.angle"),
}


def _at_check(module: str, text: str) -> Case:
    def followed(desk: Desk) -> None:
        faults, change = AT_CHECK[module, text]
        study = Path(desk.write(study=STUDY, robot=ROBOT))
        assert rendered(text, refusal(lambda: load(study, faults)))
        assert refusal(lambda: load(study, [*faults, change])) == ""

    followed.__name__ = f"{module}: {text}"
    return followed


for key in AT_CHECK:
    case(*key)(_at_check(*key))


@case("excitation/grids.py", "widen band_hz")
def band_between_two_lines(desk: Desk) -> None:
    def lines(high: float) -> str:
        return refusal(lambda: grid_lines("full", (2.1, high), 500.0, 1000))

    assert rendered("widen band_hz", lines(2.2))
    assert lines(2.6) == ""


@case("robot/friction.py", "raise stiction")
def stiction_that_nothing_falls_from(desk: Desk) -> None:
    def law(stiction: float) -> str:
        return refusal(lambda: LoadDependence(coulomb=0.1, stiction=stiction, stribeck_velocity=0.1))

    assert rendered("raise stiction", law(0.05))
    assert law(0.2) == ""


@case("study/checks/logs.py", "lower rate_hz")
def rate_of_another_log(desk: Desk) -> None:
    t = np.arange(400) / 100.0
    log = np.column_stack([t, np.random.default_rng(0).standard_normal((400, 2))])
    np.savetxt(desk.folder / "log.csv", log, header="t,u,q", comments="", delimiter=",")
    text = (
        "name: late\nrobot: robot.yml\nfriction: {passes: detect}\nexperiment:\n  recorded:\n    rate_hz: 500\n"
        "    time: t\n    channels:\n      - {role: u, at: motor 1, channel: u}\n"
        "      - {role: y, at: motor 1, channel: q, quantity: position}\n    files:\n      - {path: log.csv}\n"
    )
    arm = "{name: arm, joints: [{name: 1, axis: z, motor: {inertia: 1e-3, ratio: 50}}], inertia: 1}"
    study = desk.write(study=text, robot=f"name: one\nbodies: [{arm}]")
    assert rendered("lower rate_hz", desk.elastid("check", study))
    assert desk.elastid("check", study, "--set", "experiment.recorded.rate_hz=100") == ""


@case("frf/local/response.py", "widen band_hz", slow=True)
def band_narrower_than_a_window(desk: Desk) -> None:
    noise(desk, 3000, 3000)
    files = tuple(FileSpec(f"{i}.csv", "home", i) for i in range(2))
    assert rendered("widen band_hz", estimated(desk, files, method="local_rational", band_hz=(10.0, 10.05)))
    assert estimated(desk, files, method="local_rational", band_hz=(5.0, 20.0)) == ""


@case("recorded/repair/__init__.py", "raise band_hz")
def wander_below_the_excited_lines(desk: Desk) -> None:
    """The slow part moves as it did; it leaks less into lines that are farther from it."""
    wander = 5 * np.sin(2 * np.pi * 1.37 * np.arange(4 * N) / N)

    def said(first: int) -> str:
        log = lab_log(desk, first=first)
        log["phi"] = log["phi"] + wander
        save_csv(desk.folder / "log.csv", log)
        return said_of(desk)

    assert rendered("raise band_hz", said(3))
    assert "band_hz" not in said(50)
