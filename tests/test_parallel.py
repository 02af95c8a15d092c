"""Work in processes: what is to be done travels once to each, what it is done with every time."""

from pickle import PicklingError

import pytest

from elastid.parallel import ordered


class Heavy:
    """Counts how often it is packed."""

    packed = 0

    def __getstate__(self):
        Heavy.packed += 1
        return {"data": bytes(1000)}

    def __call__(self, item):
        return item * len(self.data)


def test_the_work_is_packed_once_for_all_items():
    assert ordered(Heavy(), list(range(12)), 2) == [1000 * i for i in range(12)]
    assert Heavy.packed == 1


def test_work_that_does_not_pickle_is_told_at_once():
    with pytest.raises((AttributeError, PicklingError), match="pickle"):
        ordered(lambda item: item, [1, 2], 2)
