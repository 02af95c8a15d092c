"""Array types, elementary functions of arrays, and frozen dataclasses of read-only arrays with labels."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, TypeAlias, TypeVar, cast, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from elastid.base.large_arrays import LargeArray

FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]
Signals = TypeVar("Signals", FloatArray, ComplexArray)
NEIGHBOURS = 9  # rows over which powers and noise are averaged


def laplace_variable(freq_hz: NDArray[np.floating[Any]]) -> ComplexArray:
    """Return s = 2 pi j f in rad/s, of the shape of the frequencies."""
    return (2j * np.pi * freq_hz).astype(np.complex128)


def quotient(a: FloatArray | float, b: FloatArray, otherwise: float = 0.0) -> FloatArray:
    """Return a / b where b is positive, else `otherwise`."""
    return np.asarray(np.divide(a, b, out=np.full(np.broadcast_shapes(np.shape(a), b.shape), otherwise), where=b > 0))


def fold_periods(x: Signals, N: int) -> Signals:
    """Return the whole periods (P, N, ...) of N rows each in x (n, ...), without the remainder at the end."""
    P = len(x) // N
    return x[: P * N].reshape(P, N, *x.shape[1:])


def values_by_name(names: Iterable[str], values: FloatArray) -> dict[str, float]:
    """Return values (n,) by their names."""
    return dict(zip(names, values.tolist(), strict=True))


def true_runs(flags: BoolArray, min_length: int = 1) -> IntArray:
    """Return the first index and the end (k, 2) of each run of at least `min_length` true flags (n,)."""
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)
    return bounds[bounds[:, 1] - bounds[:, 0] >= min_length]


def smallest_step(x: FloatArray) -> float:
    """Return the smallest difference between values of x (n,) that exceeds 1e-7 of its range; 0 for equal values."""
    steps = np.diff(np.unique(x))
    return float(np.min(steps[steps > 1e-7 * np.ptp(x)])) if len(steps) else 0.0


def mean_of_neighbours(values: Signals, width: int = NEIGHBOURS) -> Signals:
    """Return the moving mean (F, ...) of values (F, ...) over an odd number of rows, over fewer rows at both ends."""
    F, half = len(values), width // 2
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    first, end = np.maximum(np.arange(F) - half, 0), np.minimum(np.arange(F) + half + 1, F)
    return np.asarray((total[end] - total[first]) / (end - first).reshape(-1, *(1,) * (values.ndim - 1)))


def interpolate(x: FloatArray | IntArray, lines: FloatArray | IntArray, values: Signals) -> Signals:
    """Interpolate values (F, ...) at increasing `lines` (F,) linearly to x (K,); extrapolate beyond the ends."""
    right = np.clip(np.searchsorted(lines, x), 1, len(lines) - 1)
    fraction = (x - lines[right - 1]) / np.maximum(lines[right] - lines[right - 1], 1e-300)
    fraction = fraction.reshape(-1, *(1,) * (values.ndim - 1))
    return (1 - fraction) * values[right - 1] + fraction * values[right]


@dataclass(frozen=True)
class Label:
    """Meaning of a field, its unit, and its layout in a result file.

    unit: SI; `{name}` in it stands for an attribute of the value, or of a value that contains it. Default: the unit in
    the ending of the field's name (_hz, _s).  axes: one name per dimension: a field or property with the values along
    this axis, or the name of an index.  rows: a tuple or mapping of values is written as a table of stacked columns.
    entry: attribute that names each value of a tuple.
    """

    text: str = ""
    unit: str = ""
    axes: tuple[str, ...] = ()
    rows: bool = False
    entry: str = ""


NO_LABEL = Label()
_UNIT_OF_ENDING = {"hz": "Hz", "s": "s", "deg": "deg", "degc": "degC", "db": "dB"}


def labelled(
    text: str = "", unit: str = "", axes: str = "", rows: bool = False, entry: str = "", **default: Any
) -> Any:
    """Declare a dataclass field with a label: `x: FloatArray = labelled("angle", "rad", "time_s inputs")`.

    axes: names with a space between them.  default: as of `dataclasses.field`.
    """
    return field(metadata={"label": Label(text, unit, tuple(axes.split()), rows, entry)}, **default)


def unit_of_name(name: str) -> str:
    """Return the unit in the ending of a name.

    >>> unit_of_name("rate_hz"), unit_of_name("message")
    ('Hz', '')
    """
    return _UNIT_OF_ENDING.get(name.rpartition("_")[2], "") if "_" in name else ""


def frozen(array: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """Return a read-only copy of an array; the array itself if it is such a copy, a slice of a copy, or mapped."""
    if isinstance(array, LargeArray):
        return cast("NDArray[Any]", array)
    if isinstance(array, np.ndarray) and not array.flags.writeable and array.dtype == dtype:
        owner = array if array.base is None else array.base
        is_plain = type(array) is type(owner) is np.ndarray and owner.flags.owndata and not owner.flags.writeable
        if is_plain or isinstance(array, np.memmap):
            return cast("NDArray[Any]", array)
    copy = np.array(array, dtype=dtype)
    copy.flags.writeable = False
    return copy


_DTYPES: dict[str, type] = {
    "FloatArray": np.float64,
    "ComplexArray": np.complex128,
    "BoolArray": np.bool_,
    "IntArray": np.int64,
}
# Annotations are strings in modules with `from __future__ import annotations` and types in all others.
_DTYPES |= {str(NDArray[dtype]): dtype for dtype in [*_DTYPES.values()]}  # type: ignore[valid-type]
T = TypeVar("T")


@dataclass_transform(frozen_default=True, field_specifiers=(field, labelled))
def frozen_value(cls: Any = None, /, *, eq: bool = True) -> Any:
    """Make a frozen dataclass whose array fields are read-only copies, made before its `__post_init__`.

    An array field is annotated as FloatArray, ComplexArray, BoolArray or IntArray, alone or with `| None`; this gives
    its dtype.
    """

    def freeze_arrays(cls: type[T]) -> type[T]:
        """Return the dataclass, which copies its arrays before each call of its `__post_init__`."""
        names = {name: _DTYPES.get(str(text).removesuffix(" | None")) for name, text in cls.__annotations__.items()}
        arrays = {name: dtype for name, dtype in names.items() if dtype is not None}
        check: Callable[[T], None] | None = getattr(cls, "__post_init__", None)

        def freeze(self: T) -> None:
            for name, dtype in arrays.items():
                value = getattr(self, name)
                if value is not None:
                    object.__setattr__(self, name, frozen(value, dtype))
            if check is not None:
                check(self)

        cls.__post_init__ = freeze  # type: ignore[attr-defined]
        return dataclass(frozen=True, eq=eq)(cls)

    return freeze_arrays if cls is None else freeze_arrays(cls)
