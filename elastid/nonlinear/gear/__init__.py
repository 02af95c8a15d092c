"""Effects of gears beside their springs, found from multisine records together with the parameters of a fit."""
