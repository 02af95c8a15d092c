"""Every key of a study has a text beside its field, and something that gives it: a shipped file or a test."""

import re
from difflib import SequenceMatcher
from functools import cache
from pathlib import Path

import pytest

from elastid.base.errors import StudyError
from elastid.study import make_schema
from elastid.study.explanation import explain, overview
from elastid.study.fleet import FleetSpec, MemberSpec
from elastid.study.reference import advice_of, keys_below, list_keys, list_sections, names_in, texts_of
from elastid.study.sections import Study

ROOT = Path(__file__).parents[2]
KEYS = {(key.section.__name__, key.name): key for key in list_keys()}


# Tests, shipped studies and templates give a key as `key: value` in YAML, `key=value` in Python or on the command line,
# or "key" in a mapping.
GIVEN = re.compile(r"(?<!\w)(\w+)\s*[:=](?!=)|[\"'](\w+)[\"']")
GIVERS = ("tests/**/*.py", "configs/**/*.yml", "elastid/app/templates/**/*.yml")


@cache
def given_words() -> set[str]:
    texts = [file.read_text(encoding="utf-8") for givers in GIVERS for file in ROOT.glob(givers)]
    return {word for text in texts for pair in GIVEN.findall(text) for word in pair}


@pytest.mark.parametrize("section", list_sections().values(), ids=lambda section: section.__name__)
def test_every_key_has_a_text_and_is_given_somewhere(section: type) -> None:
    """A text in the docstring of its section, as `key: text`; and a shipped study or a test that uses it."""
    own, texts = texts_of(section)
    names = [name for of, name in KEYS if of == section.__name__]
    assert own, f"{section.__name__}: say what it is before its keys"
    assert [name for name in names if " " not in texts.get(name, "")] == [], "without a text"
    assert [name for name in names if name not in given_words()] == [], "in no test and no shipped study"


def test_the_schema_shows_the_texts() -> None:
    """Each key of each section has its text, its unit where it has one, and its advice."""
    schema = make_schema()
    for (section, name), key in KEYS.items():
        definition = schema if section == "Study" else schema["$defs"][section]
        description = definition["properties"][name]["description"]
        assert description.startswith(key.text), f"{section}.{name}"
        assert description.endswith(key.advice), f"{section}.{name}"
    period = schema["$defs"]["MultisineSpec"]["properties"]["period"]["description"]
    assert period.startswith(
        "of the multisine; the lines are 1/period apart. in s, or a text with a unit: s, ms, us, min, h."
    )


def test_a_text_ends_where_the_next_begins() -> None:
    """Several keys share a text; a colon within a sentence, or after a word that is no key, begins none."""

    class Section:
        """A thing.  Further words.

        left, right: both ends (such as
        left: mine).  other: no key.
        width: of it.

        More on the thing.
        """

    Section.__annotations__ = {"left": float, "right": float, "width": float}
    from elastid.base.section import section

    own, texts = texts_of(section(Section))
    both = "both ends (such as left: mine). other: no key."
    assert own == "A thing. Further words. More on the thing."
    assert texts == {"left": both, "right": both, "width": "of it."}


def test_a_key_knows_its_places() -> None:
    """Entries of lists and names that a study chooses have a sign of their own."""
    paths = {key.path for key in list_keys()}
    assert {"seed", "experiment.recorded.files[].samples", "fit.parameters.<name>.tie.to"} <= paths
    assert {"robot.bodies[].joints[].motor.ratio", "robot.links[].joint.axis", "robot.urdf"} <= paths


def test_a_key_is_explained_by_its_path_or_by_its_end() -> None:
    """Text, type with unit, default and the keys below, with names and numbers as a study has them."""
    band = explain("excitation.band_hz")
    assert band.splitlines()[0] == "excitation.band_hz"
    assert "each a number in Hz" in band
    assert "none, it must be given" in band
    assert "\n  How to choose it: " in band
    assert "\n  When to change it: more where few of them reach the optimum" in explain("fit.starts")
    assert explain("fit.parameters.k_1.start").startswith("fit.parameters.<name>.start")
    assert "Keys below it: to, factor" in explain("fit.parameters.k_1.tie")
    assert explain("experiment.recorded.files[0].samples") == explain("files.samples").split("\n\n")[0]
    assert explain("fit.criterion") in explain("criterion").split("\n\n")
    assert explain("fit.parameters.k_1") == explain("fit.parameters")
    assert "Keys of each: robot, date, set." in explain("fleet.members")
    assert "Keys of each: start, bounds, fixed" in explain("fit.parameters")


@pytest.mark.parametrize(
    ("asked", "nearest"),
    [
        ("fit.critereon", "did you mean 'fit.criterion'?"),
        ("fit.parameters.k_1.strt", "did you mean 'fit.parameters.k_1.start'?"),
        ("experiment.recorded.files[0].pth", "did you mean 'experiment.recorded.files.path'?"),
        ("excitaton", "did you mean 'excitation'?"),
        ("bnad_hz", "did you mean 'excitation.band_hz'?"),
        ("model.qqq", "there are model.formulation, model.variant, model.independent"),
        ("qqq", "there are name, "),
        ("fit.parametrs.k_1.start", "did you mean 'fit.parameters'?"),
    ],
)
def test_a_misspelt_key_has_a_nearest_one(asked: str, nearest: str) -> None:
    """At the step where its path stops to exist; of a single word that of any section."""
    with pytest.raises(StudyError) as refusal:
        explain(asked)
    assert f"a study has no key {asked}; {nearest}" in str(refusal.value)


def test_without_a_key_the_sections_are_listed_in_the_order_of_a_study() -> None:
    """Each with its text; every shipped study keeps that order."""
    order = [line.split()[0] for line in overview().splitlines() if re.match(r"  \w", line)]
    assert sorted(order) == sorted(names_in(Study))
    for file in (ROOT / "configs").glob("*.yml"):
        given = [line.split(":")[0] for line in file.read_text().splitlines() if re.match(r"\w+:", line)]
        assert sorted(given, key=order.index) == given, file.name


# Advice that fits every key says nothing of one.
FILLER = re.compile(
    r"\b(if|when|where|as) (it is |this is |you )?(need(ed)?|necessary|required|appropriate|desired|want(ed)?)\b"
    r"|as (you|one) (like|wish|please)|seldom changed|usually left|leave (it )?(alone|as it is)|default is fine",
    re.IGNORECASE,
)


@pytest.mark.parametrize("section", [*list_sections().values(), FleetSpec, MemberSpec], ids=lambda of: of.__name__)
def test_every_key_says_when_to_change_it(section: type) -> None:
    """Advice behind ` -- ` in the docstring of its section: whole words on this key, not its text once more."""
    advice = advice_of(section)
    keys = [key for key in keys_below(section, "") if key.section is section]
    assert [key.name for key in keys if key.name not in advice] == [], "without advice"
    assert [name for name, words in advice.items() if len(words.split()) < 6 or FILLER.search(words)] == [], "filler"
    assert [key.name for key in keys if SequenceMatcher(None, key.text, key.advice).ratio() > 0.8] == [], "an echo"


def test_no_advice_is_given_twice() -> None:
    """One sentence for many keys is filler; keys that share one text within a section share its advice."""
    given: dict[str, set[tuple[str, str]]] = {}
    for key in (*KEYS.values(), *keys_below(FleetSpec, "")):
        section = key.section.__name__
        for sentence in re.split(r"(?<=\.)\s+", key.advice.rstrip(".")) if key.advice else ():
            given.setdefault(sentence.rstrip("."), set()).add((section, key.text))
    assert {sentence: where for sentence, where in given.items() if len(where) > 1} == {}


def test_advice_names_keys_that_exist() -> None:
    """`experiment.realisations` in an advice is a path of the study, or the end of one."""
    roots = set(names_in(Study)) - {"name", "seed", "filter", "report"}
    dotted = re.compile(rf"(?<![\w./])((?:{'|'.join(roots)})(?:\.[a-z_]+)+)\b")
    for key in KEYS.values():
        for path in dotted.findall(f"{key.text} {key.advice}"):
            assert explain(path), f"{key.path}: {path}"
