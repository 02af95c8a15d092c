"""Stages of a study, one per file; `elastid.app.stage_table` lists them."""
