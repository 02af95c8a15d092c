"""Files of a run folder: HDF5 artefacts with named axes, units and provenance, texts, checkpoints and a lock.

- files, lock:            text files and checksums; one writer for a run folder
- artefacts:              HDF5 files with provenance; damaged files are rejected
- kinds:                  layout of any frozen dataclass, by its annotations and labels (`base.arrays`); JSON
- writing, reading:       writer and reader of all artefacts by this layout
- description:            content of an artefact as text
- measured, plan:         records.h5, frf.h5, modes.h5; plan.h5
- results:                fit.h5, gears.h5, validation.h5, compare.json, map.h5, tune.h5 and loops.h5
- friction_study:         artefacts of a friction study
- trajectory:             CSV and YAML files for a robot controller
- checkpoint:             finished parts of an interrupted stage

The same value gives the same bytes: no file contains a date.
"""
