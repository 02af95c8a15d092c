"""Keys of a study: places, type in words, default and text (`Key` beside its field), for editors, terminal, pages."""

import inspect
import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from difflib import get_close_matches
from functools import cache
from textwrap import fill
from typing import Any, get_args, get_origin

from pydantic import TypeAdapter

from elastid.base.codes import codes, new_code, renamed_key
from elastid.base.display import capitalise
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.section import Key
from elastid.robot import Robot
from elastid.robot.denavit_hartenberg import DenavitHartenberg
from elastid.robot.friction_numbers import TERMS
from elastid.robot.measurement_chain import channel_meaning
from elastid.robot.urdf import UrdfRobot
from elastid.study.annotations import describe, hints_of, names_in, options_of
from elastid.study.sections import FleetSpec, Study

# The forms of a robot's file; a study names the file, or holds the robot itself.
ROBOT_FORMS = (Robot, DenavitHartenberg, UrdfRobot)
# The name under which `elastid new` writes the schema into the folder of a study, whose first line refers to it.
SCHEMA_NAME = "study.schema.json"


@dataclass(frozen=True)
class StudyKey:
    """One key of a study at one of its places, such as experiment.recorded.files[].samples.

    `[]` stands for the number of an entry, `<name>` for a name that the study chooses.  section: the class that has the
    key.  advice: when to change it, and the effect.  default: MISSING where the key is needed.
    """

    path: str
    section: type
    name: str
    annotation: Any
    text: str
    advice: str
    default: Any

    @property
    def full_advice(self) -> str:
        """The advice with its heading: a key without a default is chosen, any other is changed."""
        return f"{'How to choose it' if self.default is MISSING else 'When to change it'}: {self.advice}"


def keys_of(section: type, path: str = "") -> Iterator[StudyKey]:
    """Yield the keys of one section.  path: before their names."""
    hints = hints_of(section)
    for f in fields(section):
        key = next(mark for mark in hints[f.name].__metadata__ if isinstance(mark, Key))
        default = f.default if f.default_factory is MISSING else f.default_factory()
        yield StudyKey(path + f.name, section, f.name, hints[f.name], key.text, key.advice, default)


def keys_below(annotation: Any, path: str) -> Iterator[StudyKey]:
    """Yield every key of the sections that an annotation allows, and of those below them; path: before their names."""
    for option in options_of(annotation):
        arguments, origin = get_args(option), get_origin(option)
        if origin is tuple:
            yield from keys_below(arguments[0], f"{path[:-1]}[].")
        elif origin is dict:
            yield from keys_below(arguments[1], f"{path}<name>.")
        elif is_dataclass(option) and isinstance(option, type):
            for key in keys_of(option, path):
                yield key
                yield from keys_below(key.annotation, f"{key.path}.")


def list_keys() -> Iterator[StudyKey]:
    """Yield every key of a study and of a robot's file in each of its forms, in the order of the sections."""
    yield from keys_below(Study, "")
    for form in ROBOT_FORMS[1:]:
        yield from keys_below(form, "robot.")


def list_sections() -> Mapping[str, type]:
    """Return every class that a study is made of, by its name."""
    return {section.__name__: section for section in (Study, *ROBOT_FORMS, *(key.section for key in list_keys()))}


def text_of(section: type) -> str:
    """Return the text of a section, in one line."""
    return " ".join((inspect.getdoc(section) or "").split())


@cache
def make_schema() -> dict[str, Any]:
    """Return JSON Schema (draft 2020-12) of a study file for editors: every key with its text, unit and default."""
    document = TypeAdapter(Study).json_schema()
    definitions = document.pop("$defs")
    for form in ROBOT_FORMS:
        definition = TypeAdapter(form).json_schema()
        definitions |= definition.pop("$defs")
        definitions[form.__name__] = definition
    for name, section in list_sections().items():
        definition = document if section is Study else definitions[name]
        definition["description"] = text_of(section)
        for key in keys_of(section):
            entry = definition["properties"][key.name]
            units = f" {entry['description']}." if "description" in entry else ""
            entry["description"] = f"{key.text}{units} {key.full_advice}"
    document["properties"]["robot"] = {
        "description": document["properties"]["robot"]["description"],
        "anyOf": [{"type": "string"}, *({"$ref": f"#/$defs/{form.__name__}"} for form in ROBOT_FORMS)],
    }
    document["$defs"] = definitions
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_for_editors(document)}


def _for_editors(node: Any) -> Any:
    """Adapt a schema to editors: names such as 1 need no quotes; defaults without a JSON value are omitted."""
    if isinstance(node, list):
        return [_for_editors(item) for item in node]
    if not isinstance(node, dict):
        return node
    plain = {key: _for_editors(value) for key, value in node.items()}
    if plain.get("type") == "string" and not {"enum", "const", "pattern"} & plain.keys():
        plain["type"] = ["string", "number"]
    if any(word in str(plain.get("default", "")) for word in ("None", "inf")):  # no limit, or no value
        del plain["default"]
    return plain


def explain(query: str) -> str:
    """Return the explanation of a key by its path, or of all keys that end so; StudyError for one that does not exist.

    Names that a study chooses and numbers of entries may be given or left out: experiment.recorded.files[0].samples.
    """
    if "/" in query:
        if query not in codes():
            text = new_code(query) or f"no error or note has the code {query}; {did_you_mean(query, codes())}"
            raise StudyError("study/unknown-key", text)
        return f"{query}\n  {codes()[query].meaning}\n  {codes()[query].remedy}"
    fleet = StudyKey("fleet", FleetSpec, "fleet", FleetSpec, text_of(FleetSpec), "", MISSING)
    keys = {key.path: key for key in (*list_keys(), fleet, *keys_below(FleetSpec, "fleet."))}
    steps, target = {path: _steps(path) for path in keys}, _steps(query)
    if any(_agree(path[: len(target)], target) and path[len(target) - 1] == "<name>" for path in steps.values()):
        target = target[:-1]  # of a name the mapping that holds it
    exact = [key for path, key in keys.items() if _agree(steps[path], target)]
    matches = exact or [key for path, key in keys.items() if _agree(steps[path][-len(target) :], target)]
    if not matches and (matching_codes := [code for code in codes() if code.endswith(f"/{query}")]):
        return "\n\n".join(map(explain, matching_codes))
    if not matches:
        names = {".".join(path[-n:]): ".".join(path) for path in reversed(steps.values()) for n in (len(path), 1)}
        close = get_close_matches(".".join(target), names, n=1)
        nearest = f"did you mean '{names[close[0]]}'?" if close else f"there are {', '.join(names_in(Study))}"
        owner = "a fleet" if query.startswith("fleet.") else "a study"
        raise StudyError("study/unknown-key", renamed_key(target) or f"{owner} has no key {query}; {nearest}")
    return "\n\n".join(map(_explanation, matches))


def overview() -> str:
    """Return the sections of a study in its order, a line each, and the commands that explain more."""
    keys = list(keys_of(Study))
    width = max(len(key.name) for key in keys)
    lines = [
        fill(key.text, 100, initial_indent=f"  {key.name:<{width}}  ", subsequent_indent=" " * (width + 4))
        for key in keys
    ]
    hint = (
        "`elastid explain fit` lists the keys below one of them, `elastid explain fit.criterion` explains one.\n"
        "Keys of a robot's file are below robot (robot.bodies), of a fleet's file below fleet (fleet.members)."
    )
    return "\n".join(["A study has these keys, in this order:", *lines, hint])


def _explanation(key: StudyKey) -> str:
    below = names_in(key.annotation)
    entries = [get_args(o)[1 if get_origin(o) is dict else 0] for o in options_of(key.annotation) if get_args(o)]
    entry_keys = [name for entry in entries for name in names_in(entry)]
    text, *rule = re.split(r" \(default: ([^)]+)\)", key.text, maxsplit=1)
    default = rule[0] if rule else _default(key.default)
    paragraphs = [text + "".join(rule[1:]), f"Value: {describe(key.annotation)}.", f"Default: {default}."]
    paragraphs += [key.full_advice] if key.advice else []
    paragraphs += [f"Keys below it: {', '.join(below)}."] if below else []
    paragraphs += [f"Keys of each: {', '.join(entry_keys)}."] if entry_keys else []
    layout: dict[str, Any] = {"initial_indent": "  ", "subsequent_indent": "  ", "break_on_hyphens": False}
    return "\n".join([key.path, *(fill(paragraph, 100, **layout) for paragraph in paragraphs)])


def _default(value: Any) -> str:
    """Return a default as a study would write it.

    >>> _default((1.0, 2.0)), _default(None), _default(MISSING), _default(True)
    ('[1, 2]', 'none', 'none, it must be given', 'true')
    """
    if value is MISSING:
        return "none, it must be given"
    if value is None or value == "":
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return f"[{', '.join(_default(entry) for entry in value)}]"
    return "{}" if is_dataclass(value) or value == {} else str(value)


def _steps(path: str) -> list[str]:
    return re.sub(r"\[\d*\]", "", path).split(".")


def _agree(steps: list[str], target: list[str]) -> bool:
    return len(steps) == len(target) and all(a in ("<name>", b) for a, b in zip(steps, target, strict=True))


# Beginnings of the names of parameters, each with the key of a robot's file that holds the number.
_FAMILIES = dict(
    re.findall(
        r"(\w+)=(\S+)",
        "k=spring.stiffness d=spring.damping k2=spring.quadratic k2s=spring.symmetric_quadratic k3=spring.cubic "
        "b=spring.backlash ki=spring.inner_stiffness e=spring.rounding f=joints.viscous Jm=motor.inertia "
        "fm=motor.viscous km=motor.spring.stiffness dm=motor.spring.damping zero=joints.zero pj=joints.point "
        "m=bodies.mass c=bodies.center_of_mass I=bodies.inertia p=placement.xyz kc=coil.stiffness "
        "L0=coil.rest_length F0=gas.force h0=gas.column kappa=gas.kappa a=rod.center l=rod.length",
    )
)


def explain_parameter(name: str, robot: Robot | None = None) -> str:
    """Explain a parameter: meaning, side, joint and nominal value, or its family; empty for any other name."""
    unit, steps = ({} if robot is None else robot.numbers | robot.geometry).get(name, ("", ()))
    meaning = channel_meaning(name)
    if meaning and not steps:
        return f"{capitalise(meaning)}."
    family, _, rest = name.partition("_")
    path = ".".join(str(step) for step in steps if not isinstance(step, int)) or (rest and _FAMILIES.get(family, ""))
    for key in list_keys() if path else ():
        if key.path.replace("[]", "").endswith(f".{path}"):
            side = " Motor side." if ".motor." in key.path else " Link side." if ".joints[]." in key.path else ""
            side = "" if side.lower()[1:-1] in key.text else side
            item: Any = robot
            owners = []
            for step in steps:
                item = item[step] if isinstance(step, int) else getattr(item, step)
                owners += [f"{type(item).__name__.lower()} {item.name}"] if hasattr(item, "name") else []
            origin = f" Of {', '.join(owners)}; nominal {item:g} {unit} ({'.'.join(map(str, steps))})." if steps else ""
            return f"{f'{capitalise(meaning)}.' if meaning else key.text}{side}{origin}"
    if name == "delay":
        return "Time delay of all outputs relative to the inputs, s."
    terms = [term.meaning for term in TERMS.values() if name.startswith(f"{term.prefix}_m")]
    return f"{terms[0].capitalize()} of a motor, link side." if terms else ""
