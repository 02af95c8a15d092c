"""The report of a study: figures and the page."""
