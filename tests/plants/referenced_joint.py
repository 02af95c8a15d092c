"""A motor and a load on a spring under a sampled PD controller, exactly discretised; references that act late."""

from dataclasses import dataclass

import numpy as np
import yaml
from scipy.linalg import expm

RATE, N = 1000.0, 2000
BAND = (0.5, 40.0)


@dataclass(frozen=True)
class ReferencedJoint:
    """Torques held at RATE.  exact_velocity: the controller has the velocity itself, else the difference of angles.

    cycle: samples between references, which are held, or reached one cycle later.
    """

    k: float = 2000.0
    d: float = 2.0
    motor: float = 0.4
    load: float = 0.8
    fm: float = 1.5
    kp: float = 400.0
    kd: float = 20.0
    forward: float = 0.0
    delay_s: float = 0.0
    exact_velocity: bool = False
    cycle: int = 1
    is_linear: bool = False

    @property
    def sampled(self):
        """A (4, 4) and B (4,) from sample to sample of angles and velocities of motor and load."""
        k, d, J, L = self.k, self.d, self.motor, self.load
        A = np.zeros((5, 5))
        A[0, 2] = A[1, 3] = 1.0
        A[2] = [-k / J, k / J, -(d + self.fm) / J, d / J, 1 / J]
        A[3] = [k / L, -k / L, d / L, -d / L, 0.0]
        E = expm(A / RATE)
        return E[:4, :4], E[:4, 4]

    def response(self, freq_hz, row=0):
        """Angle of motor (0) or load (1) over reference (F,), in closed form."""
        z = np.exp(2j * np.pi * freq_hz / RATE)
        A, B = self.sampled
        X = np.linalg.solve(z[:, None, None] * np.eye(4) - A, B.astype(complex)[None, :, None])[:, :, 0]
        D = RATE * (1 - 1 / z)
        fed_back = self.kp * X[:, 0] + self.kd * (X[:, 2] if self.exact_velocity else D * X[:, 0])
        late = np.exp(-2j * np.pi * freq_hz * self.delay_s)
        return X[:, row] * (self.kp + self.forward * self.kd * D) * late / (1 + fed_back)

    def log(self, seed, periods=3, noise=1e-6, row=0, torque=False, target=False):
        """Reference, or torque, and angle (periods N, 2) of a multisine, after the transient.

        target: the reference is logged before it is interpolated.
        """
        rng = np.random.default_rng(seed)
        lines = np.arange(round(BAND[0] * N / RATE), round(BAND[1] * N / RATE) + 1)
        omega, phases = 2 * np.pi * lines * RATE / N, rng.uniform(0, 2 * np.pi, len(lines))
        size = 1 / np.maximum(lines * RATE / N, 3.0)
        size *= 2e-3 * np.sqrt(2 / np.sum(size**2))

        def path(k, delay_s=0.0, is_linear=self.is_linear):
            first = k // self.cycle * self.cycle
            share = (k - first + 1)[:, None] / self.cycle if is_linear else 1.0
            return (share * bases(first, delay_s) + (1 - share) * bases(first - self.cycle, delay_s)) @ size

        def bases(k, delay_s):
            return np.cos(np.outer(k / RATE - delay_s, omega) + phases)

        k = np.arange(N)
        r, late, before = (
            path(k, is_linear=self.is_linear and not target),
            path(k, self.delay_s),
            path(k - 1, self.delay_s),
        )
        command = (self.kp * late + self.forward * self.kd * RATE * (late - before)).tolist()
        (A, B), x, old, q = self.sampled, np.zeros(4), 0.0, np.zeros((periods + 2) * N)
        u = np.zeros_like(q)
        for i in range(len(q)):
            q[i] = x[row]
            velocity = x[2] if self.exact_velocity else RATE * (x[0] - old)
            old = x[0]
            u[i] = command[i % N] - self.kp * x[0] - self.kd * velocity
            x = A @ x + B * u[i]
        y = q[2 * N :] + noise * rng.standard_normal(periods * N)
        return np.column_stack([u[2 * N :] if torque else np.tile(r, periods), y])

    def write(
        self,
        folder,
        logs=3,
        stated=None,
        every=1,
        seed=0,
        sensor="motor 1",
        noise=1e-6,
        torque=False,
        target=False,
        **fit,
    ):
        """Logs, robot.yml and study.yml in a folder; stated: gains that do not act.  every: of the samples."""
        folder.mkdir(parents=True, exist_ok=True)
        row = int(sensor.startswith("joint"))
        for i in range(logs):
            rows = self.log(1000 * seed + i, noise=noise, row=row, torque=torque, target=target)[::every]
            np.savetxt(folder / f"m{i}.csv", rows, "%.14g", ",", header="command,angle", comments="")
        kp, kd = stated or (self.kp, self.kd)
        controller = {"position_gain": kp / kd, "velocity_gain": kd, "velocity_feedforward": self.forward}
        if every > 1:
            controller |= {"reference": {"cycle": 1 / RATE, "interpolation": "hold"}, "ticks": 1}
        if self.cycle > 1:
            path = {"cycle": self.cycle / RATE, "interpolation": "linear" if self.is_linear else "hold"}
            controller |= {"reference": path, "ticks": self.cycle}
        if self.exact_velocity:
            controller["velocity"] = "exact"
        motor, spring = {"inertia": self.motor, "ratio": 1.0, "viscous": 1.0}, {"stiffness": 1.3 * self.k}
        joint = {"name": "1", "axis": "z", "motor": motor, "spring": spring | {"damping": 1.5 * self.d}}
        body = {"name": "load", "inertia": self.load, "joints": [joint]}
        place = {"quantity": "position", "unit": "rad"}
        drive = {"role": "u", "hold": "zero-order"} if torque else {"role": "reference", **place}
        channels = [
            {"at": "motor 1", "channel": "command", **drive},
            {"role": "y", "at": sensor, "channel": "angle", **place},
        ]
        files = [{"path": f"m{i}.csv", "configuration": "c", "realisation": i} for i in range(logs)]
        recorded = {"rate_hz": RATE / every, "period": N / RATE, "controller": controller, "channels": channels}
        study = {
            "name": "referenced",
            "robot": "robot.yml",
            "experiment": {"configurations": {"c": [0.0]}, "recorded": recorded | {"files": files}},
            "fit": {"starts": 2, "profile": [], "parameters": {"k_1": {}, "d_1": {}, "fm_1": {}} | fit},
        }
        robot = {"name": "joint", "tolerances": "exact", "bodies": [body]}
        for name, content in (("robot.yml", robot), ("study.yml", study)):
            (folder / name).write_text(yaml.safe_dump(content, sort_keys=False))
        return folder / "study.yml"
