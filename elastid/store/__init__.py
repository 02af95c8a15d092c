"""The files of a run folder: artefacts in HDF5 with named axes, units and provenance, texts, and who may write them.

- files:       whole or absent: written under another name, synced and renamed
- lock:        one writer for a run folder
- kinds:       the layout of any frozen dataclass, by its annotations and labels (`base.label`)
- values, reading: the writer and the reader of all artefacts, by that layout
- json_values: the same for JSON
- design:      plan.h5, and CSV files for a robot controller
- measured:    records.h5 and frf.h5
- results:     fit.h5, validation.h5 and compare.json
- friction_study: plan.h5, records.h5, levels.h5, friction.h5 and filter.h5 of a friction study
- description: the content of any of them as text
- checksum, text_checksums: a bit that flips on the disk is noticed, in HDF5 files and in all others of a run folder
- checkpoint:  finished parts of an interrupted stage

The same value gives the same bytes: no file holds a date. A name is loaded when it is first used: `estimate` needs
neither forecasts nor validations, and their libraries.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elastid.store.checkpoint import Checkpoint as Checkpoint
    from elastid.store.checksum import has_checksum as has_checksum
    from elastid.store.checksum import is_intact as is_intact
    from elastid.store.description import described as described
    from elastid.store.design import read_forecast as read_forecast
    from elastid.store.design import read_peaks as read_peaks
    from elastid.store.design import read_plan as read_plan
    from elastid.store.design import read_rehearsal as read_rehearsal
    from elastid.store.design import write_movement as write_movement
    from elastid.store.design import write_plan as write_plan
    from elastid.store.design import write_torque as write_torque
    from elastid.store.files import Stamp as Stamp
    from elastid.store.files import kind_of as kind_of
    from elastid.store.files import read_stamp as read_stamp
    from elastid.store.files import remove_leftovers as remove_leftovers
    from elastid.store.files import replacing as replacing
    from elastid.store.files import text_file as text_file
    from elastid.store.lock import one_writer as one_writer
    from elastid.store.measured import read_configurations as read_configurations
    from elastid.store.measured import read_friction as read_friction
    from elastid.store.measured import read_records as read_records
    from elastid.store.measured import read_responses as read_responses
    from elastid.store.measured import write_records as write_records
    from elastid.store.measured import write_responses as write_responses
    from elastid.store.results import read_fit as read_fit
    from elastid.store.results import read_validation as read_validation
    from elastid.store.results import write_fit as write_fit
    from elastid.store.results import write_validation as write_validation
    from elastid.store.text_checksums import changed_texts as changed_texts
    from elastid.store.text_checksums import is_as_written as is_as_written
    from elastid.store.text_checksums import keep_checksums as keep_checksums

_NAMES = {
    "checkpoint": "Checkpoint",
    "checksum": "has_checksum is_intact",
    "description": "described",
    "design": "read_forecast read_peaks read_plan read_rehearsal write_movement write_plan write_torque",
    "files": "Stamp kind_of read_stamp remove_leftovers replacing text_file",
    "lock": "one_writer",
    "measured": "read_configurations read_friction read_records read_responses write_records write_responses",
    "results": "read_fit read_validation write_fit write_validation",
    "text_checksums": "changed_texts is_as_written keep_checksums",
}
_HOME = {name: f"elastid.store.{module}" for module, names in _NAMES.items() for name in names.split()}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Load a public name from its module when it is first used."""
    if name not in _HOME:
        raise AttributeError(f"module 'elastid.store' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)
