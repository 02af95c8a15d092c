"""Values that go to another process once: large frozen arrays, and instances of `Kept`, which stay there as here.

Both ends of a pipe know what the other one has by names. A value that dies where it was made, or where it first came
from, is forgotten at the other end with the next message.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import fields
from io import BytesIO
from typing import Any
from weakref import WeakSet, WeakValueDictionary, finalize

import numpy as np

from elastid.base.arrays import FileArray, kept_in

# Bytes of an array from which on a name is shorter.
MIN_BYTES = 1 << 12


class Kept:
    """A frozen dataclass that goes to another process once, without what was worked out of its fields."""


class LostError(Exception):
    """The other end names a value that is not here, or no longer."""


_NAMES = dict[int, bytes]()  # by the identity of what lives
_VALUES = WeakValueDictionary[bytes, Any]()
_ENDS = WeakSet["End"]()
_ARRIVED: ContextVar[dict[bytes, Any]] = ContextVar("values that come with a message")


class End:
    """This end of a pipe: what the other one has; keeps: whether what comes stays until the other end forgets it."""

    def __init__(self, keeps: bool) -> None:
        self.known, self._gone = set[bytes](), list[bytes]()
        self._keeps, self._held = keeps, dict[bytes, Any]()
        _ENDS.add(self)

    def packed(self, value: Any) -> memoryview:
        """A message to the other end."""
        file = BytesIO()
        pickler = _Pickler(file, self.known)
        pickler.dump(value)
        gone, self._gone = self._gone, []
        pickle.dump(gone, file)
        self.known.update(pickler.new)
        if self._keeps:
            self._held |= pickler.new
        return file.getbuffer()

    def unpacked(self, message: bytes) -> Any:
        """The value of a message from the other end; LostError where it names what is not here."""
        file, arrived = BytesIO(message), dict[bytes, Any]()
        token = _ARRIVED.set(arrived)
        try:
            value = pickle.load(file)
        finally:
            _ARRIVED.reset(token)
        for name in pickle.load(file):
            self._held.pop(name, None)
            self.known.discard(name)
        self.known |= arrived.keys()
        if self._keeps:
            self._held |= arrived
        return value

    def forget(self, name: bytes) -> None:
        """Tell the other end with the next message that a value is gone."""
        if name in self.known:
            self.known.discard(name)
            self._gone.append(name)


class _Pickler(pickle.Pickler):
    """Names in place of what the other end has; new: what it is given."""

    def __init__(self, file: BytesIO, known: set[bytes]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._known, self.new = known, dict[bytes, Any]()

    def reducer_override(self, value: Any) -> Any:
        parts: tuple[Any, ...]
        if isinstance(value, Kept):
            parts = (_made, type(value), {f.name: getattr(value, f.name) for f in fields(value)})  # type: ignore[arg-type]
        elif not isinstance(value, np.ndarray) or value.flags.writeable or value.nbytes < MIN_BYTES:
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
    finalize(value, _forget, id(value), name).atexit = False
    return name


def _forget(key: int, name: bytes) -> None:
    del _NAMES[key]
    for end in list(_ENDS):
        end.forget(name)


def _recalled(name: bytes) -> Any:
    value = _VALUES.get(name)
    if value is None:
        raise LostError
    return value


def _arrived(name: bytes, make: Callable[..., Any], *parts: Any) -> Any:
    value = _VALUES.get(name)  # as in a worker that is a thread of this process
    if value is None:
        value = make(*parts)
        _named(name, value)
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
