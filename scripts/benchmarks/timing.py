"""CPU times of functions for the benchmarks: medians, of functions that are compared in turn."""

import statistics
import time
from collections.abc import Callable, Mapping


def cpu_seconds(function: Callable[[], object], repeats: int) -> float:
    """Median CPU time of a call, after one that does not count; the machine may be shared."""
    return in_turn({"": function}, repeats)[""]


def in_turn(functions: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median CPU times of functions that take turns, so that what else the machine does meets all of them."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for repeat in range(repeats + 1):
        for name, function in functions.items():
            begin = time.process_time()
            function()
            if repeat:
                times[name].append(time.process_time() - begin)
    return {name: statistics.median(each) for name, each in times.items()}
