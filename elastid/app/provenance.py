"""What a stage's result hangs on, as hashes: study sections, input files, what went before, the code itself."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

from elastid import __version__
from elastid.store import Stamp
from elastid.study import LoadedStudy, Study
from elastid.study.checks.design import responses_file

# The sections of a study that each stage reads, or single keys of one; what an earlier stage has read comes with its
# result.
_SECTIONS = {
    "design": ("seed", "robot", "excitation", "experiment", "design", "model"),
    "measure": ("seed", "robot", "excitation", "experiment"),
    "estimate": ("estimator",),
    "fit": ("name", "seed", "robot", "model", "fit", "validation.left_out"),
    "validate": ("robot", "model", "validation"),
    "report": ("name", "report"),
}
UPSTREAM: dict[str, tuple[str, ...]] = {
    "design": (),
    "measure": ("design",),
    "estimate": ("measure",),
    "fit": ("estimate",),
    "validate": ("estimate", "fit"),
    "report": ("design", "estimate", "fit", "validate"),
}


# Only a simulated experiment is designed; frequency responses from elsewhere are not measured either.
_ABSENT: dict[str, tuple[str, ...]] = {"simulated": (), "recorded": ("design",), "responses": ("design", "measure")}


def stages_of(study: Study) -> tuple[str, ...]:
    """The stages that a study has, in order."""
    return tuple(stage for stage in UPSTREAM if stage not in _ABSENT[study.experiment.kind])


def upstream(study: Study, stage: str) -> tuple[str, ...]:
    """The stages whose results a stage reads."""
    return tuple(name for name in UPSTREAM[stage] if name not in _ABSENT[study.experiment.kind])


def stamps(loaded: LoadedStudy) -> dict[str, Stamp]:
    """For each stage the stamp that its result must carry to be what the study asks for."""
    study, code = loaded.study, code_hash()
    sections = asdict(study)
    inputs: dict[str, str] = {}
    first = stages_of(study)[0]
    for stage in stages_of(study):
        # What the stages that a study lacks would have read is read by its first one.
        names = dict.fromkeys((*(_SECTIONS["measure"] if stage == first else ()), *_SECTIONS[stage]))
        document: list[object] = [stage, [_read(sections, name) for name in names]]
        # A plan without choice holds nothing that its own sections do not tell; its forecast is no matter to the rig.
        before = () if stage == "measure" and not _is_for_the_fit(study) else upstream(study, stage)
        document += [inputs[name] for name in before]
        if stage == "design":
            document.append(_foretold_with(loaded, sections))
        if stage == first:
            document.append([[path, file_hash(loaded.base / path)] for path in data_files(study)])
        if stage == "report":
            document.append(loaded.text)
        # The order of keys counts: it is the order in which configurations are measured and patterns win.
        inputs[stage] = hashlib.sha256(json.dumps(document).encode()).hexdigest()
    return {stage: Stamp(hash_, code, __version__, study.seed, loaded.text) for stage, hash_ in inputs.items()}


def data_files(study: Study) -> tuple[str, ...]:
    """The measured files that a study reads, relative to its folder."""
    recorded, responses = study.experiment.recorded, study.experiment.responses
    files = [path for file in (recorded.files if recorded else ()) for path in (file.path, *file.also)]
    files += [file.path for file in (responses.files if responses else ())]
    return tuple(dict.fromkeys(files))


def _read(sections: dict[str, Any], name: str) -> Any:
    """A section, or one key of it."""
    section, _, key = name.partition(".")
    return sections[section][key] if key else sections[section]


def _foretold_with(loaded: LoadedStudy, sections: dict[str, Any]) -> list[object]:
    """What choice and forecast hang on beside the plan's sections: what the fit will do, what was measured."""
    design, fit = loaded.study.design, sections["fit"]
    told: list[object] = [fit[name] for name in ("parameters", "criterion", "weights", "band_hz", "mask")]
    told += [sections["estimator"]["quantity"], sections["validation"]["left_out"]]
    if design is not None:
        files = [responses_file(loaded.base, path) for path in (*design.measured, design.noise.frf) if path]
        files += [file.with_name("fit.h5") for file in files if file.with_name("fit.h5").is_file()]
        told += [[file.name, file_hash(file)] for file in files]
    return told


def _is_for_the_fit(study: Study) -> bool:
    """Whether configurations or spectra are chosen for what the fit will do with them."""
    return study.design is not None or (study.excitation is not None and study.excitation.flat == "information")


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def code_hash() -> str:
    """SHA-256 of the package's own source: another version, another result."""
    digest = hashlib.sha256(__version__.encode())
    root = Path(str(files("elastid")))
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root).as_posix()
        if path.suffix in (".py", ".j2", ".js", ".css") and not name.startswith("app/templates/"):
            digest.update(name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
