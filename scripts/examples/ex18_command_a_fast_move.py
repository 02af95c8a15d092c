"""
Fast move without vibration
===========================

Move the tool of an arm with an elastic link in 0.8 s. The example compares rigid-body feedforward, catalogue stiffness
and identified stiffness, simulated with the true values.
"""

import numpy as np

import elastid as ei
from elastid.robot import Frame, Limits, Placement
from elastid.use.moves import point_to_point
from elastid.use.tune import CATALOGUE, IDENTIFIED, RIGID, MoveRobots, tune_move

limits = Limits(velocity=3.0, torque=900.0)
motor = ei.Motor(inertia=2e-3, ratio=100, viscous=1e-3, coulomb=0.05)
turning = ei.Joint("1", "z", ei.Spring(6e4, 80), motor, limits=limits)
lifting = ei.Joint("2", "y", ei.Spring(4e4, 60), motor, limits=limits)
bending = ei.Joint("2z", "z", ei.Spring(2e4, 20))
upper = ei.Body("upper", joints=(turning,), mass=20, center_of_mass=(0.3, 0, 0), inertia=1.0)
fore = ei.Body("fore", "upper", Placement((0.6, 0, 0)), (lifting, bending), 12, (0.3, 0, 0.02), 0.5)
tool = Frame("tool", "fore", Placement((0.6, 0, 0)))
catalogue = ei.Robot("arm", (upper, fore), frames=(tool,))

# The true springs are 20 % softer; a fit knows them to 0.3 %. Of a run, `draw_robots` gives such robots.
true = catalogue.with_parameters({"k_1": 4.8e4, "k_2": 3.2e4, "k_2z": 1.6e4})
rng = np.random.default_rng(0)
identified, *draws = (
    true.with_parameters({
        name: true.parameters()[name][0] * np.exp(3e-3 * rng.standard_normal()) for name in ("k_1", "k_2", "k_2z")
    })
    for _ in range(6)
)  # fmt: skip

given = MoveRobots(
    identified, catalogue, true, "truth", draws, "tool", rate_hz=500.0, bandwidth_hz=4.0, error_m=1e-3
)  # fmt: skip
way = point_to_point(np.radians([0.0, 40.0]), np.radians([35.0, 15.0]), 0.8)
move = tune_move(given, way, "arm")
gain = move[RIGID].largest / move[IDENTIFIED].largest
over_catalogue = move[CATALOGUE].largest / move[IDENTIFIED].largest

if __name__ == "__main__":
    for outcome in move.outcomes:
        print(f"{outcome.name:20s} largest {1e3 * outcome.largest:.3f} mm, vibration {1e3 * outcome.residual:.3f} mm")
    print(f"torques take {100 * float((move.max_torque / move.limits[3]).max()):.0f} % of their limits at most")
    from elastid.report.figures.use import move_figure

    figure = move_figure(move)
    figure.savefig("ex18.png")
