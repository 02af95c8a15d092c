"""Measurements of `elastid new --from`: logs that belong together, their runs and hit points.

They follow from file names and headings, or else from the responses to hammer hits: hits at one point have equal
responses, so that logs with different responses are of different points.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.channel_guess import LogGuess
from elastid.logs.channel_names import DRIVES, ChannelGuess, guess_by_name
from elastid.logs.clocks import MAX_SAMPLES, find_clock
from elastid.logs.files.formats import open_log
from elastid.logs.log_signals import read_signals

Signals: TypeAlias = list[tuple[ChannelGuess, FloatArray]]
# Words before the numbers of hit points, and of sensor locations, in file names.
_POINT, _SENSOR = "p|pt|points?|pos|node|loc|location", "s|sens|sensors?|acc|accel|out|output|resp"
_MIN_DIFFERENCE = 0.1  # power of the difference of responses of different points, relative to their power
_SMOOTHED_LINES = 8  # lines that are averaged
_MIN_EXCITATION = 1e-2  # least power of the force at an excited line, relative to the largest


@dataclass(frozen=True)
class Run:
    """Realisation and experiment of a log, and its locations by channel location if they differ (at)."""

    at: Mapping[str, str]
    realisation: int
    experiment: int


def runs_by_name(logs: Sequence[Path]) -> list[tuple[str, int, int]]:
    """Return configuration, realisation and experiment of logs named such as p1-r0-e2; none if another name occurs."""
    names = [re.fullmatch(r"(.+?)[-_ ]r(\d+)[-_ ]e(\d+)", path.stem) for path in logs]
    runs = [(name[1], int(name[2]), int(name[3])) for name in names if name]
    return runs if len(set(runs)) == len(logs) else []


def in_two_files(logs: Sequence[Path], form: TextFormatSpec) -> tuple[list[tuple[Path, ...]], Signals]:
    """Pair logs of inputs with logs of outputs; return the pairs and the signals of the first pair, else empty lists.

    The two kinds differ by their headings, or by names such as 1_torque.csv.
    """
    kinds = dict[tuple[tuple[str, ...], str], list[Path]]()
    for path in logs:
        with open_log(path, form) as log:
            kinds.setdefault((tuple(log.shapes()), guess_by_name(path.stem, None).quantity), []).append(path)
    if len(kinds) != 2 or len({len(paths) for paths in kinds.values()}) > 1:
        return [], []
    is_alike = len({headings for headings, _ in kinds}) == 1  # headings do not distinguish the files
    sides = []
    for (_, quantity), paths in kinds.items():
        with open_log(paths[0], form) as log:
            clock = find_clock(log)
            signals = [(g, x) for g, x in read_signals(log, MAX_SAMPLES) if g.name != clock.name]
        by_file = quantity if is_alike else ""
        sides.append((paths, [(replace(g, quantity=by_file or g.quantity or quantity), x) for g, x in signals]))
    sides.sort(key=lambda side: not any(g.quantity in DRIVES for g, _ in side[1]))
    signals = [(replace(g, file=i), x) for i, side in enumerate(sides, start=1) for g, x in side[1]]
    if len({len(x) for _, x in signals}) != 1:  # different clocks
        return [], []
    return list(zip(*(paths for paths, _ in sides), strict=True)), signals


def hit_runs(logs: Sequence[Path], form: TextFormatSpec, guess: LogGuess) -> list[Run]:
    """Return the runs of logs between which the hammer or the sensors move; none if nothing moves.

    Locations follow from different headings, from names such as point2_acc3, or else from the responses.  guess: the
    channels of a structure with one input.
    """
    headings = [headings_of(path, form) for path in logs]
    if len(set(headings)) > 1:
        drive = guess.joints[0].torque
        locations = {drive.name: hit_place(guess)} | {motion.name: motion.place for motion in guess.motions}
        columns = [(location, headings[0].index(name)) for name, location in locations.items()]
        by_log = [{location: guess_by_name(row[i], None).place for location, i in columns} for row in headings]
        by_log = [{location: name for location, name in at.items() if name != location} for at in by_log]
    elif not (by_log := _by_names(logs, guess)):
        by_log = [{hit_place(guess): point} for point in _points_by_response(logs, form, guess)]
    first = [at for i, at in enumerate(by_log) if at not in by_log[:i]]
    return [Run(at, by_log[:i].count(at), first.index(at)) for i, at in enumerate(by_log)] if len(first) > 1 else []


def headings_of(path: Path, form: TextFormatSpec) -> tuple[str, ...]:
    """List the names of all signals of a log."""
    with open_log(path, form) as log:
        return tuple(log.shapes())


def hit_place(guess: LogGuess) -> str:
    """Return the location of the input; `hammer` if an output has the same location."""
    location = guess.joints[0].torque.place
    return "hammer" if location in {motion.place for motion in guess.motions} else location


def _by_names(logs: Sequence[Path], guess: LogGuess) -> list[dict[str, str]]:
    """Return the locations in the names of the logs; empty for names without locations."""
    words_of_names = [re.findall(r"([a-z]*)[-_ .]?(\d+)([xyz]?)(?![a-z])", path.stem.lower()) for path in logs]
    is_alike = len({tuple(word for word, *_ in row) for row in words_of_names}) == 1
    moves = [column for column in zip(*words_of_names, strict=True) if len(set(column)) > 1] if is_alike else []
    result: list[dict[str, str]] = [{} for _ in logs]
    outputs = [motion.place for motion in guess.motions]
    for column in moves:
        kind = next((kind for kind in (_POINT, _SENSOR) if re.fullmatch(kind, column[0][0])), "")
        locations = {_POINT: [hit_place(guess)], _SENSOR: outputs}.get(kind, [])
        for at, (word, number, axis) in zip(result, column, strict=True):
            name = f"{word}{number} {axis}".strip()
            at |= {location: f"{location} {name}" if len(locations) > 1 else name for location in locations}
    return result if any(result) else []


def _points_by_response(logs: Sequence[Path], form: TextFormatSpec, guess: LogGuess) -> list[str]:
    """Return the name of the hit point of each log: the first log with an equal response."""
    keys = [guess.joints[0].torque.key, *(motion.key for motion in guess.motions)]
    responses, points = list[ComplexArray](), list[str]()
    for path in logs:
        with open_log(path, form) as log:
            signals = {g.key: x for g, x in read_signals(log, MAX_SAMPLES)}
        if not signals.keys() >= set(keys):
            return [""] * len(logs)
        G = _response(signals[keys[0]], np.stack([signals[key] for key in keys[1:]], axis=1))
        firsts = zip(responses, logs, strict=False)
        points.append(next((first.stem for H, first in firsts if _difference(G, H) < _MIN_DIFFERENCE), path.stem))
        responses.append(G)
    return points


def _response(force: FloatArray, motions: FloatArray) -> ComplexArray:
    """Return responses (F, n_y) from a force (n,) to motions (n, n_y), averaged over lines; NaN if not excited."""
    U, Y = np.fft.rfft(force - force.mean()), np.fft.rfft(motions - motions.mean(axis=0), axis=0)
    window = np.ones(_SMOOTHED_LINES)
    power = np.convolve(np.abs(U) ** 2, window, "same")
    cross = np.stack([np.convolve(y * U.conj(), window, "same") for y in Y.T], axis=1)
    is_excited = power > _MIN_EXCITATION * power.max()
    return np.where(is_excited[:, None], cross / np.maximum(power, 1e-300)[:, None], np.nan)


def _difference(G: ComplexArray, H: ComplexArray) -> float:
    """Return the power of the difference of two responses relative to their power; 1 for other frequencies."""
    if G.shape != H.shape:
        return 1.0
    is_excited = np.isfinite(G + H)
    G, H = G[is_excited], H[is_excited]
    return float(np.sum(np.abs(G - H) ** 2) / max(np.sum(np.abs(G) ** 2 + np.abs(H) ** 2), 1e-300))
