"""Any value of frozen dataclasses comes back equal from HDF5 and JSON; a damaged file ends in a sentence or a value."""

import itertools
import json
import math
import random
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import h5py
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import array_shapes, arrays
from plants.artefacts import STAMP, TEXT, same
from typing_extensions import TypeAliasType

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.errors import DataError
from elastid.store.files import write_checksum
from elastid.store.kinds import from_json, json_value, or_text
from elastid.store.reading import read_part
from elastid.store.writing import write_artefact, write_value

QUICK = settings(deadline=None, max_examples=15)


NAME = TEXT.filter(bool)


Scalar = TypeVar("Scalar", bound=np.generic)
# As numpy.typing has it from NumPy 2.5 and Python 3.12 on.
Alias = TypeAliasType("Alias", np.ndarray[Any, np.dtype[Scalar]], type_params=(Scalar,))


@dataclass(frozen=True)
class Leaf:
    name: str
    count: int
    share: float
    is_on: bool
    mode: Literal["a", "b"]
    limit: float | None
    band: tuple[float, float]
    lines: tuple[int, ...]
    places: tuple[str, ...] = ()


@dataclass(frozen=True)
class Branch:
    leaf: Leaf
    other: Leaf | None
    leaves: tuple[Leaf, ...]
    unit: tuple[str, float]
    shares: Mapping[str, float] = field(default_factory=dict)


@frozen_value
class Block:
    x: Alias[np.float64]
    z: ComplexArray | None
    flags: BoolArray
    lines: IntArray
    name: str = ""


@dataclass(frozen=True)
class Lag:
    name: str
    coefficients: tuple[float, ...]


@dataclass(frozen=True)
class Difference:
    name: str


@frozen_value
class Tree:
    branches: tuple[Branch, ...]
    blocks: tuple[Block, ...]
    chain: tuple[Lag | Difference, ...]
    windows: tuple[tuple[float, float], ...] | None
    moved: dict[str, tuple[float, float]]
    groups: tuple[tuple[Leaf, ...], ...]
    units: tuple[tuple[str, int], ...]
    named: tuple[Block, ...] = labelled(entry="name")
    rows: tuple[Block, ...] = labelled(rows=True)
    slopes: dict[str, Block] = labelled(rows=True)
    table: tuple[Mapping[str, int], ...] = ()


@frozen_value
class Inner:
    G: ComplexArray = labelled("response", "({unit})^2", "freq_hz outputs")


@frozen_value
class Outer:
    freq_hz: FloatArray
    outputs: tuple[str, ...]
    inner: Inner
    unit: str = "rad"


FLOAT, INT = st.floats(), st.integers(-(2**63), 2**63 - 1)
TEXTS = st.lists(TEXT, max_size=3).map(tuple)
LEAF = st.builds(
    Leaf,
    TEXT,
    INT,
    FLOAT,
    st.booleans(),
    st.sampled_from(["a", "b"]),
    st.none() | st.floats(allow_nan=False),  # None and NaN are both null in JSON
    st.tuples(FLOAT, FLOAT),
    st.lists(INT, max_size=3).map(tuple),
    TEXTS,
)


def tuples(values):
    return st.lists(values, max_size=3).map(tuple)


def mappings(values):
    return st.dictionaries(TEXT, values, max_size=3)


def any_array(dtype, **elements):
    return arrays(dtype, array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=3), **elements)


BRANCH = st.builds(Branch, LEAF, st.none() | LEAF, tuples(LEAF), st.tuples(TEXT, FLOAT), mappings(FLOAT))
BLOCK = st.builds(Block, any_array(float), st.none() | any_array(complex), any_array(bool), any_array(np.int64), NAME)
CHAIN = st.builds(Lag, TEXT, tuples(FLOAT)) | st.builds(Difference, TEXT)
TREE = st.builds(
    Tree,
    tuples(BRANCH),
    tuples(BLOCK),
    tuples(CHAIN),
    st.none() | tuples(st.tuples(FLOAT, FLOAT)),
    mappings(st.tuples(FLOAT, FLOAT)),
    tuples(tuples(LEAF)),
    tuples(st.tuples(TEXT, INT)),
    tuples(BLOCK),
    tuples(BLOCK),
    mappings(BLOCK),
    tuples(mappings(INT)),
)


@given(tree=TREE)
@QUICK
def test_any_value_comes_back_to_the_last_bit(tmp_path_factory, tree) -> None:
    """Tables and groups, arrays of equal and of different shapes, None, unions, mappings, empty ones of all."""
    path = tmp_path_factory.mktemp("store") / "tree.h5"
    write_artefact(path, "tree", STAMP, {"tree": (tree, Tree)})
    assert same(read_part(path, "tree", "tree", Tree), tree)


@given(branch=BRANCH)
@QUICK
def test_any_value_without_arrays_comes_back_from_json(branch) -> None:
    """Infinite and undefined numbers included."""
    assert same(from_json(json.loads(json.dumps(json_value(branch, or_text), allow_nan=False)), Branch), branch)


def test_summaries_have_null_for_nonfinite_numbers() -> None:
    """NumPy's numbers and arrays are plain ones."""
    value = {"a": np.float64(0.5), "b": (math.nan, math.inf), "c": np.array([1, 2]), "d": np.bool_(True)}
    assert json.dumps(json_value(value)) == '{"a": 0.5, "b": [null, null], "c": [1, 2], "d": true}'


def test_a_value_without_a_place_in_a_file_is_refused() -> None:
    """A type that could not be read again."""
    with pytest.raises(TypeError, match="'set'> has no place in a file"):
        write_value(None, "x", {1})


def some_tree() -> Tree:
    leaf = Leaf("l" * 5000, 3, 0.5, True, "a", 1.5, (1.0, 2.0), (1, 2), ("x", "y"))
    branch = Branch(leaf, leaf, (leaf,) * 3, ("rad", 2.0), {"a": 1.0})
    block = Block(np.arange(6.0).reshape(2, 3), np.ones(2) + 1j, np.array([True]), np.arange(3), "one")
    odd = Block(np.arange(3.0), None, np.array([False]), np.arange(2), "two")
    return Tree(
        (branch, branch),
        (block, odd),
        (Lag("lag", (1.0, 0.5)), Difference("d")),
        ((1.0, 2.0),),
        {"k": (1.0, 2.0)},
        ((leaf, leaf), ()),
        (("N", 1), ("m", 2)),
        (block, odd),
        (block, odd),
        {"k": block, "d": odd},
        ({"a": 1}, {}),
    )


def test_entries_are_named_and_axes_are_those_around_them(tmp_path) -> None:
    """A program that knows no elastid finds its way: names, units, meanings and scales."""

    with h5py.File(tmp_path / "a.h5", "w") as file:
        outer = Outer(np.array([1.0, 2.0]), ("a", "b", "c"), Inner(np.ones((2, 3))))
        write_value(file, "outer", outer)
        G = file["outer/inner/G"]
        assert G.attrs["units"] == "(rad)^2"
        assert G.attrs["long_name"] == "response"
        assert [each.label for each in G.dims] == ["freq_hz", "outputs"]
        assert [each[0] == file["outer"][each.label] for each in G.dims] == [True, True]
        assert file["outer/freq_hz"].attrs["units"] == "Hz"


@pytest.mark.slow
def test_damage_with_valid_checksum_is_refused_or_harmless(tmp_path) -> None:
    """Members and attributes that are missing, of other types, lengths and shapes, and counts beyond their data."""
    path = tmp_path / "tree.h5"
    write_artefact(path, "tree", STAMP, {"tree": (some_tree(), Tree)})
    whole = path.read_bytes()
    with h5py.File(path) as file:
        places = []
        file["tree"].visit(places.append)
        pairs = [(place, key) for place in places for key in file["tree"][place].attrs]
    content = ["text", -1, 10**9, math.nan, np.zeros(0), np.zeros((0, 3)), np.array(["a"], object), [-1, 10**12]]
    draw, refused = random.Random(0), 0
    members = [(place, None) for place in places]
    cases = [(*each, new) for each, new in itertools.product(pairs + members, [None, *content])]
    for place, key, new in draw.sample(cases, 120):
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            item = file["tree"][place]
            if key is not None:
                del item.attrs[key]
                if new is not None:
                    item.attrs[key] = new
            else:
                del file["tree"][place]
                if new is not None:
                    file["tree"][place] = new
        write_checksum(path)
        with suppress(DataError):
            assert isinstance(read_part(path, "tree", "tree", Tree), Tree)
            continue
        refused += 1
    assert refused > 40
