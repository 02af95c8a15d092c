"""What only the sections of a study together can tell, one file a section."""
