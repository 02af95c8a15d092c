"""Does every damaged file, whoever wrote it, end in a sentence with its name?

    python scripts/studies/campaign_readers.py [--quick] [--files 10000] [--kinds log response result]
                                      [--seed 0] [--jobs 1]

Logs (text, HDF5, MATLAB 7.3, Parquet, and MATLAB 5, a fifth as often), responses (text, HDF5, universal files, and
MATLAB, a fifth as often) and results (records.h5, frf.h5, fit.h5, validation.h5), damaged by flipped bits, cuts, blocks
exchanged or made of noise; HDF5 files also in their content: datasets and attributes that are missing, empty, texts, of
other shapes or lengths, full of NaN, links to "/". Each is inspected, and read by the stage that would read it; a
result under a checksum that fits what was made of it, which no accident makes, is inspected and read alone. All in
processes that may die. A command ends with exit code 0 to 3, and names the file where it fails; anything else, and more
than 20 s, is a finding and fails the campaign. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import io
import json
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat

from elastid.app.cli import run_command
from elastid.base.errors import DataError
from elastid.base.execution import surviving
from elastid.export.uff import write_uff
from elastid.record import Configuration
from elastid.response import FrequencyResponse
from elastid.store.files import write_checksum
from elastid.store.measured import read_records, read_responses
from elastid.store.results import read_fit, read_validation

MAX_S = 20.0
HDF5 = (".h5", ".mat73")
# With files as small as these, starting a second process costs more than it does.
IN_RUN = ("study.yml", "--run", "run", "--jobs", "1")


@dataclass(frozen=True)
class Seed:
    """A folder with a study, the file in it that is damaged, and the commands that read that file."""

    kind: str
    folder: Path
    file: str
    commands: tuple[tuple[str, ...], ...]


def quiet(*words: str) -> tuple[int, str]:
    """The exit code of a command and what it said."""
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        return run_command(words), said.getvalue()


def made(base: Path) -> tuple[Seed, ...]:
    """One folder for each format, with studies of elastid's own templates."""
    return (*_logs(base), *_responses(base), *_results(base))


def _logs(base: Path) -> list[Seed]:
    quiet("new", str(base / "log"), "--template", "recorded")
    text = (base / "log" / "study.yml").read_text(encoding="utf-8")
    values = np.loadtxt(base / "log" / "logs" / "bench_1.csv", delimiter=",", skiprows=1)
    columns = dict(zip(("current", "motor_angle", "load_angle"), values.T, strict=True))
    writers: dict[str, Callable[[Path], None]] = {
        "bench.csv": lambda path: shutil.copyfile(base / "log" / "logs" / "bench_1.csv", path) and None,
        "bench.h5": lambda path: _hdf5(path, columns),
        "bench.mat73": lambda path: _hdf5(path, columns, user_block=512),
        "bench.mat": lambda path: savemat(path, {"log": columns | {"name": "bench"}, **columns}),
        "bench.parquet": lambda path: _parquet(path, columns),
    }
    found = []
    for name, write in writers.items():
        folder = base / f"log-{name}"
        folder.mkdir()
        shutil.copyfile(base / "log" / "robot.yml", folder / "robot.yml")
        own = text.replace("logs/bench_1.csv", name).replace("logs/bench_2.csv", "other.csv")
        (folder / "study.yml").write_text(own, encoding="utf-8")
        shutil.copyfile(base / "log" / "logs" / "bench_2.csv", folder / "other.csv")
        write(folder / name)
        found.append(Seed("log", folder, name, (("inspect", name), ("measure", *IN_RUN))))
    return found


def _hdf5(path: Path, values: dict[str, Any], user_block: int = 0) -> None:
    with h5py.File(path, "w", userblock_size=user_block) as file:
        for name, value in values.items():
            file.create_dataset(name, data=value)
    if user_block:
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _parquet(path: Path, columns: dict[str, Any]) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(columns), path)


def _responses(base: Path) -> list[Seed]:
    freq = np.linspace(2, 60, 40)
    G = (1 / (1 - (freq / 20) ** 2 + 0.02j * freq))[:, None] * np.array([10.0, 4.0])
    text = "freq_hz," + ",".join(f"{part}_{y}_torque" for y in ("motor", "load") for part in ("re", "im"))
    table = np.column_stack([freq, G[:, 0].real, G[:, 0].imag, G[:, 1].real, G[:, 1].imag])
    struct = {"ResponseData": np.moveaxis(G[:, :, None], 0, 2), "Frequency": freq, "FrequencyUnit": "Hz",
              "OutputName": np.array(["motor", "load"], object), "InputName": np.array(["torque"], object)}  # fmt: skip
    plain = {"frequency": freq, "response": G[:, :, None]}
    writers: dict[str, Callable[[Path], None]] = {
        "bench.csv": lambda path: np.savetxt(path, table, delimiter=",", header=text, comments=""),
        "bench.mat": lambda path: savemat(path, {"s": struct}),
        "bench.h5": lambda path: _hdf5(path, plain),
        "bench.uff": lambda path: _universal(path, freq, G),
    }
    quiet("new", str(base / "response"), "--template", "responses")
    study = (base / "response" / "study.yml").read_text(encoding="utf-8")
    found = []
    for name, write in writers.items():
        folder = base / f"response-{name}"
        folder.mkdir()
        shutil.copyfile(base / "response" / "robot.yml", folder / "robot.yml")
        own = study.replace("path: bench.csv", f"path: {name}")
        if name == "bench.h5":
            own = own.replace("{frequency: freq_hz, real: \"re_{y}_{u}\", imaginary: \"im_{y}_{u}\"}",
                              "{frequency: frequency, response: response}")  # fmt: skip
        if name == "bench.uff":  # its channels are nodes and directions
            for channel, node in (("torque", "1z"), ("motor", "1z"), ("load", "2z")):
                own = own.replace(f"channel: {channel}", f"channel: {node}")
        (folder / "study.yml").write_text(own, encoding="utf-8")
        write(folder / name)
        found.append(Seed("response", folder, name, (("inspect", name), ("estimate", *IN_RUN))))
    return found


def _universal(path: Path, freq: Any, G: Any) -> None:
    at = Configuration("bench", np.zeros(1))
    write_uff(path.parent, "", [FrequencyResponse(freq, G[:, :, None], ("1z",), ("1z", "2z"), "acceleration", at)])


def _results(base: Path) -> list[Seed]:
    folder = base / "result"
    quiet("new", str(folder), "--template", "recorded")
    code, said = quiet("run", str(folder / "study.yml"), "--run", str(folder / "run"), "--jobs", "1")
    assert code in (0, 3), said
    reads = {
        "records.h5": "estimate", "frf.h5": "fit", "fit.h5": "validate", "validation.h5": "report",
    }  # fmt: skip
    return [
        Seed("result", folder, f"run/{name}", (("inspect", f"run/{name}"), (stage, *IN_RUN)))
        for name, stage in reads.items()
    ]


READERS: dict[str, Callable[[Path], Any]] = {
    "records.h5": lambda path: list(read_records(path)),
    "frf.h5": read_responses,
    "fit.h5": read_fit,
    "validation.h5": read_validation,
}


def read(path: Path) -> tuple[int, str]:
    """As a command that reads a result and does nothing with it."""
    try:
        READERS[path.name](path)
    except DataError as error:
        return 1, str(error)
    return 0, ""


def damaged(path: Path, random: Random) -> bool:
    """A file is changed, as its bytes or, if it is HDF5, as its content; whether its checksum was made to fit."""
    if path.suffix in HDF5 and random.random() < 0.6:
        with suppress(Exception), h5py.File(path, "r+") as file:  # some damages h5py itself refuses
            for _ in range(random.randint(1, 3)):
                _content(file, random)
        return path.parent.name == "run" and random.random() < 0.9 and _forged(path)
    raw = bytearray(path.read_bytes())
    for _ in range(random.randint(1, 4)):
        i, j = sorted(random.randrange(len(raw) + 1) for _ in range(2))
        match random.randrange(6):
            case 0 | 1:
                if raw:
                    raw[random.randrange(len(raw))] ^= 1 << random.randrange(8)
            case 2:
                del raw[i:]
            case 3:
                raw[i : i + 64] = random.randbytes(64)
            case 4:
                raw[i:i] = raw[j : j + 200]
            case _:
                del raw[i : min(j, i + 100)]
    path.write_bytes(raw)
    return path.parent.name == "run" and random.random() < 0.5 and _forged(path)


def _forged(path: Path) -> bool:
    write_checksum(path)
    return True


def _content(file: Any, random: Random) -> None:
    names: list[str] = []
    file.visit(names.append)
    if not names:
        return
    name = random.choice(names)
    item = file[name]
    if random.random() < 0.25 and len(item.attrs):
        key = random.choice(list(item.attrs))
        item.attrs[key] = random.choice(["", "x", np.nan, -1, [1, 2, 3], b"\xff"])
        return
    if isinstance(item, h5py.Group):
        if random.random() < 0.5:
            file.pop(name)
        else:
            item["itself"] = h5py.SoftLink("/")
        return
    value = item[()]
    attributes = dict(item.attrs)
    replaced: list[Any] = [
        "text", np.zeros(0), np.zeros((0, 3)), np.nan, np.array(["a", "b"], object), np.float64(1e308), -1,
    ]  # fmt: skip
    if isinstance(value, np.ndarray) and value.size:
        replaced += [value[:-1], np.concatenate([value, value]), value[..., None], value.ravel()[::-1]]
        if value.dtype.kind in "fc":
            odd = value.copy()
            odd.flat[random.randrange(odd.size)] = random.choice([np.nan, np.inf, 0, 1e300, -odd.flat[0]])
            replaced += [odd, odd, value * np.nan, value * 0, value.astype("S8")]
    new = random.choice(replaced)
    del file[name]
    if random.random() < 0.85:
        if random.random() < 0.1:
            file[name] = h5py.SoftLink(random.choice(["/", "/nowhere", f"/{name}"]))
            return
        file.create_dataset(name, data=new)
        with suppress(Exception):
            file[name].attrs.update(attributes)


def judged(number: int, seed: int, chosen: tuple[Seed, ...]) -> tuple[str, str]:
    """How the commands on a damaged file ended: a word to count, and what is wrong, empty where nothing is."""
    random = Random(f"{seed}/{number}")
    # SciPy's reader of MATLAB files is a process of its own and ten times as dear as the others.
    (source,) = random.choices(chosen, [0.2 if Path(each.file).suffix == ".mat" else 1.0 for each in chosen])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "here"
        shutil.copytree(source.folder, folder)
        forged = damaged(folder / source.file, random)
        ended = []
        for words in source.commands:
            whole = [str(folder / word) if "." in word or word == "run" else word for word in words]
            began = time.process_time()
            try:
                reads_alone = forged and words[0] != "inspect"
                code, said = read(folder / source.file) if reads_alone else quiet(*whole)
            except Exception as error:
                return "exception", f"{number} {source.folder.name}, {words[0]}: {type(error).__name__}: {error}"
            took = time.process_time() - began
            if code not in (0, 1, 2, 3) or took > MAX_S:
                return "exit code", f"{number} {source.folder.name}, {words[0]}: exit code {code} after {took:.1f} s"
            if code in (1, 2) and str(folder) not in said and Path(source.file).name not in said:
                return "no name", f"{number} {source.folder.name}, {words[0]}: {said[-300:]!r}"
            ended.append(code)
    return f"{source.kind} {'/'.join(map(str, ended))}", ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--files", type=int, default=10_000, help="of each kind")
    parser.add_argument("--kinds", nargs="*", default=["log", "response", "result"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    count = 3 if given.quick else given.files
    ended: Counter[str] = Counter()
    findings = []
    with tempfile.TemporaryDirectory() as base:
        every = made(Path(base))
        for kind in given.kinds:
            chosen = tuple(each for each in every if each.kind == kind)
            work = partial(judged, seed=given.seed, chosen=chosen)
            for index, found in surviving(work, list(range(count)), given.jobs):
                word, wrong = found or ("died", f"{index} of {kind}: the process died")
                ended[word] += 1
                if wrong:
                    findings.append(wrong)
                    print(wrong, flush=True)
    print(f"{sum(ended.values())} files: {dict(ended)}, {len(findings)} findings")
    print(json.dumps({"files": sum(ended.values()), "ended": dict(ended), "findings": len(findings)}))
    assert not findings


if __name__ == "__main__":
    main()
