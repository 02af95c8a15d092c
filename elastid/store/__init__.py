"""The HDF5 layout of every artefact: named axes as dimension scales, units, native complex numbers, provenance.

- files:      whole or absent: written under another name, synced and renamed
- lock:       one writer for a run folder
- design:     plan.h5, with references, rehearsal and forecast, and CSV files for a robot controller
- measured:   records.h5 and frf.h5
- friction:   what of frf.h5 is friction that was taken out
- friction_study: plan.h5, records.h5, levels.h5 and friction.h5 of a friction study
- values:     any frozen dataclass, field by field
- results:    fit.h5 and validation.h5
- comparison: compare.json
- description: the content of any of them as text
- checksum, text_checksums: a bit that flips on the disk is noticed, in HDF5 files and in all others of a run folder
- unfinished: the checkpoint of an interrupted stage

The same value gives the same bytes: no file holds a date. A name is loaded when it is first used: `estimate` needs
neither forecasts nor validations, and what they are made with.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elastid.store.checksum import has_checksum, is_intact
    from elastid.store.description import described
    from elastid.store.design import (
        read_forecast,
        read_peaks,
        read_plan,
        read_rehearsal,
        write_movement,
        write_plan,
        write_torque,
    )
    from elastid.store.files import Stamp, kind_of, read_stamp, remove_leftovers, replacing, text_file
    from elastid.store.lock import one_writer
    from elastid.store.measured import (
        read_configurations,
        read_friction,
        read_records,
        read_responses,
        write_records,
        write_responses,
    )
    from elastid.store.results import read_fit, read_validation, write_fit, write_validation
    from elastid.store.text_checksums import changed_texts, is_as_written, keep_checksums
    from elastid.store.unfinished import Checkpoint

_HOME = {
    "Checkpoint": "elastid.store.unfinished",
    "Stamp": "elastid.store.files",
    "changed_texts": "elastid.store.text_checksums",
    "described": "elastid.store.description",
    "has_checksum": "elastid.store.checksum",
    "is_as_written": "elastid.store.text_checksums",
    "is_intact": "elastid.store.checksum",
    "keep_checksums": "elastid.store.text_checksums",
    "kind_of": "elastid.store.files",
    "one_writer": "elastid.store.lock",
    "read_configurations": "elastid.store.measured",
    "read_fit": "elastid.store.results",
    "read_forecast": "elastid.store.design",
    "read_friction": "elastid.store.measured",
    "read_peaks": "elastid.store.design",
    "read_plan": "elastid.store.design",
    "read_records": "elastid.store.measured",
    "read_rehearsal": "elastid.store.design",
    "read_responses": "elastid.store.measured",
    "read_stamp": "elastid.store.files",
    "read_validation": "elastid.store.results",
    "remove_leftovers": "elastid.store.files",
    "replacing": "elastid.store.files",
    "text_file": "elastid.store.files",
    "write_fit": "elastid.store.results",
    "write_movement": "elastid.store.design",
    "write_plan": "elastid.store.design",
    "write_records": "elastid.store.measured",
    "write_responses": "elastid.store.measured",
    "write_torque": "elastid.store.design",
    "write_validation": "elastid.store.results",
}

__all__ = [
    "Checkpoint",
    "Stamp",
    "changed_texts",
    "described",
    "has_checksum",
    "is_as_written",
    "is_intact",
    "keep_checksums",
    "kind_of",
    "one_writer",
    "read_configurations",
    "read_fit",
    "read_forecast",
    "read_friction",
    "read_peaks",
    "read_plan",
    "read_records",
    "read_rehearsal",
    "read_responses",
    "read_stamp",
    "read_validation",
    "remove_leftovers",
    "replacing",
    "text_file",
    "write_fit",
    "write_movement",
    "write_plan",
    "write_records",
    "write_responses",
    "write_torque",
    "write_validation",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its module when it is first used."""
    if name not in _HOME:
        raise AttributeError(f"module 'elastid.store' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)
