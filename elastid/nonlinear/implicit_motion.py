"""Motion that implicit effects of gears, such as friction and hardening, cause and depend on.

The unknowns are deflections of gears and velocities of motors and links at the effects (`periodic_newton`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import starmap

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.nonlinear.basis_functions import GearEffect, GearMotion, Place, along_period, transmission_error
from elastid.nonlinear.period_lines import PeriodLines
from elastid.nonlinear.period_model import DriveLines
from elastid.nonlinear.periodic_newton import Linear, newton


@dataclass(frozen=True, eq=False)
class ImplicitMotion:
    """Equation of the implicit effects of a configuration.

    force_response (F, n, n): motion q by forces.  loads (M, n_j, n): as in `SmoothedMotion`.
    """

    lines: PeriodLines
    drive: DriveLines
    effects: tuple[GearEffect, ...]
    magnitudes: FloatArray
    force_response: ComplexArray
    loads: FloatArray
    tolerance: float

    @cached_property
    def signals(self) -> list[tuple[Place, int]]:
        """Location and joint (index) of each unknown."""
        effects = filter(lambda effect: effect.is_implicit, self.effects)
        return sorted({(effect.place, self.drive.joints.index(effect.joint)) for effect in effects})

    def solve(
        self, base: ComplexArray, m: int, starts: Mapping[tuple[Place, int], FloatArray]
    ) -> tuple[ComplexArray, FloatArray, FloatArray]:
        """Return motion (F, n), unknowns (n_x, n) and forces (n_x, n) of experiment m.

        base (F, n): motion without implicit effects.  starts: earlier unknowns (n,), of `signals`.
        """
        lines, rows = self.lines, self._rows
        if not self.signals:
            return base, *(np.zeros((0, 0)),) * 2
        x_0, static = lines.fine((self._powers * (base @ rows.T)).T), self._static_deflection(m)
        for i, (place, j) in enumerate(self.signals):
            if place == "gear":
                x_0[i] += static[j] + self._transmission_error(base, j, m)
        start = np.array([starts.get(signal, x) for signal, x in zip(self.signals, x_0, strict=True)])
        x, force = newton(partial(self._law, m), self.linear, x_0, start, self.tolerance)
        return base - (self.force_response @ (rows.T @ lines.amplitudes(force).T[:, :, None]))[:, :, 0], x, force

    @cached_property
    def _rows(self) -> FloatArray:
        """Directions (n_x, n) of the unknowns."""
        return np.array(list(starmap(self.drive.directions, self.signals)))

    @cached_property
    def _powers(self) -> ComplexArray:
        """Factor (F, n_x) of the unknowns: 1 for deflections, s for velocities."""
        return self.lines.s[:, None] ** np.where([place == "gear" for place, _ in self.signals], 0, 1)

    @cached_property
    def linear(self) -> "Linear":
        """Map from forces at the unknowns to the unknowns."""
        is_gear = np.array([place == "gear" for place, _ in self.signals], bool)
        A = self._powers[:, :, None] * (self._rows @ self.force_response @ self._rows.T)
        softness = np.where(is_gear, 1 / self.drive.k[[j for _, j in self.signals]], 0.0)
        remainder = len(A) / np.arange(len(A) + 1, self.lines.points // 2)
        return Linear(A.transpose(1, 2, 0).copy(), remainder ** np.where(is_gear, 2, 1)[:, None], softness)

    def _static_deflection(self, m: int) -> FloatArray:
        """Return the mean deflections (n_j,) of the gears in experiment m, under gravity along its motion."""
        return (self.drive.torque + (0.0 if self.lines.arm is None else self.lines.arm[0, :, m].real)) / self.drive.k

    def _transmission_error(self, q: ComplexArray, j: int, m: int) -> FloatArray:
        """Return the transmission error (n,) of joint j along the motion of its motor."""
        angle, total = self._angle(q, j, m), np.zeros(self.lines.points)
        for effect, f in zip(self.effects, self.magnitudes, strict=True):
            if effect.joint == self.drive.joints[j] and effect.kind.startswith("error"):
                total += f * transmission_error(effect, angle, float(self.drive.ratios[j]))[0]
        return total

    def _angle(self, q: ComplexArray, j: int, m: int) -> FloatArray:
        row = self.drive.directions("motor", j)
        return np.asarray(self.lines.fine((q @ row)[None])[0] + row @ self.drive.B @ self.lines.mean[:, m])

    def _law(self, m: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the force (n_x, n) at each unknown of experiment m, and its slope; x (n_x, n)."""
        force, slope = np.zeros_like(x), np.zeros_like(x)
        shapes = {}
        for effect, f in zip(self.effects, self.magnitudes, strict=True):
            if effect.is_implicit and f:
                j = self.drive.joints.index(effect.joint)
                i, size = self.signals.index((effect.place, j)), self.loads[m, j] if effect.kind == "load" else 1.0
                # Load-dependent friction has the sign of the other friction.
                key = "friction" if effect.kind == "load" else effect.kind, i, effect.scale
                if key not in shapes:
                    shapes[key] = along_period(effect, x[i])
                phi, dphi = shapes[key]
                force[i] += f * size * phi
                slope[i] += f * size * dphi
        return force, slope

    def motion(self, q: ComplexArray, j: int, m: int, x: FloatArray, force: FloatArray) -> GearMotion:
        """Return the motion of joint j in experiment m from q (F, n), unknowns x (n_x, n) and their forces."""
        lines, drive, signals = self.lines, self.drive, self.signals
        motor, gear, link = (q @ drive.directions(location, j) for location in ("motor", "gear", "link"))
        amplitudes = np.stack([gear, lines.s * gear, lines.s * motor, lines.s * link])
        swing, slope, velocity, link_velocity = lines.fine(amplitudes)
        motions: dict[Place, FloatArray] = {
            "gear": swing + self._static_deflection(m)[j] + self._transmission_error(q, j, m),
            "motor": velocity, "link": link_velocity,
        }  # fmt: skip
        motions |= {location: signal for (location, joint), signal in zip(signals, x, strict=False) if joint == j}
        torque = drive.k[j] * motions["gear"] + drive.d[j] * slope
        if ("gear", j) in signals:
            torque = torque + force[signals.index(("gear", j))]
        numbers = float(drive.ratios[j]), float(drive.k[j]), float(drive.d[j])
        return GearMotion(self._angle(q, j, m), motions["motor"], motions["link"], motions["gear"], torque, *numbers)
