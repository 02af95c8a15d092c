"""Every key of a study has a text in the annotation of its field, and advice on when to change it."""

import re
from dataclasses import make_dataclass
from difflib import SequenceMatcher
from pathlib import Path

import pytest
from plants.paths import ROOT
from plants.refusals import refused

from elastid.app import cli
from elastid.app.explanation import explain_name
from elastid.base.section import Key
from elastid.study import load
from elastid.study.annotations import describe, names_in
from elastid.study.reference import explain, keys_below, keys_of, list_keys, list_sections, make_schema, overview
from elastid.study.sections import FleetSpec, MemberSpec, Study

SECTIONS = {**list_sections(), "FleetSpec": FleetSpec, "MemberSpec": MemberSpec}
PLACES = [*list_keys(), *keys_below(FleetSpec, "fleet.")]
KEYS = {(key.section.__name__, key.name): key for key in PLACES}


def test_a_field_without_a_text_is_refused() -> None:
    """A section whose key lacks its text has no reference."""
    with pytest.raises(AttributeError):
        list(keys_of(make_dataclass("Section", [("width", float)])))


@pytest.mark.parametrize("bound", """
Gear.load -0.1; TransmissionError.amplitude 0; GearRipple.order 0; Hysteresis.deflection 0; Friction.coulomb -1
LuGre.stiffness -1; LuGre.damping -1; MaxwellSlip.attraction 0; Motor.inertia 0; Motor.viscous -1; Spring.stiffness 0
Spring.damping -1; Rod.length 0; Chain.torque_damping 0; Body.mass -1; GasSpring.column 0; GasSpring.kappa 0.9
CoilSpring.rest_length -1; ModalSpec.max_order 1; ModalSpec.exponential 0; ModalSpec.poles_hz -5; LawSpec.elements 0
ConstantVelocitySpec.count 4; PreslidingLoopsSpec.loops 2; GearsSpec.orders 0
""".strip().replace("\n", "; ").split("; "))  # fmt: skip
def test_a_number_below_the_bound_of_its_key_is_refused(bound: str) -> None:
    path, _, value = bound.partition(" ")
    key = next(mark for mark in KEYS[*path.split(".")].annotation.__metadata__ if isinstance(mark, Key))
    with pytest.raises(ValueError, match=r"^it must be "):
        key.check(float(value))


def test_the_schema_shows_the_texts() -> None:
    """Each key of each section has its text, its unit where it has one, and its advice."""
    schema = make_schema()
    for (section, name), key in KEYS.items():
        if section in ("FleetSpec", "MemberSpec"):
            continue
        definition = schema if section == "Study" else schema["$defs"][section]
        description = definition["properties"][name]["description"]
        assert description.startswith(key.text), f"{section}.{name}"
        assert description.endswith(key.advice), f"{section}.{name}"
    period = schema["$defs"]["MultisineSpec"]["properties"]["period"]["description"]
    assert f"{KEYS['MultisineSpec', 'period'].text} in s, or a text with a unit: s, ms, us, min, h." in period


def test_key_is_explained_by_path_or_end() -> None:
    """Text, type with unit, default and the keys below, with names and numbers as a study has them."""
    for path in ("excitation.band_hz", "fit.starts", "fit.parameters.<name>.start", "fit.parameters.<name>.tie"):
        key = next(key for key in PLACES if key.path == path)
        words = " ".join(explain(path.replace("<name>", "k_1")).split())
        parts = (
            path,
            *re.split(r" \(default: |\)", key.text),
            describe(key.annotation),
            key.advice,
            *names_in(key.annotation),
        )
        assert all(" ".join(part.split()) in words for part in parts)
    assert "60000 N*m/rad" in explain_name("k_2", ROOT / "configs" / "gear.yml")
    assert all("\n" in explain_name(name) for name in ("fm_1", "delay", "h_1", "e1_2"))
    channels = {explain_name(f"{name}_motor_1") for name in ("gain_kp", "gain_kd", "gain_u", "delay_r", "delay_u")}
    assert len({text.partition("\n")[2] for text in channels}) == 5
    assert explain("experiment.recorded.files[0].samples") == explain("files.samples").split("\n\n")[0]
    assert explain("fit.criterion") in explain("criterion").split("\n\n")
    assert explain("fit.parameters.k_1") == explain("fit.parameters")
    assert "Keys of each: robot, date, set." in explain("fleet.members")
    assert "Keys of each: start, bounds, fixed" in explain("fit.parameters")


@pytest.mark.parametrize(
    ("asked", "nearest"),
    [
        ("fit.critereon", "fit.criterion"),
        ("experiment.recorded.files[0].pth", "experiment.recorded.files.path"),
        ("excitaton", "excitation"),
        ("bnad_hz", "excitation.band_hz"),
    ],
)
def test_a_misspelt_key_has_a_nearest_one(asked: str, nearest: str) -> None:
    """By its path, or of a single word that of any section."""
    with refused("study/unknown-key", holds=(asked, nearest)):
        explain(asked)


def test_sections_are_listed_in_study_order() -> None:
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


@pytest.mark.parametrize("section", SECTIONS.values(), ids=lambda section: section.__name__)
def test_every_key_says_when_to_change_it(section: type) -> None:
    """Advice of whole words on this key, not its text once more."""
    keys = list(keys_of(section))
    assert [k.name for k in keys if len(k.advice.split()) < 6 or FILLER.search(k.advice)] == [], "none, or filler"
    assert [k.name for k in keys if SequenceMatcher(None, k.text, k.advice).ratio() > 0.8] == [], "an echo"


def test_advice_names_keys_that_exist() -> None:
    """`experiment.realisations` in an advice is a path of the study, or the end of one."""
    roots = set(names_in(Study)) - {"name", "seed", "filter", "report"}
    dotted = re.compile(rf"(?<![\w./])((?:{'|'.join(roots)})(?:\.[a-z_]+)+)\b")
    for key in KEYS.values():
        for path in dotted.findall(f"{key.text} {key.advice}"):
            assert explain(path), f"{key.path}: {path}"


@pytest.mark.slow
@pytest.mark.parametrize("template", ["friction", "recorded", "responses", "serial"])
def test_keys_that_a_template_proposes_can_be_set(template: str, tmp_path: Path) -> None:
    """Every line behind `Keys for further questions`, of the study and of its robot's file."""
    study = tmp_path / "new" / "study.yml"
    assert cli.run_command(["new", str(study.parent), "--template", template]) == 0
    if template == "responses":
        (study.parent / "bench.csv").touch()
    for file, prefix in ((study, ""), (study.with_name("robot.yml"), "robot.")):
        _, _, proposed = file.read_text(encoding="utf-8").partition("# Keys for further questions")
        for line in proposed.splitlines()[1:]:
            load(study, [prefix + override for override in line.removeprefix("#   ").split("  ")])
