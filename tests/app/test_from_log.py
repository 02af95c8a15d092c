"""`elastid new DIR --from LOG` writes a study that is accepted and runs, every guess marked."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.drafts import drafted as new
from plants.drafts import save
from plants.measured import BENCH, EMPS, KUKA, measured
from plants.mjcf_arm import ARM as CRANE
from plants.refusals import refused
from plants.runs import summary_of
from scipy.io import savemat
from scipy.signal import butter, chirp, lfilter

from elastid.app import cli
from elastid.app.console import Console
from elastid.app.from_log import texts_from_logs
from elastid.app.joint_assignment import order_of_names
from elastid.app.run import Run, run_all
from elastid.app.stages.estimate import imported_responses
from elastid.base.errors import StudyError
from elastid.logs.channel_names import guess_by_name
from elastid.logs.friction_logs import read_friction_logs
from elastid.robot import Body, Joint, Motor, Robot
from elastid.store.measured import read_responses
from elastid.study import load, load_with_logs
from elastid.study.robots import yaml_text
from tests.app.test_scaffold import ARM

REAL = {
    EMPS: ("friction-recorded", "qm", "rate_hz: 1000"),
    KUKA: ("friction-recorded", "rec.act_pos_mot_deg", "rate_hz: 250"),
    BENCH: ("frf", "theta_mx", "period_samples: 2500"),
}


@pytest.fixture
def motion(tmp_path) -> Path:
    """A semicolon-separated log of two joints that move slowly, with times in ms and angles in deg."""
    t = np.arange(6000) / 200.0
    columns = {"time": 1000 * t}
    for k in range(2):
        omega = np.array([0.9, 2.1, 3.3]) * (1 + 0.31 * k)
        q, v, a = (sum(0.2 * w**m * np.sin(w * t + m * np.pi / 2) for w in omega) for m in range(3))
        noise = 0.1 * np.random.default_rng(k).standard_normal(len(t))
        columns |= {f"Torque{k + 1} [Nm]": 3 * a + 5 * v + 4 * np.sign(v) + noise, f"Angle{k + 1} [deg]": np.rad2deg(q)}
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(tmp_path / "motion.csv", rows, "%.8g", ";", header=";".join(columns), comments="")
    return tmp_path / "motion.csv"


@pytest.mark.slow
def test_a_motion_becomes_a_study_of_friction_that_runs(motion: Path, tmp_path: Path) -> None:
    """Coulomb and viscous friction of both joints within 1 %."""
    folder = tmp_path / "new"
    new(tmp_path, motion)
    assert (folder / "study.yml").read_text().count("# guessed: ") >= 6
    assert cli.run_command(["run", str(folder / "study.yml"), "--run", str(folder / "run"), "-q"]) in (0, 3)
    summary = summary_of(folder / "run")
    numbers = {name: number["value"] for name, number in summary["parameters"].items()}
    for k in (1, 2):
        assert numbers[f"Fc_m{k}"] == pytest.approx(4, rel=0.01)
        assert numbers[f"f_m{k}"] == pytest.approx(5, rel=0.01)


WRONG_CELLS = [*(f"{cell};{{1}};{{2}};{{3}};{{4}}" for cell in ("-999", "nan", "65535")), "{0};100;{2};{3};{4}"]


@pytest.mark.parametrize(
    "row", [*WRONG_CELLS, "{0};#N/A;{2};{3};{4}", "1;x", "0.5;ERR;0.1;0.2;0.3", "--- marker ---", "overflow;;;;"]
)
def test_one_damaged_row_changes_neither_kind_nor_rate(motion, tmp_path, row):
    """A row without its numbers is missing, and named."""
    lines = motion.read_text().splitlines()
    lines[2000] = row.format(*lines[2000].split(";"))
    motion.write_text("\n".join(lines) + "\n")
    study = new(tmp_path, motion)
    assert study.friction is not None
    assert study.experiment.as_recorded().rate_hz == 200.0
    is_named = "motion.csv, row 2001" in (tmp_path / "new" / "study.yml").read_text()
    assert is_named or row in WRONG_CELLS or "#" in row


def test_rows_that_run_backwards_in_time_are_refused(motion: Path, tmp_path: Path) -> None:
    """By `check`, too, of a study that was written for the log in its order."""
    new(tmp_path, motion)
    head, *rows = motion.read_text().splitlines()
    motion.write_text("\n".join([head, *reversed(rows)]) + "\n")
    with refused("records/clock", place=str(motion)):
        texts_from_logs(tmp_path / "other", [motion])
    with refused("study/invalid", holds="rate_hz"):
        load_with_logs(tmp_path / "new" / "study.yml")


def test_log_with_set_back_clock_becomes_friction_study(motion: Path, tmp_path: Path) -> None:
    """Divided there, where the samples of the other part begin."""
    head, *rows = motion.read_text().splitlines()
    motion.write_text("\n".join([head, *rows[:1500], *rows[500:2000]]) + "\n")
    study = new(tmp_path, motion)
    recorded = study.experiment.as_recorded()
    assert (study.friction is not None, recorded.time, recorded.rate_hz) == (True, "time", 200.0)
    robot = study.as_robot()
    records = read_friction_logs(robot, study.experiment, tmp_path / "new", robot.driven_names, {})
    assert [len(record.position) for record in records.records if record.joint == "1"] == [1500, 1500]


def test_a_log_of_one_row_is_too_short(motion: Path, tmp_path: Path) -> None:
    """Its delimiter is right."""
    motion.write_text("\n".join(motion.read_text().splitlines()[:2]) + "\n")
    with refused("records/values"):
        texts_from_logs(tmp_path / "new", [motion])


def test_hammer_tests_without_force_are_refused(tmp_path: Path) -> None:
    """Two accelerometers alone; with the hammer's column the same log becomes a study."""
    a = np.random.default_rng(0).normal(size=(400, 3))
    columns = "a1 (m/s^2),a2 (g),Impact (N)"
    for n, code in ((2, 1), (3, 0)):
        log = save(tmp_path / f"{n}.csv", ",".join(columns.split(",")[:n]), a[:, :n])
        assert cli.run_command(["new", str(tmp_path / f"s{n}"), "--from", str(log)]) == code
    assert "# Not used" not in (tmp_path / "s3" / "study.yml").read_text()


def test_missing_path_and_robot_among_logs_are_refused(motion: Path, tmp_path: Path) -> None:
    for paths in ((motion, "lost.csv"), ("arm.urdf", "other.xml", motion)):
        wanted = [str(tmp_path / path) for path in paths]
        assert cli.run_command(["new", str(tmp_path / "new"), "--from", *wanted]) in (1, 2)
        assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", REAL)
def test_real_logs_become_studies_that_check_accepts(name: str, tmp_path: Path) -> None:
    kind, motion, line = REAL[name]
    study = new(tmp_path, measured(name))
    assert line in (tmp_path / "new" / "study.yml").read_text()
    assert study.kind == kind
    assert motion in [c.channel for c in study.experiment.channels if c.role == "y"]


def logged(path: Path, names: tuple[str, ...], angles: tuple[float, ...], units: str = "", drive: str = "tau") -> str:
    """Two periods of random torques, and the angles of masses that they move, each joint alone."""
    rng = np.random.default_rng(0)
    u = np.tile(rng.standard_normal((1000, len(names))), (2, 1))
    q = np.cumsum(np.cumsum(u - u.mean(axis=0), axis=0), axis=0)
    q = 0.01 * (q - q.mean(axis=0)) / q.std(axis=0) + np.array(angles)
    scale = [np.rad2deg(1.0) if units and name != "x" else 1.0 for name in names]
    units_of = ["" if name == "x" else units for name in names]
    heads = (f"q_{name}{unit}" for name, unit in zip(names, units_of, strict=True))
    head = ",".join(["t", *(f"{drive}_{name}" for name in names), *heads])
    u += np.tile(3 * rng.standard_normal((1000, len(names))), (2, 1))  # friction, beside inertias of no robot
    return str(save(path, head, np.arange(len(u)) / 500, u, scale * q))


@pytest.mark.parametrize(
    ("suffix", "units"), [("urdf", ""), pytest.param("xml", " [deg]", marks=pytest.mark.oracle("mujoco"))]
)
def test_logs_are_at_the_motors_that_they_name(suffix: str, units: str, tmp_path: Path) -> None:
    """In any order of the columns; the means of the angles are the configurations, in rad."""
    joints = {"urdf": ("shoulder", "elbow"), "xml": ("x", "turn", "lift")}[suffix]
    robot = tmp_path / f"arm.{suffix}"
    robot.write_text(ARM if suffix == "urdf" else CRANE)
    logs = [
        logged(tmp_path / f"{i}.csv", joints[::-1], tuple(angle * (k + 1) for k in range(len(joints))), units)
        for i, angle in enumerate((0.2, -0.3))
    ]
    study = new(tmp_path, robot, *logs)
    assert [joint.name for joint in study.as_robot().driven] == list(joints)
    recorded = study.experiment.as_recorded()
    assert {(c.at, c.channel.split(" ")[0]) for c in recorded.channels} == {
        (f"motor {joint}", f"{signal}_{joint}") for joint in joints for signal in ("tau", "q")
    }
    forces = {c.at for c in recorded.channels if c.quantity == "force"}
    assert forces == {f"motor {joint.name}" for joint in study.as_robot().driven if joint.slides}
    wanted = np.outer((0.2, -0.3), np.arange(len(joints), 0, -1))
    np.testing.assert_allclose([*study.experiment.configurations.values()], wanted, atol=1e-3)
    assert {*study.fit.parameters} == {"k_*", "d_*", "fm_*", "Jm_*"}


@pytest.mark.parametrize(("drive", "gear", "sides"), [("tau", 100, {"motor"}), ("current", 1, {"motor", "link"})])
def test_gear_sides_follow_joint_limits_and_currents(drive: str, gear: int, sides: set[str], tmp_path: Path) -> None:
    """Motors at 100 times the angles, in degrees as stated; currents act before gears whose angles are behind them."""
    (tmp_path / "arm.urdf").write_text(ARM)
    log = logged(tmp_path / "log.csv", ("shoulder", "elbow"), (0.2 * gear, -0.3 * gear), " [deg]", drive)
    study = new(tmp_path, tmp_path / "arm.urdf", log)
    channels = study.experiment.as_recorded().channels
    assert {channel.side for channel in channels} == sides
    assert {channel.side for channel in channels if channel.role == "u"} == {"motor"}
    np.testing.assert_allclose(study.experiment.configurations["bench"], [0.2, -0.3], atol=1e-3)


def test_log_without_time_becomes_response_study_with_unused_columns(tmp_path: Path) -> None:
    """A torque that repeats, two angles, a current, and a column that does not change."""
    u = np.tile(np.random.default_rng(0).standard_normal(1000), 4)
    columns = {"torque": u, "motor_angle": 0.1 * u, "load_angle": 0.2 * u, "current": u, "state": 0 * u}
    study = new(tmp_path, save(tmp_path / "log.csv", ",".join(columns), *columns.values()))
    assert study.kind == "frf"
    assert [c.channel for c in study.experiment.channels] == ["torque", "motor_angle", "load_angle"]
    unused = [line for line in (tmp_path / "new" / "study.yml").read_text().splitlines() if "# Not used" in line]
    assert [line.rpartition(" ")[2] for line in unused] == ["state", "current"]


@pytest.mark.parametrize(
    ("clock", "time"),
    [
        ({"t": 5 + np.arange(400) / 500}, ""),
        ({"t": 2.0 * np.arange(400)}, ""),
        ({"t": np.delete(np.arange(401) / 500, 99)}, "t"),
        ({"t": 133_300_000_000_000_000 + 20_000 * np.delete(np.arange(401), 99)}, "t"),
        ({"fs": 500.0}, ""),
    ],
    ids=["s", "ms", "gap", "filetime", "rate"],
)
def test_the_rate_is_that_of_the_clock_of_a_log(clock: dict[str, Any], time: str, tmp_path: Path) -> None:
    """Wherever it begins and whatever its unit; stamps of an even one need not be read."""
    signals = {name: np.random.default_rng(0).standard_normal(400) for name in ("torque_1", "acc_1")}
    savemat(tmp_path / "log.mat", {**clock, **signals})
    recorded = new(tmp_path, tmp_path / "log.mat").experiment.as_recorded()
    assert (recorded.known_rate_hz, recorded.time) == (pytest.approx(500), time)
    assert [c.channel for c in recorded.channels] == ["torque_1", "acc_1"]


def test_logs_with_different_drives_are_not_one_excitation(tmp_path: Path) -> None:
    """The signs of orthogonal experiments, on a carrier that is most of the second drive: `run` would refuse them."""
    t, lines, rng = np.arange(1500) / 500, np.arange(7, 100, 4), np.random.default_rng(0)
    phases, logs = rng.uniform(0, 2 * np.pi, (2, len(lines))), []
    x = np.cos(2 * np.pi * t[:, None, None] * lines + phases).sum(axis=2)
    for number, sign in enumerate((1, -1)):
        u = x * [1, sign] + [0, 15] * np.sin(4 * np.pi * t)[:, None]
        a, head = 0.1 * u + 1e-3 * rng.standard_normal(u.shape), "torque_1 [Nm],torque_2 [Nm],acc_1,acc_2"
        logs.append(save(tmp_path / f"{number}.csv", head, u, a))
    assert [file.realisation for file in new(tmp_path, *logs).experiment.as_recorded().files] == [0, 1]


def test_hammer_log_at_tool_becomes_study_at_frame(tmp_path: Path) -> None:
    """A force of zero between hits at a robot of three motors: not clipped; its response enters the robot's study."""
    robot, rng, n = tmp_path / "arm.urdf", np.random.default_rng(0), 8000
    robot.write_text(ARM)
    force = np.zeros(n)
    for start in (500, 2500, 4500, 6500):
        force[start : start + 12] = 400 * np.sin(np.pi * np.arange(12) / 12) ** 2
    ring = 0.02 * np.exp(-np.arange(2000) / 200) * np.sin(np.arange(2000) / 20)
    a = np.stack([np.convolve(force, gain * ring)[:n] + 1e-3 * rng.standard_normal(n) for gain in (1.0, 0.5)], axis=1)
    head = "time [s],hammer [N],acc_x [m/s^2],acc_z [m/s^2]"
    new(tmp_path, robot, save(tmp_path / "hit.csv", head, np.arange(n) / 2000, force.round(2), a))
    loaded = load(tmp_path / "new" / "study.yml")
    places = [channel.at for channel in loaded.study.experiment.as_recorded().channels]
    assert places == ["force base x", "accelerometer base x", "accelerometer base z"]
    run_all(Run(loaded, tmp_path / "run", 1, Console(-1)))
    (response,) = read_responses(tmp_path / "run" / "frf.h5")
    assert "records/clipped" not in {note.code for note in response.notes}
    listed = "{files: [{path: run/frf.h5, configuration: low, response: bench}]}"
    experiment = f"{{configurations: {{low: [0.1, 0.2]}}, responses: {listed}}}"
    (tmp_path / "study.yml").write_text(f"name: arm\nrobot: new/robot.yml\nexperiment: {experiment}\n")
    (imported,) = imported_responses(load(tmp_path / "study.yml").study, tmp_path)
    assert imported.configuration.angles.tolist() == [0.1, 0.2]


MAKES = {
    "rsi": ("MACur.A", "AIPos.A", "RKorr.A"),
    "rtde": ("actual_current_", "actual_q_", "target_q_"),
    "egm": ("effort_", "fb_joint", "ref_joint"),
}


@pytest.mark.parametrize("make", MAKES)
def test_logs_of_makes_have_references_and_runs_of_their_names(make: str, tmp_path: Path) -> None:
    """Degrees by the limits of the robot; files named p1-r0-e1; the robot as elastid writes it."""
    (tmp_path / "arm.urdf").write_text(ARM)
    assert cli.run_command(["new", str(tmp_path / "robot"), "--from", str(tmp_path / "arm.urdf")]) == 0
    logs = []
    for name, angle in (("p1-r0-e0", 0.9), ("p1-r0-e1", 0.905), ("p2-r1-e0", -0.5)):
        path = tmp_path / f"{name}.csv"
        logged(path, ("shoulder", "elbow"), (angle, angle), " [deg]")
        rows = np.loadtxt(path, delimiter=",", skiprows=1)
        heads = [f"{word}{i}" for word in MAKES[make] for i in (1, 2)]
        logs.append(save(path, ",".join(["t", *heads]), rows, np.roll(rows[:, 3:], -2, axis=0)))
    study = new(tmp_path, tmp_path / "robot" / "robot.yml", *logs)
    recorded = study.experiment.as_recorded()
    assert [file.run for file in recorded.files] == [("p1", 0, 0), ("p1", 0, 1), ("p2", 1, 0)]
    assert [(c.role, c.at, c.channel, c.unit == "deg") for c in recorded.channels if c.at == "motor elbow"] == [
        (role, "motor elbow", f"{word}2", role != "u")
        for role, word in zip(("u", "y", "reference"), MAKES[make], strict=True)
    ]
    assert study.experiment.configurations["p1"] == pytest.approx([0.9, 0.9], abs=1e-3)


def commands() -> tuple[np.ndarray, np.ndarray]:
    """Times (600,) and commands of two joints (600, 2)."""
    t = np.arange(600) / 200
    return t, np.stack([np.sin(2 * t), np.cos(3 * t)], axis=1)


def test_commands_and_gains_without_torques_become_a_study_of_friction(tmp_path: Path) -> None:
    """Gains of each joint are those of the log; the study is accepted as it is, but not as one of elasticity."""
    t, command = commands()
    arrays = {"time_s": t, "position_rad": 0.9 * command, "velocity_rad_s": np.gradient(command, 0.005, axis=0)}
    arrays |= {"command_rad": command, "command_velocity_rad_s": 0 * command}
    np.savez(tmp_path / "log.npz", **arrays, kp=np.array([20.0, 40.0]), kd=np.array([1.0, 4.0]))
    recorded = new(tmp_path, tmp_path / "log.npz").experiment.as_recorded()
    assert {(c.role, c.at, c.channel, c.column) for c in recorded.channels} == {
        (role, f"motor {i}", name, i)
        for i in (1, 2)
        for role, name in (("y", "position_rad"), ("reference", "command_rad"))
    }
    assert (recorded.controller.position_gain, recorded.controller.velocity_gain) == ((20.0, 10.0), (1.0, 4.0))
    path = tmp_path / "new" / "study.yml"
    path.write_text("\n".join(line for line in path.read_text().splitlines() if not line.startswith("friction:")))
    with pytest.raises(StudyError):
        load(path)


def test_commands_with_gaps_become_a_study_that_names_their_time(tmp_path: Path) -> None:
    """Samples without their time would be too close after each gap, and inertia and delay wrong."""
    t, command = commands()
    logged = np.delete(np.arange(len(t)), [50, 51, 120])
    arrays = {"time_s": t[logged], "position_rad": 0.9 * command[logged], "command_rad": command[logged]}
    np.savez(tmp_path / "log.npz", **arrays, kp=np.array([20.0, 40.0]), kd=np.array([1.0, 4.0]))
    assert new(tmp_path, tmp_path / "log.npz").experiment.as_recorded().time == "time_s"


@pytest.mark.parametrize(("size", "unit"), [(1.0, "rad"), (180 / np.pi, "deg")])
def test_commanded_positions_without_units_have_the_unit_of_their_range(size: float, unit: str, tmp_path: Path) -> None:
    """Text without gains: a study that is accepted, in degrees if a joint covers more than four turns in rad."""
    t, command = commands()
    log = save(tmp_path / "log.csv", "time_s,q_cmd_1,q_cmd_2,q_1,q_2", t, size * command, 0.9 * size * command)
    recorded = new(tmp_path, log).experiment.as_recorded()
    assert {(c.role, c.unit) for c in recorded.channels} == {("y", unit), ("reference", unit)}


@pytest.mark.parametrize("late", [0, 20, "above the corner"])
def test_command_columns_followed_by_position_are_no_torques(late: int | str, tmp_path: Path) -> None:
    """By the names of the joints in any order, without a quantity or a unit in the name.

    The positions are 0 or 20 samples late, or those of loops with a corner of 1 Hz under chirps up to 4 Hz.
    """
    t, command = commands()
    follow = partial(np.roll, shift=late, axis=0)
    if isinstance(late, str):
        t = np.arange(0.0, 20, 0.01)
        command = np.stack([chirp(t, 0.1, 20, 4), chirp(t, 0.2, 20, 4)], axis=1)
        follow = partial(lfilter, *butter(1, 1.0, fs=100), axis=0)
    heads = "time,knee_command,hip_command,hip_position,knee_position"
    log = save(tmp_path / "log.csv", heads, t, command[:, ::-1], 0.9 * follow(command))
    recorded = new(tmp_path, log).experiment.as_recorded()
    assert {(c.role, c.at, c.channel) for c in recorded.channels} == {
        (role, f"motor {i}", f"{joint}_{name}")
        for i, joint in ((1, "hip"), (2, "knee"))
        for role, name in (("y", "position"), ("reference", "command"))
    }


@pytest.mark.parametrize("kp", [[20.0, 40.0, 60.0], [0.0, 40.0], [[20.0, 40.0]] * 599 + [[20.0, 41.0]]])
def test_gains_of_wrong_count_or_zero_are_ignored(kp: list, tmp_path: Path) -> None:
    """The study is accepted, with gains to enter."""
    t, command = commands()
    np.savez(tmp_path / "log.npz", time_s=t, command_rad=command, position_rad=0.9 * command, kp=np.array(kp), kd=1.0)
    controller = new(tmp_path, tmp_path / "log.npz").experiment.as_recorded().controller
    assert (controller.position_gain, controller.velocity_gain) == ((1.0, 1.0), (1.0, 1.0))


def test_commanded_joints_of_a_robot_are_found_by_their_names(tmp_path: Path) -> None:
    """Not by the order of the columns; positions of a joint that slides are in m."""
    joints = (Joint("hip", motor=Motor(1.0)), Joint("knee", motor=Motor(1.0), motion="translation"))
    robot = Robot("leg", tuple(Body(f"{joint.name} link", joints=(joint,), mass=1) for joint in joints))
    (tmp_path / "robot.yml").write_text(yaml_text(robot))
    t, command = commands()
    log = save(tmp_path / "log.csv", "time,pos_knee,pos_hip,cmd_pos_knee,cmd_pos_hip", t, 0.9 * command, command)
    recorded = new(tmp_path, tmp_path / "robot.yml", log).experiment.as_recorded()
    places = {(c.at, c.channel.rpartition("_")[2]) for c in recorded.channels}
    assert places == {("motor hip", "hip"), ("motor knee", "knee")}
    assert {(c.at, c.unit) for c in recorded.channels} == {("motor hip", "rad"), ("motor knee", "m")}


@pytest.mark.parametrize(
    ("joints", "channels", "order"),
    [
        ("left_arm_joint1 left_arm_joint2 right_arm_joint1", "right_1 left_1 left_2", [1, 2, 0]),
        ("ur_pan_joint ur_lift_joint ur_elbow_joint", "elbow_joint lift_joint pan_joint finger_joint", [2, 1, 0]),
        ("pan_joint lift_joint elbow_joint", "elbow_joint lift_joint pan_joint finger_joint", [2, 1, 0]),
        ("joint_a1 joint_a2", "A1 A2 E1", None),
        ("FR_hip_joint FR_calf_joint FL_hip_joint", "FL_hip FR_calf FR_hip", [2, 1, 0]),
        ("left_shoulder right_shoulder right_elbow", "elbow_right shoulder_left shoulder_right", [1, 2, 0]),
        ("l_joint1 l_joint2 r_joint1", "left_1 left_2 right_1", None),
        ("rob1_joint_2 rob2_joint_1 rob2_joint_2", "rob2_1 rob1_2 rob2_2", [1, 0, 2]),
        ("pan lift elbow", "3 1 2", [1, 2, 0]),
        ("j1 j2 z", "1 2 z", None),
        ("1 2", "elbow shoulder", [0, 1]),
        ("1 2 3", "left_1 right_1 right_2", None),
        ("hip", "motor", [0]),
    ],
)
def test_channels_belong_to_joints_by_words_and_numbers(joints: str, channels: str, order: list[int] | None) -> None:
    """Columns in any order, with any common words in their names; names with different words are rejected."""
    guesses = [guess_by_name(f"{name}_torque", None) for name in channels.split()]
    if order is not None:
        channel_order, doubt = order_of_names(joints.split(), guesses)
        assert (channel_order, bool(doubt)) == (order, joints in ("pan lift elbow", "1 2"))
        return
    with refused("records/channels"):
        order_of_names(joints.split(), guesses)


@pytest.mark.parametrize(
    ("change", "numbers"),
    [
        ({"kp": 25.0}, ["20", "25"]),
        ({"time_s": np.arange(600) / 100}, ["200", "100"]),
        ({"command_rad": np.zeros((600, 1)), "position_rad": np.sin(np.arange(600.0))[:, None]}, []),
    ],
)
def test_logs_that_are_not_of_one_study_are_refused(change: dict, numbers: list[str], tmp_path: Path) -> None:
    """Of two controllers, two rates, other joints: where the log is, and the numbers of both; gains as a series."""
    t, command = commands()
    arrays = {"time_s": t, "command_rad": command, "position_rad": 0.9 * command, "kp": np.full((600, 2), 20.0)}
    for name, more in (("a", {}), ("b", change)):
        np.savez(tmp_path / f"{name}.npz", **(arrays | more), kd=1.0)
    assert new(tmp_path, tmp_path / "a.npz").experiment.as_recorded().controller.position_gain == (20.0, 20.0)
    with refused("records/channels", holds=("b.npz", *numbers)):
        texts_from_logs(tmp_path / "new", [tmp_path / "a.npz", tmp_path / "b.npz"])


def test_commands_without_time_are_refused(tmp_path: Path) -> None:
    """Inertia and delay refer to it; a rate in the file is enough."""
    command = np.sin(np.arange(600.0) / 100)[:, None]
    arrays = {"command_rad": command, "position_rad": 0.9 * command, "kp": 20.0, "kd": 1.0}
    np.savez(tmp_path / "log.npz", **arrays)
    with refused("records/clock"):
        texts_from_logs(tmp_path / "new", [tmp_path / "log.npz"])
    np.savez(tmp_path / "log.npz", **arrays, rate_hz=250.0)
    assert new(tmp_path, tmp_path / "log.npz").experiment.as_recorded().rate_hz == 250


def scope_export(path: Path, start_ms: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """TwinCAT Scope's export of a two-mass joint: torque every 1 ms, position every 2 ms from a start, temperature.

    Returns the frequencies of the excited lines, and the acceleration by the torque there.
    """
    rng, n = np.random.default_rng(0), 4000
    freq, lines = np.fft.rfftfreq(n // 2, 1e-3), np.arange(4, 100)
    s = 2j * np.pi * np.maximum(freq, 1e-9)
    G = (0.05 * s**2 + 0.4 * s + 900) / (0.001 * s**4 + 0.07 * (0.4 * s**3 + 900 * s**2))
    U = np.zeros(len(freq), complex)
    U[lines] = np.exp(2j * np.pi * rng.random(len(lines))) * n / 20
    u, q = (np.tile(np.fft.irfft(x, n // 2), 2) for x in (U, np.where(U != 0, G, 0) * U))
    columns = [("Torque", 1, u, "Nm"), ("Pos", 2, q[::2], "rad"), ("Temp", 100, 30 + u[::100], "(None)")]
    rows = ["Name\tdrive", "Starttime of export\t132959733843760000\tMonday\t15:56:24.376", "", ""]
    rows += ["\t".join(f"{key}\t{value(c)}" for c in columns) for key, value in PROPERTIES.items()]
    starts = {"Pos": start_ms}
    rows += [
        "\t".join(f"{i * c[1] + starts.get(c[0], 0):g}\t{c[2][i]:.9g}" if i < len(c[2]) else " \t " for c in columns)
        for i in range(n)
    ]
    path.write_text("\n".join([*rows, "EOF", ""]))
    return freq[lines], (s**2 * G)[lines]


PROPERTIES = {
    "Name": lambda c: c[0], "Data-Type": lambda c: "REAL64", "SampleTime[ms]": lambda c: c[1],
    "VariableSize": lambda c: 8, "Unit": lambda c: c[3],
}  # fmt: skip


def test_channels_of_a_scope_with_their_own_sample_times_are_in_step(tmp_path: Path) -> None:
    """Response within 0.1 % up to 50 Hz; a position whose stamps are 1 ms early leads by it."""
    freq, G = scope_export(tmp_path / "scope.csv")
    recorded = new(tmp_path, tmp_path / "scope.csv").experiment.as_recorded()
    assert recorded.rate_hz == 500
    assert {(c.channel, c.rate_hz) for c in recorded.channels} == {("Torque", 1000.0), ("Pos", None)}
    assert cli.run_command(["run", str(tmp_path / "new" / "study.yml"), "-q", "--run", str(tmp_path / "run")]) == 0
    (response,) = read_responses(tmp_path / "run" / "frf.h5")
    measured = np.interp(freq, response.freq_hz, np.real(response.G[:, 0, 0]))
    np.testing.assert_allclose(measured, G.real, atol=1e-3 * abs(G).max())
    scope_export(tmp_path / "late.csv", start_ms=-1)
    (tmp_path / "new" / "study.yml").write_text(texts_from_logs(tmp_path / "new", [tmp_path / "late.csv"])["study.yml"])
    assert cli.run_command(["run", str(tmp_path / "new" / "study.yml"), "-q", "--run", str(tmp_path / "late")]) == 0
    (response,) = read_responses(tmp_path / "late" / "frf.h5")
    measured = np.interp(freq, response.freq_hz, np.real(response.G[:, 0, 0]))
    np.testing.assert_allclose(measured, (G * np.exp(2e-3j * np.pi * freq)).real, atol=3e-3 * abs(G).max())


@pytest.mark.parametrize("file", ["raw_data_x.csv", "resonances_x.csv"])
def test_accelerations_or_spectra_alone_are_refused(file: str, tmp_path: Path) -> None:
    """Files of a printer's firmware: an accelerometer in mm/s^2, and power spectral densities."""
    rng, names = np.random.default_rng(0), ["#time,accel_x,accel_y,accel_z", "freq,psd_x,psd_y,psd_z,psd_xyz"]
    head = names["resonances" in file]
    save(tmp_path / file, head, np.arange(400) / 3200, rng.normal(0, 300, (400, head.count(","))))
    with refused("records/channels"):
        texts_from_logs(tmp_path, [tmp_path / file])


def test_column_of_error_values_is_named_in_the_refusal(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,q_1,tau_1\n" + "".join(f"{k},{k % 37},#N/A\n" for k in range(400)))
    with refused("records/channels", holds=("q_1", "tau_1")):
        texts_from_logs(tmp_path, [tmp_path / "log.csv"])


@pytest.mark.parametrize(("size", "unit", "scale"), [(9806.65, "mm/s^2", 1), (1.0, "m/s^2", 9.80665), (0, "m/s^2", 1)])
def test_force_and_accelerometer_in_two_files_are_one_measurement(
    size: float, unit: str, scale: float, tmp_path: Path
) -> None:
    """The unit of three axes by gravity; the file of the force first, whatever the order."""
    rng, t = np.random.default_rng(0), np.arange(3000) / 3000
    force = 300 * np.exp(-0.5 * ((t - 0.3) / 1e-3) ** 2)
    axes = 0.01 * rng.normal(size=(3000, 3)) + np.array([0, 0, size])
    for name, values, head in (("acc", axes, "accel_x,accel_y,accel_z"), ("hammer", force[:, None], "force")):
        save(tmp_path / f"{name}.csv", f"time,{head}", t, values)
    recorded = new(tmp_path, tmp_path / "acc.csv", tmp_path / "hammer.csv").experiment.as_recorded()
    (file,) = recorded.files
    assert (Path(file.path).name, [Path(path).name for path in file.also]) == ("hammer.csv", ["acc.csv"])
    assert {(c.unit, c.scale, c.file) for c in recorded.channels if c.role == "y"} == {(unit, scale, 2)}


@pytest.mark.parametrize(("first", "second"), [("j1", "j2"), ("Joint_1", "Joint_2")])  # the latter alone: a position
def test_files_with_equal_headings_form_measurement_by_name(
    first: str, second: str, motion: Path, tmp_path: Path
) -> None:
    """Torques and positions as joint_effort and joint_position."""
    rows = np.loadtxt(motion, delimiter=";", skiprows=1)
    for name, columns in (("joint_position", [0, 2, 4]), ("joint_effort", [0, 1, 3])):
        save(tmp_path / f"{name}.csv", f"time,{first},{second}", rows[:, columns])
    study = new(tmp_path, tmp_path / "joint_position.csv", tmp_path / "joint_effort.csv")
    channels = {(c.role, c.channel, c.file) for c in study.experiment.as_recorded().channels}
    assert channels == {("u", first, 1), ("u", second, 1), ("y", first, 2), ("y", second, 2)}
    assert study.friction is not None
