"""Messages between processes, in which large frozen arrays and `WorkerConstant` values are sent only once.

Both ends of a pipe know the values that the other end has, by names of eight random bytes; a later message contains the
name alone. If a value is deleted in this process, the next task deletes its copy at the other end.
"""

import os
import pickle
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import fields
from io import BytesIO
from typing import Any
from weakref import WeakValueDictionary, finalize

import numpy as np

from elastid.base.large_arrays import MIN_MAPPED_BYTES, FileArray, move_to_file


class WorkerConstant:
    """Frozen dataclass that is sent to another process once, without its cached properties."""


class LostError(Exception):
    """A message names a value that this process does not have, or the worker itself is gone."""


_NAMES = dict[int, bytes]()  # by the id of a living value
_VALUES = WeakValueDictionary[bytes, Any]()  # by name
_RECEIVED: ContextVar[dict[bytes, Any]] = ContextVar("values that come with a message")


class PipeEnd:
    """This end of a pipe, with the names of the values that both ends have.

    keeps: True in a worker, which keeps received values until the other end releases them.
    """

    def __init__(self, keeps: bool) -> None:
        self._shared_names, self._keeps, self._kept_values = set[bytes](), keeps, dict[bytes, Any]()

    def pack(self, value: Any, is_first: bool = False) -> bytearray:
        """Pickle a message. is_first: first message of a task, which releases values that were deleted here."""
        deleted = [name for name in self._shared_names if name not in _VALUES] if is_first else []
        message = _Message()
        pickler = _Pickler(message, self._shared_names)
        pickler.dump(value)
        pickle.dump(deleted, message)
        self._update(pickler.new_values, deleted)
        return message

    def unpack(self, message: bytes) -> Any:
        """Decode a message from the other end; raise LostError if it names a missing value."""
        file, new_values = BytesIO(message), dict[bytes, Any]()
        token = _RECEIVED.set(new_values)
        try:
            value = pickle.load(file)
        finally:
            _RECEIVED.reset(token)
        self._update(new_values, pickle.load(file))
        return value

    def _update(self, new_values: dict[bytes, Any], deleted: list[bytes]) -> None:
        self._shared_names.difference_update(deleted)
        self._shared_names.update(new_values)
        if self._keeps:
            self._kept_values |= new_values
            for name in deleted:
                self._kept_values.pop(name, None)


class _Message(bytearray):
    """Pickled value that is sent without a copy. (A BytesIO raises an error when freed while its buffer is in use.)"""

    write = bytearray.extend


class _Pickler(pickle.Pickler):
    """Replace values that the other end has by their names; collect the others in `new_values`."""

    def __init__(self, message: _Message, shared_names: set[bytes]) -> None:
        super().__init__(message, pickle.HIGHEST_PROTOCOL)
        self._shared_names, self.new_values = shared_names, dict[bytes, Any]()

    def reducer_override(self, value: Any) -> Any:
        """Reduce a shared value to its name, a new one to its name and contents; pickle any other value as usual."""
        parts: tuple[Any, ...]
        if isinstance(value, WorkerConstant):
            parts = (_construct, type(value), {f.name: getattr(value, f.name) for f in fields(value)})  # type: ignore[arg-type]
        elif not isinstance(value, np.ndarray) or value.flags.writeable or value.nbytes < MIN_MAPPED_BYTES:
            return NotImplemented
        elif type(value) is np.ndarray and value.flags.owndata and not value.dtype.hasobject:
            parts = (_frozen, value.view())
        elif type(value) is FileArray and hasattr(value, "shared_file"):
            parts = (move_to_file, value.folder, np.array(value))
        else:
            return NotImplemented
        name = _NAMES.get(id(value)) or _register(os.urandom(8), value)
        if name in self._shared_names:
            return _recall, (name,)
        self.new_values[name] = value
        return _receive, (name, *parts)


def _register(name: bytes, value: Any) -> bytes:
    _NAMES[id(value)], _VALUES[name] = name, value
    finalize(value, _NAMES.pop, id(value)).atexit = False
    return name


def _recall(name: bytes) -> Any:
    value = _VALUES.get(name)
    if value is None:
        raise LostError
    return value


def _receive(name: bytes, make: Callable[..., Any], *parts: Any) -> Any:
    value = _VALUES.get(name)  # exists if the worker is a thread of this process
    if value is None:
        _register(name, value := make(*parts))
    _RECEIVED.get()[name] = value
    return value


def _construct(kind: type[Any], values: dict[str, Any]) -> Any:
    value = object.__new__(kind)
    value.__dict__.update(values)
    return value


def _frozen(values: Any) -> Any:
    values = values.copy(order="K")  # an unpickled array owns no memory and would not be sent by name
    values.flags.writeable = False
    return values
