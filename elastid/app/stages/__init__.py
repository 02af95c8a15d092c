"""One file a stage of a study, and the table of stages."""
