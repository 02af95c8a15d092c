"""Every script runs: examples give their number, benches and studies end with JSON; budget and licences refuse."""

import json
import re
import runpy
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.paths import ROOT

SCRIPTS = ROOT / "scripts"
EXAMPLES = SCRIPTS / "examples"
# From the variables of an example, whether each of its promises is kept.
Check = Callable[[dict[str, Any]], list[Any]]
# Scripts with a main function, apart from the comparison of commits.
RUNNABLE = sorted(p for p in SCRIPTS.glob("[bs]*/*.py") if "__main__" in p.read_text() and p.stem != "speed")


def example(name: str) -> dict[str, Any]:
    """The variables of an example, without its figures; the gallery and a notebook know no __file__."""
    path = EXAMPLES / f"{name}.py"
    variables = {"__name__": name}
    sys.path.insert(0, str(EXAMPLES))
    try:
        exec(compile(path.read_text(encoding="utf-8"), path, "exec"), variables)
        return variables
    finally:
        sys.path.remove(str(EXAMPLES))


def near(value: object, expected: object, part: float) -> bool:
    return bool(np.allclose(value, expected, rtol=part, atol=0))


def _follows_a_move(v: dict[str, Any]) -> list[bool]:
    """The vibration is a third; draws enclose the error, within the limits of torque."""
    move, identified = v["move"], v["move"][v["IDENTIFIED"]]
    enclosed = bool(np.all(identified.low <= identified.high) and np.all(move.max_torque <= 900.0))
    return [identified.residual < move[v["RIGID"]].residual / 3, enclosed, not move.advice]


def _finds_friction(v: dict[str, Any]) -> list[bool]:
    """Coulomb, viscous and static friction within 0.5 % of the truth, by intervals that are as narrow."""
    truth = {"Fc_m1": 22.0, "f_m1": 13.0, "Fs_m1": 31.0}
    return [0.995 * truth[n] < v["found"][n][0] < v["found"][n][1] < 1.005 * truth[n] for n in truth]


def _within(v: dict[str, Any], result: Any) -> list[bool]:
    return [abs(result.values[name] - truth) < 3 * result.std[name] for name, truth in v["truth"].items()]


def _finds_the_bearing(v: dict[str, Any]) -> list[bool]:
    """Without it the misfit of left-out configurations is 100 times larger."""
    models = {model["name"]: sum(model["misfit"]) for model in v["comparison"]["models"]}
    best = models[v["comparison"]["models"][0]["name"]]
    tilts = "1x" in v["comparison"]["verdict"].split(".")[0]
    return [v["codes"] == [0, 0], tilts, models["gear 1 elastic"] > 100 * best]


FAST = {
    "ex01_identify_from_python": lambda v: [
        v["low"] < v["true_stiffness"] < v["high"] < v["low"] + 0.05 * v["true_stiffness"]
    ],
    "ex02_linkage_two_formulations": lambda v: [v["difference"] < 1e-9],
    "ex07_multisine": lambda v: [
        v["orthogonality"] < 1e-12, near(v["found_rms"], np.tile(v["rms"], (3, 1)), 1e-9),
    ],
    "ex08_crest_factor": lambda v: [
        v["crest"]["optimised"] < 1.5 < v["crest"]["schroeder"] < 2.0 < 3.0 < v["crest"]["random"]
    ],
    "ex09_closed_loop_estimators": lambda v: [
        max(v["error"]["arithmetic"], v["error"]["joint"]) < 0.8 * v["error"]["h1"]
    ],
    "ex10_local_methods": lambda v: [
        v["error"]["local_rational"] < min(0.03, 0.2 * v["error"]["local_polynomial"])
    ],
    "ex12_friction_observer": lambda v: [
        near(v["end"][n], v["true"][n][-1], part) for n, part in {"Fc": 0.05, "f": 0.1, "offset": 0.05}.items()
    ],
    "ex15_simulation": lambda v: [v["signal"].error < 0.02, v["poor"].error > 0.4],
    "ex16_fleet": lambda v: [
        {(f.robot, f.parameter) for f in v["findings"]} == {("robot 3", "k_2"), ("robot 6", "Fc_m2")},
        {f.robot for f in v["findings"] if f.kind == "drifts"} == {"robot 6"},
    ],
    "ex19_modes_of_a_structure": lambda v: [
        np.all(v["agreement"] > 0.999), np.all(np.abs(v["modes"].zeta - v["zeta"]) < 4 * v["modes"].zeta_std),
    ],
}  # fmt: skip
SLOW = {
    "ex03_responses_of_python_control": lambda v: [
        near([v["result"].values[n] for n in ("k_1", "d_1")], [3e3, 4.0], 1e-6), v["result"].status == "noise_unknown",
    ],
    "ex04_controller_on_the_fitted_model": lambda v: [near(v["gain_margin"], 10, 0.01)],  # 2 / (100 T) of two lags T
    "ex06_friction_curve": _finds_friction,
    "ex11_geometry_and_priors": lambda v: [
        *_within(v, v["result"]), v["result"].std["m_fore"] < 0.005 * v["truth"]["m_fore"],
    ],
    "ex13_three_axes": lambda v: [len(v["off"]) == 7, max(map(abs, v["off"].values())) < 3e-3],
    "ex14_search": _finds_the_bearing,
    "ex17_where_can_i_mill": lambda v: [near(v["soft"] / v["stiff"], 3.25, 0.03), near(v["gain"], 25.3, 0.05)],
    "ex18_command_a_fast_move": lambda v: [v["gain"] > 100, v["over_catalogue"] > 30, *_follows_a_move(v)],
    "ex20_load_tests": lambda v: [
        not v["both"].static.disagrees, near(v["relative"]["k_3"], (0.081, 0.007), 0.1),
        *(abs(v["both"].values[n] / v["truth"][n] - 1) < 3 * std for n, (_, std) in v["relative"].items()),
    ],
    "ex21_live_identification": lambda v: [
        v["reached"], v["share"] < 2 / 3, all(v["inside"].values()),
        all(widths[-1] <= 0.05 < widths[0] for widths in v["half_widths"].values()),
    ],
    "ex22_gains_of_joint_loops": lambda v: [
        5.5 < v["designed"].peak_db.max() <= 6.0, np.mean(v["designed"].drawn_peaks_db <= 6.0) >= 0.95,
        any("mode at" in cause for cause in v["designed"].limited_by), v["wild"].peak_db.max() > 7.0,
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", [*FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_an_example_gives_its_numbers(name: str) -> None:
    found = (FAST | SLOW)[name](example(name))
    assert all(found), found


def test_every_example_is_short_and_asserted() -> None:
    """A new example has its test, here or, of example 5, with the run folder of the README, and a figure or picture."""
    tests = "".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))
    for path in EXAMPLES.glob("ex[0-9]*.py"):
        assert path.stem in tests, path.name
        assert len((text := path.read_text(encoding="utf-8")).splitlines()) <= 60, path.name
        assert re.search(r"^    figure = |figure := Figure|sphinx_gallery_thumbnail_path", text, re.M), path.name


@pytest.mark.slow
@pytest.mark.parametrize("script", RUNNABLE, ids=lambda path: f"{path.parent.name} {path.stem}")
def test_every_bench_and_study_ends_with_json(script: Path, tmp_path: Path) -> None:
    """--quick is a small problem; the full size is for scripts' users."""
    done = subprocess.run(
        [sys.executable, str(script), "--quick"], cwd=tmp_path, capture_output=True, text=True, timeout=580, check=False
    )
    assert done.returncode == 0, done.stderr
    assert isinstance(json.loads(done.stdout.splitlines()[-1]), dict)


BENCHMARKS = SCRIPTS / "benchmarks"
LAST_RUN = json.loads((BENCHMARKS / "last_run.json").read_text())
# A number and the key of the line of JSON that it is from, as in: 2.5 (evaluation_over_solve).
QUOTE = re.compile(r"(\d+(?:\.\d+)?) \((\w+)\)")


@pytest.mark.parametrize("script", sorted(LAST_RUN))
def test_every_quoted_ratio_is_that_of_the_last_run(script: str) -> None:
    """Each number names its key, and has its value in as many digits as are quoted."""
    paragraphs = (BENCHMARKS / script).read_text().split("\n\n")
    paragraph = next(each for each in paragraphs if each.startswith("Measured")).replace("\n", " ")
    quotes = QUOTE.findall(paragraph)
    assert quotes
    for number, key in quotes:
        digits = len(number.partition(".")[2])
        assert float(number) == round(LAST_RUN[script][key], digits), key
    assert not re.search(r"\d", QUOTE.sub("", paragraph)), "a number without a source"


MODULE = '''"""One module."""
LIMIT = 2 * 3.0
class RoomLimits:
    most: int = 4
    name: str = "no number"
def f(x):
    """A docstring of many words, which is not counted."""
    return "a text of words without an end", "A sentence has five words.", f"{x} is more than {x} of it"
'''


def test_a_number_beyond_the_budget_fails_until_it_falls(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what, where and how much; lowering takes the numbers that fell and leaves the others."""
    monkeypatch.syspath_prepend(SCRIPTS)
    main = runpy.run_path(str(SCRIPTS / "budget.py"))["main"]
    for room in ("elastid", "tests", "scripts"):
        (tmp_path / room).mkdir()
    (tmp_path / "elastid" / "__init__.pyi").write_text("from elastid.robot import Robot as Robot\n")
    (tmp_path / "elastid" / "module.py").write_text(MODULE)
    path = tmp_path / "scripts" / "budget.toml"
    path.write_text("[elastid]\nlines = 7\nthresholds = 9\n")
    (tmp_path / "README.md").write_text("A line with what is\nmissing. Nothing is wrong with this sentence.\n")
    assert main(["--lower"], tmp_path) == 1
    assert "elastid: lines: 8, 1 more than the budget of 7" in capsys.readouterr().out
    lowered = tomllib.loads(path.read_text())
    assert lowered["elastid"].pop("nodes") > 30
    assert lowered["prose"] == {"pages": 1, "package": 0}
    assert {k: n for k, n in lowered["elastid"].items() if n} == {
        "lines": 7,
        "thresholds": 2,
        "sentences": 2,
        "names": 1,
    }
    path.write_text(path.read_text().replace("lines = 7", "lines = 8"))
    assert main([], tmp_path) == 0


@pytest.mark.parametrize(
    ("ratio", "repeat", "is_slower"),
    [(1.0, 1.15, False), (1.15, 1.15, True), (1.15, 1.0, False), (1.15, 1.06, False), (1.08, 1.15, True)],
)
def test_speed_fails_only_if_the_repeat_confirms_it(ratio: float, repeat: float, is_slower: bool) -> None:
    """By its interval, with errors of 3 % of each time: ratios of 1.06 with them may be the limit of 1.05."""
    rng, speed = np.random.default_rng(1), runpy.run_path(str(BENCHMARKS / "speed.py"))
    samples = [np.log(r) + 0.04 * rng.standard_normal(n) for r, n in zip((ratio, repeat), speed["PAIRS"], strict=True)]
    assert speed["is_slower"](samples, speed["LIMITS"]["base"], "fit") == is_slower
    assert speed["interval"](range(9)) == (0.5, 4, 7.5)  # the second smallest and largest mean of two, by the tables


LICENCES = runpy.run_path(str(SCRIPTS / "licences.py"))


@pytest.mark.parametrize(
    ("licence", "is_allowed"),
    [
        ("GPL-3.0-or-later", False),
        ("GNU Affero General Public License v3", False),
        ("CC-BY-NC-4.0", False),
        ("LGPL-3.0-only", True),
        ("GNU Lesser General Public License v3 or later (LGPLv3+)", True),
        ("BSD-3-Clause AND MIT", True),
    ],
)
def test_licences_that_bind_a_user_are_refused(licence: str, is_allowed: bool) -> None:
    assert (LICENCES["FORBIDDEN"].search(licence) is None) == is_allowed


def test_what_is_installed_passes(capsys: pytest.CaptureFixture[str]) -> None:
    """CasADi's LGPL is among the licences."""
    assert LICENCES["main"]() == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("casadi ") and "Lesser" in line]
