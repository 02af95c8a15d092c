"""Where do logarithms and the harmonic mean pay: as the criterion of the fit, as its first stage, as a mean?

    python scripts/studies/logarithmic_claims.py [--quick] [--sets 100] [--starts 200]
                                               [--robot three-mass demo] [--seed 0]

Published: the logarithmic criterion is the more robust one against model errors and wrong starts, the harmonic and
logarithmic means have less bias than the arithmetic one (Wernholt and Gunnarsson, LiTH-ISY-R-2774; Wernholt and Moberg,
LiTH-ISY-R-2827 and Automatica 47, 2011). Here each claim is swept from where nothing is wrong to where all is.

1. Criterion: rms error of the stiffnesses and of the dampings, complex, logarithmic, complex with Huber's loss, where
   the model is wrong by more and more: masses, a mode that it lacks, a share of lines that are outliers; weighed by the
   noise alone, and with a floor of 10 % of |G|, which makes all of them relative.
2. First stage: share of single starts that reach the optimum, as starts are further and further off.
3. Means: error and bias of a stiffness fitted to each of them, as the noise of the torque that is measured grows, alone
   (sensor) or through the loop.

Found, and asserted at full size (three masses with 100 data sets and 200 starts; the demo's robot with 20 and 40):

- Where the model is right or wrong by a few per cent the logarithmic criterion gains nothing, and where elements come
  down to their noise, as the demo's, it costs: its stiffnesses scatter twice as much.
- It wins where residuals are factors, not per cents: lines that are wrong altogether (1 % of them is enough: 2 to 4
  times nearer), a missing mode of 30 %. These are the conditions of the published claim. But the complex criterion with
  Huber's loss (`fit.weights.loss: huber`) is nearer still there, 2 to 20 times with outliers, and costs 6 % where
  nothing is wrong.
- As a first stage the logarithm never costs a start: 0 to 15 of 100 more single starts arrive.
- The harmonic mean is 15 to 31 % nearer than the arithmetic one where the measured torque stands 6 dB and less above
  the noise of its own sensor, and hardly from 10 dB on or where the noise comes through the loop. The logarithmic mean
  is within 10 % of the arithmetic one. H1 is the worst from 6 dB down.

So the criterion stays complex with a logarithmic first stage, the mean arithmetic, and Huber's loss is what a rough
measurement asks for. The last line is one JSON object.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from study_plants import Plant, Rig, demo, responses, three_mass

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import ElastidError
from elastid.excitation.multisine import orthogonal_set
from elastid.fit.assembly import relinearise
from elastid.fit.identify import fit_parameters
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.solve.solvers import MAX_HIT_EXCESS
from elastid.fit.spec import WeightSpec
from elastid.frf.covariance import total_covariance, total_error
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.frf.methods import METHODS
from elastid.response import FrequencyResponse

# complex and log as the fit has them, and the complex one with Huber's loss.
Criterion = Literal["complex", "log", "huber"]
CRITERIA: tuple[Criterion, ...] = ("complex", "log", "huber")
FLOORS = (0.0, 0.1)
MEANS = ("arithmetic", "harmonic", "logarithmic", "h1", "joint")
REALISATIONS = 4


def thinned_demo() -> Plant:
    """The demo's robot on every second line of two configurations: a quarter of the time, the same question."""
    plant = demo()
    return replace(plant, freq_hz=plant.freq_hz[::2], configurations=plant.configurations[:2])


ROBOTS: dict[str, Callable[[], Plant]] = {"three-mass": three_mass, "demo": thinned_demo}


def right(rig: Rig, size: float, rng: np.random.Generator) -> tuple[FrequencyResponse, ...]:
    """Nothing is wrong."""
    return rig.exact


def masses(rig: Rig, size: float, rng: np.random.Generator) -> tuple[FrequencyResponse, ...]:
    """Every body with mass and inertia off by a factor of up to 1 + size, up or down."""
    robot = rig.plant.robot
    scale = {body.name: (1 + size) ** rng.uniform(-1, 1) for body in robot.bodies}
    heavy = [name for name in robot.parameters() if name.startswith(("m_", "I_"))]
    values = {n: robot.parameters()[n][0] * scale[n.split("_")[1]] for n in heavy if n.split("_")[1] in scale}
    return responses(rig.plant, rig.linearisation, robot.with_parameters(values))


def hidden_mode(rig: Rig, size: float, rng: np.random.Generator) -> tuple[FrequencyResponse, ...]:
    """A pair of resonance and antiresonance that the model lacks, of this relative size, somewhere in the band."""
    freq_hz = rig.plant.freq_hz
    r = 1j * freq_hz / float(np.exp(rng.uniform(np.log(freq_hz[0]), np.log(freq_hz[-1]))))
    factor = 1 + size * r**2 / (1 + 0.06 * r + r**2)
    return tuple(replace(response, G=response.G * factor[:, None, None]) for response in rig.exact)


def outliers(rig: Rig, size: float, rng: np.random.Generator) -> tuple[FrequencyResponse, ...]:
    """This share of the lines with every element too large or too small by a factor of up to 10."""
    found = []
    for response in rig.exact:
        hit = rng.uniform(size=len(response.freq_hz)) < size
        factor = np.where(hit, 10.0 ** rng.uniform(-1, 1, len(hit)), 1.0)
        found.append(replace(response, G=response.G * factor[:, None, None]))
    return tuple(found)


Wrong = Callable[[Rig, float, np.random.Generator], tuple[FrequencyResponse, ...]]
WRONG: tuple[tuple[Wrong, tuple[float, ...]], ...] = (
    (right, (0.0,)),
    (masses, (0.02, 0.1, 0.3, 1.0)),
    (hidden_mode, (0.003, 0.03, 0.3)),
    (outliers, (0.01, 0.1, 0.3)),
)


def fitted(rig: Rig, data: list[FrequencyResponse], floor: float, criterion: Criterion) -> FloatArray:
    """x - truth (n_x,) of a fit from the truth; NaN where it did not converge, or all was left out as noise."""
    x = rig.plant.parameters.x
    weights = WeightSpec(floor=floor, loss="huber" if criterion == "huber" else "square")
    residual: Literal["complex", "log"] = "log" if criterion == "log" else "complex"
    spec = replace(rig.plant.spec, weights=weights, criterion=residual)
    try:
        end = relinearise(rig.assembly(data, spec), LocalOptimum(x, x, 0.0, 0, True, "the truth"), residual).end
    except ElastidError:
        return np.full(len(x), np.nan)
    moved = np.max(np.abs(end.x - x)) > 1e-9
    return end.x - x if end.converged and moved else np.full(len(x), np.nan)


def rms(errors: FloatArray, names: tuple[str, ...], prefix: str) -> float:
    """Root mean square in % over sets and parameters, the worst tenth of the sets aside: one lost fit is no rms."""
    of_set = np.mean(errors[:, [name.startswith(prefix) for name in names]] ** 2, axis=1)
    of_set = np.where(np.isfinite(of_set), of_set, np.inf)
    return 100 * float(np.sqrt(np.mean(np.sort(of_set)[: max(1, round(0.9 * len(of_set)))])))


def compare_criteria(rig: Rig, sets: int, seed: int) -> list[dict[str, Any]]:
    """Rows: case, size, floor, rms of k and d by criterion in %, and the share of sets in which log is nearer in k."""
    names, rows = rig.plant.parameters.free_names, []
    for wrong, sizes in WRONG:
        for size in sizes:
            data = [rig.drawn(rng, wrong(rig, size, rng)) for rng in _generators(seed, sets)]
            for floor in FLOORS:
                errors = {each: np.array([fitted(rig, one, floor, each) for one in data]) for each in CRITERIA}
                stiff = [name.startswith("k_") for name in names]
                distance = {each: np.mean(error[:, stiff] ** 2, axis=1) for each, error in errors.items()}
                row: dict[str, Any] = {"wrong": wrong.__name__, "size": size, "floor": floor}
                row |= {f"{p}{each}": round(rms(errors[each], names, p), 3) for p in ("k_", "d_") for each in CRITERIA}
                row |= {f"lost_{each}": int(np.sum(np.isnan(distance[each]))) for each in CRITERIA}
                row["log_nearer"] = round(float(np.mean(distance["log"] < distance["complex"])), 3)
                rows.append(row)
    return rows


def compare_first_stages(rig: Rig, starts: int, seed: int) -> list[dict[str, Any]]:
    """Rows: how far the starts are, and the share of single starts that reach the optimum, by the first stage."""
    plant, rows = rig.plant, []
    x = plant.parameters.x
    for factor in (3.0, 10.0, 30.0):
        hits = {True: 0, False: 0}
        for rng in _generators(seed, starts):
            data = rig.drawn(rng)
            best = relinearise(rig.assembly(data, plant.spec), LocalOptimum(x, x, 0.0, 0, True, ""), "complex").end
            values = {
                name: plant.robot.parameters()[name][0]
                * factor ** (rng.uniform(-1, 1) * (1 if name[0] == "k" else 1.5))
                for name in plant.parameters.free_names
            }
            robot = plant.robot.with_parameters(values)
            for log_first in hits:
                spec = replace(plant.spec, starts=1, log_first=log_first, profile=())
                try:
                    result = fit_parameters(data, robot, spec, model=plant.model)
                except ElastidError:
                    continue
                hits[log_first] += result.cost <= best.cost + MAX_HIT_EXCESS * max(1.0, best.cost / result.dof)
        rows.append(
            {
                "factor": factor,
                "complex alone": round(hits[False] / starts, 3),
                "log first": round(hits[True] / starts, 3),
            }
        )
    return rows


def blocks_of(G: ComplexArray, snr_db: float, through_loop: bool, rng: np.random.Generator) -> list[Block]:
    """Realisations of n orthogonal experiments at G (F, n, n), the torque snr_db above the noise N in it.

    sensor: N is in the torque's sensor alone, U = R + N, Y = G R.  through_loop: of a torque N that is not measured and
    a controller K = G^-1 that answers it, Y = G (U + N), U = R - K Y = (R - N) / 2: what biases H1.
    The motion stands 20 dB above its own sensor's noise.
    """
    F, n, _ = G.shape
    size = np.sqrt(np.mean(np.abs(G) ** 2, axis=2))[:, :, None]
    blocks = []
    for _ in range(REALISATIONS):
        R = np.moveaxis(orthogonal_set(np.ones((F, n)), rng), 0, 2)
        e, w = (_circular(rng, F, n, n) for _ in range(2))
        N = 10 ** (-snr_db / 20) * e
        U = (R - N) / 2 if through_loop else R + N
        Y = G @ (U + N if through_loop else R)
        Y = Y + 0.1 * (0.5 if through_loop else 1.0) * size * w
        blocks.append(Block(U, Y, R, np.ones(n), np.zeros((F, n)), 1))
    return blocks


def compare_means(rig: Rig, sets: int, seed: int) -> list[dict[str, Any]]:
    """Rows: noise of the torque, its way, and of each method rms error and bias of the stiffnesses in %."""
    names, rows = rig.plant.parameters.free_names, []
    stiff = [name.startswith("k_") for name in names]
    for through_loop in (False, True):
        for snr_db in (3.0, 6.0, 10.0, 20.0):
            errors: dict[str, list[FloatArray]] = {method: [] for method in MEANS}
            for rng in _generators(seed, sets):
                drawn = [blocks_of(exact.G, snr_db, through_loop, rng) for exact in rig.exact]
                for method in MEANS:
                    data = [_response(r, blocks, method) for r, blocks in zip(rig.exact, drawn, strict=True)]
                    errors[method].append(fitted(rig, data, 0.01, "complex"))
            row: dict[str, Any] = {"way": "through the loop" if through_loop else "sensor", "snr_db": snr_db}
            for method, found in errors.items():
                error = np.array(found)
                known = error[np.isfinite(error).all(axis=1)]
                row[method] = (
                    [
                        round(rms(known, names, "k_"), 3),
                        round(100 * float(np.mean(np.median(known[:, stiff], axis=0))), 3),
                    ]
                    if len(known) > sets / 2
                    else "lost in noise"
                )
            rows.append(row)
    return rows


def _response(exact: FrequencyResponse, blocks: list[Block], method: str) -> FrequencyResponse:
    """The estimate of a method with its covariance from the scatter over realisations."""
    n = exact.G.shape[1] + exact.G.shape[2]
    data = MeanSpectra(tuple(blocks), np.zeros((len(exact.G), n, n), dtype=complex), 0)
    found = METHODS[method](data)
    error = total_error(data, found)
    assert error is not None
    return replace(exact, G=found.G, total=total_covariance(data, found, *error))


def _circular(rng: np.random.Generator, *shape: int) -> ComplexArray:
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def _generators(seed: int, sets: int) -> list[np.random.Generator]:
    return [np.random.default_rng([seed, number]) for number in range(sets)]


def check_claims(found: dict[str, list[dict[str, Any]]]) -> None:
    """What the text above says was found."""
    by_case = {(row["wrong"], row["size"], row["floor"]): row for row in found["criterion"]}
    exact = by_case["right", 0.0, 0.0]
    assert exact["k_complex"] < 1.02 * exact["k_log"]
    assert exact["k_huber"] < 1.08 * exact["k_complex"]
    for size in (0.01, 0.1):
        wild = by_case["outliers", size, 0.1 if size > 0.01 else 0.0]
        assert wild["k_log"] < 0.5 * wild["k_complex"]
        assert wild["k_huber"] < 0.5 * wild["k_log"]
    lacking = by_case["hidden_mode", 0.3, 0.1]
    assert lacking["k_huber"] < lacking["k_log"] < lacking["k_complex"]
    for row in found["first stage"]:
        assert row["log first"] >= row["complex alone"]
    for row in found["means"]:
        if row["way"] == "sensor":
            ratio = row["harmonic"][0] / row["arithmetic"][0]
            assert 0.6 < ratio < 0.9 if row["snr_db"] <= 6 else 0.9 < ratio < 1.1
            assert 0.9 < row["logarithmic"][0] / row["arithmetic"][0] < 1.1
            assert row["snr_db"] > 6 or row["h1"][0] > row["arithmetic"][0]


def show(title: str, rows: list[dict[str, Any]]) -> None:
    """A table."""
    print(f"\n{title}")
    print("  ".join(f"{name:>16}" for name in rows[0]))
    for row in rows:
        print("  ".join(f"{value!s:>16}" for value in row.values()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few data sets of the smallest robot, to see that it runs")
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--robot", nargs="*", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--starts", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    sets, starts = (3, 2) if given.quick else (given.sets, given.starts)
    plants = [ROBOTS[name]() for name in (["three-mass"] if given.quick else given.robot)]
    results: dict[str, Any] = {}
    for plant in plants:
        rig = Rig.of(plant)
        one = {
            "criterion": compare_criteria(rig, sets, given.seed),
            "first stage": compare_first_stages(rig, starts, given.seed),
            "means": compare_means(rig, max(3, sets // 2), given.seed),
        }
        for title, rows in one.items():
            show(f"{plant.name}: {title}", rows)
        results[plant.name] = one
        if not given.quick:
            check_claims(one)
    print(json.dumps(results))


if __name__ == "__main__":
    main()
