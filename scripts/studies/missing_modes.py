"""Measured modes beside those of a robot's model: how often a right model is said to lack one, a wrong one blamed.

    python scripts/studies/missing_modes.py [--quick] [--draws 150] [--seed 0]

The arm of the template `serial` in random postures, lines 0.25 Hz apart from 3 to 60 Hz, noise of 0.1 to 2 % of the
rms of G, and a model whose numbers are 0.3 % off (standard deviation).  In a second response each, a mode at 5 to 55
Hz of 1 to 4 % damping is added at two motors, at least five of its half widths from those of the model, and 0.3 to 1
times as high as the largest |G|.

150 draws: one right model is blamed, and 148 of the modes that are lacking are named.  Asserted: at most 1 % (of few
draws one) and at least 95 %.  The last line is one JSON object.
"""

import argparse
import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.study import load_robot
from elastid.validation.measured_modes import modes_beside

FREQ_HZ = np.arange(12, 240) / 4


def noisy(response: FrequencyResponse, added: np.ndarray, level: float, rng: np.random.Generator) -> FrequencyResponse:
    """With noise and what is added to G."""
    G = response.G + added
    std = level * np.sqrt(np.mean(np.abs(G) ** 2))
    noise = std / np.sqrt(2) * (rng.normal(size=G.shape) + 1j * rng.normal(size=G.shape))
    return replace(response, G=G + noise, noise=Covariance(np.full(G.shape, std**2), np.inf))


def lacking_mode(own_hz: np.ndarray, G: np.ndarray, rng: np.random.Generator) -> tuple[float, np.ndarray]:
    """Frequency of a mode away from the model's, and its part of G."""
    while True:
        f, zeta = rng.uniform(5, 55), rng.uniform(0.01, 0.04)
        if np.abs(own_hz - f).min() > 5 * zeta * f:
            break
    w, natural, shape = 2 * np.pi * FREQ_HZ, 2 * np.pi * f, np.zeros(G.shape[1])
    shape[rng.choice(len(shape), 2, replace=False)] = rng.uniform(0.5, 1, 2)
    modal = -(w**2) / (natural**2 - w**2 + 2j * zeta * natural * w) * 2 * zeta
    return f, rng.uniform(0.3, 1) * np.abs(G).max() * modal[:, None, None] * np.outer(shape, shape)


def main(draws: int, seed: int) -> dict[str, object]:
    """The table, printed and asserted."""
    robot = load_robot(Path(str(files("elastid"))) / "app" / "templates" / "serial" / "robot.yml")
    model, n_u = formulate(robot, ModelSpec()), len(robot.driven)
    false = named = 0
    for draw in range(draws):
        rng = np.random.default_rng(seed + draw)
        linear = linearise(
            model, Configuration("posture", rng.uniform(-1, 1, n_u)), model.theta, model.inputs, "acceleration"
        )
        theta = linear.theta_ref * (1 + 0.003 * rng.normal(size=len(linear.theta_ref)))
        right, modelled = (to_response(linear, each, FREQ_HZ) for each in (linear.theta_ref, theta))
        level = 10 ** rng.uniform(-3, np.log10(0.02))
        clean = modes_beside(noisy(right, np.zeros(right.G.shape), level, rng), modelled, linear, theta)
        false += bool(clean.is_missing.any())
        f, added = lacking_mode(modes(linear, theta).freq_hz, right.G, rng)
        own = modes_beside(noisy(right, added, level, rng), modelled, linear, theta)
        found = own.freq_hz[own.is_missing]
        named += len(found) > 0 and np.abs(found - f).min() < 0.02 * f
        if not (len(found) > 0 and np.abs(found - f).min() < 0.02 * f):
            near = np.argmin(np.abs(own.freq_hz - f)) if len(own.freq_hz) else -1
            print(f"  draw {draw}: {f:.2f} Hz, nearest {own.rows[near] if near >= 0 else None}", flush=True)
        if draws > 50 and draw % 50 == 49:
            print(draw + 1, false, named, flush=True)
    table = {"draws": draws, "right_models_blamed": false / draws, "lacking_modes_named": round(named / draws, 4)}
    assert false <= max(0.01 * draws, 1), table
    assert named >= 0.95 * draws, table
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="5 draws")
    parser.add_argument("--draws", type=int, default=150)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    print(json.dumps(main(5 if asked.quick else asked.draws, asked.seed)))
