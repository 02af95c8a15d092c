"""How often does each note and refusal appear in friction studies whose logs have nothing wrong?

    python scripts/studies/false_alarms_of_friction.py [--quick] [--logs 300] [--seed 0]

Each set of logs is of one rigid axis, simulated here by a leapfrog of 0.5 ms with LuGre's bristles, viscous
friction, in half of the sets a Stribeck effect and in half gravity, under a PD controller: passes there and back at
five speeds, in a file each with its speed or in one, and a free motion of five sines. Encoders have 2^16 to 2^20 counts
a turn of the joint, torque has white noise or a slow drift of up to 1 % of its rms, rates are 200 to 1000 Hz, and the
stamps of an even clock are exact, UNIX time, rounded to 1e-6 s or to 1 ms, or a quartz is off by up to 50 ppm. A
multisine at rest of two amplitudes (2^21 to 2^23 counts) goes with every set. Logs are read from
files, levels and laws found as by a study, and of one set in eight, if its logs state speeds, the filter follows them.

Every note of any severity, finding and refusal counts once in a set; that crests of sines in the free motion slide
steadily in one direction is true, and none. The rates are compared with the docstrings of the tables as those of
false_alarms.py are. The last line is one JSON object.

300 sets, of an earlier state: a coarse encoder of 2^16 counts left the ways there and back without common positions
in 2. The first 80 of them raise nothing today but in the filter. Of the eight kinds up to number 80 that are followed,
each simulated by itself, three have warnings of the filter: numbers 16, 32 and 72. The law has the stiction of 16 and
32, whose passes are not slower than 0.9 v_s, and says that slower ones are missing; neither it nor the inertia is the
cause, since the warnings stay with the true ones. At slow constant speed the noise of the angle is taken for viscous
friction, which rises while F_c falls, so that the warnings are true.
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
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
from false_alarms import compared

from elastid.app.stages.friction import _followed, _records_of
from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.base.note import Note
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.friction_study.identify import identify_friction
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.spec import FilterSpec, FrictionSpec
from elastid.record import FrictionRecord, FrictionRecords
from elastid.recorded.friction_logs import read_friction_logs
from elastid.robot import Body, Joint, Motor, Robot

STEP_S, GRAVITY, RATIO, BATCH, FOLLOW_EVERY = 5e-4, 9.81, 100.0, 60, 8
# Samples of STEP_S in one of a log: 200 to 1000 Hz.
THINNED = (10, 8, 6, 5, 4, 2)
REST_S, RAMP_S, FREE_S = 0.4, 0.25, 20.0
PLATEAU_S = (6.0, 6.0, 4.0, 2.5, 1.5)
CLOCKS = ("exact", "1e-6 s", "1 ms", "unix", "unix, 1 ms", "quartz")
SINE_S = 2.0
FOLLOWED = "friction_study.filter_consistency.FilterThresholds"
# Table: judgement -> the fields on which it depends, all of them where it is "*".
JUDGEMENTS: Mapping[str, Mapping[str, str]] = {
    "recorded.friction_logs.JointLimits": {"logs-refused": "held_travel_rad max_turns"},
    "recorded.repair.time_stamps.TimeStampLimits": {
        "samples-resampled": "max_deviation max_rounding",
        "samples-missing-in-time": "min_gap",
    },
    "friction_study.pass_checks.PassThresholds": {
        "friction/passes": "clipped_run clipped_share constant_share min_values",
        "friction/passes": "step_chance step_share same_load",
        "friction/passes": "large_gravity",
        "friction/by-angle": "min_pairs min_cover min_change",
    },
    "friction_study.passes.PlateauLimits": {
        "friction/passes": "steady_share shortest_s rest_share same_speed steady_hz turn_share end_share windows "
        "line_share",
        "friction/no-record": "other_speed same_speed common_share",
    },
    "friction_study.levels.LevelLimits": {"friction/levels": "*"},
    "friction_study.joint_levels.SideLimits": {"levels-refused": "min_ratio min_stds close_factor"},
    "friction_study.at_rest.RestLimits": {
        "friction/at-rest": "max_condition min_counts same_amplitude min_lines",
        "friction/at-rest": "max_slip",
    },
    FOLLOWED: {
        "not-excited": "max_std_ratio",
        "filter/not-excited": "weak_std_ratio",
        "filter/not-excited": "distinct_correlation",
        "diverged": "diverged_stds",
        "filter/inconsistent": "max_correlation",
        "filter/inconsistent": "nis_band around_a_stop_s standing_share least_moving",
        "filter/inconsistent": "lags_s max_movement",
        "filter/at-stops": "max_before_stops max_square_before_stops max_after_stops repeating_stds least_events",
    },
}


@dataclass(frozen=True)
class Kind:
    """One axis, its controller and its logs; SI, friction at the joint.

    gravity: largest torque.  bend: of the bristles at stiction, rad.  bristle_damping: over sqrt(sigma_0 J).
    """

    number: int
    seed: int
    inertia: float
    file_inertia: float
    coulomb: float
    viscous: float
    stiction: float
    stribeck_velocity: float
    gravity: float
    bandwidth_hz: float
    speeds: tuple[float, ...]
    thinned: int
    counts: int
    noise: float
    drift: float
    clock: str
    states_speeds: bool
    bend: float
    bristle_damping: float

    @classmethod
    def drawn(cls, number: int, seed: int) -> "Kind":
        """The kind of a number."""
        rng = np.random.default_rng((seed, number))
        inertia, coulomb = rng.uniform(2, 10), rng.uniform(8, 30)
        excess = rng.uniform(0.1, 0.4) if rng.integers(2) else 0.0
        drifts = bool(rng.integers(2))
        return cls(
            number, seed, inertia, inertia * rng.uniform(0.85, 1.15), coulomb, rng.uniform(0.3, 1.5) * coulomb,
            coulomb * (1 + excess), rng.uniform(0.05, 0.2), rng.uniform(0.3, 4) * coulomb if rng.integers(2) else 0.0,
            rng.uniform(4, 10), tuple(np.geomspace(rng.uniform(0.03, 0.08), rng.uniform(0.6, 1.2), 5).tolist()),
            int(rng.choice(THINNED)), 2 ** int(rng.integers(16, 21)),
            rng.uniform(1e-3, 3e-3) if drifts else rng.uniform(2e-3, 0.01), rng.uniform(2e-3, 0.01) if drifts else 0.0,
            CLOCKS[number % len(CLOCKS)], bool(rng.integers(2)), rng.uniform(5e-4, 2e-3), rng.uniform(0.1, 0.6),
        )  # fmt: skip

    def __str__(self) -> str:
        words = f"{self.number}: {self.rate_hz:.4g} Hz, 2^{int(np.log2(self.counts))}, clock {self.clock}"
        extras = {"Stribeck": self.stiction > self.coulomb, "gravity": self.gravity > 0, "drift": self.drift > 0}
        return ", ".join([words, *(name for name, has in extras.items() if has)])

    @property
    def rate_hz(self) -> float:
        """Of the logs."""
        return 1 / (STEP_S * self.thinned)

    @property
    def is_followed(self) -> bool:
        """By the filter; logs of single speeds, since its noise is found over the longest."""
        return self.states_speeds and self.number % FOLLOW_EVERY == 0

    @cached_property
    def robot(self) -> Robot:
        """As a laboratory's file has it, with an inertia that is somewhat wrong."""
        arm = 0.5
        mass = self.gravity / GRAVITY / arm if self.gravity else 1.0
        rotor = max(self.file_inertia - mass * arm**2 - 0.1, 0.2 * self.file_inertia) / RATIO**2
        joint = Joint("1", "y" if self.gravity else "z", None, Motor(rotor, RATIO))
        body = Body("arm", joints=(joint,), mass=mass, center_of_mass=(arm, 0, 0), inertia=(0.1, 0.1, 0.1))
        return Robot("axis", (body,), gravity=(0.0, 0.0, -GRAVITY))


def reference() -> tuple[FloatArray, list[tuple[int, int]]]:
    """Profiles (n, 5) of the speeds of passes, of 1, and samples [first, last) of each, the last of a free motion."""
    profiles, parts, n = [], [], 0
    for k, plateau_s in enumerate(PLATEAU_S):
        t = np.cumsum([0, REST_S, RAMP_S, plateau_s, RAMP_S, REST_S, RAMP_S, plateau_s, RAMP_S, REST_S])
        v = [0, 0, 1, 1, 0, 0, -1, -1, 0, 0]
        profile = np.zeros((round(t[-1] / STEP_S), len(PLATEAU_S)))
        profile[:, k] = np.interp(np.arange(len(profile)) * STEP_S, t, v)
        profiles.append(profile)
        parts.append((n, n + len(profile)))
        n += len(profile)
    parts.append((n, n + round(FREE_S / STEP_S)))
    return np.vstack([*profiles, np.zeros((round(FREE_S / STEP_S), len(PLATEAU_S)))]), parts


def simulated(kinds: list[Kind]) -> tuple[FloatArray, FloatArray, list[tuple[int, int]]]:
    """Angle and torque (n, draws) every STEP_S, and the parts."""
    profile, parts = reference()
    rng = np.random.default_rng((kinds[0].seed, kinds[0].number, 1))
    D = len(kinds)
    speed = profile @ np.array([kind.speeds for kind in kinds]).T
    first, last = parts[-1]
    t = np.arange(last - first) * STEP_S
    fade = np.minimum(1, np.minimum(t, t[-1] - t) / 1.0)[:, None]
    for _ in range(5):
        freq_hz, phase = rng.uniform(0.1, 1.0, D), rng.uniform(0, 2 * np.pi, D)
        speed[first:] += fade * rng.uniform(0.1, 0.5, D) * np.cos(2 * np.pi * np.outer(t, freq_hz) + phase)
    wanted = np.cumsum(speed, axis=0) * STEP_S

    def column(name: str) -> FloatArray:
        return np.array([getattr(kind, name) for kind in kinds])

    J, f, F_c, excess = column("inertia"), column("viscous"), column("coulomb"), column("stiction") - column("coulomb")
    sigma_0, sigma_1 = bristles(kinds)
    omega = 2 * np.pi * column("bandwidth_hz")
    k_p, k_d, slow, G = J * omega**2, 1.6 * J * omega, 1 / column("stribeck_velocity"), column("gravity")
    q, v, z = wanted[0].copy(), np.zeros(D), np.zeros(D)
    angle, torque = np.empty(speed.shape), np.empty(speed.shape)
    for i in range(len(speed)):
        # Gravity is fed forward, as by robots' controllers.
        u = k_p * (wanted[i] - q) + k_d * (speed[i] - v) + G * np.cos(wanted[i])
        angle[i], torque[i] = q, u
        rate = sigma_0 * np.abs(v) / (F_c + excess * np.exp(-((v * slow) ** 2)))
        friction = sigma_0 * z + sigma_1 * (v - rate * z) + f * v
        v = v + STEP_S / J * (u - G * np.cos(q) - friction)
        # Exact where velocity is constant, since a step bends fast bristles to their end.
        z = z - np.expm1(-rate * STEP_S) * (v / np.maximum(rate, 1e-300) - z)
        q = q + STEP_S * v
    return angle, torque, parts


def bristles(kinds: list[Kind]) -> tuple[FloatArray, FloatArray]:
    """sigma_0, sigma_1 (draws,) of LuGre."""
    sigma_0 = np.array([kind.stiction / kind.bend for kind in kinds])
    return sigma_0, np.array([kind.bristle_damping * np.sqrt(kind.inertia) for kind in kinds]) * np.sqrt(sigma_0)


def at_rest(kinds: list[Kind]) -> list[list[FrictionRecord]]:
    """Four periods of a multisine each at 0.05 and 0.1 of Coulomb friction, of each axis."""
    rng = np.random.default_rng((kinds[0].seed, kinds[0].number, 2))
    n, waves = round(SINE_S / STEP_S), []
    for kind in kinds:
        lines = np.unique(np.geomspace(5, min(80, kind.rate_hz / 5), 40).round() * SINE_S).astype(int)
        phases = rng.uniform(0, 2 * np.pi, len(lines))
        wave = np.cos(2 * np.pi * np.outer(np.arange(n), lines) / n + phases).sum(axis=1)
        waves.append(np.outer(kind.coulomb * wave / np.abs(wave).max(), [0.05, 0.1]))
    u = np.tile(np.stack(waves, axis=1), (6, 1, 1))
    J, f, bend = (np.array([[getattr(kind, name)] for kind in kinds]) for name in ("inertia", "viscous", "bend"))
    sigma_0, sigma_1 = (number[:, None] for number in bristles(kinds))
    q, v, z, angle = np.zeros(u.shape[1:]), np.zeros(u.shape[1:]), np.zeros(u.shape[1:]), np.empty(u.shape)
    for i in range(len(u)):
        angle[i] = q
        slip = v - np.abs(v) * z / bend
        v = v + STEP_S / J * (u[i] - sigma_0 * z - sigma_1 * slip - f * v)
        z = z + STEP_S * (v - np.abs(v) * z / bend)
        q = q + STEP_S * v
    records = []
    for k, kind in enumerate(kinds):
        count, kept = 2 * np.pi / 2 ** int(rng.integers(21, 24)), slice(2 * n, None, kind.thinned)
        position = np.round(angle[kept, k] / count) * count
        torque = u[kept, k] * 1.0
        torque += 0.05 * torque.std(axis=0) * rng.standard_normal(torque.shape)
        records.append([
            FrictionRecord(
                f"rest{i}", "1", "at_rest", kind.rate_hz, position[:, i], torque[:, i], resolution=count,
                period_samples=n // kind.thinned,
            )
            for i in range(2)
        ])  # fmt: skip
    return records


@dataclass(frozen=True)
class Signals:
    """Of an axis every STEP_S: angle, torque (n,), the parts, and what was measured at rest."""

    angle: FloatArray
    torque: FloatArray
    parts: list[tuple[int, int]]
    rest: list[FrictionRecord]


def write(kind: Kind, measured: Signals, folder: Path) -> RecordedSpec:
    """Logs of an axis as files, with the section that describes them."""
    angle, torque, parts = measured.angle, measured.torque, measured.parts
    rng = np.random.default_rng((kind.seed, kind.number, 3))
    passes = parts[:-1] if kind.states_speeds else [(parts[0][0], parts[-2][1])]
    speeds = [*(kind.speeds if kind.states_speeds else [None]), None]
    count, files = 2 * np.pi / kind.counts, []
    rms = float(np.sqrt(np.mean(torque**2)))
    walk = np.cumsum(rng.standard_normal(len(torque)))
    drift = kind.drift * rms * walk / np.abs(walk).max()
    for i, ((first, last), speed) in enumerate(zip([*passes, parts[-1]], speeds, strict=True)):
        own = slice(first, last, kind.thinned)
        q, u = np.round(angle[own] / count) * count, torque[own] + drift[own]
        with h5py.File(folder / f"{i}.h5", "w") as file:
            file["q"], file["u"] = q, u + kind.noise * rms * rng.standard_normal(len(u))
            file["t"] = stamps(kind.clock, first * STEP_S + np.arange(len(u)) / kind.rate_hz, rng)
        files.append(FileSpec(f"{i}.h5", speed=speed))
    channels = (ChannelSpec("u", "motor 1", "u"), ChannelSpec("y", "motor 1", "q", quantity="position"))
    return RecordedSpec(kind.rate_hz, channels, tuple(files), time="t")


def stamps(clock: str, time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Those that an even clock writes."""
    if clock == "quartz":
        return np.asarray(time_s * (1 + rng.uniform(-5e-5, 5e-5)))
    if clock.startswith("unix"):
        time_s = 1.7e9 + time_s
    digits = {"1e-6 s": 6, "1 ms": 3, "unix, 1 ms": 3}.get(clock)
    return time_s if digits is None else np.round(time_s, digits)


def judged(kind: Kind, measured: Signals) -> dict[str, str]:
    """Code -> sentence of all that is said about the logs of an axis."""
    codes: dict[str, str] = {}
    stage, spec = "logs", FrictionSpec()
    try:
        with tempfile.TemporaryDirectory() as folder:
            recorded = write(kind, measured, Path(folder))
            logs = read_friction_logs(kind.robot, ExperimentSpec({}, recorded=recorded), Path(folder), ["1"], {})
        free = f"motion {logs.records[-1].name} "
        codes |= _codes((note for record in logs.records for note in record.notes), free)
        records = FrictionRecords((*logs.records, *measured.rest))
        stage = "levels"
        levels = find_joint_levels(kind.robot, kind.robot.driven, records)
        codes |= _codes((note for each in levels for note in each.notes), free)
        stage = "law"
        (joint,) = identify_friction(kind.robot, levels, records, spec).joints
        codes |= _codes(joint.notes, free)
        if kind.is_followed:
            stage = "follow"
            codes |= _codes(_followed(kind.robot, joint, _records_of(logs, "1"), FilterSpec()).notes, free)
    except ElastidError as error:
        codes[f"{stage}-refused"] = str(error)
    return codes


def _codes(notes: Iterable[Note], free: str) -> dict[str, str]:
    """Without what is true: crests of sines are steady, and not each has its like in the other direction."""
    return {
        note.code: str(note) for note in notes if not (note.code == "friction/passes" and note.place.startswith(free))
    }


def alarms(count: int, seed: int) -> Iterator[tuple[Kind, dict[str, str]]]:
    """Of every set."""
    for first in range(0, count, BATCH):
        kinds = [Kind.drawn(number, seed) for number in range(first, min(count, first + BATCH))]
        angle, torque, parts = simulated(kinds)
        for i, (kind, rest) in enumerate(zip(kinds, at_rest(kinds), strict=True)):
            yield kind, judged(kind, Signals(angle[:, i], torque[:, i], parts, rest))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--logs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    count = 2 if given.quick else given.logs
    totals: Counter[str] = Counter()
    followed = 0
    for kind, codes in alarms(count, given.seed):
        totals.update(codes.keys())
        followed += kind.is_followed
        for code, text in codes.items():
            print(f"{code}: {kind}: {text[:160]}", flush=True)
    of_filter = {*JUDGEMENTS[FOLLOWED], "follow-refused"}
    rows, unmeasured, wrong = compared(JUDGEMENTS, totals, lambda _, code: followed if code in of_filter else count)
    own = [name for name in unmeasured if name.rpartition(".")[0] in JUDGEMENTS]
    print(json.dumps({"logs": count, "followed": followed, "alarms": rows, "unmeasured": own, "wrong": wrong}))
    assert not wrong


if __name__ == "__main__":
    main()
