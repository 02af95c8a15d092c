"""The report of a study: figures, the page, the booklet."""
