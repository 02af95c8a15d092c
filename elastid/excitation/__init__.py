"""Excitation signals: grids of lines, amplitude spectra, phases, multisines."""
