"""Do logs in the forms that laboratories write raise an alarm where nothing is wrong, and are their faults named?

    python scripts/studies/clean_files.py [--quick] [--sets 4] [--only WORD]

Clean measurements of a two-axis arm (`clean_logs.py`: equations of its own, 200 Hz, periods of 2 s, two postures, two
realisations, with and without the reference) in the forms below: stamps of two decimals, logs that begin and end within
a period or with rest, all experiments in one file, torques at another rate, the ripple of a PWM, a prime period, single
precision, counters that start again, an accelerometer with an offset or one that warms up, a first axis that slides,
rounded columns, axes under gravity with little excitation. Each is read, repaired, estimated, fitted by the true
robot's file and validated as in `false_alarms.py`; its alarms are counted, but those that are true of it (TRUE). Then
measurements with a fault in one of these forms, of which it is asserted that words name it. No alarm may have a rate of
more than 1 %, or appear more than once. The last line is one JSON object.

Four sets of each form up to the counter of a turn, and one to three of each of the others, raise nothing; all faults
are named (one draw).

An accelerometer that is sampled with the held torques at 200 Hz without a filter is no such form: it has images of the
torques, which a log cannot state. Nor has one two realisations: four experiments give no covariance of three outputs,
their variances alone weigh, and the cost is beyond that of noise in 6 of 11 measurements.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from clean_logs import RATE_HZ, RATIO, TORQUE_RMS, Chain, Kind, simulated_robot
from false_alarms import Alarms, _alarms

from elastid.base.arrays import FloatArray
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.record import Record
from elastid.recorded.rig import RecordedRig
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot, Spring


@dataclass(frozen=True)
class Files:
    """Signals of each log (n,) or (m,), the robot, the sections that describe them, and what one file holds."""

    robot: Robot
    logs: list[dict[str, FloatArray]]
    recorded: RecordedSpec
    configurations: dict[str, tuple[float, ...]]
    rng: np.random.Generator

    def changed(self, by: Callable[[dict[str, FloatArray]], dict[str, FloatArray]], **section: Any) -> "Files":
        """With other signals in every log, and other keys of the section."""
        return replace(self, logs=[by(dict(log)) for log in self.logs], recorded=replace(self.recorded, **section))

    def with_channels(self, role: str, **keys: Any) -> "Files":
        """With other keys of the channels of a role."""
        channels = tuple(replace(c, **keys) if c.role == role else c for c in self.recorded.channels)
        return replace(self, recorded=replace(self.recorded, channels=channels))

    def records(self, folder: Path) -> tuple[list[Record], Robot]:
        """Written and read as a study does it."""
        for log, path in zip(self.logs, dict.fromkeys(f.path for f in self.recorded.files), strict=True):
            with h5py.File(folder / path, "w") as file:
                for name, signal in log.items():
                    file[name] = signal
        rig = RecordedRig(self.robot, ExperimentSpec(self.configurations, recorded=self.recorded), folder)
        return [rig.measure(experiment) for experiment in rig.experiments], self.robot


TOOL_M = 0.5
# m/s^2, of a sample: 0.1 mg in a root hertz.
ACCELEROMETER_STD = 0.02


def measured(number: int, chain: type[Chain] = Chain, rest_s: float = 0.0, beyond: int = 0, **kind: Any) -> Files:
    """A measurement of two axes in two postures, two realisations; from rest, or in the steady state.

    beyond: further samples.
    """
    shape: dict[str, Any] = {
        "source": "closed form", "axes": 2, "postures": 2, "periods": (2, 3, 5)[number % 3], "realisations": 2,
        "grid": "odd", "noise": 0.005, "wander": 0.0, "step": 0.0, "counts": 1 << 20,
        "has_reference": number % 2 == 0, "coulomb": 0.0, "bandwidth_hz": 3.0, "carrier": 0.0, "half_wave": False,
    }  # fmt: skip
    drawn = Kind(number, 11, **{**shape, **kind})
    arm = chain.drawn(drawn)
    rng, N = np.random.default_rng((number, 11)), drawn.period
    rest = round(rest_s * drawn.rate_hz)
    first = 0 if rest else 3 * N
    logs, files = [], []
    for name, angles in drawn.configurations.items():
        there = replace(arm, posture=angles[-1])
        r = np.concatenate([there.multisines(rng) for _ in range(drawn.realisations)])
        r = np.tile(r, (1, (0 if rest else 3) + drawn.periods + (2 if beyond else 0), 1))
        r = np.concatenate([np.zeros((len(r), rest, 2)), r], axis=1)
        r = r[:, : first + rest + drawn.periods * N + beyond]
        size = np.array(TORQUE_RMS)
        u, q, a = there.run(r, 0.002 * size * rng.standard_normal(r.shape), rng)
        u = u + drawn.noise * size * rng.standard_normal(u.shape)
        for i in range(len(r)):
            of_tool = there.tool(a[i]) + ACCELEROMETER_STD * rng.standard_normal(len(a[i]))
            names = {"r": r[i], "u": u[i], "q": q[i] * RATIO}
            signals = {f"{role}{j + 1}": x[first:, j] for role, x in names.items() for j in range(2)}
            logs.append({**signals, "a": of_tool[first:]})
            files.append(FileSpec(f"{len(files)}.h5", name, i // 2, i % 2))
    channels = [ChannelSpec("u", f"motor {j}", f"u{j}") for j in (1, 2)]
    channels += [ChannelSpec("r", f"motor {j}", f"r{j}") for j in (1, 2) if drawn.has_reference]
    channels += [ChannelSpec("y", f"motor {j}", f"q{j}", quantity="position", side="motor") for j in (1, 2)]
    section = RecordedSpec(drawn.rate_hz, tuple(channels), tuple(files), N / drawn.rate_hz, hold="zero-order")
    return Files(arm.robot, logs, section, drawn.configurations, rng)


@dataclass(frozen=True)
class Arm(Chain):
    """With an accelerometer on the fore arm."""

    @property
    def robot(self) -> Robot:
        """With a frame for it."""
        frame = Frame("tool", "fore", Placement((TOOL_M, 0, 0)))
        return replace(super().robot, frames=(frame,))

    def tool(self, a: FloatArray) -> FloatArray:
        """Acceleration (n,) of the tool along y of the fore arm, from those of the links (n, 2)."""
        return np.asarray(self.arm[3] * np.cos(self.posture) * a[:, 0] + TOOL_M * (a[:, 0] + a[:, 1]))


@dataclass(frozen=True)
class Rail(Arm):
    """An arm on a carriage that a belt moves along x, whose motor has a ratio of 100 in 1/m."""

    @property
    def inertia(self) -> FloatArray:
        """M (2, 2) in kg, kg m and kg m^2."""
        m1, _, _, _, m2, c2, I2 = self.arm
        both = -m2 * c2 * np.sin(self.posture)
        return np.array([[m1 + m2, both], [both, I2 + m2 * c2**2]])

    @property
    def robot(self) -> Robot:
        """As a file has it."""
        m1, _, _, _, m2, c2, I2 = self.arm
        motors = [Motor(J / i**2, i, f / i**2) for J, i, f in zip(self.J, RATIO, self.f, strict=False)]
        springs = [Spring(k, d) for k, d in zip(self.k, self.d, strict=True)]
        carriage = Body("carriage", joints=(Joint("1", "x", springs[0], motors[0], motion="translation"),), mass=m1)
        fore = Body("fore", "carriage", Placement((0, 0, 0)), (Joint("2", "z", springs[1], motors[1]),), mass=m2,
                    center_of_mass=(c2, 0, 0), inertia=(I2, I2, I2))  # fmt: skip
        return Robot("arm on a rail", (carriage, fore), gravity=(0.0, 0.0, 0.0))

    def tool(self, a: FloatArray) -> FloatArray:
        """None is read."""
        return a[:, 0]


def stamped(decimals: int, start: float = 0.0) -> Callable[[int], Files]:
    """Time stamps with so many decimals."""

    def form(number: int) -> Files:
        def with_time(log: dict[str, FloatArray]) -> dict[str, FloatArray]:
            return log | {"t": np.round(start + np.arange(len(log["u1"])) / RATE_HZ, decimals)}

        return measured(number, Arm).changed(with_time, time="t")

    return form


def within_a_period(number: int) -> Files:
    """Logs that begin and end anywhere."""
    files = measured(number, Arm, beyond=237)
    return replace(files, logs=[{k: x[(i * 37) % 100 :] for k, x in log.items()} for i, log in enumerate(files.logs)])


def one_file(number: int) -> Files:
    """All experiments in one file, three seconds of rest between them."""
    files = measured(number, Arm)
    whole: dict[str, list[FloatArray]] = {name: [] for name in files.logs[0]}
    specs, at, rest = [], 0, round(3 * RATE_HZ)
    for log, spec in zip(files.logs, files.recorded.files, strict=True):
        n = len(log["u1"])
        specs.append(replace(spec, path="all.h5", samples=(at, at + n)))
        at += n + rest
        for name, x in log.items():
            still = x[-1] + 1e-3 * np.ptp(x) * files.rng.standard_normal(rest)
            whole[name] += [x, 0 * still if name[0] == "r" else still]
    joined = {name: np.concatenate(parts) for name, parts in whole.items()}
    return replace(files, logs=[joined], recorded=replace(files.recorded, files=tuple(specs)))


def fast_torque(number: int) -> Files:
    """Torques at 1000 Hz, angles at 200 Hz."""
    files = measured(number, Arm, rate_hz=1000.0, period=2000)
    files = files.changed(lambda log: {k: x[::5] if k[0] == "q" else x for k, x in log.items()}, rate_hz=200.0)
    return files.with_channels("u", rate_hz=1000.0).with_channels("r", rate_hz=1000.0)


def rest_before(number: int) -> Files:
    """Ten seconds of rest, and then the excitation."""
    return measured(number, Arm, rest_s=10.0, periods=5)


def ripple(number: int) -> Files:
    """The ripple of a PWM, folded to 73.1 Hz, on the torques."""

    def rippled(log: dict[str, FloatArray]) -> dict[str, FloatArray]:
        t = np.arange(len(log["u1"])) / RATE_HZ
        return log | {f"u{j}": log[f"u{j}"] + 0.05 * TORQUE_RMS[j - 1] * np.sin(460 * t + j) for j in (1, 2)}

    return measured(number, Arm).changed(rippled)


def prime(number: int) -> Files:
    """A period of a prime number of samples."""
    return measured(number, Arm, period=397)


def single_precision(number: int) -> Files:
    """Columns of float32, the angle behind 80 turns of the motor."""
    turns = {"q1": 500.0, "q2": -500.0}
    return measured(number, Arm).changed(
        lambda log: {name: np.float32(x + turns.get(name, 0.0)) for name, x in log.items()}  # type: ignore[misc]
    )


def counter(bits: int, counts: int) -> Callable[[int], Files]:
    """Angles as counts of the motor's encoder, in a counter that starts again at 2^bits."""

    def form(number: int) -> Files:
        def counted(log: dict[str, FloatArray]) -> dict[str, FloatArray]:
            values = {j: np.round(log[f"q{j}"] * counts / (2 * np.pi)) for j in (1, 2)}
            return log | {f"q{j}": (x - x[0] + 2 ** (bits - 1) * (j % 2)) % 2**bits for j, x in values.items()}

        files = measured(number, Arm, counts=counts).changed(counted)
        return files.with_channels("y", scale=2 * np.pi / counts)

    return form


def with_accelerometer(offset: float, drift: float) -> Callable[[int], Files]:
    """An accelerometer with a constant offset and one that warms up, m/s^2."""

    def form(number: int) -> Files:
        def warmed(log: dict[str, FloatArray]) -> dict[str, FloatArray]:
            t = np.arange(len(log["a"])) / 1000.0
            return log | {"a": log["a"] + offset + drift * (1 - np.exp(-t / 30))}

        # Its filter leaves no images of the torques that are held at this rate.
        files = measured(number, Arm, rate_hz=1000.0, period=2000, realisations=4).changed(warmed)
        channel = ChannelSpec("y", "accelerometer tool y", "a", quantity="acceleration")
        return replace(files, recorded=replace(files.recorded, channels=(*files.recorded.channels, channel)))

    return form


def rail(number: int) -> Files:
    """The first axis slides."""
    return measured(number, Rail)


def rounded(number: int) -> Files:
    """Torques in whole per mille of 300 Nm, angles of the joint in degrees with five digits."""

    def few(log: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {k: np.round(x / 0.3) if k[0] == "u" else np.round(np.degrees(x), 3) if k[0] == "q" else x
                for k, x in log.items()}  # fmt: skip

    files = measured(number, Arm).changed(few).with_channels("y", unit="deg")
    return files.with_channels("u", scale=0.3)


def loaded(number: int) -> Files:
    """Axes that gravity loads, moved by a twentieth of what holds them."""
    robot, rms, configurations = simulated_robot(2, 0.0), (1.0, 3.0), {"c1": (0.3, 0.0), "c2": (-0.5, 0.8)}
    lines = MultisineSpec(RATE_HZ, 2.0, (1.0, 40.0), rms, grid="odd-random")
    noise = NoiseSpec(0.005 * rms[-1], 2e-8, 0.0)
    experiment = ExperimentSpec(configurations, 2, (2, 3, 5)[number % 3], 1, simulated=SimulatedSpec(noise=noise))
    rig = SimulatedRig(robot, experiment, make_plan(lines, experiment, robot, number), number)
    logs, files = [], []
    for one in rig.experiments:
        record = rig.measure(one)
        names = {"r": record.r, "u": record.u, "q": record.y * RATIO}
        logs.append({f"{name}{j + 1}": x[:, j] for name, x in names.items() if x is not None for j in range(2)})
        files.append(FileSpec(f"{len(files)}.h5", one.configuration.name, one.realisation, one.experiment))
    usual = measured(number, Arm).recorded
    return Files(robot, logs, replace(usual, files=tuple(files)), configurations, np.random.default_rng(number))


FORMS: Mapping[str, Callable[[int], Files]] = {
    "as they are": lambda number: measured(number, Arm),
    "stamps of two decimals": stamped(2),
    "stamps of two decimals, clock time": stamped(2, 1.7e9),
    "within a period": within_a_period,
    "one file": one_file,
    "torque at 1000 Hz": fast_torque,
    "rest before": rest_before,
    "PWM ripple": ripple,
    "prime period": prime,
    "float32": single_precision,
    "counter of a turn": counter(17, 1 << 17),
    "counter of 16 bits": counter(16, 1 << 17),
    "accelerometer": with_accelerometer(0.0, 0.0),
    "accelerometer with an offset": with_accelerometer(0.8, 0.0),
    "accelerometer that warms up": with_accelerometer(0.8, 0.03),
    "rail": rail,
    "rounded": rounded,
    "gravity": loaded,
}


# What is true of a form, and said.
TRUE: Mapping[str, Mapping[str, str]] = {
    "within a period": {"records/incomplete-period": "the end of the log is left out"},
    "torque at 1000 Hz": {"channels-brought-to-another-rate": "they are"},
    "rest before": {"rest-left-out": "it is", "frf/transient-left-out": "the robot begins to move from rest"},
    "counter of a turn": {"records/unwrapped": "it does start again"},
    "counter of 16 bits": {"records/unwrapped": "it does start again"},
    "rounded": {"quantised-channels": "steps of 0.3 Nm are noise"},
}


def rows(files: Files, kept: Callable[[int], Any]) -> Files:
    """With some of the n samples of each log."""
    return files.changed(lambda log: {name: x[kept(len(x))] for name, x in log.items()})


def of_one(files: Files, name: str, by: Callable[[FloatArray], FloatArray]) -> Files:
    """With a signal through a function of its samples."""
    return files.changed(lambda log: log | {name: by(log[name])})


def stuck(x: FloatArray) -> FloatArray:
    """A signal that stays where it was for half a second, in its second period."""
    start = 2 * len(x) // 3
    return np.concatenate([x[:start], np.full(100, x[start]), x[start + 100 :]])


def exchanged(log: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """The angles of the motors in each other's columns."""
    return log | {"q1": log["q2"], "q2": log["q1"]}


def without(lost: int) -> Callable[[int], Any]:
    """The samples of a log without some in its middle."""
    return lambda n: np.delete(np.arange(n), n // 2 + np.arange(lost))


# Form with a fault, and words that name it.
FAULTS: Mapping[str, tuple[Callable[[int], Files], str]] = {
    "torque clipped": (lambda n: of_one(FORMS["rounded"](n), "u1", lambda x: np.clip(x, -350, 350)), "limit"),
    "accelerometer clipped": (
        lambda n: of_one(FORMS["accelerometer with an offset"](n), "a", lambda x: np.minimum(x, np.quantile(x, 0.97))),
        "limit",
    ),
    "samples lost": (lambda n: rows(FORMS["prime period"](n), without(7)), "does not repeat"),
    "samples lost, with stamps": (
        lambda n: rows(FORMS["stamps of two decimals"](n), without(7)), "7 samples are missing"
    ),
    "stamps run backwards": (
        lambda n: of_one(FORMS["stamps of two decimals"](n), "t", lambda t: np.where(t > 3, t - 2, t)),
        "runs backwards",
    ),
    "angles late": (
        lambda n: FORMS["within a period"](n).changed(
            lambda log: log | {f"q{j}": np.roll(log[f"q{j}"], 3) for j in (1, 2)}
        ),
        "late",
    ),
    "angles exchanged": (lambda n: FORMS["float32"](n).changed(exchanged), "exchanged"),
    "encoder stuck": (lambda n: of_one(FORMS["counter of 16 bits"](n), "q2", stuck), "is stuck"),
    "wrong period": (lambda n: FORMS["prime period"](n).changed(lambda log: log, period=2.0), "repeats every 397"),
    "one file as a whole": (
        lambda n: (lambda f: replace(f, recorded=replace(f.recorded, files=(FileSpec("all.h5", "c1"),))))(
            FORMS["one file"](n)
        ),
        "repeat",
    ),
}  # fmt: skip


QUICK = ("stamps of two decimals", "rest before", "counter of 16 bits", "samples lost, with stamps", "encoder stuck")


def judged(name: str, form: Callable[[int], Files], number: int) -> Alarms:
    """All alarms of a form."""
    with tempfile.TemporaryDirectory() as folder:
        return _alarms(name, lambda: form(number).records(Path(folder)), TRUE.get(name, {}), number)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--sets", type=int, default=4)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    alarms: dict[str, dict[str, int]] = {}
    count = 1 if given.quick else given.sets
    for name in [name for name in FORMS if given.only in name and (name in QUICK or not given.quick)]:
        found = [judged(name, FORMS[name], number) for number in range(count)]
        alarms[name] = dict(Counter(code for each in found for code in each.codes))
        print(f"{name:<36}{alarms[name]}", flush=True)
        for code, text in {code: text for each in found for code, text in each.codes.items()}.items():
            print(f"    {code}: {text[:300]}", flush=True)
    unnamed = []
    for name, (fault, words) in FAULTS.items():
        if given.only in name and (name in QUICK or not given.quick):
            said = judged(name, fault, 1).codes
            unnamed += [] if any(words in text for text in said.values()) else [name]
            print(f"{name:<36}{', '.join(said)}", flush=True)
    total = sum((Counter(each) for each in alarms.values()), Counter[str]())
    print(json.dumps({"sets": count, "alarms": alarms, "unnamed": unnamed}))
    assert not unnamed, unnamed
    # A test of the cost says of itself that it is wrong once in two hundred measurements.
    wrong = {code: n for code, n in total.items() if n > max(1, 0.01 * count * len(alarms))}
    assert not wrong, wrong


if __name__ == "__main__":
    main()
