"""Local polynomial and local rational methods: responses from fewer experiments than inputs, transients removed.

least_squares   windows of bins, and one model at a block of lines: response, transient, residual
regression      the simplest sufficient model at every line; spectra without their transient; repeats
fitted_response G with covariances, coherences, levels and singular values from the fits at its lines
bandwidth       modal bandwidths, compared with the windows
response        records to FrequencyResponse, in open and closed loop, with the error of the model
"""
