"""One file a stage: file -> value -> file in the run folder of a study. Their table is `elastid.app.stage_table`."""
