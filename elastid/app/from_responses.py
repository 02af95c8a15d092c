"""Study of frequency responses in universal files, MATLAB, HDF5, NumPy and text files: `elastid new DIR --from FILE`.

Names and units come from the file. Quantities that the file does not state are guessed from the slope of |G|.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elastid.app.study_lines import channel_line, file_line, head_lines, join_lines, mapping, quote, relative_paths
from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.base.units import translation_unit
from elastid.experiment.specs.channels import QUANTITY_UNIT
from elastid.logs.channel_names import ChannelGuess, guess_by_name
from elastid.logs.files.formats import open_log
from elastid.logs.files.log import StoredArray
from elastid.logs.files.text import TextLog
from elastid.logs.files.text_format import describe_format, guess_format
from elastid.logs.headings import is_time
from elastid.logs.responses.table import complex_array, find_responses, find_structs, struct_table
from elastid.logs.responses.universal_files import uff_locations
from elastid.robot import Robot

_FREQUENCY = re.compile(r"(.*[./_ ])?(f|freq|frequenc(y|ies)|w|omega)([ _./(\[].*)?", re.IGNORECASE)
_RADIANS = re.compile(r"(.*[./_ ])?(w|omega)([ _./(\[].*)?|.*rad.*", re.IGNORECASE)
# Both parts of a complex number, by their names in a study, and their words in headings.
_PARTS = {
    ("real", "imaginary"): ("re|real", "im|imag|imaginary"),
    ("magnitude", "phase"): ("mag|magnitude|abs", "phase|arg|angle"),
}
_POSITION, _VELOCITY = -1.5, -0.5  # largest slope of ln |G| over ln f of positions, and of velocities


@dataclass(frozen=True)
class _Table:
    """Frequency response of a file, with its keys in a study.

    keys: of experiment.responses.  responses: names of all similar responses of the file.  outputs, inputs: channels by
    name or column, without a quantity if it is unknown.
    """

    freq: FloatArray
    G: ComplexArray
    keys: Mapping[str, str]
    outputs: tuple[ChannelGuess, ...]
    inputs: tuple[ChannelGuess, ...]
    responses: tuple[str, ...] = ("",)


def texts_from_universal(paths: Sequence[Path], folder: Path) -> dict[str, str]:
    """Draft the study of universal files; return texts by file name."""
    outputs, inputs = uff_locations(paths[0])
    names = ["bench"] if len(paths) == 1 else [f"bench_{i}" for i in range(1, len(paths) + 1)]
    states = ", ".join(f"{name}: []" for name in names)
    lines = [
        *(*head_lines("responses", paths[0]), "experiment:", f"  configurations: {{{states}}} # guessed: a state each"),
        *("  responses:", "    channels: # node and direction of each place; `at` is a name of your choice"),
    ]
    quantities = [*(("u", at, "torque" if "r" in at else "force") for at in inputs)]
    quantities += [("y", at, quantity) for at, quantity in outputs.items()]
    for role, at, quantity in quantities:
        unit = QUANTITY_UNIT[quantity] if "r" in at else translation_unit(QUANTITY_UNIT[quantity])
        lines.append(channel_line(role, at, ChannelGuess(at, None, quantity, unit, 0, "SI")))
    files = zip(relative_paths(paths, folder), names, strict=True)
    lines += ["    files:", *(file_line(path, configuration=name) for path, name in files)]
    return {"study.yml": join_lines(lines)}


def texts_from_responses(paths: Sequence[Path], folder: Path, robot: Robot | None) -> dict[str, str]:
    """Draft the study of responses: texts by file name, none without responses; DataError for an unsuitable robot."""
    if paths[0].is_dir():
        return {}
    form = guess_format(paths[0])
    with open_log(paths[0], form) as log:
        table = _text_table(log) if isinstance(log, TextLog) else _array_table(paths[0], log.arrays)
    if table is None:
        return {}
    drives = () if robot is None else robot.driven_names
    if robot is not None and len(drives) != len(table.inputs):
        text = f"the response has {len(table.inputs)} inputs, the robot model {len(drives)} motors"
        raise DataError("responses/table", f"{text}. Choose another model", paths[0])
    lines = [*head_lines("responses" if robot is None else "elasticity", paths[0]), "robot: robot.yml" if robot else ""]
    files = [(path, response) for path in relative_paths(paths, folder) for response in table.responses]
    names = ["bench"] if len(files) == 1 else [f"bench_{i + 1}" for i in range(len(files))]
    why = "a state each" if robot is None else "enter the angles of the joints"
    lines += [
        "experiment:", f"  configurations: # guessed: {why}",
        *(f"    {name}: [{', '.join(['0'] * len(drives))}]" for name in names),
        "  responses:", *(f"    {key}: {value}" for key, value in table.keys.items()),
        f"    {describe_format(form)}" if isinstance(log, TextLog) else "", "    channels:",
        *_channels(table, drives), "    files:",
    ]  # fmt: skip
    for (path, response), name in zip(files, names, strict=True):
        lines.append(file_line(path, configuration=name, response=quote(response) if response else None))
    return {"study.yml": join_lines(lines)}


def _channels(table: _Table, drives: Sequence[str]) -> Iterator[str]:
    """Yield the lines of inputs and outputs, at the motors of a robot or at locations with the names in the file."""
    for i, guess in enumerate(table.inputs):
        location = f"motor {drives[i]}" if drives else guess.name or f"input {i + 1}"
        quantity = guess.quantity or ("torque" if drives else "force")
        why = guess.why if guess.quantity else f"a {quantity} is assumed"
        yield channel_line("u", location, replace(guess, quantity=quantity, why=why))
    by_slope, slope = _quantity_by_slope(table)
    for i, guess in enumerate(table.outputs):
        location = f"motor {drives[i]}" if i < len(drives) else guess.name or f"output {i + 1}"
        if not guess.quantity:
            unit = QUANTITY_UNIT[by_slope] if drives else translation_unit(QUANTITY_UNIT[by_slope])
            guess = replace(guess, quantity=by_slope, unit=unit, why=f"|G| is proportional to f^{slope:.2g}")
        yield channel_line("y", location, guess)


def _quantity_by_slope(table: _Table) -> tuple[str, float]:
    """Return the likeliest quantity of the outputs, and the slope of ln |G| over ln f: -2 for positions of a mass."""
    size = np.ma.masked_invalid(np.abs(table.G)).mean(axis=(1, 2)).filled(0.0)
    is_used = (table.freq > 0) & (size > 0)
    ln_f, ln_size = np.log([table.freq[is_used], size[is_used]])
    slope = float(np.polyfit(ln_f, ln_size, 1)[0]) if len(ln_f) > 1 else 0.0
    return "position" if slope < _POSITION else "velocity" if slope < _VELOCITY else "acceleration", slope


def _array_table(path: Path, arrays: Mapping[str, StoredArray]) -> _Table | None:
    """Return the structs of a file with the size of the first one, else its first complex array with frequencies."""
    if names := find_structs(arrays):
        return _struct_table(path, arrays, names)
    return next(filter(None, (_matrix_table(arrays, name) for name in find_responses(arrays))), None)


def _struct_table(path: Path, arrays: Mapping[str, StoredArray], names: Sequence[str]) -> _Table:
    """Return the first struct, such as an frd object of MATLAB, with the names of all structs of its size."""
    first = struct_table(path, arrays, names[0])
    similar = [name for name in names if struct_table(path, arrays, name).G.shape[1:] == first.G.shape[1:]]
    prefix = f"{names[0]}." if names[0] else ""
    outputs = _guesses(first.outputs, first.G.shape[1], arrays, f"{prefix}OutputUnit")
    inputs = _guesses(first.inputs, first.G.shape[2], arrays, f"{prefix}InputUnit")
    keys = {} if first.frequency_unit else {"frequency_unit": "Hz # guessed: the file states none"}
    return _Table(first.freq, first.G, keys, outputs, inputs, tuple(similar) if len(similar) > 1 else ("",))


def _matrix_table(arrays: Mapping[str, StoredArray], name: str) -> _Table | None:
    """Return a complex array with its frequencies: increasing numbers, first by name, as many as lines of the array."""
    G = complex_array(arrays, name)
    is_log = any(is_time(key) and arrays[key].is_signal for key in arrays)  # also of a log of complex numbers
    axes = [key for key in arrays if not is_log or _FREQUENCY.fullmatch(key)]
    for key in sorted(axes, key=lambda key: (not _FREQUENCY.fullmatch(key), key)):
        freq = np.squeeze(np.asarray(arrays[key])) if arrays[key].is_signal else np.zeros(0)
        if G is None or G.ndim > 3 or freq.ndim != 1 or G.shape.count(len(freq)) != 1 or np.any(np.diff(freq) <= 0):
            continue
        matrix = np.moveaxis(G, G.shape.index(len(freq)), 0)
        matrix = matrix.reshape((*matrix.shape, 1, 1)[: max(matrix.ndim, 3)])
        unit = arrays[key].units or ("rad/s" if _RADIANS.fullmatch(key) else "Hz")
        columns = mapping({"response": quote(name), "frequency": quote(key)})
        keys = {"columns": columns, "frequency_unit": f"{unit} # guessed by the name {key}"}
        outputs, inputs = (_guesses((), n, arrays, "") for n in matrix.shape[1:])
        return _Table(freq.astype(float), matrix, keys, outputs, inputs)
    return None


def _guesses(names: Sequence[str], n: int, arrays: Mapping[str, StoredArray], units: str) -> tuple[ChannelGuess, ...]:
    """Return n channels with the names and units (cells of an array) in the file, else with their numbers."""
    guesses = []
    for i in range(n):
        cell = next((arrays[key] for key in (f"{units}{{{i + 1}}}", units) if key in arrays), None)
        guess = guess_by_name(names[i] if names else "", None if names else i + 1, "" if cell is None else cell.text)
        guesses.append(guess if guess.unit else replace(guess, quantity=""))
    return tuple(guesses)


def _text_table(log: TextLog) -> _Table | None:
    """Pair columns re_1_1 and im_1_1, or mag_1_1 and phase_1_1, by output and input; a single pair needs no numbers."""
    frequency = next((name for name in log.headings if _FREQUENCY.fullmatch(name)), "")
    for names, words in _PARTS.items() if frequency else ():
        patterns = [rf"(?<![a-z])({word})(?![a-z])" for word in words]
        first, second = ([h for h in log.headings if re.search(p, h, re.IGNORECASE)] for p in patterns)
        numbers, second_numbers = ([tuple(re.findall(r"\d+", name)[-2:]) for name in side] for side in (first, second))
        rows, columns = ([*dict.fromkeys(pair[i] for pair in numbers if len(pair) == 2)] or ["1"] for i in (0, 1))
        is_matrix = len(first) in (1, len(set(numbers))) and len(first) == len(rows) * len(columns)
        if not first or not is_matrix or numbers != second_numbers:
            continue
        labels = [re.sub(r"(\d+)(\D+)(\d+)(\D*)$", r"{y}\2{u}\4", name) for name in (first[0], second[0])]
        x, y = (log.columns([log.headings.index(name) for name in side]) for side in (first, second))
        is_polar = "phase" in names
        label_of = {"frequency": quote(frequency)} | dict(zip(names, map(quote, labels), strict=True))
        if is_polar:  # dB if any magnitude is negative, degrees if any phase is beyond pi; cells may be empty
            is_db = np.nanmin(x, initial=0.0) < 0
            label_of["magnitude_unit"] = "dB" if is_db else quote("1")
            label_of["phase_unit"] = "deg" if np.nanmax(np.abs(y), initial=0.0) > 3.15 else "rad"
            x = 10 ** (x / 20) if is_db else x
        G = (x if is_polar else x + 1j * y).astype(np.complex128)  # |G| alone, if polar, for the guess by its slope
        unit = "rad/s" if _RADIANS.fullmatch(frequency) else "Hz"
        keys = {"columns": mapping(label_of), "frequency_unit": f"{unit} # guessed by the name {frequency}"}
        outputs, inputs = (tuple(ChannelGuess("", int(n), "", "", 0, "") for n in side) for side in (rows, columns))
        freq = log.columns([log.headings.index(frequency)])[:, 0]
        return _Table(freq, G.reshape(len(x), len(rows), len(columns)), keys, outputs, inputs)
    return None
