"""A type of arrays is known for one, whatever NumPy and Python make of its alias."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from elastid.store.kinds import is_array

Scalar = TypeVar("Scalar", bound=np.generic)
# As numpy.typing has it from NumPy 2.5 and Python 3.12 on.
Alias = TypeAliasType("Alias", np.ndarray[Any, np.dtype[Scalar]], type_params=(Scalar,))


def test_an_alias_of_its_own_is_an_array() -> None:
    assert is_array(NDArray[np.float64])
    assert is_array(Alias[np.float64])
    assert not is_array(tuple[float, ...])
    assert not is_array(float)
