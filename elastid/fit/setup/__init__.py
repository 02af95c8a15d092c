"""Before the search: which parameters are identified, what is wrong with responses or wishes, the fit assembled."""
