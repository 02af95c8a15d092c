"""`elastid new --from` of random logs: refused, or a study that `check` accepts, in which no guess is a statement."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.app.from_log import texts_from_logs
from elastid.base.errors import DataError, StudyError
from elastid.base.units import dimension_and_size
from elastid.study import load_with_logs

# Names of torque, position and commanded position of joint i, by makes and users.
LAYOUTS = (
    "tau_{i} q_{i} q_cmd_{i}", "Torque_Joint_{i} Position_Joint_{i} Ref_Position_Joint_{i}", "MACur.A{i} AIPos.A{i} "
    "RKorr.A{i}", "A{i}.act_trq A{i}.act_pos A{i}.ref_pos", "Drehmoment_Achse_{i} Winkel_Achse_{i} Soll_Winkel_A_{i}",
    "Achse{i}_Ist_Strom Achse{i}_Ist_Lage Achse{i}_Soll_Lage", "joint{i}_effort joint{i}_position "
    "joint{i}_position_command", "effort_{word} position_{word} cmd_{word}", "u{i} y{i} r{i}", "force_{i} pos_{i} "
    "pos_ref_{i}", "Motor_{i}_Current Motor_{i}_Speed Motor_{i}_Speed_Ref", "motorTorque.j{i} jointAngle.j{i} ref.j{i}",
)  # fmt: skip
WORDS = ["shoulder", "elbow", "wrist", "base"]
UNITS = (
    ["", "Nm", "N·m", "mNm", "kNm", "Ncm", "A", "mA", "Arms", "%", "V", "N", "kN", "inc", "0.1%"],
    ["", "rad", "deg", "°", "mrad", "mm", "m", "rev", "inc", "arcsec", "rpm", "deg/s", "rad/s", "m/s^2"],
)
KNOWN = {"Nm": "N*m", "N·m": "N*m", "mNm": "mN*m", "kNm": "kN*m", "Ncm": "N*cm", "°": "deg"}
IN_BRACKETS = ("A", "V", "m", "rev", "Arms", "%", "inc", "0.1%")
UNKNOWN = ("Arms", "%", "inc", "0.1%")
CLOCKS = {"time": 1.0, "Time [ms]": 1e3, "timestamp": 1e6, "time_ns": 1e9, "index": 0.0, "": 0.0}


# Of a further column.
HEADINGS = ("Temp. [°C]", '"a,b"', "x: y", "# no", "null", "😀", "IO 1", "\u0085q")


class Case(NamedTuple):
    """How a log is written; odd: an error of a cell, or a further column."""

    layout: str
    units: tuple[str, str]
    form: str
    clock: str
    delimiter: str
    kind: str
    numbers: tuple[int, ...]
    order: int
    copies: int
    odd: str


CASES = st.builds(
    Case,
    st.sampled_from(LAYOUTS),
    st.tuples(*map(st.sampled_from, UNITS)),
    st.sampled_from(["{0} [{1}]", "{0} ({1})", "{0}_{1}", "{0}[{1}]"]),
    st.sampled_from(sorted(CLOCKS)),
    st.sampled_from([",", ";", "\t"]),
    st.sampled_from(["motion", "noise", "periodic", "commands"]),
    st.sampled_from([(1,), (1, 2), (2, 1), (1, 2, 4), (3, 1, 2)]),
    st.integers(0, 1 << 16),
    st.integers(1, 2),
    st.sampled_from(["", "cell", *HEADINGS]),
)


def signals(case: Case, joint: int) -> tuple[np.ndarray, ...]:
    """Torque, position and commanded position (1200,) of a joint at 250 Hz."""
    rng, t = np.random.default_rng(case.order + joint), np.arange(1200) / 250
    if case.kind in ("motion", "commands"):
        w = 2 * np.pi * (0.6 + 0.2 * joint)
        q, v = 0.3 * np.sin(w * t), 0.3 * w * np.cos(w * t)
        u = -3 * w**2 * q + 4 * v + 2 * np.sign(v)
    else:
        u = np.tile(rng.standard_normal(400), 3) if case.kind == "periodic" else rng.standard_normal(1200)
        q = np.cumsum(np.cumsum(u - u.mean()))
        q *= 0.1 / q.std()
    noise = rng.standard_normal((3, 1200))
    return u + 0.01 * noise[0], q + 1e-6 * noise[1], 1.01 * q + 1e-3 * np.sin(9 * t)


def write(folder: Path, case: Case) -> list[Path]:
    """The logs of a case."""
    columns = {}
    for joint, number in enumerate(case.numbers):
        names = case.layout.format(i=number, word=WORDS[number - 1]).split()
        units = (*case.units, case.units[1])
        wanted = {"commands": (1, 2), "motion": (0, 1, 2)}.get(case.kind, (0, 1))
        x = signals(case, joint)
        columns |= {case.form.format(names[k], units[k]) if units[k] else names[k]: x[k] for k in wanted}
    heads = list(columns)
    np.random.default_rng(case.order).shuffle(heads)
    rows = np.stack([columns[head] for head in heads], axis=1)
    if case.clock:
        heads = [case.clock, *heads]
        rows = np.column_stack([np.arange(1200) * (CLOCKS[case.clock] / 250 or 1.0), rows])
    if case.odd in HEADINGS:
        heads, rows = [*heads, case.odd], np.column_stack([rows, np.sin(np.arange(1200) / 40)])
    paths = [folder / f"log_{i}.csv" for i in range(case.copies)]
    for i, path in enumerate(paths):
        scaled = rows * np.array([1.0 if head == case.clock else 1 + 0.05 * i for head in heads])
        cells = [heads, *([f"{x:.9g}" for x in row] for row in scaled)]
        if case.odd == "cell":
            cells[600][case.order % len(heads)] = "#N/A"
        path.write_text("\n".join(case.delimiter.join(row[: len(heads)]) for row in cells) + "\n", encoding="utf-8")
    return paths


def check_statements(text: str, case: Case) -> None:
    """A stated unit is the study's; an unknown one has a question mark; without one its reason is written."""
    bracketed = "_" not in case.form
    for role, unit in (("u", case.units[0]), ("y", case.units[1])):
        if not bracketed and unit in IN_BRACKETS:  # a label as well
            continue
        for line in re.findall(rf"- {{role: {role}, .*", text):
            keys, why = line.split(" # guessed: ")
            written = re.search(r"unit: ([^,}]+)", keys)
            scale = re.search(r"scale: ([^,}]+)", keys)
            if case.odd in HEADINGS and case.odd.strip('"') in line:  # has no unit
                continue
            if unit in UNKNOWN:
                assert why.startswith("?"), line
            elif unit and not (scale or "torque_constant" in keys):
                assert written, line
                assert dimension_and_size(written[1]) == dimension_and_size(KNOWN.get(unit, unit)), line
            elif not unit:
                assert re.search("assumed|since|by |in its name|identifies", why), line


@pytest.mark.parametrize("examples", [12, pytest.param(150, marks=pytest.mark.slow)])
def test_new_writes_studies_that_check_accepts(examples: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A study that is accepted, or a refusal of less than half of the logs."""
    is_accepted = list[bool]()

    @settings(max_examples=examples, deadline=None)
    @given(case=CASES)
    def every(case: Case) -> None:
        folder = tmp_path_factory.mktemp("logs")
        try:
            texts = texts_from_logs(folder / "new", write(folder, case))
        except (DataError, StudyError):
            is_accepted.append(False)
            return
        (folder / "new").mkdir()
        for name, text in texts.items():
            (folder / "new" / name).write_text(text, encoding="utf-8")
        load_with_logs(folder / "new" / "study.yml")
        check_statements(texts["study.yml"], case)
        is_accepted.append(True)

    every()
    assert np.mean(is_accepted) > 0.5
