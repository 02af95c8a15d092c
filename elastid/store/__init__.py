"""The HDF5 layout of every artefact: named axes as dimension scales, units, native complex numbers, provenance.

- files:    written under another name, synced and renamed, so that no half file is ever seen; read-only afterwards
- design:   reference trajectories, the peaks of their rehearsal, the run nearest to a limit
- forecasts: what a plan is expected to tell
- wing:     plan, records, frequency responses
- results:  fit and validation
- finished: what a stopped stage had done

The same value gives the same bytes: nothing in a file tells the time.
"""

from elastid.store.design import read_forecast, read_peaks, read_rehearsal, write_movement, write_torque
from elastid.store.files import Stamp, described, kind_of, read_stamp, remove_leftovers, replacing, text_file
from elastid.store.measured import (
    read_configurations,
    read_plan,
    read_records,
    read_responses,
    write_plan,
    write_records,
    write_responses,
)
from elastid.store.results import read_fit, read_validation, write_fit, write_validation
from elastid.store.unfinished import Checkpoint

__all__ = [
    "Checkpoint",
    "Stamp",
    "described",
    "kind_of",
    "read_configurations",
    "read_fit",
    "read_forecast",
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
