"""HTML pages of results, with interactive plots of responses and modes."""
