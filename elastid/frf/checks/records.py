"""Records that cannot be estimated together, or not by the method asked for, are refused."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.errors import DataError
from elastid.frf.methods import AVERAGED
from elastid.record import Record

# Clocks of logs differ by so little that their lines are the same ones.
_MAX_CLOCK_DIFFERENCE = 1e-4


def refuse_mismatch(records: Sequence[Record]) -> None:
    """DataError where the records of a configuration do not fit together, or there are none."""
    if isinstance(records, Record):
        raise TypeError("records is a single Record; give a sequence of them, such as [record]")
    if not records:
        raise DataError("there is no record to estimate a response from; measure at least one experiment")
    first = records[0]
    for record in records:
        if not np.array_equal(record.configuration.angles, first.configuration.angles):
            raise DataError(
                f"the records are of configurations {first.configuration.name} and {record.configuration.name}, at "
                f"different angles; read_records(path, '{first.configuration.name}') reads those of one"
            )
    for record in records:
        names = ["is_periodic", "rate_hz", "half_wave", "hold", "hold_samples", "inputs", "outputs", "quantities"]
        # Without a period each record has its own length.
        for name in [*names, "period_samples"] if first.is_periodic else names:
            a, b = getattr(first, name), getattr(record, name)
            is_same = abs(a - b) <= _MAX_CLOCK_DIFFERENCE * a if name == "rate_hz" else a == b
            if not is_same:
                raise DataError(
                    f"records {first.name} and {record.name} of configuration {first.configuration.name} do not fit "
                    f"together: {name} is {a} and {b}; make two configurations of them"
                )


def refuse_single_period(records: Sequence[Record], method: str) -> None:
    """DataError where a record holds less than two periods, which leave no noise level."""
    short = [record.name for record in records if record.n_samples < 2 * record.repeat_samples]
    if short:
        raise DataError(
            f"records {', '.join(short)} of configuration {records[0].configuration.name} hold one period, method "
            f"{method} needs two; measure more, or take estimator.method local_rational"
        )


def refuse_few_experiments(groups: Sequence[Sequence[Record]], method: str) -> None:
    """DataError where a realisation, or all of them for a method that pools them, has too few experiments."""
    first = groups[0][0]
    n_u = len(first.inputs)
    if method in AVERAGED:
        counts = {f"realisation {group[0].realisation}": len(group) for group in groups}
    else:
        counts = {"all realisations": sum(map(len, groups))}
    for what, count in counts.items():
        if count < n_u:
            raise DataError(
                f"configuration {first.configuration.name}, {what}: {count} experiments for "
                f"{n_u} inputs ({', '.join(first.inputs)}); each realisation needs at least {n_u} that move the inputs "
                "in different ways (number them as its experiments 0, 1, ...)"
            )
