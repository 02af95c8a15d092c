"""The first screen: the verdict follows the intervals and the status, and the actions follow the covariance."""

from dataclasses import replace

import numpy as np
from plants.report_values import TRUTH, fit_result, report_content

from elastid.base.display import number, percent
from elastid.base.errors import Note
from elastid.covariance import Covariance
from elastid.experiment.simulated.plant import true_response
from elastid.fit.result import DISTORTED
from elastid.modal.estimate import estimate_modes
from elastid.nonlinear.gear_result import NOT_EXPLAINED
from elastid.report.content import ResponsesContent, parameter_rows
from elastid.report.overview import (
    next_steps,
    numbers_answer,
    questions_of_responses,
    residual_sentence,
    verdict_sentence,
)
from elastid.response import Configuration, Response


def rows_of(result):
    return parameter_rows(result, TRUTH)


def test_the_verdict_is_of_the_numbers_and_names_the_cause_where_it_did_not_converge():
    result = replace(fit_result(), status="converged", cost_dof=200.0)
    sentence = verdict_sentence(result, rows_of(result))
    assert sentence.startswith("the model describes the data; ")
    assert "3 of 3 springs and dampers known to 40 % or better" in sentence
    assert verdict_sentence(fit_result(), rows_of(result)).startswith("The fit ended with d_1 at its lower bound;")
    unknown = replace(result, status="noise_unknown", cost_dof=np.nan, message="The noise is unknown.")
    assert "noise is unknown" in verdict_sentence(unknown, rows_of(unknown))


def test_the_page_of_responses_answers_its_three_questions_by_the_modes():
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
    assert good == f"Noise is {percent(float(np.median(modes.stated)))} of the response at a line."
    assert modes.n_modes == 3
    assert found.startswith("bench: 3 modes from 11.1")
    least = int(np.argmax(modes.zeta_std / modes.zeta))
    assert f"damping at {number(float(modes.freq_hz[least]), 4)} Hz is known least" in following
    none = ResponsesContent("a bench", (), (), "", {})
    assert questions_of_responses(none)[1][1] == ("None that stands out of the noise.",)


def test_the_answer_says_how_exact_what_was_held_must_be():
    """Of a measured robot: up to 5 % of a torque constant shows in no residual; a simulated one is its file."""
    held = "the intervals take as exact ...; up to 5 % of gain_u_* shows in no residual: measure them as exactly"
    result = replace(fit_result(), status="converged", notes=(Note("fit/held-as-exact", held),), indices=())
    rows = [replace(row, truth=None) for row in rows_of(result)]
    assert (
        numbers_answer(result, rows)
        == "Yes, if what the fit held is exact: up to 5 % of gain_u_* shows in no residual."
    )
    assert numbers_answer(result, [replace(rows[0], truth=1.0), *rows[1:]]) == "Yes."
    assert numbers_answer(replace(result, notes=()), rows) == "Yes."


def test_answers_do_not_contradict_the_status():
    """A misfit has no widths and no advice to measure longer; residuals that only a floor holds are said to be so."""
    result = replace(fit_result(), status="misfit", cost_dof=200.0, cost=4000.0, cost_expected=100.0)
    content, rows = report_content(result=result), rows_of(result)
    assert "known to" not in verdict_sentence(result, rows)
    assert numbers_answer(result, rows).startswith("Not yet: ")
    actions = next_steps(result, rows, content.plan)
    assert [action.text for action in actions] == ["elastid compare STUDY --search"]
    sentence = residual_sentence(result, content.validation.configurations)
    assert sentence.startswith("The residuals are 6.32 times the noise.")
    held = replace(result, status="converged", cost=100.0)
    beyond = [
        replace(one, power_ratio=4.0, power_dof=400.0, left_out=False) for one in content.validation.configurations
    ]
    within = [replace(one, power_ratio=1.0) for one in beyond]
    assert "beyond the floor" in residual_sentence(held, beyond)
    assert "within its floor" in verdict_sentence(held, rows, beyond)
    assert residual_sentence(held, within) == "Nowhere: no residual beyond what the noise explains."
    assert verdict_sentence(held, rows, within).startswith("the model describes the data; ")


def test_a_misfit_never_ends_in_numbers_to_be_used():
    """A spring that is not straight asks for its gear to be laid open, once; any other for the first warning."""
    result = replace(fit_result(), status="misfit", message="off", indices=(), cost=100.0, cost_expected=100.0)
    rows = rows_of(result)
    assert [action.what for action in next_steps(result, rows)] == [
        "Correct what the first warning names, and fit again."
    ]
    bent = replace(result, verdicts=(DISTORTED,))
    assert next_steps(bent, rows)[0].text == "--set 'gears={}'"
    opened = replace(bent, message=f"{bent.message}; {NOT_EXPLAINED}")
    assert not any("gears" in action.text for action in next_steps(opened, rows))


def test_a_fit_that_converged_a_little_beyond_the_noise_is_not_told_of_missing_joints():
    """Distortion by the arm's own swing leaves so much in right models; a misfit without a cause is told to search."""
    beyond = replace(fit_result(), status="converged", cost_dof=200.0, indices=())
    beyond = replace(beyond, cost=1.5 * beyond.cost_expected)
    assert beyond.exceeds_noise
    assert next_steps(beyond, rows_of(beyond))[0].what.startswith("Measure at half the torque")
    misfit = replace(beyond, status="misfit", message="misfit")
    assert "compare STUDY --search" in next_steps(misfit, rows_of(misfit))[0].text
