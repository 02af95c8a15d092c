"""How often does each repair, note and warning appear on logs in which nothing is wrong?

    python scripts/studies/false_alarms.py [--quick] [--logs 300] [--seed 0] [--jobs 1]

Sets of clean logs of many kinds are read, repaired, estimated, as a study does, by a local method (codes that begin
with `local-`), fitted by the true robot's file with the diagnosis, and validated. An alarm is a repair, a warning, a
refusal, a status that is not `converged`, friction that is taken out of a robot without any, or an excess of the cost;
each counts once in a set. What is true of a kind, such as a period that differs because the torque stepped in it, is
none (`true_of`). No code may have alarms in 1 % of the sets or more, but those that state their own rate. The
last line is one JSON object.

Half of the logs are of the simulated rig. The others come from equations of their own, which share nothing with it:
motors on elastic gears and the links of a planar arm under a sampled controller,

    x_k+1 = e^(A h) x_k + A^-1 (e^(A h) - 1) B (u_k + w_k),     u = r + K_p e + K_d (e - e_k-1) / h,    e = c - q_m.

u: link side.  q_m: the encoder's.  c: a carrier.
"""

import json
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import study_run
import h5py
import numpy as np
from plants.outside_arm import Outside
from scipy.linalg import expm
from scipy.signal import lfilter
from scipy.stats import binomtest

from elastid import api
from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError, Note
from elastid.base.execution import Execution
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, ColoredNoiseSpec, NoiseSpec, SimulatedSpec
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.record import Configuration, Record
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from elastid.simulation.spec import ControllerSpec
from elastid.validation.frf_error import noise_p, validate
from elastid.validation.measured_modes import measured_modes
from elastid.validation.residual_tests import FALSE_ALARM

# Of the sets; a judgement that states its own rate in its words may reach it.  Fewer sets show no such rate.
MAX_RATE, MIN_COUNTED, STATED = 0.01, 100, ("excess-of-cost",)
RATE_HZ, PERIOD = 200.0, 400
# Lines 0.5 Hz apart: all from 1 to 40 Hz, odd ones, odd ones with gaps, every fourth.
GRIDS: Mapping[str, tuple[int, ...]] = {
    "full": tuple(range(2, 81)),
    "odd": tuple(range(3, 80, 2)),
    "odd-random": tuple(k for k in range(3, 80, 2) if (k * 7919) % 11 > 2),
    "sparse": tuple(range(3, 80, 4)),
}
RATIO, TORQUE_RMS = np.array((100.0, 80.0)), np.array((60.0, 30.0))


@dataclass(frozen=True)
class Kind:
    """What a set of logs is like.

    wander: rms of a slow torque that no log shows, over that of the excitation; step: of one that jumps once in a log.
    counts: of the encoder in a turn, 0 for a fine one.  noise: of the logged torque over its rms.  coulomb: friction
    over the rms of the torque.  bandwidth_hz: of the position loop.  carrier: amplitude of a slow movement, rad.
    """

    number: int
    seed: int
    is_simulated: bool
    axes: int
    postures: int
    periods: int
    realisations: int
    grid: str
    noise: float
    wander: float
    step: float
    counts: int
    has_reference: bool
    coulomb: float
    bandwidth_hz: float
    carrier: float
    half_wave: bool

    @classmethod
    def draw(cls, number: int, seed: int) -> "Kind":
        """Draw the kind of the set of logs with an index."""
        rng, is_simulated = np.random.default_rng((seed, number)), bool(number % 2)
        grid = str(rng.choice(list(GRIDS)))
        axes, realisations = int(rng.integers(1, 3)), int(rng.integers(1, 4))
        # One realisation does not show the distortion by friction.
        coulomb = float(rng.choice((0.0, 0.05))) if is_simulated and realisations > 1 else 0.0
        return cls(
            number=number,
            seed=seed,
            is_simulated=is_simulated,
            axes=axes,
            postures=int(rng.integers(1, 3)) if axes > 1 else 1,
            periods=int(rng.choice((2, 3, 5))),
            realisations=realisations,
            grid=grid,
            noise=float(rng.choice((0.001, 0.005, 0.02))),
            wander=float(rng.choice((0.0, 0.03, 0.1))),
            step=0.0 if is_simulated else float(rng.choice((0.0, 0.0, 0.1))),
            counts=int(rng.choice((0, 1 << 14, 1 << 17, 1 << 20))),
            has_reference=bool(rng.random() < 0.8),
            coulomb=coulomb,
            bandwidth_hz=float(rng.choice((1.5, 3.0, 5.0))),
            carrier=float(rng.choice((0.0, 0.01))) if coulomb == 0 else 0.01,
            half_wave=grid.startswith("odd") and bool(rng.random() < 0.3),
        )

    @cached_property
    def robot(self) -> Robot:
        """A planar arm with resonances near 10 and 20 Hz; each number within 20 % of a typical one."""
        coulomb = self.coulomb * TORQUE_RMS / RATIO
        first = Joint("1", "z", Spring(45e3, 37.0), Motor(2e-3, 100.0, 0.02, coulomb[0]))
        second = Joint("2", "z", Spring(26e3, 12.0), Motor(1.1e-3, 80.0, 0.02, coulomb[1]))
        upper = Body("upper", joints=(first,), mass=40.0, center_of_mass=(0.3, 0, 0), inertia=4.0)
        fore = Body("fore", "upper", Placement((0.6, 0, 0)), (second,), 20.0, (0.25, 0, 0), 1.2)
        typical = Robot("planar arm", (upper, fore)[: self.axes], gravity=(0.0, 0.0, 0.0))
        rng = np.random.default_rng((self.seed, self.number, 1))
        return typical.with_parameters({n: v * rng.uniform(0.8, 1.2) for n, (v, _) in typical.parameters().items()})

    @cached_property
    def spec(self) -> ExperimentSpec:
        """Its experiments on the simulated rig; closed forms have their configurations, realisations and periods."""
        angles = np.random.default_rng((self.seed, self.number, 2)).uniform(0.6, 1.6, (self.postures, self.axes))
        rms = TORQUE_RMS[self.axes - 1]
        wander = (ColoredNoiseSpec("disturbance", self.wander * rms, 0.03),) if self.wander else ()
        noise = NoiseSpec(self.noise * rms, 2e-7, 0.002 * rms, self.counts, colored=wander)
        carrier = CarrierSpec(self.carrier, 1) if self.carrier else None
        simulated = SimulatedSpec(
            controller=ControllerSpec(self.bandwidth_hz), noise=noise, carrier=carrier, substeps=2
        )
        configurations = {f"c{i}": tuple(row) for i, row in enumerate(angles.tolist(), 1)}
        return ExperimentSpec(configurations, self.realisations, self.periods, 1, simulated=simulated)

    @cached_property
    def plan(self) -> Plan:
        """Multisines at the lines of its grid that the controller does not cancel, from half its bandwidth on."""
        lines = tuple(k for k in GRIDS[self.grid] if k * RATE_HZ / PERIOD >= self.bandwidth_hz / 2)
        rms = tuple(TORQUE_RMS[: self.axes].tolist())
        excitation = MultisineSpec(RATE_HZ, PERIOD / RATE_HZ, (1.0, 40.0), rms, grid="lines", lines=lines)
        return make_plan(excitation, self.spec, self.robot, self.number)

    def records(self) -> Iterator[Record]:
        """Simulate the records of all experiments."""
        if not self.is_simulated:
            return closed_form(self)
        rig = SimulatedRig(self.robot, self.spec, self.plan, self.number)
        return map(rig.measure, rig.experiments)


def closed_form(kind: Kind) -> Iterator[Record]:
    """Yield each run without its first three periods, after the transient has decayed."""
    rng, plan, rms = np.random.default_rng((kind.seed, kind.number, 3)), kind.plan, TORQUE_RMS[: kind.axes]
    places = ("position",) * kind.axes
    for run in plan.experiments:
        r = np.tile(plan.torque(run), (3 + kind.periods, 1))
        w = disturbance(kind, len(r), rng) + 0.002 * rms * rng.standard_normal(r.shape)
        u, q = closed_loop(kind, run.configuration, r, w, 1e-7 * (1 + 4 * rng.random()) * rng.standard_normal(r.shape))
        u = u + kind.noise * rms * rng.standard_normal(u.shape)
        r, u, q = (signal[3 * PERIOD :] for signal in (r, u, q))
        names = (run.name, run.configuration, run.realisation, run.experiment, RATE_HZ, PERIOD)
        yield Record(*names, plan.inputs, plan.inputs, places, u, q, r)


def disturbance(kind: Kind, n: int, rng: np.random.Generator) -> FloatArray:
    """Draw a disturbance torque (n, n_u): drift with a time constant of 5 s, and a step at a random time."""
    decay = np.exp(-1 / (5.0 * RATE_HZ))
    white = rng.standard_normal((n, kind.axes)) * np.sqrt(1 - decay**2)
    slow, _ = lfilter([1.0], [1.0, -decay], white, axis=0, zi=decay * rng.standard_normal((1, kind.axes)))
    jump = (np.arange(n) >= rng.integers(n))[:, None] * rng.choice((-1.0, 1.0), kind.axes)
    return np.asarray((kind.wander * slow + kind.step * jump) * TORQUE_RMS[: kind.axes])


def closed_loop(
    kind: Kind, posture: Configuration, r: FloatArray, w: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Simulate a run; return torques and measured angles (n, n_u), link side."""
    M, D, K, _ = Outside(kind.robot).matrices(posture.angles)
    n, size = kind.axes, 4 * kind.axes
    A = np.zeros((5 * n, 5 * n))
    A[: 2 * n, 2 * n : size] = np.eye(2 * n)
    A[2 * n : size, :size] = -np.linalg.solve(M, np.hstack([K, D]))
    A[2 * n : size, size:] = np.linalg.inv(M)[:, n:]
    whole = expm(A / RATE_HZ)[:size]  # exact for torques that are held
    total = np.diag(M)[n:] + np.diag(M)[:n]
    omega = 2 * np.pi * kind.bandwidth_hz
    stiffness, damping = total * omega**2, (1.6 if kind.bandwidth_hz < 2 else 0.8) * total * omega
    count = 2 * np.pi / kind.counts / RATIO[:n] if kind.counts else None
    carrier = kind.carrier * np.sin(2 * np.pi * np.arange(len(r)) / PERIOD)
    x, before = np.zeros(size), np.zeros(n)
    u, q = np.empty(r.shape), np.empty(r.shape)
    for i in range(len(r)):
        read = x[n : 2 * n] + noise[i]
        q[i] = read if count is None else np.round(read / count) * count
        error = carrier[i] - q[i]
        u[i], before = r[i] + stiffness * error + damping * (error - before) * RATE_HZ, error
        x = whole @ np.concatenate([x, u[i] + w[i]])
    return u, q


def judge(number: int, seed: int) -> tuple[Kind, dict[str, str]]:
    """Return the codes of all alarms for the set of clean logs of an index, with their sentences."""
    kind, codes = Kind.draw(number, seed), dict[str, str]()
    with tempfile.TemporaryDirectory() as name:
        try:
            for code, text in _alarms(read(kind, Path(name)), kind.robot, seed):
                codes[code] = text
        except ElastidError as error:
            codes["refused"] = str(error)
    return kind, {code: text for code, text in codes.items() if code not in true_of(kind)}


def true_of(kind: Kind) -> dict[str, str]:
    """Return the alarms that are correct for a kind, with the reasons."""
    true: dict[str, str] = {}
    if kind.step:
        true |= dict.fromkeys(("frf/periods-discarded", "frf/transient-discarded"), "the period with the step differs")
    if kind.carrier and kind.axes > 1 and not kind.has_reference:
        true["frf/lines-discarded"] = "at the line of a carrier that no reference shows the inputs move together"
    if kind.coulomb:
        true["nonlinear/friction-compensated"] = "there is friction"
    if kind.is_simulated and kind.axes > 1 and kind.realisations == 1 and kind.carrier:
        distorted = ("fit/likely-cause", "status-misfit", "excess-of-cost")
        true |= dict.fromkeys(distorted, "one realisation does not show how a carrier through postures distorts")
    return true


def _alarms(records: list[Record], robot: Robot, seed: int) -> Iterator[tuple[str, str]]:
    """Yield codes and sentences from records, responses, fit and validation; an error ends the sequence."""
    of_records = _codes(note for record in records for note in record.notes)
    yield from of_records.items()
    responses = api.estimate(records, robot)
    yield from _codes(note for response in responses for note in response.notes).items()
    yield from ((f"local-{code}", text) for code, text in _local(records, robot).items() if code not in of_records)
    free = {pattern: ParameterSpec() for pattern in ("k_*", "d_*", "fm_*")}
    result = identify(responses, robot, FitSpec(parameters=free, starts=3, seed=seed))
    yield from _codes(result.notes).items()
    if result.status != "converged":
        yield f"status-{result.status}", result.message
    fitted = FittedRobot.of(result, robot, responses)
    judged = validate(responses, fitted.responses, ())
    if noise_p(judged.configurations) < FALSE_ALARM:
        yield "excess-of-cost", judged.verdict
    yield from _codes(note for modes in measured_modes(fitted) for note in modes.notes).items()


def _local(records: list[Record], robot: Robot) -> dict[str, str]:
    """Return alarms of the local rational method; experiments with new phases are no repetitions."""
    try:
        responses = api.estimate(records, robot, method="local_rational", friction="none")
    except ElastidError as error:
        return {"refused": str(error)}
    return _codes(note for response in responses for note in response.notes)


def _codes(notes: Iterable[Note]) -> dict[str, str]:
    return {
        note.code: str(note)
        for note in notes
        if note.severity == "warning" or note.code == "nonlinear/friction-compensated"
    }


def read(kind: Kind, folder: Path) -> list[Record]:
    """Write the logs of a kind to files, and read them like measured logs."""
    files, channels = [], []
    for i, record in enumerate(kind.records()):
        with h5py.File(folder / f"{i}.h5", "w") as file:
            file["r"], file["u"], file["q"] = record.r, record.u, record.y * RATIO[: kind.axes]
        run = {"realisation": record.realisation, "experiment": record.experiment}
        files.append({"path": f"{i}.h5", "configuration": record.configuration.name, **run})
    roles = {"r": {}, "u": {}, "y": {"channel": "q", "quantity": "position", "side": "motor"}}
    for j, place in enumerate(kind.robot.motor_locations, 1):
        for role in "ruy" if kind.has_reference else "uy":
            channels.append({"role": role, "at": place, "channel": role, "column": j} | roles[role])
    logs = {"rate_hz": RATE_HZ, "period": PERIOD / RATE_HZ, "channels": channels, "files": files, "hold": "zero-order"}
    logs |= {"configurations": kind.spec.configurations, "half_wave": kind.half_wave}
    return [*api.read_records(kind.robot, folder=folder, **logs)]


def interval(count: int, of: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate, count / of (Clopper and Pearson, 1934)."""
    ends = binomtest(count, of).proportion_ci()
    return float(ends.low), float(ends.high)


def main() -> None:
    options = study_run.options(__doc__, "two sets", logs=300, seed=0, jobs=1)
    sets = 2 if options.quick else options.logs
    totals: Counter[str] = Counter()
    for _, (kind, codes) in Execution(options.jobs).unordered(partial(judge, seed=options.seed), range(sets)):
        totals.update([*codes])
        for code, text in codes.items():
            print(f"{code}: {kind}: {text[:160]}", flush=True)
    rates = {code: (count, *interval(count, sets)) for code, count in sorted(totals.items())}
    too_often = MAX_RATE * sets if sets >= MIN_COUNTED else 1
    wrong = [f"{code} in {n} of {sets} sets" for code, n in totals.items() if n > too_often and code not in STATED]
    print(json.dumps({"logs": sets, "alarms": rates, "wrong": wrong}))
    assert not wrong, "\n".join(wrong)


if __name__ == "__main__":
    main()
