"""Cases of advice in messages about logs: a log is spoilt, refused, and used once the advice is followed."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec, TextFormatSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import single_logs, whole_logs
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.pass_checks import check_counts
from elastid.record import FrictionRecord, Record
from elastid.recorded.channel_doubts import channel_doubts
from elastid.recorded.drive_notes import drive_notes
from elastid.recorded.friction_logs import read_friction_logs
from elastid.recorded.link_side import to_joints
from elastid.recorded.responses.table import ResponseTable
from elastid.recorded.rig import RecordedRig
from plants import lab_logs
from plants.advice import Desk, case, pasted, refusal, rendered, value_of
from plants.friction_logs import SPEEDS, THERMOMETER_LINE, sliding_torque, trapezoids, write_log, write_study
from plants.lab_logs import N, measured, save_csv, study_of, write_matlab
from plants.steady_record import steady_record

NO_PERIOD: dict[str, Any] = {"period_samples": None, "period": "none"}


def lab_log(desk: Desk, samples: int = 4 * N, half: bool = False, first: int = 1) -> dict[str, FloatArray]:
    """A log of two axes in the folder, random phases from a line on, of some samples."""
    lines = np.arange(first, 60, 2 if half else 1)
    U = orthogonal_set(np.ones((len(lines), 4)), np.random.default_rng(3))[0]
    signals = np.tile(synthesise(lines, U, N), (-(-samples // N), 1))[:samples]
    log = dict(zip(("i1", "i2", "phi", "w2"), signals.T, strict=True))
    save_csv(desk.folder / "log.csv", log)
    return log


def said_of(desk: Desk, **keys: Any) -> str:
    """Why log.csv is refused under some keys of experiment.recorded, and the notes on it where it is not."""

    def attempt() -> Record:
        return measured(desk.folder, study_of("log.csv", **keys))

    return refusal(attempt) or " ".join(f"note: {note}" for note in attempt().notes)


def piece(text: str) -> dict[str, Any]:
    """`samples: [first, last]` as keys."""
    return {"files": (FileSpec("log.csv", "home", samples=tuple(value_of(text))),)}


@case("recorded/periodicity.py", "period_samples: ‹›", "half_wave: true")
def half_periods(desk: Desk) -> None:
    lab_log(desk, N, half=True)
    said = said_of(desk, period_samples=N // 2)
    stated = value_of(rendered("period_samples: ‹›", said.replace(" and", "; and")))
    assert rendered("half_wave: true", said)
    assert said_of(desk, period_samples=stated, half_wave=True) == ""


@case("recorded/periodicity.py", "period: none")
def not_a_whole_period(desk: Desk) -> None:
    lab_log(desk, 360)
    stated = value_of(rendered("period: none", said_of(desk)))
    assert "one transient" not in said_of(desk, period_samples=None, period=stated)


@case("recorded/periodicity.py", "period: find", slow=True)
def unstated_period(desk: Desk) -> None:
    lab_log(desk)
    stated = value_of(rendered("period: find", said_of(desk, period_samples=None).replace(" the", "; the")))
    assert "no period is stated" not in said_of(desk, period_samples=None, period=stated)
    assert measured(desk.folder, study_of("log.csv", period_samples=None, period=stated)).period_samples == N
    assert "no period is stated" not in said_of(desk, **NO_PERIOD)


@case("recorded/repair/missing.py", "samples: [‹›, ‹›]")
def gap_without_a_period(desk: Desk) -> None:
    log = lab_log(desk)
    log["w2"][100:130] = np.nan
    save_csv(desk.folder / "log.csv", log)
    text = rendered("samples: [‹›, ‹›]", said_of(desk, **NO_PERIOD))
    assert said_of(desk, **NO_PERIOD, **piece(text)) == ""


@case("recorded/repair/stops.py", "samples: [‹›, ‹›]", "period: none")
def emergency_stop(desk: Desk) -> None:
    log = lab_log(desk, 2 * N)
    for x in log.values():
        x[300:] = x[300]
    save_csv(desk.folder / "log.csv", log)
    said = said_of(desk)
    keys = {"period_samples": None, "period": value_of(rendered("period: none", said))}
    assert said_of(desk, **keys, **piece(rendered("samples: [‹›, ‹›]", said))) == ""


@case("recorded/repair/time_stamps.py", "rate_hz: ‹›", slow=True)
def rate_beyond_the_stamps(desk: Desk) -> None:
    t = np.cumsum(np.random.default_rng(4).choice([0.010, 0.012], 2000))
    save_csv(
        desk.folder / "log.csv", {"t": t} | {name: np.sin(t + i) for i, name in enumerate(("i1", "i2", "phi", "w2"))}
    )
    keys: dict[str, Any] = NO_PERIOD | {"time": "t"}
    text = rendered("rate_hz: ‹›", said_of(desk, **keys, rate_hz=200.0).partition("state ")[2])
    assert "promises" not in said_of(desk, **keys, rate_hz=float(value_of(text)))


@case("recorded/files/text.py", "text: {delimiter: '‹›', decimal: '‹›'‹›}")
def another_delimiter(desk: Desk) -> None:
    save_csv(desk.folder / "log.csv", lab_log(desk), delimiter=";", comma=True)
    text = rendered("text: {delimiter: '‹›', decimal: '‹›'‹›}", said_of(desk))
    assert said_of(desk, text=TextFormatSpec(**value_of(text))) == ""


def doubted(channels: tuple[ChannelSpec, ...], factors: tuple[float, ...], robot: Any = None) -> str:
    """Doubts about the torque, the motor's and the link's angle of a joint, each times a factor."""
    from recorded.test_channel_doubts import ROBOT as JOINT
    from recorded.test_channel_doubts import signals

    values = signals()[:, : len(channels)] * np.array(factors)
    return " ".join(doubt.text for doubt in channel_doubts(channels, values, 500.0, robot or JOINT))


U = ChannelSpec("u", "motor 1", "tau")
Q = ChannelSpec("y", "motor 1", "q", quantity="position")
LINK = ChannelSpec("y", "joint 1", "link", quantity="position")


@case("recorded/channel_doubts.py", "sign: -1", slow=True)
def turned_channels(desk: Desk) -> None:
    for factors in ((1, 1, -1), (-1, 1, 1)):
        sign = value_of(rendered("sign: -1", doubted((U, Q, LINK), factors)))
        assert doubted((U, Q, LINK), tuple(sign if f < 0 else f for f in (factors * np.array(factors)))) == ""


@case("recorded/channel_doubts.py", "unit: ‹›")
def unit_left_out(desk: Desk) -> None:
    factors = (1, 1, 57.29578)
    offered = re.findall(r"unit: (\w+)", doubted((U, Q, LINK), factors))  # of which the user knows the true one
    assert "deg" in offered
    assert doubted((U, Q, replace(LINK, unit="deg")), factors) == ""


@case("recorded/channel_doubts.py", "side: motor")
def side_left_out(desk: Desk) -> None:
    side = value_of(rendered("side: motor", doubted((U, Q, LINK), (1, 50, 1))))
    assert doubted((U, replace(Q, side=side), LINK), (1, 50, 1)) == ""


@case("recorded/channel_doubts.py", "side: link")
def wrong_side(desk: Desk) -> None:
    motor = replace(Q, side="motor")
    side = value_of(rendered("side: link", doubted((U, motor, LINK), (1, 1, 1))))
    assert doubted((U, replace(motor, side=side), LINK), (1, 1, 1)) == ""


@case("recorded/channel_doubts.py", "quantity: ‹›")
def wrong_quantity(desk: Desk) -> None:
    named = replace(LINK, quantity="velocity")
    said = doubted((U, Q, named), (1, 1, 1))
    quantity = value_of(rendered("quantity: ‹›", said[said.index("seems to be") :]))
    assert doubted((U, Q, replace(named, quantity=quantity)), (1, 1, 1)) == ""


@case("recorded/drive_notes.py", "sign: -1")
def mirrored_drive(desk: Desk) -> None:
    r = np.tile(synthesise(np.arange(1, 60), np.exp(2j * np.pi * np.random.default_rng(3).random((59, 1))), N)[:, 0], 4)
    channels = (ChannelSpec("r", "motor 1", "r"), ChannelSpec("u", "motor 1", "u"))

    def said(sign: float) -> str:
        return " ".join(map(str, drive_notes(channels, np.stack([r, -0.9 * sign * r], axis=1), N, "log")))

    assert said(value_of(rendered("sign: -1", said(1.0)))) == ""


def levels(desk: Desk, *overrides: str, stages: tuple[str, ...] = ("measure", "levels")) -> str:
    """Why stages of the friction study in the folder fail; empty where all end well."""
    for stage in stages:
        sets = [word for override in overrides for word in ("--set", override)]
        path = str(desk.folder / "study.yml")
        if said := desk.elastid(stage, path, "--run", str(desk.folder / "run"), "--jobs", "1", *sets):
            return said
    return ""


@case("friction_study/levels.py", "sign: -1", slow=True)
def torque_with_the_other_sign(desk: Desk) -> None:
    q = trapezoids(SPEEDS)
    write_log(desk.folder / "log.csv", q, -sliding_torque(q))
    write_study(desk.folder)
    assert levels(desk, pasted(rendered("sign: -1", levels(desk)), "experiment.recorded.channels.0.")) == ""


@case("friction_study/motion.py", "sign: -1", slow=True)
def torque_of_few_speeds_with_the_other_sign(desk: Desk) -> None:
    q = trapezoids((0.2, 0.5))
    write_log(desk.folder / "log.csv", q, -sliding_torque(q))
    write_study(desk.folder)
    assert levels(desk, pasted(rendered("sign: -1", levels(desk)), "experiment.recorded.channels.0.")) == ""


@case("friction_study/joint_levels.py", "side: motor", slow=True)
def torque_of_the_other_side(desk: Desk) -> None:
    q = trapezoids(SPEEDS)
    write_log(desk.folder / "log.csv", q, sliding_torque(q))
    write_study(desk.folder, torque_side="link")
    assert levels(desk, pasted(rendered("side: motor", levels(desk)), "experiment.recorded.channels.0.")) == ""


@case("recorded/friction_logs.py", "side: motor", slow=True)
def angle_of_the_other_side(desk: Desk) -> None:
    q = trapezoids(SPEEDS)
    write_log(desk.folder / "log.csv", q, sliding_torque(q))
    write_study(desk.folder, angle_side="link")
    assert levels(desk, pasted(rendered("side: motor", levels(desk)), "experiment.recorded.channels.1.")) == ""


@case("recorded/friction_logs.py", "unit: ‹›", slow=True)
def kelvins(desk: Desk) -> None:
    q = trapezoids(SPEEDS)
    write_log(desk.folder / "log.csv", q, sliding_torque(q), np.full(len(q), 313.0))
    write_study(desk.folder, thermometer=THERMOMETER_LINE)
    said = levels(desk, stages=("measure",))
    text = rendered("unit: ‹›", said.partition("give that channel ")[2])
    assert levels(desk, pasted(text, "experiment.recorded.channels.2.")) == ""


@case("recorded/friction_logs.py", "purpose: motion", slow=True)
def not_at_rest(desk: Desk) -> None:
    q = trapezoids(SPEEDS)
    write_log(desk.folder / "log.csv", q, sliding_torque(q))
    write_study(desk.folder, ("{path: log.csv, purpose: at_rest}",))
    text = rendered("purpose: motion", levels(desk, stages=("measure",)))
    assert levels(desk, pasted(text, "experiment.recorded.files.0."), stages=("measure",)) == ""


@case("recorded/warm_up_logs.py", "purpose: motion", slow=True)
def short_warm_up(desk: Desk) -> None:
    q = trapezoids(SPEEDS)
    write_log(desk.folder / "log.csv", q, sliding_torque(q), np.full(len(q), 40.0))
    write_study(desk.folder, ("{path: log.csv, purpose: warm_up}",), thermometer=THERMOMETER_LINE)
    text = rendered("purpose: motion", levels(desk))
    assert levels(desk, pasted(text, "experiment.recorded.files.0.")) == ""


@case("friction_study/pass_checks.py", "purpose: motion", slow=True)
def loops_without_a_way_back(desk: Desk) -> None:
    t = np.linspace(0, 1, 200)
    loops = FrictionRecord("loops", "1", "loops", 200.0, 1e-3 * t, np.tanh(9 * (t - 0.5)), resolution=1e-5)
    assert rendered("purpose: motion", refusal(lambda: check_counts(loops)))
    # As a motion it is judged by what motions need: a log there and back.
    q = trapezoids(SPEEDS)
    write_log(desk.folder / "log.csv", q, sliding_torque(q))
    write_study(desk.folder, ("{path: log.csv, purpose: motion}",))
    assert levels(desk) == ""


@case("study/checks/friction.py", "passes: detect")
def passes_of_logs(desk: Desk) -> None:
    write_log(desk.folder / "log.csv", trapezoids((0.5,)), sliding_torque(trapezoids((0.5,))))
    study = write_study(desk.folder, passes="{count: 9}")
    assert (
        desk.elastid(
            "check",
            str(study),
            "--set",
            pasted(rendered("passes: detect", desk.elastid("check", str(study))), "friction."),
        )
        == ""
    )


@case("recorded/files/log.py", "column: 1", slow=True)
def matrix_in_a_file(desk: Desk) -> None:
    write_matlab(desk.folder, lab_log(desk))
    u, y = ChannelSpec("u", "motor 1", "run(1).w"), ChannelSpec("y", "motor 1", "rec.cur", quantity="position")

    def said(*channels: ChannelSpec) -> str:
        return refusal(lambda: measured(desk.folder, study_of("log.mat", channels)))

    column = value_of(rendered("column: 1", said(u, y)))
    assert "give column" not in said(u, replace(y, column=column))


@case("recorded/responses/table.py", "column: 1")
def unnamed_responses(desk: Desk) -> None:
    table = ResponseTable(desk.folder / "a.mat", np.ones(3), "Hz", np.ones((3, 1, 1), complex))
    channel = ChannelSpec("y", "motor 1", "w", quantity="velocity")
    column = value_of(rendered("column: 1", refusal(lambda: table.index(channel))))
    assert table.index(replace(channel, channel="", column=column)) == 0


@case("recorded/link_side.py", "side: motor")
def half_of_coupled_gears(desk: Desk) -> None:
    from model.test_gears import LINKS, wrist

    channels = [ChannelSpec("u", f"motor {n}", f"t{n}", side="motor") for n in LINKS]
    side = value_of(rendered("side: motor", refusal(lambda: to_joints([*channels[:2], *channels[3:]], wrist()))))
    further = ChannelSpec("u", channels[2].at, "further", side=side)
    assert refusal(lambda: to_joints([*channels[:2], further, *channels[3:]], wrist())) == ""


def estimated(desk: Desk, files: tuple[FileSpec, ...], **keys: Any) -> str:
    """Why no response is estimated from files without a period; empty where one is."""
    spec = study_of("log.csv", files=files, **NO_PERIOD)
    rig = RecordedRig(lab_logs.ROBOT, spec, desk.folder)

    def attempt() -> None:
        estimate([rig.measure(experiment) for experiment in rig.experiments], EstimatorSpec(**keys))

    return refusal(attempt)


@case("frf/estimate.py", "samples: [first, last]")
def transient_without_a_period(desk: Desk) -> None:
    noise(desk, 3000, 3000)
    files = tuple(FileSpec(f"{i}.csv", "home", i) for i in range(2))
    said = estimated(desk, files, method="h1", transient_periods=1)
    cut = tuple(value_of(filled(rendered("samples: [first, last]", said), 500, 3000)))
    assert estimated(desk, tuple(replace(file, samples=cut) for file in files), method="h1") == ""


@case("frf/local/response.py", "samples: [first, last]", slow=True)
def records_of_two_lengths(desk: Desk) -> None:
    noise(desk, 3000, 1000)
    files = tuple(FileSpec(f"{i}.csv", "home", i) for i in range(2))
    said = estimated(desk, files, method="local_rational")
    cut = tuple(value_of(filled(rendered("samples: [first, last]", said), 0, 1000)))
    assert estimated(desk, (replace(files[0], samples=cut), files[1]), method="local_rational") == ""


@case("frf/spectra.py", "samples: [first, last]")
def missing_samples_for_a_local_method(desk: Desk) -> None:
    record = replace(steady_record(), starts=(1,), left_out=(2,))
    assert rendered("samples: [first, last]", refusal(lambda: whole_logs([record])))
    whole, n = single_logs(record)[0], single_logs(record)[0].n_samples
    cut = replace(whole, u=whole.u[: n // 2], y=whole.y[: n // 2], period_samples=n // 2)
    assert refusal(lambda: whole_logs([cut])) == ""


def noise(desk: Desk, *lengths: int) -> None:
    """Logs of noise in the folder, 0.csv and so on, of some lengths."""
    rng = np.random.default_rng(0)
    for i, n in enumerate(lengths):
        save_csv(desk.folder / f"{i}.csv", {name: rng.normal(size=n) for name in ("i1", "i2", "phi", "w2")})


def filled(text: str, first: int, last: int) -> str:
    """The advice with the samples that the user knows."""
    return text.replace("first", str(first)).replace("last", str(last))


@case("friction_study/motion.py", "files[].purpose: run_down", slow=True)
def motion_one_way(desk: Desk) -> None:
    from friction_study.test_run_down import CHANNELS as RUN_DOWN
    from friction_study.test_run_down import RATE, coasting
    from friction_study.test_run_down import ROBOT as JOINT

    rows = "\n".join(f"-1,{x:.9g}" for x in coasting(40.0, -1.0))
    (desk.folder / "0.csv").write_text(f"torque,angle\n{rows}\n")

    def found(purpose: str) -> None:
        recorded = RecordedSpec(float(RATE), RUN_DOWN, (FileSpec("0.csv", purpose="run_down"),))
        logs = read_friction_logs(JOINT, ExperimentSpec(recorded=recorded), desk.folder, ["1"], {})
        records = tuple(replace(record, purpose=purpose) for record in logs.records)
        find_joint_levels(JOINT, JOINT.driven, replace(logs, records=records))

    assert (
        refusal(lambda: found(value_of(rendered("files[].purpose: run_down", refusal(lambda: found("motion")))))) == ""
    )
