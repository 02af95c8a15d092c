"""Robots with a position interface: references of a plan in, logs of three makes out, and the study of the logs."""

import ctypes
import json
import re
import shutil
import subprocess
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from plants.runs import summary_of

from elastid.app import cli

RIG = Path(__file__).parents[3] / "shared" / "prototypes" / "controllers"
GAINS = "position_gain: [20, 20, 25], velocity_gain: [1500, 1500, 400], integral_time: 60 ms"
# Cycle and filter of the references, delay of the logged torque in s, and the largest errors of its estimate and of k.
# With a cycle and an interpolation that no filter follows, images of the references leave 6 % of k_1, 1.6 std.
MAKES = {
    "egm": ("{cycle: 4 ms, unit: deg, filter_hz: 20, filter_order: 2}", 0.0, 1e-4, 0.02),
    "drive": ("{cycle: 1 ms, unit: deg, side: motor}", 2.5e-4, 5e-5, 0.02),
    "rsi": ("{cycle: 4 ms, unit: deg}", 4e-3, 2e-4, 0.08),
}
# What the user of a make adds to the study of `new`: of currents, constants and filter, and the path of references.
EDITS = {
    "rsi": (
        *(("torque_constant: 1 N", f"torque_constant: {constant} N") for constant in (0.85, 0.85, 0.62)),
        *[("side: motor}", "side: motor, low_pass_hz: 200 }")] * 3,
        ("    period_samples:", f"    controller: {{{GAINS}, reference: {{cycle: 4 ms}}}}\n    period_samples:"),
    )
}


@pytest.fixture(scope="module")
def makes(tmp_path_factory) -> ModuleType:
    """The simulator of an arm with drive cascades at 8 kHz, compiled into a folder of its own."""
    engine = find_spec("mujoco")
    if not RIG.is_dir() or engine is None or shutil.which("gcc") is None:
        pytest.skip("needs the simulator ../shared/prototypes/controllers, mujoco and gcc")
    folder, mujoco = tmp_path_factory.mktemp("rig"), Path(str(engine.origin)).parent
    (library,) = mujoco.glob("libmujoco.so.*")
    flags = ["-O2", "-shared", "-fPIC", "-I", str(mujoco / "include"), f"-Wl,-rpath,{mujoco}"]
    source, out = str(RIG / "arm.c"), str(folder / "drives.so")
    subprocess.run(["gcc", *flags, source, str(library), "-lm", "-o", out], check=True)
    with pytest.MonkeyPatch.context() as patch:
        load = ctypes.CDLL
        patch.setattr(ctypes, "CDLL", lambda name, *args: load(out if "drives.so" in str(name) else name, *args))
        patch.setattr("sys.dont_write_bytecode", True)
        patch.syspath_prepend(str(RIG))
        module, rig, arm = map(import_module, ("makes", "rig", "arm"))
        (folder / "arm.xml").write_text(arm.xml())
        rig._xml = folder / "arm.xml"
        return module


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("make", MAKES)
def test_logs_of_a_make_give_stiffness_delay_and_friction(
    make: str, makes: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a model with default tolerances, by at most ten edited lines: k to 3 std and 2 %, Coulomb torque to 5 %."""
    path, late, limit, of_stiffness = MAKES[make]
    robot = re.sub(r"acceleration: \d+, ", "", import_module("arm").robot())
    (tmp_path / "robot.yml").write_text(robot)
    places = dict(list(makes.CONF.items())[:2])
    (tmp_path / "plan.yml").write_text(f"""
name: plan
robot: robot.yml
excitation: {{inject: position, rate_hz: 1000, period: 4 s, band_hz: [1.5, 60], torque_rms: [160, 160, 55]}}
experiment:
  configurations: {json.dumps(places)}
  ramp: 1 s
  simulated:
    controller:
      kind: cascade
      gains: {{{GAINS}}}
      reference: {path}
    carrier: {{amplitude: 1 deg, cycles: 1}}
    compiled: true
fit: {{parameters: {{k_*: {{}}, d_*: {{}}}}}}
""")
    assert cli.run_command(["run", str(tmp_path / "plan.yml"), "design", "-q", "--run", str(tmp_path / "plan")]) == 0
    runs = {}
    for file in sorted((tmp_path / "plan" / "references").glob("*.csv")):
        q = np.radians(np.genfromtxt(file, delimiter=",", skip_header=1)[:, 1:])
        q = q / (np.array(makes.N) if make == "drive" else 1.0)
        name, realisation, experiment = re.fullmatch(r"(\w+)-r(\d+)-e(\d+)", file.stem).groups()
        runs[file.stem] = name, int(realisation), int(experiment), q - np.array(places[name])
    timing = {"first": 1.0, "period": 4.0, "whole": 16.0}
    monkeypatch.setattr(makes, "references", lambda *_, **__: (runs, timing))
    monkeypatch.setattr("sys.argv", ["makes.py", str(tmp_path), make])
    makes.main()
    logs = [str(log) for log in sorted((tmp_path / "logs").glob("*.csv"))]
    study = tmp_path / "study" / "study.yml"
    assert cli.run_command(["new", str(study.parent), "--from", str(tmp_path / "robot.yml"), "--from", *logs]) == 0
    text = re.sub(
        "fit: .*", "fit: {starts: 2, parameters: {k_*: {}, d_*: {}, fm_*: {}, delay_u: {}}}", study.read_text()
    )
    for before, after in EDITS.get(make, ()):
        text = text.replace(before, after, 1)
    study.write_text(text)
    assert cli.run_command(["check", str(study)]) == 0
    assert cli.run_command(["run", str(study), "-q", "--run", str(tmp_path / "run")]) == 0
    summary, true = summary_of(tmp_path / "run"), makes.TR
    stiffness = {"k_1": true["k"][0], "k_2": true["k"][1], "k_3": true["k"][2], "k_2z": true["kz"]}
    numbers = summary["parameters"]
    for name, value in stiffness.items():
        error, std = numbers[name]["value"] - value, numbers[name]["std"]
        print(f"{make} {name}: {100 * error / value:+.2f} %, {error / std:+.2f} std")
        assert abs(error) < min(3 * std, of_stiffness * value)
    print(f"{make} delay: {1e3 * (numbers['delay_u']['value'] - late):+.3f} ms")
    assert abs(numbers["delay_u"]["value"] - late) < limit
    for friction, value in zip(summary["friction"], true["fc"], strict=True):
        print(f"{make} {friction['motor']}: Coulomb torque {100 * (friction['F_c'] / value - 1):+.1f} %")
        assert friction["F_c"] == pytest.approx(value, rel=0.05)


LATE_S, PERIOD_S, TICK_S = 8e-3, 2.0, 1.25e-4


def references(rng: np.random.Generator, rate: int) -> np.ndarray:
    """Five periods (n, 3) of three references of random phases with a rise at the start, of one torque at all lines."""
    lines = np.arange(3, 120, 2)
    omega, t = 2 * np.pi * lines / PERIOD_S, np.arange(round(5 * PERIOD_S * rate)) / rate
    phases = np.exp(2j * np.pi * rng.uniform(size=(3, len(lines))))
    waves = np.real(np.exp(1j * np.outer(t, omega)) @ (phases / (omega * np.hypot(omega, 2 * np.pi * 5))).T)
    return np.minimum(t / 0.5, 1.0)[:, None] * waves / waves.std(axis=0) * np.array([8e-4, 8e-4, 1.6e-3])


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1000, 250])
def test_references_alone_give_stiffness_damping_and_delay(rate: int, makes: ModuleType, tmp_path: Path) -> None:
    """Without a torque, at 250 Hz with images of the references: four springs to 1 %, dampings to 5 %, delay to 0.1 ms.

    The integral of the rig contains the error of its own sample, and its two sampled lags are 112 us less late than the
    continuous ones of the chain.
    """
    rig, arm, late = import_module("rig"), import_module("arm"), round(LATE_S * rate)
    chain = "chain: {torque_lag: 0.2054 ms, torque_order: 2, torque_damping: 1.033}\n"
    (tmp_path / "robot.yml").write_text(arm.robot(tolerances="exact") + chain)
    files, posture, ticks = [], "p1", round(1 / TICK_S / rate)
    for k in range(6):
        rows = references(np.random.default_rng(k), rate)
        acts = np.vstack([np.zeros((late, 3)), rows])[: len(rows)]
        signals = rig.run(makes.CONF[posture], acts, ticks, rig.params(friction=0.0, ripple=0.0, dist=1.0), seed=k)
        log = np.hstack([rows + np.array(makes.CONF[posture]), signals["q"][::ticks]])[round(2 * PERIOD_S * rate) :]
        heads = ",".join([f"command_{j}" for j in (1, 2, 3)] + [f"position_{j}" for j in (1, 2, 3)])
        np.savetxt(tmp_path / f"{k}.csv", log, "%.10g", ",", header=heads, comments="")
        files.append({"path": f"{k}.csv", "configuration": posture, "realisation": k // 3, "experiment": k % 3})
    T_i = [time_s + TICK_S for time_s in rig.GAINS["ti"]]
    K_v = [gain * time_s / (time_s - TICK_S) for gain, time_s in zip(rig.GAINS["kv"], T_i, strict=True)]
    gains = {"position_gain": rig.GAINS["kp"], "velocity_gain": K_v, "integral_time": T_i}
    controller = gains | {"velocity_feedforward": 1, "ticks": ticks, "reference": {"cycle": 1 / rate}}
    channels = [
        {"role": role, "at": f"motor {j}", "channel": f"{name}_{j}", "quantity": "position", "unit": "rad"}
        for role, name in (("reference", "command"), ("y", "position"))
        for j in (1, 2, 3)
    ]
    recorded = {"rate_hz": rate, "period": PERIOD_S, "controller": controller, "channels": channels, "files": files}
    parameters = {"k_*": {}, "d_*": {}, "fm_*": {}, "delay": {"start": -1.118e-4, "fixed": True}}
    study = {
        "name": "arm",
        "robot": "robot.yml",
        "experiment": {"configurations": {posture: list(makes.CONF[posture])}, "recorded": recorded},
        "fit": {"starts": 4, "profile": [], "parameters": parameters},
    }
    (tmp_path / "study.yml").write_text(json.dumps(study))
    cli.run_command(["run", str(tmp_path / "study.yml"), "-q", "--run", str(tmp_path / "run")])
    summary, true = summary_of(tmp_path / "run"), makes.TR
    assert summary["status"] == "converged"
    springs = dict(zip(("1", "2", "3", "2z"), (*true["k"], true["kz"]), strict=True))
    dampers = dict(zip(springs, (*true["d"], true["dz"]), strict=True))
    limits = {f"k_{name}": (value, 0.01 * value) for name, value in springs.items()}
    limits |= {f"d_{name}": (value, 0.05 * value) for name, value in dampers.items()} | {"delay_r": (LATE_S, 1e-4)}
    for name, (value, limit) in limits.items():
        error, std = summary["parameters"][name]["value"] - value, summary["parameters"][name]["std"]
        print(f"{rate} Hz, {name}: {100 * error / value:+.3f} %, {error / std:+.2f} std")
        assert abs(error) < min(5 * std, limit)
