"""What may be wrong with a fit: status, findings, modification indices, configurations that are unlike the others."""
