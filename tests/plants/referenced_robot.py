"""Logs of references and encoders of a robot of several joints under sampled PD controllers, in steady state."""

from dataclasses import replace

import numpy as np
import yaml
from scipy.linalg import expm

from elastid.linear.linear_model import state_space
from elastid.linear.linearise import Linearisation
from elastid.record import Configuration
from elastid.study.robots import yaml_text

RATE, N, PERIODS = 1000.0, 4000, 3


def write(folder, robot, postures, delay_s, band=(0.75, 45.0), noise=1e-7, realisations=2):
    """Study, robot.yml with stiffness +30 % and damping +50 %, and logs; the linear robot is exactly discretised.

    The gains give each joint 4 Hz and a damping ratio of 0.8 with its inertia at the lowest line of the first posture.
    """
    folder.mkdir()
    rng, linearisation, files, gains = np.random.default_rng(0), Linearisation.of_robot(robot), [], None
    theta, motors = np.array([value for value, _ in robot.parameters().values()]), robot.motor_locations
    n, lines = len(motors), np.arange(round(band[0] * N / RATE), round(band[1] * N / RATE), 3)
    f, z = lines * RATE / N, np.exp(2j * np.pi * lines / N)[:, None, None]
    for name, angles in postures.items():
        model = linearisation.at(Configuration(name, np.array(angles)), theta, motors, "position")
        plant = state_space(model, model.theta_ref)
        if gains is None:
            inertia = 1 / np.abs(np.diag(plant.response(f[:1])[0]) * (2 * np.pi * f[0]) ** 2)
            gains = inertia * (8 * np.pi) ** 2, 1.6 * inertia * 8 * np.pi
        kp, kd = gains
        m = len(plant.A)
        E = expm(np.block([[plant.A, plant.B], [np.zeros((n, m + n))]]) / RATE)
        P = plant.C @ np.linalg.solve(z * np.eye(m) - E[:m, :m], np.broadcast_to(E[:m, m:], (len(f), m, n)))
        C = (kp + kd * RATE * (1 - 1 / z[:, :, 0]))[:, :, None] * np.eye(n)
        T = P @ np.linalg.solve(np.eye(n) + C @ P, np.exp(-2j * np.pi * f * delay_s)[:, None, None] * np.diag(kp))
        for realisation in range(realisations):
            size = 1 / np.maximum(f, 3.0)[:, None] * np.exp(2j * np.pi * rng.random((len(f), n)))
            for experiment in range(n):
                R = 2e-3 * size * np.exp(2j * np.pi * experiment * np.arange(n) / n)
                spectra = np.zeros((N // 2 + 1, 2 * n), complex)
                spectra[lines] = N / 2 * np.hstack([R, (T @ R[:, :, None])[:, :, 0]])
                rows = np.tile(np.fft.irfft(spectra, N, axis=0), (PERIODS, 1))
                rows[:, n:] += noise * rng.standard_normal((len(rows), n))
                path = f"{name}-r{realisation}-e{experiment}.csv"
                head = ",".join([*(f"r{i}" for i in range(n)), *(f"q{i}" for i in range(n))])
                np.savetxt(folder / path, rows, "%.14g", ",", header=head, comments="")
                numbers = {"realisation": realisation, "experiment": experiment}
                files.append({"path": path, "configuration": name, **numbers})
    channels = [
        {"role": role, "at": motor, "channel": f"{letter}{i}", "quantity": "position", "unit": "rad"}
        for role, letter in (("reference", "r"), ("y", "q"))
        for i, motor in enumerate(motors)
    ]
    controller = {"position_gain": (kp / kd).tolist(), "velocity_gain": kd.tolist()}
    recorded = {"rate_hz": RATE, "period": N / RATE, "controller": controller, "channels": channels, "files": files}
    experiment = {"configurations": {k: [*map(float, v)] for k, v in postures.items()}, "recorded": recorded}
    fit = {"starts": 2, "profile": [], "parameters": {"k_*": {}, "d_*": {}, "fm_*": {}}}
    study = {"name": "referenced", "robot": "robot.yml", "experiment": experiment, "fit": fit}
    (folder / "study.yml").write_text(yaml.safe_dump(study, sort_keys=False))
    start = {k: v * (1.3 if k[0] == "k" else 1.5) for k, (v, _) in robot.parameters().items() if k[:2] in ("k_", "d_")}
    nominal = replace(robot.with_parameters(start), tolerances="exact")
    (folder / "robot.yml").write_text(yaml_text(nominal))
    return folder / "study.yml"
