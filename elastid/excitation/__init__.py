"""What to inject: grids of lines, amplitude spectra, phases, multisines."""
