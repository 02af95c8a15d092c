"""From records to frequency responses with their covariance."""
