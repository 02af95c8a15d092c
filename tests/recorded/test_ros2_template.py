"""From a ROS 2 bag with the states of a joint to its stiffness, by the template `ros2`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from elastid.app.console import Console
from elastid.app.run import Run, run_all
from elastid.app.scaffold import new
from elastid.study import load

RATE, N, PERIODS = 500, 1000, 8
STIFFNESS = 60.0


def _simulated() -> tuple[np.ndarray, np.ndarray]:
    """Effort and position (PERIODS N,) of a motor and its load, with noise in both."""
    rng, lines = np.random.default_rng(8), np.arange(4, 240)
    s = 2j * np.pi * lines * RATE / N
    through, load_inertia = 0.01 * s + STIFFNESS, 0.9e-3 * s**2
    motor = 1.1e-3 * s**2 + 1e-3 * s
    G = (load_inertia + through) / ((motor + through) * (load_inertia + through) - through**2)
    spectrum = np.zeros((2, N // 2 + 1), dtype=complex)
    spectrum[0, lines] = np.exp(2j * np.pi * rng.uniform(size=len(lines))) * N / 40
    spectrum[1, lines] = G * spectrum[0, lines]
    signals = np.tile(np.fft.irfft(spectrum, N, axis=1), PERIODS)
    noisy = signals + 0.005 * signals.std(axis=1, keepdims=True) * rng.standard_normal(signals.shape)
    return noisy[0], noisy[1]


def _write_bag(path: Path) -> None:
    """Stamps that jitter, and three messages that the recorder lost."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/JointState"
    State, Header, Stamp = (store.types[name] for name in (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    jitter = np.random.default_rng(6).integers(-50_000, 50_000, PERIODS * N)
    with Writer(path, version=9) as writer:
        states = writer.add_connection("/joint_states", kind, typestore=store)
        for k, (effort, position) in enumerate(zip(*_simulated(), strict=True)):
            if k in (2500, 2501, 5000):
                continue
            at = 1_750_000_000 * 10**9 + k * 10**9 // RATE + int(jitter[k])
            message = State(
                Header(Stamp(at // 10**9, at % 10**9), ""),
                ["joint_0", "joint_1"],
                np.array([0.0, position]),
                np.zeros(0),
                np.array([0.0, effort]),
            )
            writer.write(states, at + 10**6, store.serialize_cdr(message, kind))


@pytest.mark.slow
def test_the_template_finds_the_stiffness_in_a_bag(tmp_path: Path) -> None:
    """Within its interval, which is narrow; the lost messages are counted."""
    pytest.importorskip("rosbags")
    study = new(tmp_path / "mine", "ros2")
    _write_bag(study.parent / "bag_1")
    folder = tmp_path / "run"
    run_all(Run(load(study), folder, 1, Console(-1)))
    summary = json.loads((folder / "summary.json").read_text())
    low, high = summary["parameters"]["k_1"]["interval95"]
    assert low < STIFFNESS < high
    assert high - low < 2
    assert any("3 samples are missing in 2 gaps" in note for note in (folder / "run.log").read_text().splitlines())
