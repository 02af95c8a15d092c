"""The page and the booklet: HTML, the interactive explorer and mode viewer, PDF."""
