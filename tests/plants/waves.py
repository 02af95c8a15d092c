"""A torque and a position with it, periodic, exact between samples too, of a log of six periods."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.logs.repair import Findings, LogReport

N, P = 500, 6
LINES = np.arange(2, 150)
LOG = LogReport("log.csv", ("torque", "angle"), 1000.0)


def wave(t: FloatArray, seed: int = 0, lines: IntArray = LINES) -> FloatArray:
    """Two periodic signals (n, 2) of period N at times t in samples: a torque of rms 1 and a position with it."""
    rng = np.random.default_rng(seed)
    U = np.exp(2j * np.pi * rng.random(len(lines))) * np.sqrt(2 / len(lines))
    G = 1e3 / (1 + 2j * 0.03 * lines / 40 - (lines / 40) ** 2)
    phasors = np.exp(2j * np.pi * np.outer(np.asarray(t) / N, lines))
    return np.stack([(phasors @ U).real, (phasors @ (U * G)).real], axis=1)


CLEAN = wave(np.arange(P * N))
DRIFT = np.arange(P * N)[:, None] / (P * N) * np.array([0.0, 5e4])
NOISE = np.random.default_rng(9).normal(size=CLEAN.shape) * np.array([1e-3, 1.0])


def outcome(repair: Callable[..., Any], *args: Any, names: tuple[str, ...] = LOG.names) -> tuple[Any, Counter[str]]:
    """Result of a repair whose last argument is a log, and its counts by kind."""
    log = replace(LOG, names=names, findings=Findings())
    return repair(*args, log), log.findings.repairs
