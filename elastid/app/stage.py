"""Stage: a row of the table, which declares the values, earlier results and files that a stage is handed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from elastid.study import LoadedStudy, Study

# Name of a file in the study -> the files behind it.
NamedFiles: TypeAlias = Mapping[str, tuple[Path, ...]]


@dataclass(frozen=True)
class Value:
    """A value of the study, handed over as the argument of its last name: a section, a key, a property of Study.

    name: `fit`, `validation.left_out`, `friction_joints`; `text` is the study's text.  without: keys of a section that
    a stage must not depend on, handed over at their defaults; every other key, and every key to come, counts.
    """

    name: str
    without: tuple[str, ...] = ()

    @property
    def argument(self) -> str:
        """The argument of the stage's function."""
        return self.name.rpartition(".")[2]

    def of(self, loaded: LoadedStudy) -> Any:
        """The value in a study."""
        value: Any = loaded if self.name == "text" else loaded.study
        for name in self.name.split("."):
            value = getattr(value, name)
        if not self.without or value is None:
            return value
        return type(value)(**{f.name: getattr(value, f.name) for f in fields(value) if f.name not in self.without})


@dataclass(frozen=True)
class Source:
    """The result of an earlier stage, handed over as the argument <stage>_file, where a study has that stage.

    part: the stage reads only that part of it which the earlier row names, and depends on no more.  optional: None is
    handed over where the file is missing or of another study; the result then says what it lacks.
    """

    stage: str
    part: bool = False
    optional: bool = False

    @property
    def argument(self) -> str:
        """The argument of the stage's function."""
        return f"{self.stage}_file"


@dataclass(frozen=True)
class Stage:
    """A stage of some kinds of study: function(*, <values>, work) -> Artefacts, see `elastid.app.work`.

    help: one line for the command of its name.  values: of the study.  sources: results of earlier stages.
    files(values, folder): named by the study, handed over as `files`.  extras: files of the run folder that other
    commands leave, handed over by their stem where they are as written, else None.  leaves: the first file carries the
    stamp, the second is for programs.  beside: patterns of further files that it leaves.  outdates: stages whose
    summary goes when the files of this one are written, unless it is current.  part(study): the values on which the
    part of the result depends that later stages read; None for all of it.  needs: a section without which a study has
    not this stage.  function, conclude: "module:name" below elastid.app.stages.  conclude(run): shows the result at
    the end of a run; FitError where it cannot be trusted.
    """

    name: str
    help: str
    kinds: tuple[str, ...]
    values: tuple[Value, ...]
    sources: tuple[Source, ...]
    leaves: tuple[str, ...]
    function: str
    files: Callable[[Mapping[str, Any], Path], NamedFiles] | None = None
    extras: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    outdates: tuple[str, ...] = ()
    part: Callable[[Study], tuple[Value, ...] | None] | None = None
    needs: str = ""
    conclude: str = ""

    @property
    def texts(self) -> tuple[str, ...]:
        """Files, folders and patterns of its artefacts besides HDF5 files, which carry their own checksums."""
        return (*(name for name in self.leaves if not name.endswith(".h5")), *self.beside)


def values(*names: str) -> tuple[Value, ...]:
    """Values by name."""
    return tuple(map(Value, names))
