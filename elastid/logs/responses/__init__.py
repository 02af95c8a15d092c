"""Frequency responses that were measured elsewhere: MATLAB structs, HDF5, CSV and UFF 58 -> Response."""
