"""What may be wrong with a fit: status and findings, misread channels, two robots in one fit."""
