"""
Three axes
==========

Identify the seven springs of the demo arm from the FRFs of its three motors in four configurations.
"""

from importlib.resources import files

import numpy as np
from exact_responses import measured

import elastid as ei
from elastid.study import load_study

study = load_study(str(files("elastid") / "app" / "templates" / "serial" / "study.yml")).study
robot, truth = study.as_robot(), dict(study.experiment.as_simulated().truth)
postures = dict(list(study.experiment.configurations.items())[:4])
data = measured(robot, truth, postures, np.linspace(2.0, 60.0, 60), noise=0.02)
result = ei.identify(data, robot, ei.choose(robot, "k_*", "d_*"), starts=2, seed=1)
off = {name: result.values[name] / truth[name] - 1 for name in truth if name.startswith("k_")}

if __name__ == "__main__":
    print({name: f"{100 * each:+.2f} %" for name, each in off.items()})
    figure = ei.plot.bode(data[0], result.model(data[0].configuration.name))
    figure.savefig("ex13.png")
