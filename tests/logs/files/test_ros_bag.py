"""ROS bags."""

from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import RATE, Signals
from plants.refusals import refused
from plants.ros_bag import JOINTS, LogArrays, write_bag, write_topics

from elastid.app.cli import run_command
from elastid.app.run import file_hash
from elastid.experiment.specs.channels import ChannelSpec, Structure
from elastid.experiment.specs.logs import FileSpec, RecordedSpec, TextFormatSpec
from elastid.logs.channels import gather_channels
from elastid.logs.files.formats import contents, read_channels
from elastid.study import load

TEXT = TextFormatSpec()


def _read(path: Path, *names: str, column: int | None = None) -> np.ndarray:
    return read_channels(path, [ChannelSpec("u", "motor 1", name, column) for name in names], TEXT)


def test_a_bag_lists_joints_fields_and_sequences_by_topic(tmp_path: Path, log: LogArrays) -> None:
    """Joints by name, numbers by the path of their field, sequences as columns; texts are left out."""
    bag, n = write_bag(tmp_path / "bag", log), len(log["i1"])
    expected = {f"joint_states.{field}.{joint}": (n,) for field in ("position", "effort") for joint in JOINTS}
    expected |= {"joint_states.time": (n,), "arm/commands.time": (n,), "arm/commands.data": (n, 2)}
    expected |= {"arm/commands.layout.data_offset": (n,), "wrench.time": (n,)}
    expected |= {f"wrench.wrench.{part}.{axis}": (n,) for part in ("force", "torque") for axis in "xyz"}
    assert contents(bag, TEXT) == expected
    np.testing.assert_array_equal(_read(bag, "/arm/commands.data", column=2)[:, 0], log["i2"])
    np.testing.assert_array_equal(_read(bag, "wrench.wrench.force.z")[:, 0], -np.arange(n))


def test_topic_time_is_stamp_of_messages(tmp_path: Path, log: LogArrays) -> None:
    """Exact to the ns although the stamps count from 1970, and not when the bag received them; else that."""
    bag = write_bag(tmp_path / "bag", log)
    at = np.arange(len(log["i1"])) / RATE
    np.testing.assert_allclose(_read(bag, "joint_states.time")[:, 0], at, atol=2e-9)
    np.testing.assert_allclose(_read(bag, "arm/commands.time")[:, 0], at, atol=2e-9)


def _angle(t: np.ndarray) -> np.ndarray:
    return 0.3 * np.sin(2 * np.pi * 3.1 * t) + 0.1 * np.sin(2 * np.pi * 17 * t)


def _torque(t: np.ndarray) -> np.ndarray:
    return 2 * np.cos(2 * np.pi * 4.3 * t)


@pytest.mark.parametrize(
    ("rate_hz", "ppm", "begin_s", "jitter_s"),
    [
        (250.0, 0, 0.004, 0.0),
        (250.0, 0, 0.0073, 0.0),
        (500.0, 0, 0.0009, 0.0),
        (250.0, 80, 0.0, 0.0),
        (250.0, 0, 0.0, 2e-4),
    ],
)
def test_topics_with_different_stamps_are_brought_to_one_clock(
    tmp_path: Path, rate_hz: float, ppm: float, begin_s: float, jitter_s: float
) -> None:
    """Positions at 500 Hz; torques later, at another rate or in between, with another quartz, 20 messages lost."""
    rng = np.random.default_rng(2)
    t_q, t_u = np.arange(8000) / 500, begin_s + np.arange(16 * int(rate_hz)) / rate_hz * (1 + 1e-6 * ppm)
    t_u = np.delete(t_u + jitter_s * rng.uniform(-1, 1, len(t_u)), slice(1000, 1020))
    topics = {"/state": (t_q, {"position": _angle(t_q)}), "/drive": (t_u, {"effort": _torque(t_u)})}
    write_topics(tmp_path / "bag", topics)
    run_command(["new", str(tmp_path / "study"), "--from", str(tmp_path / "bag")])
    drafted = load(tmp_path / "study" / "study.yml").study
    recorded = drafted.experiment.recorded
    log = gather_channels(recorded, recorded.files[0], tmp_path / "study", drafted.places)
    assert log.rate_hz == rate_hz
    t = max(t_u[0], 0.0) + np.arange(len(log.signals)) / rate_hz
    expected = {"u": _torque(t), "y": _angle(t)}
    for channel, x in zip(log.channels, log.signals.T, strict=True):
        error = np.abs(x - expected[channel.role])[50:-50] / np.abs(expected[channel.role]).max()
        assert np.sqrt(np.nanmean(error**2)) < 5e-4
        assert np.isnan(error).sum() <= 24


T_Q, T_U = np.arange(8000) / 500, 0.3 + np.arange(3500) / 250


def gathered(
    folder: Path,
    drive: tuple[np.ndarray, np.ndarray],
    state: tuple[np.ndarray, np.ndarray] = (T_Q, _angle(T_Q)),
    rate_hz: float = 500.0,
    samples: tuple[int, int] | None = None,
) -> Signals:
    """Torque and position by role at rate_hz, of topics with stamps and values; positions are logged at 500 Hz."""
    u = ChannelSpec("u", "motor 1", "drive.effort.axis", None, "torque", "N*m")
    y = ChannelSpec("y", "motor 1", "state.position.axis", None, "position", "rad", rate_hz=500.0)
    write_topics(
        folder / "bag", {"/state": (state[0], {"position": state[1]}), "/drive": (drive[0], {"effort": drive[1]})}
    )
    recorded = RecordedSpec(rate_hz, (u, y), (FileSpec("bag", samples=samples),))
    log = gather_channels(recorded, recorded.files[0], folder, Structure.from_channels((u, y)))
    return {channel.role: x for channel, x in zip(log.channels, log.signals.T, strict=True)}


def test_a_clock_that_is_set_back_keeps_its_start(tmp_path: Path) -> None:
    """From 0.3 s on, by 5 s at 8.3 s: aligned before and after."""
    t = 0.3 + np.arange(7000) / 500
    torque = gathered(tmp_path, (t - 5.0 * (t > 8.3), _torque(t)))["u"]
    is_near = np.abs(t - 8.3) < 0.01
    np.testing.assert_allclose(torque[~is_near], _torque(t)[~is_near], atol=1e-6)


def test_messages_that_all_come_twice_count_once(tmp_path: Path) -> None:
    t = 0.3 + np.arange(3500) / 500
    twice = np.repeat(t, 2)
    np.testing.assert_allclose(gathered(tmp_path, (twice, _torque(twice)))["u"][:3500], _torque(t), atol=1e-6)


def test_the_times_of_a_bag_start_at_its_first_right_stamp(tmp_path: Path) -> None:
    """The first message of all is stamped five minutes early."""
    write_topics(tmp_path / "bag", {"/state": (T_Q[:200] - 300 * (T_Q[:200] == 0), {"position": T_Q[:200]})})
    np.testing.assert_allclose(_read(tmp_path / "bag", "state.time")[1:, 0], T_Q[:199], atol=2e-9)


def _late(t: np.ndarray) -> np.ndarray:
    """Stamps of messages that are received five at a time."""
    return np.repeat(t[4::5], 5) + np.tile(2e-5 * np.arange(5), len(t) // 5)


@pytest.mark.parametrize(
    ("stamps_q", "stamps_u"),
    [
        (T_Q, T_U),
        (_late(T_Q), _late(T_U)),
        (T_Q - 300 * (T_Q == 0), T_U),
        (T_Q, T_U + 300 * (T_U[-2] < T_U)),
        (np.delete(T_Q, [50, 900, 901, 4000]), T_U),
        (T_Q, np.round(T_U, 2)),
    ],
    ids=["exact", "bursts", "first stamp wrong", "last stamp wrong", "lost", "rounded"],
)
def test_topics_of_two_rates_are_aligned_to_their_ends(
    tmp_path: Path, stamps_q: np.ndarray, stamps_u: np.ndarray
) -> None:
    """Where the faster one is brought to the slower, a slope of the position at the ends, too."""
    angle = _angle(T_Q) if len(stamps_q) == len(T_Q) else np.delete(_angle(T_Q), [50, 900, 901, 4000])
    signals = gathered(tmp_path, (stamps_u, _torque(T_U)), (stamps_q, angle), 250.0)
    n = len(signals["u"])
    np.testing.assert_allclose(signals["u"][60:-60], _torque(T_U)[60 : n - 60], atol=4e-3)
    np.testing.assert_allclose(signals["y"], _angle(T_U)[:n], atol=4e-4)


def test_samples_are_cut_from_the_common_clock(tmp_path: Path) -> None:
    """Counted at the rate of the study from the start that both topics have, whatever rate a topic has."""
    whole, cut = (
        gathered(tmp_path / name, (T_U, _torque(T_U)), rate_hz=250.0, samples=samples)
        for name, samples in (("whole", None), ("cut", (500, 2000)))
    )
    for role, x in cut.items():
        np.testing.assert_allclose(x[60:-60], whole[role][560:1940], atol=1e-6)
        assert len(x) == 1500


def test_joints_of_several_nodes_have_own_time(tmp_path: Path, log: LogArrays) -> None:
    bag = write_bag(tmp_path / "bag", log, publishers=2)
    found = contents(bag, TEXT)
    assert "joint_states.time" not in found
    assert found["joint_states.time.elbow"] == found["joint_states.effort.elbow"] == (len(log["i2"]),)
    np.testing.assert_array_equal(_read(bag, "joint_states.effort.elbow")[:, 0], log["i2"])


def test_folder_without_bag_and_damaged_bag_are_refused(tmp_path: Path, log: LogArrays) -> None:
    (tmp_path / "logs").mkdir()
    with refused("files/missing", holds=("logs", "metadata.yaml")):
        contents(tmp_path / "logs", TEXT)
    bag = write_bag(tmp_path / "bag", log)
    next(bag.glob("*.db3")).unlink()
    with refused("files/damaged"):
        contents(bag, TEXT)


def test_a_bag_of_other_content_is_another_input(tmp_path: Path, log: LogArrays) -> None:
    """The hash of a folder is that of its files."""
    bag = write_bag(tmp_path / "bag", log)
    before = file_hash(bag)
    assert before == file_hash(bag)
    with (bag / "metadata.yaml").open("a") as file:
        file.write("\n")
    assert file_hash(bag) != before
