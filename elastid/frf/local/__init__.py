"""Local polynomial and local rational methods: responses from fewer experiments than inputs, transients removed.

windows         the bins that the fit at each line sees, and how many it needs
least_squares   one least-squares model at a block of lines: response, transient, residual
regression      the simplest of several models that is sufficient, at every line
transient       a record's spectra without its transient, and their noise, from the bins that are not excited
bandwidth       whether a window is narrower than the modes in it
repeats         repeats of one excitation as one experiment
fitted_response G and its covariances from the fits at its lines
quality         coherences, levels and singular values of G, from the fits at its lines
model_error     the error of a model, from richer ones
response        records to FrequencyResponse, in open and closed loop
"""
