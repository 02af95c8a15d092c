"""Array types of signatures, and values that cannot be edited; letters F, Q, n_y, n_u ... in docstrings are shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias, TypeVar, cast, dataclass_transform, overload

import numpy as np
from numpy.typing import NDArray

from elastid.base.label import labelled

FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]


def frozen(array: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy of an array, unless it is read-only already: a copy like that, or mapped from a file."""
    is_frozen = isinstance(array, np.ndarray) and not array.flags.writeable and array.dtype == dtype
    if is_frozen and (isinstance(array, np.memmap) or (type(array) is np.ndarray and array.flags.owndata)):
        return cast(NDArray[Any], array)
    copy = np.array(array, dtype=dtype)
    copy.flags.writeable = False
    return copy


_DTYPES: dict[str, type] = {
    "FloatArray": np.float64,
    "ComplexArray": np.complex128,
    "BoolArray": np.bool_,
    "IntArray": np.int64,
}
T = TypeVar("T")


@overload
@dataclass_transform(frozen_default=True, field_specifiers=(field, labelled))
def frozen_value(cls: type[T], /) -> type[T]: ...


@overload
@dataclass_transform(frozen_default=True, field_specifiers=(field, labelled))
def frozen_value(*, eq: bool) -> Callable[[type[T]], type[T]]: ...


def frozen_value(cls: type[T] | None = None, /, *, eq: bool = True) -> type[T] | Callable[[type[T]], type[T]]:
    """A frozen dataclass whose array fields are read-only copies of the given arrays, made before its `__post_init__`.

    An array field is one annotated FloatArray, ComplexArray, BoolArray or IntArray, alone or with `| None`; the
    annotation gives the dtype.
    """

    def decorated(cls: type[T]) -> type[T]:
        """The class as such a dataclass."""
        names = {name: _DTYPES.get(str(text).removesuffix(" | None")) for name, text in cls.__annotations__.items()}
        arrays = {name: dtype for name, dtype in names.items() if dtype is not None}
        check: Callable[[T], None] | None = cls.__dict__.get("__post_init__")

        def freeze(self: T) -> None:
            """Freeze the arrays, then check."""
            for name, dtype in arrays.items():
                value = getattr(self, name)
                if value is not None:
                    object.__setattr__(self, name, frozen(value, dtype))
            if check is not None:
                check(self)

        cls.__post_init__ = freeze  # type: ignore[attr-defined]
        return dataclass(frozen=True, eq=eq)(cls)

    return decorated if cls is None else decorated(cls)
