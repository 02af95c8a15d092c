"""
Run folder in a notebook
========================

Open a run folder in a notebook: results, tables, a figure and a prediction.
"""

# sphinx_gallery_thumbnail_path = "pictures/frf.png"
import sys
from pathlib import Path

import numpy as np

import elastid as ei

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/demo")
responses, result = ei.load(folder / "frf.h5"), ei.load(folder / "fit.h5")
first = next(G for G in responses if G.configuration.name in result.configurations)
model = result.model(first.configuration.name)
figure = ei.plot.bode(first, model)
prediction = model.response(np.geomspace(1.0, 100.0, 400))
relative_std = model.response_std(first.freq_hz) / np.abs(model.response(first.freq_hz).G)

if __name__ == "__main__":
    print(first, result, model, sep="\n\n")
    figure.savefig(folder / "bode.png")
