"""Logs at the rate of the references: images of their steps are subtracted, if the references are logged or not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.limited_arm import EXCITATION, arm
from plants.measured_robots import R, U, Y, deviation

from elastid.experiment.plan.plan import make_plan
from elastid.experiment.plan.reference_trajectory import references
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import CascadeSpec, FileSpec, RecordedSpec
from elastid.experiment.specs.simulated import NoiseSpec, SimulatedSpec
from elastid.fit.identify import fit_parameters
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.logs.rig import RecordedRig
from elastid.logs.step_images import with_image_errors
from elastid.record import Record
from elastid.robot import Limits
from elastid.robot.simplified import without_dry_friction
from elastid.simulation.spec import ReferencePathSpec

CYCLE, RATE, POSTURES = 0.004, 1000.0, {"a": (0.2, 0.4), "b": (-0.3, 0.9)}
GAINS = {"position_gain": 20.0, "velocity_gain": (3000.0, 1500.0), "low_pass_hz": 200.0}
CONTROLLER = CascadeSpec(**GAINS, reference=ReferencePathSpec(CYCLE, "linear"), ticks=4)
ROBOT = replace(without_dry_friction(arm(Limits())), gravity=(0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    """Whole periods of a robot with a controller at 1 kHz, one row for each of its references every 4 ms."""
    folder, noise = tmp_path_factory.mktemp("logs"), NoiseSpec(torque_std=0.5, encoder_counts=1 << 20)
    simulated = SimulatedSpec(substeps=2, controller=CONTROLLER.spec, noise=noise)
    spec = ExperimentSpec(POSTURES, 2, periods=4, transient_periods=2, simulated=simulated)
    excitation = replace(EXCITATION, rate_hz=RATE, torque_rms=60.0, inject="position")
    loop = closed_loop_of(ROBOT, CONTROLLER.spec, RATE, "position")
    rig = SimulatedRig(ROBOT, spec, make_plan(excitation, spec, ROBOT, 0, closed_loop=loop), 0)
    for trial in rig.experiments:
        record, first = rig.measure(trial), rig.plan.measured.start // 4
        u, y = record.u[::4], record.y[::4]
        table = np.hstack([u, y, references(rig.plan, None, trial)[first : first + len(u)]])
        header = ",".join(channel.channel for channel in (*U, *Y, *R))
        # Torques a quarter of a cycle late, references a cycle before they act; all repeat.
        late = np.hstack([np.roll(record.u, 1, axis=0)[::4], y, np.roll(table[:, -2:], -1, axis=0)])
        # A slow motion at constant speed, which the feedforward follows without an error of its path.
        slow = table + np.r_[0, 0, 1, 1, 1, 1] * 0.2 * np.linspace(0, 1, len(table))[:, None]
        for name, rows in ((trial.name, table), (f"{trial.name}-late", late), (f"{trial.name}-slow", slow)):
            np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("is_logged", "suffix"), [(True, ""), (False, ""), (True, "-late")])
def test_images_of_reference_steps_are_subtracted(is_logged: bool, suffix: str, logs: Path) -> None:
    """Torques at the cycle without a filter, delay free: k within 0.2 % and 3 std, logged references or not, late."""
    records, recorded = measured(logs, CONTROLLER, (*U, *Y, *(R if is_logged else ())), suffix)
    notes = {(note.code, note.severity) for record in records for note in record.notes}
    assert notes == {("records/step-images", "information")}
    fitted(records, recorded)


@pytest.mark.slow
def test_images_by_inaccurate_gains_are_systematic_errors(logs: Path) -> None:
    """Gains 10 to 15 % off, references not logged: k within 0.2 %, delay within 0.02 ms, both within 3 std."""
    gains = GAINS | {"position_gain": 22.0, "velocity_gain": (2550.0, 1725.0)}
    records, recorded = measured(logs, replace(CONTROLLER, **gains), (*U, *Y))
    result = fitted(records, recorded)
    std = np.sqrt(np.diag(result.covariance))[result.parameters.free_names.index("delay")]
    assert abs(result.values["delay"] - 0.5 / RATE) < min(2e-5, 3 * std)  # torques are held for a tick


def measured(
    logs: Path, controller: CascadeSpec, channels: tuple[ChannelSpec, ...], suffix: str = ""
) -> tuple[list[Record], RecordedSpec]:
    """Records of all logs with a stated controller."""
    files = tuple(FileSpec(f"{p}-r{m}-e{e}{suffix}.csv", p, m, e) for p in POSTURES for m in range(2) for e in range(2))
    recorded = RecordedSpec(1 / CYCLE, channels, files, period=1.0, controller=controller)
    rig = RecordedRig(ROBOT, ExperimentSpec(POSTURES, recorded=recorded), logs)
    return [rig.measure(trial) for trial in rig.experiments], recorded


def fitted(records: list[Record], recorded: RecordedSpec) -> Result:
    """Springs and delay by records of all postures: k within 0.2 % and 3 std."""
    each = [[r for r in records if r.configuration.name == name] for name in POSTURES]
    responses = [
        with_image_errors(estimate(of_one, EstimatorSpec(friction="none")), recorded, ROBOT) for of_one in each
    ]
    free = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*", "delay")}
    start = ROBOT.with_parameters({"k_1": 2.4e5, "k_2": 2.4e5})
    result = fit_parameters(responses, start, FitSpec(parameters=free, starts=1))
    for name in ("k_1", "k_2"):
        k = ROBOT.parameters()[name][0]
        assert abs(result.values[name] / k - 1) < 2e-3
        assert deviation(result, name, k) < 3
    return result


@pytest.mark.slow
def test_images_are_the_same_with_a_slow_motion(logs: Path) -> None:
    """Logs that end 0.2 rad from their start have the images of logs that end where they start, within 1 % rms."""
    torques = []
    for suffix in ("", "-slow"):
        recorded = RecordedSpec(
            1 / CYCLE, (*U, *Y, *R), (FileSpec(f"a-r0-e0{suffix}.csv", "a"),), period=1.0, controller=CONTROLLER
        )
        rig = RecordedRig(ROBOT, ExperimentSpec({"a": POSTURES["a"]}, recorded=recorded), logs)
        record = rig.measure(rig.experiments[0])
        assert {note.code for note in record.notes if note.severity == "information"} == {"records/step-images"}
        torques.append(record.u)
    raw = np.genfromtxt(logs / "a-r0-e0.csv", delimiter=",", skip_header=1)[:, :2]
    images = raw - torques[0]
    assert np.all(np.std(torques[1] - torques[0], axis=0) < 0.01 * np.std(images, axis=0))
