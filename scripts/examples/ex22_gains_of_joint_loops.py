"""
Gains of joint control loops
============================

Two motors with elastic gears and one elastic link have a sampled cascade controller with a delay of one sample. The
example maximises the bandwidth with a sensitivity peak below 6 dB, in two configurations and for posterior samples. It
names the limiting modes.
"""

import elastid as ei
from elastid.record import JointLoop
from elastid.robot import Placement
from elastid.use.gain_design import design_robust
from elastid.use.loops import assess
from elastid.use.plants import PostureFamily

rate_hz, delay = 500.0, 1
motor = ei.Motor(inertia=2e-3, ratio=100, viscous=1e-3)
turning, bending = ei.Joint("1", "z", ei.Spring(4e4, 60), motor), ei.Joint("1z", "z", ei.Spring(2e4, 20))
lifting = ei.Joint("2", "y", ei.Spring(3e4, 40), motor)
upper = ei.Body("upper", joints=(turning,), mass=20, center_of_mass=(0.3, 0, 0), inertia=1.0)
fore = ei.Body("fore", "upper", Placement((0.6, 0, 0)), (lifting, bending), 12, (0.3, 0, 0), 0.5)
robot = ei.Robot("arm", (upper, fore))

# Responses as a robot would give them, by the simulated rig, and a fit of stiffness and damping.
excitation = {"rate_hz": rate_hz, "period": "4 s", "band_hz": [1, 80], "torque_rms": 30}
rig = {"truth": {"k_1": 4.6e4, "k_1z": 2.3e4, "k_2": 3.4e4}, "noise": {"torque_std": 1, "encoder_counts": 2**20}}
experiment = {"configurations": {"stretched": [0, 0], "folded": [0.6, 1.2]}, "simulated": rig}
records = ei.simulate(robot, excitation=excitation, experiment=experiment, seed=1)
fit = ei.identify(ei.estimate(records, friction="none"), robot, ei.choose(robot, "k_*", "d_*"), starts=2, seed=1)

family = PostureFamily.of(fit, [linear.configuration for linear in fit.linear], rate_hz)
draws = family.draws(fit, 20, seed=1)
first_hz = min(mode.freq_hz for own in family.modes for mode in own)
cascade = design_robust(family.estimate, draws, first_hz, delay)
designed = assess("designed", family, draws, cascade.gains, cascade.filters(rate_hz))

# The same numbers without notches and low pass, at three times the gain.
harder = JointLoop(9 * cascade.gains.kp, 3 * cascade.gains.kd, cascade.gains.ki)
wild = assess("three times", family, None, harder, None)

if __name__ == "__main__":
    print(cascade.to_spec(("1", "2")), designed.bandwidth_hz, designed.limited_by, sep="\n")
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots()
    for state in (designed, wild):
        axes.semilogx(state.freq_hz[0], state.sensitivity_db[0], label=state.name)
    axes.legend(title="sensitivity in dB over Hz")
    figure.savefig("ex20.png")
