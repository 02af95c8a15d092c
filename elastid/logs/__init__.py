"""The rig that is a folder of logs: reading, aligning, mending and gathering them into records."""
