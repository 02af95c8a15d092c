"""Contradictions between sections, each at its key: one row a rule."""

from pathlib import Path

import pytest
from plants.refusals import refused
from plants.two_axes import ROBOT, STUDY

from elastid.app.run import Run, run_stage
from elastid.base.errors import StudyError
from elastid.study import load

CHANNELS = (
    "{role: u, at: motor 1, channel: u}, {role: u, at: motor 2, channel: u}, "
    "{role: y, at: motor 1, channel: y, quantity: position}"
)
FILES = ", ".join(f"{{path: a.csv, configuration: {name}}}" for name in "abcd")
SHAKEN = (
    "{role: u, at: shaker, channel: u, quantity: force}, {role: y, at: tip, channel: y, quantity: position, unit: mm}"
)
TAPPED = (
    "{role: u, at: force tool x, channel: u, quantity: force}, {role: y, at: motor 1, channel: y, quantity: position}"
)
NO_RIG, FRAME = "experiment.simulated=null", "robot.frames=[{name: tool, body: fore}]"
ONE = "files: [{path: a.csv, configuration: a}]"
LOGS = (NO_RIG, f"experiment.recorded={{rate_hz: 500, period: 2, channels: [{CHANNELS}], files: [{FILES}]}}")
LOAD = "{force: [0, 0, 1], frame: tool, deflection: [0, 0, 1 mm], std: 1 um}"
NOTCH = "{joint: 2, freq_hz: 20, width: 0.5, depth: 0.2}"
GAINS = "experiment.simulated.controller.gains"
CASCADE = (
    "experiment.simulated.controller={kind: cascade, gains: {position_gain: 10, velocity_gain: 300, "
    f"integral_time: 0.1, notches: [{NOTCH}]}}}}"
)
# Overrides that make a study of a kind.
KINDS = {
    "simulated": (),
    "designed": ("design={count: 1, candidates: {given: {e: [0, 0]}}}",),
    "loaded": (FRAME, f"loads.tests=[{LOAD}]", "loads.tests.0.configuration=a"),
    "recorded": LOGS,
    "tapped": (*LOGS, FRAME, f"tool={{motors: free, responses: {{{ONE}, channels: [{TAPPED}]}}}}"),
    "responses": (NO_RIG, f"experiment.responses={{channels: [{CHANNELS}], files: [{FILES}]}}"),
    "structure": (
        *(NO_RIG, "robot=null", "excitation=null", "seed=0", "fit={}"),
        "experiment.configurations={a: []}",
        f"experiment.recorded={{rate_hz: 500, channels: [{SHAKEN}], {ONE}}}",
    ),
}


@pytest.fixture
def study(tmp_path) -> Path:
    (tmp_path / "robot.yml").write_text(ROBOT)
    (tmp_path / "study.yml").write_text(STUDY)
    (tmp_path / "a.csv").write_text("u,y\n1,2\n")
    return tmp_path / "study.yml"


def refusals(study: Path, *overrides: str) -> list[str]:
    """The lines of the refusal; none where the study is good."""
    try:
        load(study, overrides)
    except StudyError as error:
        return str(error).splitlines()
    return []


@pytest.mark.parametrize(
    ("kind", "overrides", "keys"),
    [
        *((kind, (), "") for kind in KINDS),
        ("simulated", ("experiment.experiments=3",), "experiment.experiments"),
        ("simulated", ("experiment.experiments=1", "estimator.method=arithmetic"), "experiment.experiments"),
        (
            "simulated",
            ("robot.bodies.0.joints.0.limits={angle: [-0.45, 2]}", "experiment.simulated.carrier={amplitude: 0.1}"),
            "experiment.configurations.c[0]",
        ),
        ("simulated", ("experiment.without_payload=[z]",), "experiment.without_payload experiment.without_payload[0]"),
        ("simulated", ("fit.robots={A: [a, b], B: [c]}",), "fit.robots"),
        ("simulated", ("fit.robots={A: [a, b, c, d, z]}",), "fit.robots.A[4]"),
        ("designed", ("fit.robots={A: [a, b, c, d, c1]}",), ""),
        ("simulated", ("fit.focus=[k_9]",), "fit.focus[0]"),
        ("simulated", ("fit.weights.factors=[{factor: 0, output: motor 2}]",), ""),
        (
            "simulated",
            ("experiment.simulated.outputs=[motor 1]", "fit.weights.factors=[{factor: 0, output: motor 2}]"),
            "fit.weights.factors[0].output",
        ),
        ("simulated", ("fit.parameters.k_1={bounds: [1, 2], start: 9}",), "fit.parameters.k_1.bounds"),
        ("simulated", ("excitation.torque_rms=[[1, 1 N], [2, 2]]",), "excitation.torque_rms[0][1]"),
        ("simulated", ("experiment.configurations={}",), "experiment.configurations"),
        ("simulated", ("design={count: 2, robot_time: 5}",), "design.count"),
        ("designed", ("design.candidates.random=5",), "design.candidates.random"),
        ("designed", ("design.candidates.given={a: [0, 0]}",), "design.candidates.given.a"),
        ("designed", ("design.candidates.given={e: [0, 1 mm]}",), "design.candidates.given.e[1]"),
        ("designed", ("design.candidates.margin=1 mm",), "design.candidates.margin"),
        ("simulated", ("experiment.simulated.carrier={amplitude: 1 mm}",), "experiment.simulated.carrier.amplitude"),
        ("simulated", (CASCADE, f"{GAINS}.velocity_gain=[1, 2, 3]"), f"{GAINS}.velocity_gain"),
        ("simulated", (CASCADE, f"{GAINS}.low_pass_hz=1000"), f"{GAINS}.low_pass_hz"),
        ("simulated", (CASCADE, f"{GAINS}.notches.0.joint=3"), f"{GAINS}.notches[0].joint"),
        ("simulated", ("experiment.simulated.carrier={amplitude: 0.1, cycles: 4}",), ""),
        ("simulated", ("experiment.simulated.carrier={amplitude: 0.1, cycles: 5}",), "experiment.simulated.carrier"),
        ("simulated", ("experiment.simulated.heat={conductance: 1}", "filter={}"), "experiment.simulated.heat filter"),
        ("simulated", ("validation.configurations=[a, b, c]",), ""),
        ("simulated", ("validation.configurations=[a, b, c, d]",), "validation.configurations"),
        ("simulated", ("loads={}",), "loads"),
        ("loaded", ("loads.tests.0.configuration=z",), "loads.tests[0].configuration"),
        ("loaded", ("loads.tests.0.configuration=''", "loads.tests.0.angles=[0]"), "loads.tests[0].angles"),
        ("loaded", ("loads.tests.0.configuration=''", "loads.tests.0.angles=[0, 1 mm]"), "loads.tests[0].angles[1]"),
        ("loaded", ("loads.tests.0.measured_at=nowhere",), "loads.tests[0].measured_at"),
        ("simulated", ("robot=null",), "robot"),
        ("recorded", ("experiment.recorded.files.0.path=gone.csv",), "experiment.recorded.files[0].path"),
        (
            "recorded",
            ("experiment.recorded.files.0.configuration=away",),
            "experiment.configurations.a experiment.recorded.files[0].configuration",
        ),
        (
            "recorded",
            ("experiment.recorded.files.0={path: a.csv}",),
            "experiment.configurations.a experiment.recorded.files[0].configuration",
        ),
        (
            "recorded",
            ("experiment.recorded.files.1.configuration=a",),
            "experiment.configurations.b experiment.recorded.files[1]",
        ),
        ("recorded", ("experiment.recorded.channels.2.at=motor 7",), "experiment.recorded.channels[2].at"),
        ("recorded", ("experiment.recorded.channels.0.at=joint 1",), "experiment.recorded.channels[0].at"),
        ("recorded", ("experiment.recorded.channels.0.at=motor 2",), "experiment.recorded.channels[1].at"),
        ("recorded", ("experiment.recorded.channels.1.role=r",), "experiment.recorded.channels[1].at"),
        ("recorded", ("experiment.recorded.channels.2.unit=N*m",), "experiment.recorded.channels[2].unit"),
        (
            "recorded",
            ("experiment.recorded.channels.1={role: d, at: joint 1, channel: d}",),
            "experiment.recorded.channels[1].at",
        ),
        (
            "recorded",
            ("experiment.recorded.channels.1={role: d, at: motor 2, channel: d}",),
            "experiment.recorded.channels[1].at",
        ),
        ("recorded", ("experiment.recorded.channels.1={role: d, at: motor 1, channel: d}",), ""),
        (
            "recorded",
            ("experiment.recorded.channels.1={role: reference, at: motor 2, channel: q, quantity: position}",),
            "",
        ),
        ("recorded", ("experiment.recorded.period=null",), ""),
        ("recorded", ("experiment.recorded.period=null", "estimator.method=arithmetic"), "estimator.method"),
        ("recorded", ("design={count: 1}", "experiment.ramp=1"), "design experiment.ramp"),
        ("recorded", ("experiment.recorded.files.1.load=x",), "experiment.recorded.files[1].load"),
        ("tapped", ("tool.motors=locked",), "tool.responses.channels[1].at"),
        ("tapped", ("tool.responses.channels.0.at=force nowhere x",), "tool.responses.channels[0].at"),
        ("tapped", ("tool.responses.channels.1.at=motor 9",), "tool.responses.channels[1].at"),
        ("tapped", ("tool.responses.channels.0.quantity=torque",), "tool.responses.channels[0].quantity"),
        ("tapped", ("tool.motors=controlled", "tool.stiffness=[1]", "tool.damping=[1]"), "tool.stiffness"),
        ("tapped", ("tool.motors=controlled", "tool.stiffness=[1, 1]", "tool.damping=[1, 1]"), ""),
        ("responses", ("gears={}",), "gears"),
        (
            "responses",
            ("experiment.responses.files.3.configuration=a",),
            "experiment.configurations.d experiment.responses.files[3]",
        ),
        ("structure", ("experiment.configurations={a: [0]}",), "experiment.configurations.a"),
        ("structure", ("experiment.recorded.channels.1.unit=",), "experiment.recorded.channels[1].unit"),
        ("structure", ("fit.starts=3",), "fit"),
    ],
)
def test_a_contradiction_is_reported_once_at_its_key(
    study: Path, kind: str, overrides: tuple[str, ...], keys: str
) -> None:
    """And no other key is; what does not contradict is no problem."""
    found = refusals(study, *KINDS[kind], *overrides)
    assert len(found) == len(keys.split()), found
    for key in keys.split():
        assert sum(f": {key}: " in line for line in found) == 1, found


def test_load_tests_of_a_table_are_those_of_the_study(study: Path) -> None:
    """Columns of numbers with their unit, of joints by their name; an empty cell is not given."""
    (study.parent / "loads.csv").write_text(
        "1,2 [deg],frame,fx,tz [kN*m],mass,y [mm],std [um],measured_at\n"
        "0.1,30,tool,4,0.5,,1.5,2,\n"
        "0.2,0,tool,,,5,2,1,fore\n"
    )
    first = "angles: [0.1, 30 deg], force: [4, 0, 0], torque: [0, 0, 500], deflection: [0, 1.5 mm, 0], std: 2 um"
    second = "angles: [0.2, 0], mass: 5, deflection: [0, 2 mm, 0], std: 1 um, measured_at: fore"
    listed = f"loads.tests=[{{frame: tool, {first}}}, {{frame: tool, {second}}}]"
    of_table, of_list = (load(study, [FRAME, loads]).study.loads for loads in ("loads.file=loads.csv", listed))
    assert of_table.tests == of_list.tests
    assert load(study, [FRAME, listed, "loads.file=loads.csv"]).study.loads.tests == 2 * of_list.tests


@pytest.mark.parametrize(
    ("override", "code"),
    [
        ("design={count: 1, candidates: {given: {e: [0]}}}", "design/candidates"),
        ("design={count: 1, candidates: {grid: [3]}}", "design/candidates"),
        ("design={robot_time: 1 s}", "design/limits"),
        ("robot.chain={differentiator: 1 ms}", "experiment/simulated"),
        ("model={formulation: minimal, independent: [joint 9]}", "model/variant"),
        ("experiment.simulated.model={formulation: minimal, independent: [joint 9]}", "model/variant"),
        ("experiment.simulated.outputs=[nowhere]", "robot/unknown-name"),
        ("experiment.simulated.saturation=true", "experiment/simulated"),
        ("excitation.band_hz=[4.5, 5.5]", "excitation/power"),
        ("excitation.phases=schroeder", "excitation/lines"),
        ("excitation.torque_rms=[1, 2, 3]", "excitation/power"),
        ("excitation=null", "study/stage"),
    ],
)
def test_what_cannot_be_designed_or_simulated_the_first_stage_refuses(study: Path, override: str, code: str) -> None:
    run = Run(load(study, [override]), study.parent / "run", 1)
    with refused(code):
        run_stage(run, "design")
        run_stage(run, "measure")
