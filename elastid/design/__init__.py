"""Design of experiments: configurations, realisations and spectra to measure, and a forecast of the estimates."""
