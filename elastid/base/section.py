"""Sections of a study: frozen dataclasses (`@section`) whose fields are keys with texts and bounds (`Key`).

Each section is declared in the package that uses it and is independent of YAML; `elastid.study` collects them.
"""

from collections.abc import Iterator
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, field, fields
from functools import cache, wraps
from itertools import pairwise
from operator import ge, gt, le, lt
from typing import Any, TypeVar, dataclass_transform, get_args, get_origin

from elastid.base.names import check_different

T = TypeVar("T")

_in_validator = ContextVar("_in_validator", default=False)  # False while pydantic makes texts or a JSON schema
# coerce_numbers_to_str: a name such as 1 needs no quotes.
_CONFIG = {"extra": "forbid", "coerce_numbers_to_str": True, "allow_inf_nan": False}


@dataclass(frozen=True)
class Key:
    """Text of a key of a study, in the annotation of its field: `Annotated[Time, Key("Period of ...", "longer ...")]`.

    text: the meaning; its first sentence needs no context.  advice: when to change the key, and the effect of it.
    above, least, most, below: bounds of its number, or of each of several; None for any.  distinct: no value is given
    twice.  rising: each number exceeds the one before.  filled: a list has at least one entry.
    """

    text: str
    advice: str
    above: float | None = None
    least: float | None = None
    most: float | None = None
    below: float | None = None
    distinct: bool = False
    rising: bool = False
    filled: bool = False

    def check(self, value: Any) -> Any:
        """Return the value of the key; ValueError for a number out of bounds and for names that are almost equal."""
        if isinstance(value, dict):
            check_different("name", map(str, value))
        if self.filled and value == ():
            raise ValueError("it is empty; list at least one entry")
        if self.distinct and isinstance(value, tuple) and len({*value}) < len(value):
            repeated = next(entry for entry in value if value.count(entry) > 1)
            raise ValueError(f"{repeated} is given twice; leave one out")
        if self.rising and value is not None and any(not low < high for low, high in pairwise(value)):
            raise ValueError("the numbers must increase, as [lowest, highest]")
        bounds = (("above", self.above, gt), ("at least", self.least, ge), ("at most", self.most, le))
        for number in _numbers(value):
            for words, bound, is_within in (*bounds, ("below", self.below, lt)):
                if bound is not None and not is_within(number, bound):
                    raise ValueError(f"it must be {words} {bound:g}")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return the pydantic schema of the field; a nested section has a separate validator, built at first use."""
        from pydantic_core import core_schema  # value types stay free of pydantic

        types = (source, *get_args(source))
        # An instance of a section, or None where allowed, needs no validator, which takes time to build.
        valid_types = () if get_origin(source) in (tuple, dict) else types
        nested = core_schema.no_info_plain_validator_function(
            lambda value: value if type(value) in valid_types else validator(source).validate_python(value)
        )
        has_section = any(hasattr(type_, "__pydantic_config__") for type_ in types)
        schema = nested if has_section and _in_validator.get() else handler(source)
        return core_schema.no_info_after_validator_function(self.check, schema)


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, tuple):
        for entry in value:
            yield from _numbers(entry)
    elif isinstance(value, int | float):
        yield value


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def section(cls: type[T]) -> type[T]:
    """Make a frozen dataclass whose fields are the keys of a section, with types checked by their annotations.

    In Python it accepts the values of a study, and an array for a tuple; ValueError names the first invalid field.
    """
    section_class: Any = dataclass(frozen=True)(cls)
    plain_init = section_class.__init__
    has_required_keys = any(f.default is f.default_factory for f in fields(section_class))  # both are MISSING

    @wraps(plain_init)  # the signature that a prompt shows
    def __init__(self: T, *values: Any, **keys: Any) -> None:
        if not (values or keys or has_required_keys):
            plain_init(self)
            return
        from pydantic_core import ArgsKwargs, ValidationError

        try:
            validator(section_class).validate_python(ArgsKwargs(values, keys), self_instance=self)
        except ValidationError as error:
            first = error.errors()[0]
            message, steps = first["msg"].removeprefix("Value error, "), list(first["loc"])
            if steps and isinstance(steps[0], int):  # a positional argument
                steps[0] = section_class.__match_args__[steps[0]]
            text = f"{'.'.join(map(str, steps))}: {message} (got {first['input']!r:.60})" if steps else message
            raise ValueError(text) from None

    section_class.__init__ = __init__
    section_class.__pydantic_config__ = _CONFIG
    return section_class  # type: ignore[no-any-return]


@cache
def validator(section: Any) -> Any:
    """Return pydantic's validator of a section, or of a union with sections; building one takes time."""
    from pydantic import TypeAdapter  # a slow import

    context = copy_context()
    context.run(_in_validator.set, True)
    return context.run(TypeAdapter, section).validator
