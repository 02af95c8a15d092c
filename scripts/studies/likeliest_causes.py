"""Test if the fit names the true cause of a model error first, and never names a wrong cause as certain.

    python scripts/studies/likeliest_causes.py [--quick] [--only WORD] [--clean 50] [--seed 0] [--jobs 2]

Each cause of `causes.py` and `workshop.py` is injected alone into exact responses of robots with two, three and six
axes and of a linkage, at about 40 DFT lines with 0.5 % noise. For `workshop.py`, every second robot also has data-sheet
errors. The fit uses the robot model with default tolerances, or without tolerances if the cause is_exact. A row has the
injected cause, the first cause of the fit, the verdict, the certainty, the explained fraction of the excess of V, the
drop of V, the status, and the largest error of a stiffness relative to half of its interval. Verdicts:

- right: the first cause is the injected cause.
- apart: the sentence names the injected cause as indistinguishable from the first cause.
- within: no cause is named, and the error of every stiffness is below SILENT half intervals.
- stated: no cause is named, and the note on fixed values contains a parameter of the injected kind.
- none: no cause is named, for any other result.
- doubt: the injected cause has no hypothesis, and the first cause is not certain.
- wrong: another cause is named.  A cause is certain if it explains CERTAIN of the excess, and no indistinguishable
  cause is named with it.

The script also fits clean data sets of the same robots. It asserts that verdicts other than `wrong` and `none` are at
least 90 % of all, that no wrong cause is certain, that no converged fit has the verdict `none`, and that at most 1 % of
the clean data sets have a cause.  The last line is one JSON object.

The default tolerances absorb a payload of 3 kg on two axes completely.
"""

import json
import math
from collections import Counter
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatch
from functools import cache, partial

import study_run
import numpy as np
from causes import FURTHER, INJECTIONS
from plants.two_mass import drawn
from study_plants import PLANTS, Plant, exact_responses, within_data_sheet
from workshop import workshop

from elastid.base.execution import Execution
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.response import Response
from elastid.robot import Tolerances

CERTAIN = LIMITS.certain_fraction
NOISE, MIN_NAMED, STARTS, SILENT = 0.005, 0.9, 2, 2.0
QUICK = ("torque constant 2 20 % off two-axis", "drive 2 late by 1 ms two-axis", "last u channels swapped linkage")


@dataclass(frozen=True)
class Row:
    """Result of a fit with an injected cause."""

    cause: str
    robot: str
    first: str
    verdict: str
    is_certain: bool
    share: float
    drop: float
    status: str
    alike: tuple[str, ...]
    off: float


@cache
def plant(name: str) -> Plant:
    """Return the plant of a name with about 40 lines, built once per process; more lines do not change the causes."""
    of = PLANTS[name]()
    return replace(of, freq_hz=of.freq_hz[:: math.ceil(len(of.freq_hz) / 40)])


EVERY = (*INJECTIONS, *FURTHER, *workshop({name: plant(name) for name in PLANTS}))


def add_noise(responses: list[Response], rng: np.random.Generator) -> list[Response]:
    """Add circular noise of known variance to responses."""
    data = []
    for G in responses:
        values, total = drawn(G.G, NOISE * np.abs(G.G) + 0.1 * NOISE * np.abs(G.G).max(axis=0), rng)
        data.append(replace(G, G=values, total=total))
    return data


def fit_model(of: Plant, data: list[Response], is_exact: bool = False) -> Result:
    """Fit the plant's robot model to data with the options of a study."""
    robot = of.robot if is_exact else replace(of.robot, tolerances=Tolerances())
    return identify(data, robot, replace(of.spec, seed=1, starts=STARTS), model=of.model)


def judge(number: int, seed: int) -> Row:
    """Fit the responses with the injected cause of an index, and classify the cause that the fit names."""
    injection = EVERY[number]
    of, rng = plant(injection.plant), np.random.default_rng([seed, number])
    true = replace(of, robot=within_data_sheet(of.robot, rng)) if injection.is_off_sheet else of
    data = add_noise(injection.responses(true), rng)
    model = of.robot if injection.has_payload else replace(of.robot, payload=None)
    result = fit_model(replace(of, robot=model), data, injection.is_exact)
    off = _off(true, result)
    first = next((index for index in result.indices if index.place == 1), None)
    if first is None or not any(note.code == "fit/likely-cause" for note in result.notes):
        text, family = _other(result), injection.right[0].partition("_")[0] if injection.right else ""
        fixed = " ".join(note.text for note in result.notes if note.code == "fit/fixed-values")
        silent = "within" if off <= SILENT else "stated" if family and f"{family}_" in fixed else "none"
        verdict = silent if result.status == "converged" else "none"
        return Row(injection.name, injection.plant, text, verdict, False, 0.0, 0.0, result.status, (), off)

    def is_right(name: str) -> bool:
        return any(fnmatch(name, pattern) for pattern in injection.right)

    named = first.alike[: LIMITS.n_named]
    is_certain = first.explained_fraction >= CERTAIN and not first.alike
    wrong = "wrong" if injection.right or is_certain else "doubt"
    verdict = "right" if is_right(first.name) else "apart" if any(map(is_right, named)) else wrong
    about = injection.name, injection.plant, first.name, verdict, is_certain
    return Row(*about, float(first.explained_fraction), float(first.drop), result.status, named, off)


def _other(result: Result) -> str:
    """Return the first note on a cause that is not ranked by V; else an empty text."""
    codes = ("fit/inconsistent-responses", "fit/frequency-unit")
    return next((f"{note.code}: {str(note)[:90]}" for note in result.notes if note.code in codes), "")


def _off(of: Plant, result: Result) -> float:
    """Return the largest error of a stiffness relative to the half of its interval on the side of the true value."""
    truth, worst = of.robot.parameters(), 0.0
    for name in (p.name for p in result.parameters.of_interest if p.name.startswith("k_")):
        value, (low, high) = result.values[name], result.interval(name)
        end = low if truth[name][0] < value else high
        worst = max(worst, abs(value - truth[name][0]) / max(abs(value - end), 1e-12 * value))
    return worst


def names_a_cause(number: int, seed: int) -> bool:
    """Return True if the fit of a clean data set names a cause; number: selects robot and noise."""
    of = plant(("two-axis", "demo")[number % 2])
    data = add_noise(exact_responses(of), np.random.default_rng([seed, 1, number]))
    return any(note.code == "fit/likely-cause" for note in fit_model(of, data).notes)


def main() -> None:
    """Print a JSON row for each cause, then one JSON object."""
    options = study_run.options(__doc__, "three causes, and one clean data set", only="", clean=50, seed=0, jobs=2)
    named = [(n, f"{i.name} {i.plant}") for n, i in enumerate(EVERY)]
    chosen = [n for n, words in named if options.only in words and (words in QUICK or not options.quick)]
    rows = []
    for _, row in Execution(options.jobs).unordered(partial(judge, seed=options.seed), chosen):
        rows.append(asdict(row))
        print(json.dumps(rows[-1]), flush=True)
    counts = Counter(row["verdict"] for row in rows)
    wrong = [row["cause"] for row in rows if row["verdict"] == "wrong" and row["is_certain"]]
    silent = [row["cause"] for row in rows if row["verdict"] == "none" and row["status"] == "converged"]
    clean = 1 if options.quick else 0 if options.only else options.clean
    alarms = sum(Execution(options.jobs).ordered(partial(names_a_cause, seed=options.seed), range(clean)))
    total = len(rows) - counts["wrong"] - counts["none"]
    assert options.only or total >= MIN_NAMED * len(rows), counts
    assert not wrong, wrong
    assert not silent, silent
    assert alarms <= 0.01 * clean, alarms
    print(json.dumps({"causes": len(rows), "verdicts": counts, "wrong and certain": wrong, "clean": clean,
                      "false alarms": alarms, "rows": rows}))  # fmt: skip


if __name__ == "__main__":
    main()
