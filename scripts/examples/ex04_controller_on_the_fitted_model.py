"""
Controller design on the fitted model
=====================================

Compute the gain margin of a motor controller on a fitted model with python-control.
"""

import control
import ex03_responses_of_python_control as fitted
import numpy as np
from matplotlib.figure import Figure

model = fitted.result.model("home")
plant = model.to_control()  # from motor torque to motor acceleration
velocity = plant * control.tf([1.0], [1.0, 0.0])
loop = 100.0 * velocity * control.tf([1.0], [2e-3, 1.0]) * control.tf([1.0], [2e-3, 1.0])
# On the lines of interest alone: the rigid motion of motor and load together is an integrator that rounding moves.
omega = 2 * np.pi * np.geomspace(1.0, 100.0, 1000)
gain_margin, phase_margin, _, _ = control.margin(control.frd(loop, omega))

if __name__ == "__main__":
    print(f"gain margin {gain_margin:.3g}, phase margin {phase_margin:.3g} deg, modes {model.modes().freq_hz} Hz")
    gain, phase, _ = control.frequency_response(loop, omega)
    figure = Figure(figsize=(8, 5), layout="constrained")
    magnitude, angle = figure.subplots(2, 1, sharex=True)
    magnitude.loglog(omega / (2 * np.pi), gain, label=f"open loop, gain margin {gain_margin:.3g}")
    angle.semilogx(omega / (2 * np.pi), np.degrees(np.unwrap(phase)))
    magnitude.axhline(1.0, color="k", lw=0.5)
    magnitude.legend()
    magnitude.set(ylabel="magnitude")
    angle.set(xlabel="frequency (Hz)", ylabel="phase (deg)")
    figure.savefig("ex04.png")
