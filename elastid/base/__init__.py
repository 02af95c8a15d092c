"""What every room uses: array types, errors, units, sections of a study, execution in processes."""
