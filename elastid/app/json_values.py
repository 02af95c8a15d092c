"""Values as JSON holds them: numbers that may be infinite, notes, torques part by part, and runs of a twin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from elastid.base.note import Note, grouped
from elastid.validation.twin import TorqueBalance
from elastid.validation.twin_run import TwinRun

# Version of the form of summary.json and validation.json.
SCHEMA = 1


def finite(value: float) -> float | None:
    """JSON knows no infinity: null."""
    return float(value) if math.isfinite(value) else None


def all_finite(values: Sequence[float]) -> list[float | None]:
    """The same of each."""
    return [finite(value) for value in values]


def note_entries(notes: Iterable[Note]) -> list[dict[str, Any]]:
    """The same note of many places once, with its places."""
    return [
        {
            "code": group.first.code,
            "severity": group.first.severity,
            "places": [place for place in group.places if place],
            "text": group.first.text,
        }
        for group in grouped(notes)
    ]


def balance_entries(balances: Iterable[TorqueBalance]) -> list[dict[str, Any]]:
    """What the parts of a model explain of each log, over all and by octave, without the signals."""
    return [
        {
            "place": balance.place,
            "log": balance.log,
            "shares": dict(zip(balance.parts, balance.shares, strict=True)),
            "left": balance.left,
            "left_without_friction": balance.left_without_friction,
            "bands": [
                asdict(band) | {"shares": dict(zip(balance.parts, band.shares, strict=True))} for band in balance.bands
            ],
        }
        for balance in balances
    ]


def run_entries(runs: Iterable[TwinRun]) -> list[dict[str, Any]]:
    """How far the twin is off each log, over all and by octave, without the signals; null without friction to leave."""
    return [
        {
            "log": run.log,
            "driven_by": run.drive,
            "held_hz": run.held_hz,
            "seconds": run.seconds,
            "lost": run.lost,
            "lost_without_friction": run.lost_without_friction,
            "signals": [
                {
                    "signal": signal.kind,
                    "place": signal.place,
                    "error": finite(signal.error),
                    "error_without_friction": finite(signal.error_without_friction),
                    "bands": [{name: finite(value) for name, value in asdict(band).items()} for band in signal.bands],
                }
                for signal in run.signals
            ],
        }
        for run in runs
    ]
