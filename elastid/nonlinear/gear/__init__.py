"""What gears do besides being springs, found from multisine records together with the parameters of a fit."""
