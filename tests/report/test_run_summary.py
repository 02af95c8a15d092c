"""The first screen: the verdict follows the intervals and the status, and the actions follow the covariance."""

import re
from dataclasses import replace

import numpy as np
import pytest
from plants.report_values import TRUTH, fit_result

from elastid.base.display import percent
from elastid.base.errors import Note
from elastid.covariance import Covariance
from elastid.experiment.simulated.plant import true_response
from elastid.fit.result import Result
from elastid.fit.result_rows import ModificationIndex, RigidPart
from elastid.fit.status_terms import BY_PRIOR, DISTORTED, GOOD, NO_CAUSE, OTHER_JOINTS, UNCERTAIN
from elastid.modal.estimate import estimate_modes
from elastid.nonlinear.gear_result import NOT_EXPLAINED
from elastid.report.next_steps import next_steps
from elastid.report.parameter_row import WITH_COULOMB, parameter_rows
from elastid.report.responses_content import ResponsesContent, questions_of_responses
from elastid.report.run_summary import numbers_answer, residual_sentence, verdict_sentence
from elastid.response import Configuration, Response


def rows_of(result):
    return parameter_rows(result, TRUTH)


def test_verdict_names_cause_without_convergence():
    result = replace(fit_result(), status="converged", cost_dof=200.0)
    assert numbers_of(verdict_sentence(result, rows_of(result)))[:2] == [3, 40]
    assert verdict_sentence(fit_result(), rows_of(result)).startswith("The fit ended with d_1 at its lower bound.")
    unknown = replace(result, status="noise_unknown", cost_dof=np.nan, message="The noise is unknown.")
    assert "noise is unknown" in verdict_sentence(unknown, rows_of(unknown))


def test_responses_page_answers_questions_by_modes():
    freq_hz = np.arange(40, 200) / 4
    G = true_response(freq_hz)
    std = np.full(G.shape, 0.02 * np.abs(G).max())
    noise = np.random.default_rng(0).standard_normal((2, *G.shape)) / np.sqrt(2)
    names = ("shaker table", "shaker tip"), ("table", "column", "tip")
    at = Configuration("bench", np.zeros(0))
    noisy = G + std * (noise[0] + 1j * noise[1])
    response = Response(freq_hz, noisy, *names, "acceleration", at, noise=Covariance(std**2, np.inf))
    modes = estimate_modes(response)
    content = ResponsesContent("a bench", (response,), (modes,), "", {})
    (_, (good, *_)), (_, (found,)), (_, (following,)) = questions_of_responses(content)
    assert good == f"Noise is {percent(float(np.median(modes.relative_std)))} of the response at a line."
    assert modes.n_modes == 3
    assert found.startswith("bench: 3 modes from 11.1")
    least = int(np.argmax(modes.zeta_std / modes.zeta))
    f, width = modes.freq_hz[least], 196 * modes.zeta_std[least] / modes.zeta[least]
    assert numbers_of(following)[:2] == pytest.approx([f, width], rel=0.01)
    noted = replace(response, notes=(Note("a", "b"), Note("c", "d")))
    many = replace(content, responses=(noted,) * 5, modes=(replace(modes, notes=()),) * 5)
    (_, (_, warned)), (_, listed), _ = questions_of_responses(many)
    assert (numbers_of(warned), len(listed), numbers_of(listed[-1])) == ([2], 4, [2])
    assert questions_of_responses(ResponsesContent("a bench", (), (), "", {}))[1][1]


def test_the_answer_says_how_exact_what_was_held_must_be():
    """A measured robot with fixed values that no residual shows is good on a condition; a simulated one is its file."""
    result = replace(fit_result(), status="converged", notes=(Note("fit/fixed-values", "5 %"),), indices=())
    rows = [replace(row, truth=None) for row in rows_of(result)]
    assert numbers_answer(result, rows).startswith("Yes, if")
    assert numbers_answer(result, [replace(rows[0], truth=1.0), *rows[1:]]) == "Yes."
    assert numbers_answer(replace(result, notes=()), rows) == "Yes."


def test_an_uncompensated_motor_is_excepted_from_good_numbers() -> None:
    """Coulomb friction in a viscous coefficient: neither "good" nor an accuracy holds for it."""
    result = replace(fit_result(), status="converged", cost_dof=200.0, notes=(), indices=())
    rows = rows_of(result)
    mixed = [replace(row, contains=WITH_COULOMB if row is rows[-1] else "") for row in rows]
    assert numbers_answer(result, mixed).count(rows[-1].name) == 1
    assert numbers_answer(result, rows).count(rows[-1].name) == 0


def test_prior_dominated_parameters_are_not_identified() -> None:
    weak = Note("fit/weakly-identifiable", "", "d_1")
    result = settled(verdicts=(BY_PRIOR, UNCERTAIN, GOOD, BY_PRIOR), notes=(weak,))
    assert numbers_of(result.meaning.clause) == [1, 4, 2, 1]


def settled(**changes) -> Result:
    """A fit that converged; two lines of information say that c2 has the most."""
    share = np.array([[0.3, 0.3, 0.25, 0.3], [0.7, 0.7, 0.75, 0.7]])
    given = {"status": "converged", "cost": 200.0, "configurations": ("c1", "c2"), "information_fraction": share}
    return replace(fit_result(), **given | changes)


def index(*members: str) -> ModificationIndex:
    n = len(members) or 1
    name, numbers = "+".join(members) or "a reading", (np.full(n, 25.0), ("kg",) * n, (True,) * n, np.full(n, 0.1))
    return ModificationIndex(name, "group", members, *numbers, explained_fraction=0.5, place=1)


PRIOR, SEARCH = "--set 'fit.parameters.mass={prior: {std: 0.05}}'", "elastid compare STUDY --search"
FREED = Note("fit/likely-cause", "a reading or a mass", remedy=f"Free it: `{PRIOR}`")
NOTHING = Note("fit/likely-cause", NO_CAUSE, remedy=OTHER_JOINTS)


@pytest.mark.parametrize(
    ("status", "found", "texts"),
    [
        ("converged", index("mass"), [PRIOR]), ("misfit", index("mass"), [PRIOR]), ("misfit", None, [SEARCH]),
        ("misfit", index("d_1"), [""]), ("misfit", index(), [PRIOR]),
        ("converged", None, [""]), ("model_error", None, ["", SEARCH]), ("model_error", index("mass"), [PRIOR, ""]),
    ],
)  # fmt: skip
def test_advice_follows_the_status_and_the_first_cause(status, found, texts) -> None:
    """A number is freed by a command where no other is tied to it."""
    notes = () if status == "converged" and found is None else (FREED if found else NOTHING,)
    result = settled(status=status, cost=3000.0, indices=() if found is None else (found,), notes=notes)
    assert [action.text for action in next_steps(result, rows_of(result))] == texts


def test_a_cause_is_the_same_in_answers_actions_and_meaning() -> None:
    """The first note with the code of a cause is their only source; one without a cause comes last."""
    notes = (NOTHING, Note("fit/loads", "13 mm", remedy="Check 7"))
    for result in (settled(notes=notes), settled(notes=notes, cost=3000.0)):
        rows = rows_of(result)
        assert numbers_of(residual_sentence(result, ()))[0] == 13
        assert "13 mm" in result.meaning.action
        assert numbers_of(next_steps(result, rows)[0].sentence) == [7]
    assert 13 in numbers_of(numbers_answer(settled(notes=notes), rows))


def test_residuals_are_over_noise_and_misfit_has_no_width() -> None:
    """Of 40 times the expected cost 6.32; which a fit that converged includes in its intervals."""
    wrong = settled(status="misfit", message="off", cost=4000.0, cost_expected=100.0)
    assert numbers_of(residual_sentence(wrong, ()))[0] == 6.32
    assert numbers_of(verdict_sentence(wrong, rows_of(wrong)))[:1] == [3]  # of 4 true values
    assert numbers_of(verdict_sentence(replace(wrong, status="converged"), rows_of(wrong)))[:3] == [6.32, 3, 40]


def numbers_of(text: str) -> list[float]:
    return [float(word) for word in re.findall(r"(?<![\w.])\d+(?:\.\d+)?", text)]


@pytest.mark.parametrize(("repeated", "of_data"), [((), 1.0), ((1.0, 1.0, 0.5, 1.0), 0.5)])
def test_twice_the_time_narrows_widest_interval(repeated, of_data: float) -> None:
    """sigma' = sigma / sqrt(1 + s), of what the file does not leave."""
    result = settled(averaging_fraction=np.array(repeated))
    rows = rows_of(result)
    low, high = rows[2].interval
    half = 50 * (high - low) / rows[2].estimate
    (action,) = next_steps(result, rows)
    assert numbers_of(action.gain) == pytest.approx((half, half / np.sqrt(1 + 0.75 * of_data)), abs=0.5)


def test_base_is_named_if_it_shifts_a_stiffness() -> None:
    """Of 3 % of k_1 with a std of 1 %, and 6 % of k_2 with 2 %, both; a base that stiffens is no base."""
    for k_1, k_2, names in ((0.03, 0.06, ["k_1", "k_2"]), (0.03, 0.01, ["k_1"]), (-0.03, 0.01, [])):
        part = RigidPart("base", 1e7, np.array([-k_1, -k_2, 0.0, 0.0]), 1e8)
        rows = parameter_rows(settled(assumed_rigid=(part,), covariance=fit_result().covariance), None)
        assert [row.name for row in rows if row.base] == names


def test_a_misfit_never_ends_in_numbers_to_be_used():
    """A spring that is not straight asks for its gear to be laid open, once."""
    result = replace(fit_result(), status="misfit", message="off", indices=(), cost=100.0, cost_expected=100.0)
    rows = rows_of(result)
    bent = replace(result, verdicts=(DISTORTED,))
    assert next_steps(bent, rows)[0].text == "--set 'gears={}'"
    caused = replace(bent, notes=(Note("fit/likely-cause", "f_1", remedy="Free it: `--set 'fit.parameters.f_1={}'`"),))
    keys = [step.text.partition("=")[0] for step in next_steps(caused, rows)]
    assert keys == ["--set 'gears", "--set 'fit.parameters.f_1"]
    opened = replace(bent, message=f"{bent.message}; {NOT_EXPLAINED}")
    assert not any("gears" in action.text for action in next_steps(opened, rows))
