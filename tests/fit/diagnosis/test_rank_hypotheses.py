"""What a fit held or read wrongly is named with its size, by its own list of causes and by those of a user."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from plants.faults import FAULTS, FURTHER, SPEC, drawn, faulty, true_case
from plants.installed import installed
from plants.marks import slow
from plants.paths import ROOT
from plants.refusals import refused
from scipy.optimize import lsq_linear

from elastid.base.arrays import FloatArray
from elastid.fit.diagnosis.hypotheses import HYPOTHESES, WITHOUT_OTHER_ROBOTS, all_hypotheses, explain_causes
from elastid.fit.diagnosis.rank_hypotheses import CONSEQUENCES, occam_factor
from elastid.fit.diagnosis.score_test import Candidate, FixedNumber, ScoreTest, free_drop
from elastid.fit.diagnosis.unmodelled_payload import find_load, load_steps
from elastid.fit.identify import fit_parameters, identify
from elastid.fit.result import Result
from elastid.fit.spec import ParameterSpec
from elastid.robot import Tolerances

# One of a number of the model, of the signals, of a response and of a configuration; the others are slow.
QUICK = {"delay left out", "link mass +5 %", "one sample late", "torques of a posture", "soft day"}


@cache
def fitted(fault: str) -> Result:
    case, hypotheses = faulty(fault), HYPOTHESES if fault in FURTHER else WITHOUT_OTHER_ROBOTS
    return identify(drawn(case, np.random.default_rng(0)), case.robot, SPEC, hypotheses=hypotheses)


@pytest.mark.parametrize(
    "fault",
    [name if name in QUICK else slow(name) for name in FAULTS if name not in ("rate 2 % wrong", "missing torsion")],
)
def test_a_fault_is_named_first_with_its_size(fault: str) -> None:
    """It explains most of the excess, its steps are the true ones, and a warning is about it."""
    result, named = fitted(fault), FAULTS[fault]
    first = result.indices[0]
    # Within tolerances of the file a reading may be as likely as another.
    assert named.cause in (first.name, *(first.alike if named.has_tolerances else ()))
    assert named.has_tolerances or first.alike == named.alike
    assert first.place == 1
    assert first.explained_fraction > named.share
    if named.steps:
        np.testing.assert_allclose(first.steps, np.broadcast_to(named.steps, len(first.steps)), atol=named.within)
    codes = {note.code for note in result.notes}
    assert "fit/likely-cause" in codes
    assert not {"fit/inconsistent-responses", *(CONSEQUENCES if result.has_single_cause else ())} & codes


def test_two_faults_are_named_one_after_the_other() -> None:
    """Each with its size and its share of all, which the sentence on the first states."""
    case, names = true_case(), ("soft day", "torques of a posture")
    for name in names:
        case = FAULTS[name].fault(case)
    result = fit_parameters(drawn(case, np.random.default_rng(0)), case.robot, SPEC)
    sequence = [index for index in result.indices if index.place]
    assert [(index.place, index.name) for index in sequence] == [(i + 1, FAULTS[n].cause) for i, n in enumerate(names)]
    for index, name in zip(sequence, names, strict=True):
        np.testing.assert_allclose(index.steps, FAULTS[name].steps, atol=FAULTS[name].within)
    assert sum(index.explained_fraction for index in sequence) == pytest.approx(1.0, abs=0.01)
    causes = [note.text for note in result.notes if note.code == "fit/likely-cause"]
    assert f"{100 * sequence[0].explained_fraction:.0f} %" in causes[0]


@pytest.mark.slow
def test_missing_spring_is_named_beside_a_delay_of_the_torques() -> None:
    """Torques 5 ms late, delay_u free: the missing torsion is the likely cause, as without the delay."""
    case, late_s = faulty("missing torsion"), 5e-3
    delayed = [replace(G, G=G.G * np.exp(2j * np.pi * G.freq_hz * late_s)[:, None, None]) for G in case.responses]
    case = replace(case, responses=tuple(delayed))
    spec = replace(SPEC, parameters=SPEC.parameters | {"delay_u": ParameterSpec()})
    result = identify(drawn(case, np.random.default_rng(0)), case.robot, spec, hypotheses=WITHOUT_OTHER_ROBOTS)
    assert result.indices[0].name == FAULTS["missing torsion"].cause
    assert result.values["delay_u"] == pytest.approx(late_s, abs=2e-4)


@example(seed=0, decades=[-8.0, 0.0, 0.0], room=1.0)
@given(seed=st.integers(0, 10**6), decades=st.lists(st.floats(-4, 4), min_size=3, max_size=3), room=st.floats(0.01, 10))
def test_freed_parameters_equal_least_squares_in_any_units(seed: int, decades: list[float], room: float) -> None:
    """Of a linear problem of five columns, two of them held, one by one or together within limits that are priors."""
    rng = np.random.default_rng(seed)
    J, raw = rng.standard_normal((50, 5)) * 10.0 ** np.array([*decades, 0, 0]), rng.standard_normal(50)

    def left(r: FloatArray, *columns: int) -> FloatArray:
        return r - J[:, columns] @ np.linalg.lstsq(J[:, columns], r, rcond=None)[0]

    r, limits = left(raw, 0, 1, 2), room / np.linalg.norm(J[:, 3:], axis=0)
    assert free_drop(J.T @ J, J.T @ raw, np.arange(5) < 3) == pytest.approx(raw @ raw - r @ r)
    numbers = [FixedNumber(name, "", 0.0, "1", False, -math.inf, math.inf, 1.0) for name in "ab"]
    test = ScoreTest.of(numbers, J.T @ J, J.T @ r, np.ones(3, dtype=bool))
    first, second = (Candidate(name, "", np.array([i]), np.eye(1)) for i, name in enumerate("ab"))
    steps, drop = test.step(second)
    one, both = left(r, 0, 1, 2, 4), left(r, 0, 1, 2, 3, 4)
    assert [drop, test.max_drop(second)] == pytest.approx(2 * [r @ r - one @ one])
    size = np.linalg.norm(J[:, [0, 1, 2, 4]], axis=0)
    every = size * np.linalg.lstsq(J[:, [0, 1, 2, 4]], -r, rcond=None)[0]
    np.testing.assert_allclose(size * [*test.effects(second, steps), *steps], every, atol=1e-6 * np.abs(every).max())
    assert test.freed(second).step(first)[1] == pytest.approx(one @ one - both @ both, rel=1e-6)
    a, b = (left(J[:, i], 0, 1, 2) for i in (3, 4))
    assert test.std(second) == pytest.approx(1 / np.linalg.norm(b))
    assert test.correlations([first, second])[0, 1] == pytest.approx((a @ b) ** 2 / (a @ a * b @ b))
    bounded = tuple(replace(n, lower=-w, upper=w) for n, w in zip(numbers, limits.tolist(), strict=True))
    steps, _ = replace(test, numbers=bounded).step(Candidate("both", "", np.arange(2), np.eye(2)))
    stacked = np.vstack([np.column_stack([a, b]) * limits, np.eye(2)])
    expected = lsq_linear(stacked, np.append(-r, [0.0, 0.0]), (-1.0, 1.0), tol=1e-13).x
    np.testing.assert_allclose(steps / limits, expected, atol=1e-5)


MASS, CENTRE, INERTIA = 40.0, (0.3, 0.0, 0.1), (0.8, 4.0, 4.1)
LOAD, PLACE = 3.0, np.array([0.7, 0.1, 0.05])


def numbers() -> list[FixedNumber]:
    centre = [FixedNumber(f"c_arm_{a}", "", c, "m", False, -1, 1, 0.01) for a, c in zip("xyz", CENTRE, strict=True)]
    inertia = [
        FixedNumber(f"I_arm_{a}{a}", "", i, "kg*m^2", True, -9, 9, 0.1) for a, i in zip("xyz", INERTIA, strict=True)
    ]
    return [FixedNumber("m_arm", "", MASS, "kg", True, -9, 9, 0.05), *centre, *inertia]


def test_a_point_mass_is_found_with_its_place() -> None:
    """By exact sums of a linear problem, with its drop of V."""
    members, rho = numbers(), PLACE - CENTRE
    change = np.array([LOAD / MASS, *(LOAD / MASS * rho), *(LOAD * (rho @ rho - rho**2) / INERTIA)])
    J = np.random.default_rng(0).standard_normal((100, len(members)))
    S = 1e6 * J.T @ J
    test = ScoreTest(tuple(members), S, -S @ change, np.zeros((0, len(members))), np.ones(len(members), dtype=bool))
    load = find_load(test, Candidate("payload_arm", "payload", np.arange(7), np.eye(7)), 1.0, 0.0)
    assert load.mass == pytest.approx(LOAD, rel=1e-3)
    np.testing.assert_allclose(load.position, rho, atol=1e-3)
    assert load.drop == pytest.approx(change @ S @ change, rel=1e-4)


@given(load=st.floats(0.1, 20.0), place=st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_body_with_load_has_combined_centre_and_inertia(load: float, place: tuple[float, ...]) -> None:
    """The inertia about its centre by Steiner's theorem: of the reduced mass at the distance of the two."""
    rho, entries = np.array(place), ("xx", "yy", "zz", "xy", "xz", "yz")
    names = [*(f"c_arm_x_{a}" for a in "xyz"), *(f"I_arm_x_{e}" for e in entries), "I_arm_x"]
    numbers = [FixedNumber(name, "", MASS, "", name == "m_arm_x", -9, 9, 0.1) for name in ("m_arm_x", *names)]
    mass, *steps = load_steps(numbers, np.array([load, *place])).tolist()
    inertia = MASS * load / (MASS + load) * (rho @ rho * np.eye(3) - np.outer(rho, rho))
    expected = [*(load / (MASS + load) * rho), *(inertia["xyz".index(a), "xyz".index(b)] for a, b in entries)]
    assert math.exp(mass) == pytest.approx(1 + load / MASS)
    assert steps == pytest.approx([*expected, MASS * load / (MASS + load) * rho @ rho])


@given(size=st.floats(-10, 10), unit=st.floats(1e-3, 1e3), sharper=st.floats(1, 1e3))
def test_an_unusual_size_and_more_freedom_lower_the_odds(size: float, unit: float, sharper: float) -> None:
    """Of two numbers in any unit, one of a size: its prior's, and ln of the information that each is known by."""
    usual, S = np.array([0.01, 2.0]), np.diag([1e12, 1e6])
    cost = occam_factor(sharper * S / unit**2, usual * unit, np.array([size, 0.0])) - occam_factor(
        S, usual, np.zeros(2)
    )
    assert cost == pytest.approx(2 * math.log(1 + size**2) + 2 * math.log(sharper), abs=1e-6)


SHARE = 0.04
FIRST_ON_SECOND = np.array([[0.0, 0.0], [1.0, 0.0]])


PACKAGE = """
import numpy as np
from elastid.fit.diagnosis.hypothesis import Hypothesis, Size

def crosstalk(response):
    return {"crosstalk_2": -response.G @ np.array([[0.0, 0.0], [1.0, 0.0]])}

CAUSE = Hypothesis("crosstalk", ("crosstalk",), Size(0.05, 0.5, unit="1"), columns=crosstalk,
                   summary="torque of one motor in the channel of another", advice="check the wiring")
"""


@pytest.fixture
def installed_cause(tmp_path) -> Iterator[Path]:
    entry = "crosstalk = crosstalk_cause:CAUSE"
    with installed(tmp_path, "crosstalk_cause", PACKAGE, "elastid.causes", entry) as info:
        yield info


def test_cause_of_another_package_is_ranked_and_explained(installed_cause: Path) -> None:
    """First, with its size to 5 % and nearly all of the excess, without any argument of identify."""
    case, mixed = true_case(), np.linalg.inv(np.eye(2) + SHARE * FIRST_ON_SECOND)
    case = replace(case, responses=tuple(replace(response, G=response.G @ mixed) for response in case.responses))
    result = identify(drawn(case, np.random.default_rng(0)), case.robot, SPEC)
    first = result.indices[0]
    assert (first.name, first.group, first.place) == ("crosstalk_2", "crosstalk", 1)
    assert first.steps[0] == pytest.approx(SHARE, rel=0.05)
    assert first.explained_fraction > 0.95
    assert "fit/likely-cause" in {note.code for note in result.notes}
    assert "torque of one motor" in explain_causes("crosstalk")


def test_entry_point_without_a_cause_is_refused(installed_cause: Path) -> None:
    """The error has the name of the entry point and its value."""
    (installed_cause / "entry_points.txt").write_text("[elastid.causes]\nwrong = crosstalk_cause:crosstalk\n")
    with refused("install/entry-point", holds=("wrong", "crosstalk_cause")):
        all_hypotheses()


def test_every_cause_is_explained_and_has_its_plant() -> None:
    """A row has a summary and a remedy; its plant is a fault of these tests or an injection of the study."""
    injections = (ROOT / "scripts" / "studies" / "causes.py").read_text(encoding="utf-8")
    for row in HYPOTHESES:
        if row.summary:
            assert f"{row.family}: {row.summary}" in explain_causes(row.family)
            assert not row.plant or row.plant in FAULTS or f'"{row.plant}"' in injections, row
    assert {row.family for row in HYPOTHESES if not row.summary} <= {"time", "number", "centre of mass"}
    with refused("study/unknown-key"):
        explain_causes("gain of nothing")


@pytest.mark.slow
def test_mass_beyond_tolerance_is_named_in_converged_fit() -> None:
    """The fore arm is 30 % lighter than its file: data move it there, and the sentence says so."""
    case = true_case()
    heavy = case.robot.with_parameters({"m_fore": 1.4 * case.robot.parameters()["m_fore"][0]})
    result = identify(drawn(case, np.random.default_rng(0)), replace(heavy, tolerances=Tolerances()), SPEC)
    assert result.indices[0].name in ("m_fore", "payload_fore")
    assert "fit/likely-cause" in {note.code for note in result.notes}
