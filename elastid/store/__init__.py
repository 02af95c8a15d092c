"""The files of a run folder: artefacts in HDF5 with named axes, units and provenance, texts, and who may write them.

- files:           whole or absent, with checksums; one writer for a run folder
- artefacts:       HDF5 with provenance, refused where it is damaged
- kinds:           the layout of any frozen dataclass, by its annotations and labels (`base.arrays`), and its JSON
- values, reading: the writer and the reader of all artefacts, by that layout; their content as text
- measured:        plan.h5 and CSV files for a robot controller, records.h5 and frf.h5
- results:         fit.h5, gears.h5, validation.h5, compare.json and map.h5
- friction_study:  plan.h5, records.h5, constant_velocity.h5, friction.h5 and filter.h5 of a friction study
- checkpoint:      finished parts of an interrupted stage

The same value gives the same bytes: no file holds a date.
"""
