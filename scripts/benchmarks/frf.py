"""How fast responses are estimated: 6 x 6 with full noise and total covariance, against the bare FFT and two peers.

    python scripts/benchmarks/frf.py [--quick] [--no-peers]

P = 8 periods, M = 6 realisations of 6 orthogonal experiments, N = 16384 samples: 36 records, 453 MB. Case A: all 8191
lines. Case B: 200 odd lines. One process, one thread, CPU time, everything in the same run and in turn. The floor is
scipy.fft.rfft of u and y, record by record, its results dropped, in the faster of two orders: all channels of a record
in contiguous periods, and as recorded; the DFT of elastid, in C, takes several signals at once. Peers:
scipy.signal.csd of all pairs at once by broadcasting, for H1 without any variance and without the detrending that
excited lines do not need; best-linear-approximation (its `noisy_input`) where it is installed; it needs Python 3.12.
--no-peers: floor and elastid only (a peer may need 12 GB).
The last line is one JSON object with the numbers of the table; last_run.json has those of the last run of each part.

Measured (CPU time, medians in turn, two cores): the odd lines take 1.00 (B_over_floor) and all lines 2.75
(A_over_floor) times the floor and 0.18 (A_gb_above_data) GB above the data. The same by scipy.signal.csd takes 14.5
(B_faster_than_csd) and 5.5 (A_faster_than_csd) times as long. A record is read from a log, checked and repaired in
82 (B_log_over_floor) times the floor of its FFT.
"""

import json
import tracemalloc
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import timing
import h5py
import numpy as np
from fit import build_robot
from scipy.fft import rfft

from elastid.base.arrays import ComplexArray, IntArray
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.logs.rig import RecordedRig
from elastid.record import Configuration, Record

AS_IS = {"window": "boxcar", "noverlap": 0, "detrend": False}
RATE_HZ, NOISE_U, NOISE_Y = 1000.0, 0.002, 0.01
PEERS = ("csd", "best-linear-approximation")
CONFIGURATION = Configuration("bench", np.zeros(6))


def plant(F: int, n: int) -> ComplexArray:
    """Draw a diagonally dominant FRF matrix (F, n, n)."""
    rng = np.random.default_rng(0)
    return rng.normal(size=(F, n, n)) + 1j * rng.normal(size=(F, n, n)) + 3 * np.eye(n)


def simulate(lines: IntArray, N: int, P: int, M: int, n: int) -> list[Record]:
    """Simulate records with orthogonal multisines at lines (F,), with noise on inputs and outputs."""
    rng, G = np.random.default_rng(1), plant(len(lines), n)
    places = tuple(f"motor {i + 1}" for i in range(n))
    records = []
    for m in range(M):
        for e, U in enumerate(orthogonal_set(np.full((len(lines), n), np.sqrt(2 / len(lines))), rng)):
            signals = ((U, NOISE_U), (np.einsum("fyu,fu->fy", G, U), NOISE_Y))
            measured = [
                np.tile(synthesise(lines, X, N), (P, 1)) + noise * rng.standard_normal((P * N, n))
                for X, noise in signals
            ]
            experiment = (f"{m}-{e}", CONFIGURATION, m, e, RATE_HZ, N)
            records.append(Record(*experiment, places, places, ("acceleration",) * n, *measured))
    return records


def by_csd(records: Sequence[Record], lines: IntArray) -> ComplexArray:
    """Estimate H1 of all records by scipy.signal.csd, with one FFT per channel instead of one per pair."""
    from scipy.signal import csd

    n, N = records[0].u.shape[1], records[0].period_samples
    yu, uu = np.zeros((2, len(lines), n, n), dtype=complex)
    for record in records:
        for S, x in ((yu, record.y), (uu, record.u)):
            each = csd(record.u.T[None], x.T[:, None], nperseg=N, **AS_IS)[1]
            S += np.moveaxis(each[:, :, lines], 2, 0)
    return np.asarray(yu @ np.linalg.inv(uu))


def by_peer(records: Sequence[Record], lines: IntArray, M: int) -> Callable[[], ComplexArray] | None:
    """Prepare noisy_input of best-linear-approximation with precomputed arrays; None if it is not installed."""
    try:
        from best_linear_approximation.robust import noisy_input
    except ImportError:
        return None
    n, N = records[0].u.shape[1], records[0].period_samples
    u, y = (
        np.array([getattr(r, name).reshape(-1, N, n) for r in records])
        .reshape(M, n, -1, N, n)
        .transpose(3, 4, 1, 0, 2)
        .copy()
        for name in ("u", "y")
    )
    return lambda: noisy_input(u, y, RATE_HZ, lines, show_warnings=False).G


def log_s(record: Record, repeats: int) -> float:
    """Return the CPU time, s, of the import of a record from an HDF5 log, with all checks and corrections."""
    channels = [ChannelSpec("u", place, f"u{i}") for i, place in enumerate(record.inputs)]
    channels += [ChannelSpec("y", place, f"y{i}", quantity="acceleration") for i, place in enumerate(record.outputs)]
    with TemporaryDirectory() as folder:
        with h5py.File(f"{folder}/log.h5", "w") as file:
            file.update(zip((channel.channel for channel in channels), (*record.u.T, *record.y.T), strict=True))
        logged = RecordedSpec(RATE_HZ, tuple(channels), (FileSpec("log.h5", "c"),), record.period_samples / RATE_HZ)
        rig = RecordedRig(build_robot(), ExperimentSpec({"c": (0.0,) * 6}, recorded=logged), Path(folder))
        return timing.cpu_seconds(lambda: rig.measure(rig.experiments[0]), repeats)


def floors(records: Sequence[Record]) -> dict[str, Callable[[], None]]:
    """Prepare the bare FFT of the same data in two memory orders, with the spectra of one record at a time."""
    recorded = [x.reshape(-1, r.period_samples, x.shape[1]) for r in records for x in (r.u, r.y)]
    blocks = [np.ascontiguousarray(x.transpose(0, 2, 1)) for x in recorded]

    def transform(arrays: Sequence[np.ndarray], axis: int) -> None:
        for x in arrays:
            rfft(x, axis=axis, workers=1)

    return {"floor, records": lambda: transform(blocks, 2), "floor, as recorded": lambda: transform(recorded, 1)}


def case(name: str, lines: IntArray, size: tuple[int, int, int, int], repeats: int, peers: bool) -> dict[str, float]:
    """Measure CPU times of bare FFT, elastid and other packages on the records of one case."""
    N, P, M, n = size
    records = simulate(lines, N, P, M, n)
    data_gb = sum(r.u.nbytes + r.y.nbytes for r in records) / 2**30
    spec = EstimatorSpec()
    tracemalloc.start()
    response = estimate(records, spec, lines)
    above = tracemalloc.get_traced_memory()[1] / 2**30
    tracemalloc.stop()
    assert response.noise is not None
    assert response.total is not None
    error = np.abs(response.G - plant(len(lines), n)) ** 2
    ratios = {
        f"{kind} variance over true": float(error.mean() / covariance.variance.mean())
        for kind, covariance in (("noise", response.noise), ("total", response.total))
    }
    orders = floors(records)
    times = timing.in_turn({**orders, "elastid": lambda: estimate(records, spec, lines)}, repeats)
    times |= {"floor": min(times[order] for order in orders), "data_gb": data_gb, "gb_above_data": above, **ratios}
    times["log"] = log_s(records[0], repeats) * len(records)
    if peers:
        times["csd"] = timing.cpu_seconds(lambda: by_csd(records, lines), min(repeats, 3))
        peer = by_peer(records, lines, M)
        if peer is not None:
            times["best-linear-approximation"] = timing.cpu_seconds(peer, min(repeats, 3))
    print(f"case {name}, {len(lines)} lines:", json.dumps({what: round(value, 3) for what, value in times.items()}))
    return times


def main() -> None:
    arguments = timing.options(__doc__, "short records, to see that it runs", **{"no-peers": False})
    size, repeats = ((512, 4, 3, 3), 1) if arguments.quick else ((16384, 8, 6, 6), 5)
    print(timing.machine())
    N = size[0]
    cases = {"B": np.arange(1, min(400, N // 2), 2), "A": np.arange(1, N // 2)}
    results = {name: case(name, lines, size, repeats, not arguments.no_peers) for name, lines in cases.items()}
    summary = {}
    for name, row in results.items():
        summary[f"{name}_over_floor"] = round(row["elastid"] / row["floor"], 3)
        summary[f"{name}_gb_above_data"] = round(row["gb_above_data"], 3)
        summary[f"{name}_log_over_floor"] = round(row["log"] / row["floor"], 1)
        for peer in PEERS:
            if peer in row:
                summary[f"{name}_faster_than_{peer.replace(' ', '_')}"] = round(row[peer] / row["elastid"], 1)
    print(f"\n{json.dumps(summary)}")


if __name__ == "__main__":
    main()
