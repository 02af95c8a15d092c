"""live: experiment by experiment towards a goal, references out and logs in as files."""
