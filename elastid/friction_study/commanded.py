"""Logs of commands and positions without torque, and the friction estimated from them (`commanded_fit`)."""

from elastid.base.arrays import BoolArray, FloatArray, frozen_value, named
from elastid.friction_study.least_squares import Estimate
from elastid.friction_study.static_model_fit import friction_of
from elastid.robot import Friction, MeasuredRange

DELAY = "command_delay"


@frozen_value
class CommandedLog:
    """Commands and encoder positions (n, m) of the joints of one log, link side, SI.

    command: k_p r + k_d r' + feed-forward torque.  kp, kd (m,): gains of the equivalent continuous controller;
    late_inertia (m,), kg m^2: effect of delayed feedback (`acting_gains`).  velocity (m,): at the first sample.
    coupled_inertia (m,): inertia of the robot model's rigid body at each joint, 0 if the joints are not coupled.
    is_zoh: true if commands are constant between samples, false if they are linear between samples.  has_gravity (m,):
    true if gravity on the joint changes with its angle.  load (n, m): torque of the rest of the robot.
    """

    name: str
    joints: tuple[str, ...]
    rate_hz: float
    position: FloatArray
    command: FloatArray
    kp: FloatArray
    kd: FloatArray
    velocity: FloatArray
    has_gravity: BoolArray
    load: FloatArray
    coupled_inertia: FloatArray
    late_inertia: FloatArray
    is_zoh: bool = True


def acting_gains(
    kp: FloatArray, kd: FloatArray, late_s: FloatArray, velocity_late_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    r"""Return the velocity gain and the inertia (m,) of the continuous controller equivalent to a sampled one.

    For a zero-order hold of T_c = 2 tau and velocities delayed by tau_v, to second order:

    .. math:: k_p\, q(t - \tau) + k_d\, \dot q(t - \tau - \tau_v) = k_p q + (k_d - k_p \tau)\, \dot q
              + \Bigl(\tfrac{2}{3} k_p \tau^2 - k_d (\tau + \tau_v)\Bigr)\, \ddot q
    """
    return kd - kp * late_s, 2 / 3 * kp * late_s**2 - kd * (late_s + velocity_late_s)


# Largest relative error: rms of measured minus simulated positions over the rms of the position about its mean.
MAX_ERROR = 0.1
LEAST_VISCOUS = -2.0  # standard deviations: viscous friction below this value would supply power


@frozen_value
class CommandedJoint(Estimate):
    """Estimate of one joint from commands alone, link side; the last parameter is the delay.

    rms: of measured minus simulated positions.  is_first: True for the first of the joints that share the delay.
    travel: rms of the position about its mean.  speeds: lowest and highest, rad/s.  logs: number of logs.  seconds:
    duration of all logs.  carried: inertia of the rigid-body model at this joint, to which the armature `inertia` is
    added; 0 if the joints are not coupled and `inertia` is the total inertia.
    """

    joint: str
    rms: float
    is_first: bool = True
    travel: float = 0.0
    speeds: tuple[float, float] = (0.0, 0.0)
    carried: float = 0.0
    logs: int = 1
    seconds: float = 0.0

    @property
    def relative_error(self) -> float:
        """Rms error of simulated positions over the rms of the position about its mean."""
        return self.rms / max(self.travel, 1e-300)

    @property
    def misfit(self) -> str:
        """Reason why positions or parameters contradict the model; empty without a contradiction."""
        stds = self["viscous"] / max(self.std("viscous"), 1e-300)
        if stds < LEAST_VISCOUS:
            return (
                f"viscous friction is {self['viscous']:.3g}, {stds:.2g} std; the limit is {LEAST_VISCOUS:g}. Check "
                "rate_hz and velocity_gain"
            )
        if self.relative_error <= MAX_ERROR:
            return ""
        return (
            f"positions simulated from the commands have an error of {self.relative_error:.0%} of the rms position; "
            f"the limit is {MAX_ERROR:.0%}. Check gains, units and sign of the commands"
        )

    def to_friction(self) -> tuple[Friction, float]:
        """Return friction law and viscous friction, N*m*s/rad, for a robot model; ValueError if that is negative."""
        if self["viscous"] < LEAST_VISCOUS * self.std("viscous"):
            raise ValueError(f"viscous friction is {self['viscous']:.3g}, below 0: velocity_gain is too large")
        return friction_of(named(self.names, self.values), 20.0, MeasuredRange(self.speeds, None, None))
