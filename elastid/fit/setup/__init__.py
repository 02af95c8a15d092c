"""Before the search: choice of parameters, checks of responses and geometry, assembly of the fit."""
