"""Values that go to another process once: large frozen arrays, and instances of `Kept`, which stay there as here.

Both ends of a pipe know what the other one has by names. What is gone here is forgotten there with the next work.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import fields
from io import BytesIO
from typing import Any
from weakref import WeakValueDictionary, finalize

import numpy as np

from elastid.base.arrays import MIN_PART_BYTES, FileArray, kept_in


class Kept:
    """A frozen dataclass that goes to another process once, without what was worked out of its fields."""


class LostError(Exception):
    """The other end names a value that is not here, or no longer."""


_NAMES = dict[int, bytes]()  # by the identity of what lives
_VALUES = WeakValueDictionary[bytes, Any]()
_ARRIVED: ContextVar[dict[bytes, Any]] = ContextVar("values that come with a message")


class End:
    """This end of a pipe: what the other one has; keeps: whether what comes stays until the other end forgets it."""

    def __init__(self, keeps: bool) -> None:
        self._known, self._keeps, self._held = set[bytes](), keeps, dict[bytes, Any]()

    def packed(self, value: Any, is_first: bool = False) -> memoryview:
        """A message to the other end; is_first: of a work, with which that end forgets what is gone here."""
        gone = [name for name in self._known if name not in _VALUES] if is_first else []
        file = BytesIO()
        pickler = _Pickler(file, self._known)
        pickler.dump(value)
        pickle.dump(gone, file)
        self._has(pickler.new, gone)
        return file.getbuffer()

    def unpacked(self, message: bytes) -> Any:
        """The value of a message from the other end; LostError where it names what is not here."""
        file, arrived = BytesIO(message), dict[bytes, Any]()
        token = _ARRIVED.set(arrived)
        try:
            value = pickle.load(file)
        finally:
            _ARRIVED.reset(token)
        self._has(arrived, pickle.load(file))
        return value

    def _has(self, new: dict[bytes, Any], gone: list[bytes]) -> None:
        self._known.difference_update(gone)
        self._known.update(new)
        if self._keeps:
            self._held |= new
            for name in gone:
                self._held.pop(name, None)


class _Pickler(pickle.Pickler):
    """Names in place of what the other end has; new: what it is given."""

    def __init__(self, file: BytesIO, known: set[bytes]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._known, self.new = known, dict[bytes, Any]()

    def reducer_override(self, value: Any) -> Any:
        """The name of a value that the other end has; of one that stays there its parts, too."""
        parts: tuple[Any, ...]
        if isinstance(value, Kept):
            parts = (_made, type(value), {f.name: getattr(value, f.name) for f in fields(value)})  # type: ignore[arg-type]
        elif not isinstance(value, np.ndarray) or value.flags.writeable or value.nbytes < MIN_PART_BYTES:
            return NotImplemented
        elif type(value) is np.ndarray and value.flags.owndata and not value.dtype.hasobject:
            parts = (_frozen, value.view())
        elif type(value) is FileArray and hasattr(value, "room"):
            parts = (kept_in, value.folder, np.array(value))
        else:
            return NotImplemented
        name = _NAMES.get(id(value)) or _named(os.urandom(8), value)
        if name in self._known:
            return _recalled, (name,)
        self.new[name] = value
        return _arrived, (name, *parts)


def _named(name: bytes, value: Any) -> bytes:
    _NAMES[id(value)], _VALUES[name] = name, value
    finalize(value, _NAMES.pop, id(value)).atexit = False
    return name


def _recalled(name: bytes) -> Any:
    value = _VALUES.get(name)
    if value is None:
        raise LostError
    return value


def _arrived(name: bytes, make: Callable[..., Any], *parts: Any) -> Any:
    value = _VALUES.get(name)  # as in a worker that is a thread of this process
    if value is None:
        _named(name, value := make(*parts))
    _ARRIVED.get()[name] = value
    return value


def _made(of: type[Any], values: dict[str, Any]) -> Any:
    value = object.__new__(of)
    value.__dict__.update(values)
    return value


def _frozen(values: Any) -> Any:
    values = values.copy(order="K")  # what comes by pickle owns no memory, and would not be known
    values.flags.writeable = False
    return values
