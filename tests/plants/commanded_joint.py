"""One joint under a PD controller with held commands, by an integrator of its own, as users of simulators log it."""

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.record import JointLoop
from elastid.robot import Body, Joint, Motor, Robot
from elastid.validation.command_replay import CommandedMotion

RATE = 200.0
STEP_S = 1e-4


@dataclass(frozen=True)
class CommandedJoint:
    """J q'' = kp (r - q) - kd q' - f q' - F_c sgn q' - G cos q, the command r held for a sample and late by delay_s."""

    inertia: float = 0.03
    viscous: float = 0.25
    coulomb: float = 0.15
    gravity: float = 0.8
    kp: float = 20.0
    kd: float = 1.0
    delay_s: float = 0.0

    @property
    def robot(self) -> Robot:
        """The joint as a robot: half a unit of mass on an arm about y, the rest of the inertia in the rotor."""
        arm, mass = self.gravity / 9.81, 1.0
        joint = Joint("knee", axis="y", motor=Motor(self.inertia - mass * arm**2, 1.0, self.viscous, self.coulomb))
        return Robot("leg", (Body("shank", joints=(joint,), mass=mass, center_of_mass=(-arm, 0.0, 0.0)),))

    def motion(self, seconds: float = 4.0, seed: int = 0) -> CommandedMotion:
        """Commands of five sines below 3 Hz, and the positions, both at RATE."""
        rng, n = np.random.default_rng(seed), round(seconds * RATE)
        t = np.arange(n) / RATE
        waves = zip(rng.uniform(0.2, 3.0, 5), rng.uniform(0, 2 * np.pi, 5), strict=True)
        command = sum((0.15 * (np.sin(2 * np.pi * f * t + p) - np.sin(p)) for f, p in waves), np.zeros(n))
        position = self.positions(command)
        gains = JointLoop(np.array([self.kp]), np.array([self.kd]), np.zeros(1))
        return CommandedMotion("log", RATE, command[:, None], np.zeros((n, 1)), position[:, None], gains)

    def positions(self, command: FloatArray) -> FloatArray:
        """Positions (n,) at the samples of a command (n,), from rest."""
        steps, late = round(1 / (RATE * STEP_S)), round(self.delay_s / STEP_S)
        held = np.repeat(command, steps)
        held = np.concatenate([np.full(late, held[0]), held])[: len(held)]
        q, v, result = float(command[0]), 0.0, np.empty(len(held))
        for i, r in enumerate(held.tolist()):
            result[i] = q
            force = self.kp * (r - q) - (self.kd + self.viscous) * v - self.gravity * float(np.cos(q))
            v += force * STEP_S / self.inertia
            dry = self.coulomb * STEP_S / self.inertia
            v = v - dry if v > dry else v + dry if v < -dry else 0.0
            q += v * STEP_S
        return np.asarray(result[::steps])
