"""Logs of commands and positions without torque, and the friction estimated from them (`commanded_fit`)."""

from elastid.base.arrays import BoolArray, FloatArray, frozen_value, values_by_name
from elastid.friction_study.least_squares import Estimate
from elastid.friction_study.static_model_fit import friction_of
from elastid.robot import Friction, MeasuredRange

DELAY = "command_delay"


@frozen_value
class CommandedLog:
    """Commands and encoder positions (n, m) of the joints of one log, link side, SI.

    command: k_p r + k_d r' + feed-forward torque.  kp, kd (m,): gains of the equivalent continuous controller;
    delay_inertia (m,), kg m^2: effect of delayed feedback (`equivalent_gains`).  velocity (m,): at the first sample.
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
    delay_inertia: FloatArray
    is_zoh: bool = True


def equivalent_gains(
    kp: FloatArray, kd: FloatArray, delay_s: FloatArray, velocity_delay_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    r"""Return the velocity gain and the inertia (m,) of the continuous controller equivalent to a sampled one.

    kp, kd (m,): gains of the sampled controller.  delay_s (m,): tau, half its period.  velocity_delay_s (m,): tau_v.
    To second order, with a zero-order hold:

    .. math:: k_p\, q(t - \tau) + k_d\, \dot q(t - \tau - \tau_v) = k_p q + (k_d - k_p \tau)\, \dot q
              + \Bigl(\tfrac{2}{3} k_p \tau^2 - k_d (\tau + \tau_v)\Bigr)\, \ddot q
    """
    return kd - kp * delay_s, 2 / 3 * kp * delay_s**2 - kd * (delay_s + velocity_delay_s)


MAX_RELATIVE_ERROR = 0.1  # rms of measured minus simulated positions over the std of the position
MIN_STDS = -2.0  # smallest viscous friction or inertia over its std; below, a negative value is significant


@frozen_value
class CommandedJoint(Estimate):
    """Estimate of one joint from commands alone, link side; the last parameter is the delay.

    rms: of measured minus simulated positions.  is_first: true for the first of the joints that share the delay.
    position_std: of the measured position.  speeds: 5 % and 99 % quantiles, rad/s.  logs, seconds: number and duration
    of the logs.  coupled_inertia: inertia of the robot model's rigid body at this joint; `inertia` is then the armature
    inertia alone. It is 0 if the joints are not coupled; `inertia` is then the total inertia.
    """

    joint: str
    rms: float
    is_first: bool = True
    position_std: float = 0.0
    speeds: tuple[float, float] = (0.0, 0.0)
    coupled_inertia: float = 0.0
    logs: int = 1
    seconds: float = 0.0

    @property
    def relative_error(self) -> float:
        """Rms error of simulated positions over the standard deviation of the position."""
        return self.rms / max(self.position_std, 1e-300)

    @property
    def misfit(self) -> str:
        """Reason why positions or parameters contradict the model; empty without a contradiction."""
        if not self.position_std:
            return "the position is constant. Omit the joint, or record a motion"
        if self.relative_error > MAX_RELATIVE_ERROR:
            return (
                f"positions simulated from the commands have an error of {self.relative_error:.0%} of their std; "
                f"the limit is {MAX_RELATIVE_ERROR:.0%}. Check gains, units and sign of the commands"
            )
        for name, meaning in (("viscous", "viscous friction"), ("inertia", "inertia")):
            stds = self[name] / max(self.std(name), 1e-300)
            if stds < MIN_STDS:
                return (
                    f"{meaning} is {self[name]:.3g}, {stds:.2g} std; the limit is {MIN_STDS:g}. Check rate_hz, "
                    "the gains and the masses of the robot model"
                )
        return ""

    def to_friction(self) -> tuple[Friction, float]:
        """Return friction law and viscous friction, N*m*s/rad, for a robot model; ValueError if that is negative."""
        if self["viscous"] < MIN_STDS * self.std("viscous"):
            raise ValueError(f"viscous friction is {self['viscous']:.3g}, below 0: velocity_gain is too large")
        positive = {"coulomb": max(self["coulomb"], self.std("coulomb") / 1e3)}
        return friction_of(
            values_by_name(self.names, self.values) | positive, 20.0, MeasuredRange(self.speeds, None, None)
        )
