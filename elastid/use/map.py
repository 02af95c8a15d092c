r"""A map of the workspace: compliance, frequencies, chatter and deflection of many postures, with their intervals.

.. math:: C = J K^{-1} J^T, \qquad
          G(j\omega) = J\, (K - \omega^2 M + j \omega D)^{-1} J^T, \qquad
          a_{lim} = \frac{-1}{2 K_t \min_\omega \mathrm{Re}\, G_{nf}}

The lines of each posture include the peak and the most negative real part of each mode. G_nf = n^T G f: motion along
the normal n of the cut by a force along f; without directions the worst of all, n = f the eigenvector of the smallest
eigenvalue of Re G (Altintas, Manufacturing Automation, 2nd ed., 2012, eq. 4.20). Standard deviations are those of
`FittedModel.response_shifts`, of first order, at the line of the extremum, which moves in second order.
"""

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.errors import StudyError
from elastid.base.statistics import QUANTILE_95
from elastid.fit.posture import Family, PredictionPorts
from elastid.fit.result import Result
from elastid.frf.matrices import singular_values
from elastid.linear.equilibrium import equilibrium
from elastid.linear.fitted_model import UncertainModes
from elastid.linear.linear_model import LinearModel
from elastid.linear.modes import strain_energy
from elastid.linear.response.transfer import frequency_response
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration

LINES, CURVE_LINES = 300, 120
_QUASI_STATIC_FRACTION = 1e-5  # of the first natural frequency: a force so slow finds the robot at rest


@dataclass(frozen=True)
class Cut:
    """Load (3,) on the tool in N, cutting coefficient K_t in N/m^2, directions (3,) in the base's axes or None.

    normal: of the cut surface, along which the chip gets thicker.  force: along which the cutting force acts.
    """

    load: tuple[float, float, float] = (0.0, 0.0, -100.0)
    cutting_coefficient: float = 700e6
    normal: tuple[float, float, float] | None = None
    force: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        directions = [each for each in (self.normal, self.force) if each is not None]
        if not (np.all(np.isfinite([self.load, *directions])) and all(map(np.any, directions))):
            raise ValueError("load, normal and force are finite, and no direction is the zero vector")
        if not self.cutting_coefficient > 0:
            raise ValueError(f"cutting coefficient {self.cutting_coefficient:g} N/m^2; it must be positive")

    @property
    def directions(self) -> tuple[FloatArray, FloatArray] | None:
        """n and f (3,) of unit length; the force acts along the normal unless it is given."""
        if self.normal is None:
            return None
        n, f = np.array(self.normal, float), np.array(self.force or self.normal, float)
        return n / np.linalg.norm(n), f / np.linalg.norm(f)


# Quantities of a posture: unit and meaning.
QUANTITIES: dict[str, tuple[str, str]] = {
    "softest_compliance": ("m/N", "static compliance in the softest direction"),
    "compliance_x": ("m/N", "static compliance along x of the base"),
    "compliance_y": ("m/N", "static compliance along y of the base"),
    "compliance_z": ("m/N", "static compliance along z of the base"),
    "deflection": ("m", "deflection of the frame under the load"),
    "frequency_1": ("Hz", "first natural frequency"),
    "frequency_2": ("Hz", "second natural frequency"),
    "frequency_3": ("Hz", "third natural frequency"),
    "dynamic_compliance": ("m/N", "largest dynamic compliance, of any direction and line"),
    "depth_of_cut": ("m", "limiting depth of cut; infinite where nothing chatters"),
}


def answers(
    family: Family, configuration: Configuration, lines_hz: FloatArray, curve_hz: FloatArray, cut: Cut
) -> dict[str, Any]:
    """Quantities (2,) of a posture, values and standard deviations, and other fields of a map; StudyError without rest.

    axes (3, 3), share (n_s,), chatter_hz, position (3,), magnitude and magnitude_std (L,) on the lines of a curve.
    """
    fitted, point = family.at(configuration), equilibrium(family.model, family.theta, configuration)
    linear, theta, modes = fitted.linear, fitted.theta, fitted.modes()
    freq_hz = modes.freq_hz
    peak_hz, chatter_hz, (n, f) = _extremes(linear, theta, modes, lines_hz, cut)
    grid_hz = np.append([_QUASI_STATIC_FRACTION * freq_hz.min(initial=lines_hz[0]), peak_hz, chatter_hz], curve_hz)
    H, shifts = frequency_response(linear, theta, grid_hz), fitted.response_shifts(grid_hz)

    def std(line: int, a: ComplexArray | FloatArray, b: ComplexArray | FloatArray) -> float:
        """Standard deviation of Re a^T G b."""
        return float(np.linalg.norm((a @ shifts[:, line] @ b).real))

    C = H[0].real
    principal, axes = np.linalg.eigh((C + C.T) / 2)
    principal, axes = principal[::-1], axes[:, ::-1]
    softest, load = axes[:, 0], np.array(cut.load)
    results = {"softest_compliance": (principal[0], std(0, softest, softest))}
    results |= {f"compliance_{name}": (C[i, i], std(0, np.eye(3)[i], np.eye(3)[i])) for i, name in enumerate("xyz")}
    deflection = float(np.linalg.norm(C @ load))
    results["deflection"] = deflection, std(0, C @ load / max(deflection, 1e-300), load)
    padded = np.full((3, 2), np.nan)
    padded[: len(freq_hz)] = np.column_stack([freq_hz, modes.freq_std])[:3]
    results |= {f"frequency_{i + 1}": tuple(padded[i]) for i in range(3)}
    U, sizes, Vh = np.linalg.svd(H[1])
    results["dynamic_compliance"] = sizes[0], std(1, U[:, 0].conj(), Vh[0].conj())
    least = float((n @ H[2] @ f).real)
    depth = -1 / (2 * cut.cutting_coefficient * least) if least < 0 else np.inf
    results["depth_of_cut"] = depth, depth / -least * std(2, n, f) if least < 0 else np.nan
    u = linear.Z @ np.linalg.solve(linear.matrices(theta)[2], linear.readout(theta)[0].T @ softest)
    fractions = strain_energy(family.model, family.theta, point, u[:, None].astype(complex)).fraction[:, 0]
    along, along_shifts = softest @ H[3:] @ softest, softest @ shifts[:, 3:] @ softest
    magnitude = np.maximum(np.abs(along), 1e-300)
    robot = family.model.robot_at(family.theta)
    return {name: np.array(value) for name, value in results.items()} | {
        "axes": axes, "chatter_hz": chatter_hz, "magnitude": magnitude,
        "compliance_fraction": np.nan_to_num(fractions),
        "magnitude_std": np.linalg.norm((along.conj() * along_shifts).real / magnitude, axis=0),
        "position": frame_poses(robot, point.q[None, : len(robot.joints)], family.frame).position[0],
    }  # fmt: skip


def _extremes(
    linear: LinearModel, theta: FloatArray, modes: UncertainModes, lines_hz: FloatArray, cut: Cut
) -> tuple[float, float, tuple[FloatArray, FloatArray]]:
    """Lines of the largest response and of the most negative real part, and the directions n and f (3,) of this."""
    zeta = np.clip(modes.zeta, 0.0, 1.0)
    # Where each mode peaks, and where its real part is most negative.
    extremes = modes.freq_hz * np.array([np.sqrt(np.maximum(1 - 2 * zeta**2, 1e-4)), np.sqrt(1 + 2 * zeta)])
    lines = np.append(lines_hz, np.clip(extremes, lines_hz[0], lines_hz[-1]))
    G, directions = frequency_response(linear, theta, lines), cut.directions
    real = np.linalg.eigvalsh(G.real)[:, 0] if directions is None else directions[0] @ G.real @ directions[1]
    worst = int(np.argmin(real))
    softest = np.linalg.eigh(G.real[worst])[1][:, 0]
    return float(lines[np.argmax(largest_gain(G))]), float(lines[worst]), directions or (softest, softest)


def largest_gain(G: ComplexArray) -> FloatArray:
    """Largest singular value (...) of matrices (..., n, n)."""
    return singular_values(G.reshape(-1, *G.shape[-2:]))[:, 0].reshape(G.shape[:-2])


@frozen_value
class Quantity:
    """One number of every posture, SI, with its standard deviation and 95 % interval.

    A positive quantity has an interval that is symmetric in its logarithm.
    """

    name: str
    text: str
    unit: str
    value: FloatArray = labelled("value", "{unit}", "posture")
    std: FloatArray = labelled("standard deviation", "{unit}", "posture")

    @property
    def relative_std(self) -> FloatArray:
        """std / value (Q,); 0 for infinite stiffness, such as a point on the axis of the only joint."""
        return np.divide(self.std, self.value, out=np.zeros_like(self.std), where=self.value != 0)

    @property
    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Ends (Q,) of the 95 % intervals."""
        with np.errstate(over="ignore", invalid="ignore"):
            reach = np.exp(QUANTILE_95 * self.relative_std)
            return np.asarray(self.value / reach), np.asarray(self.value * reach)


@frozen_value
class WorkspaceMap:
    """Quantities of Q postures with an equilibrium, the motors held, in the axes of the base.

    angles (Q, n_u): of the driven joints `joints`.  asked (Q,): number of each among the postures asked for; those
    without an equilibrium are `refused`.  sliding: of each joint, True where it slides.  position (Q, 3): of the frame.
    axes (Q, 3, 3): directions of the principal static compliances, columns, the softest first.  springs, share (Q,
    n_s): part of each spring in the compliance of the softest direction.
    curve_hz (L,): of `magnitude`.
    """

    name: str
    frame: str
    joints: tuple[str, ...]
    angles: FloatArray = labelled("angle of the driven joints", "rad, m", "posture joints")
    asked: IntArray = labelled("number of the posture among those asked for", "", "posture")
    refused: tuple[int, ...] = labelled("postures without an equilibrium")
    position: FloatArray = labelled("origin of the frame", "m", "posture axis")
    axes: FloatArray = labelled("directions of principal compliances, the softest first", "", "posture axis rank")
    springs: tuple[str, ...]
    compliance_fraction: FloatArray = labelled("part of each spring in the softest compliance", "", "posture springs")
    chatter_hz: FloatArray = labelled("line of the most negative real part", "", "posture")
    curve_hz: FloatArray = labelled("lines of the curves")
    magnitude: FloatArray = labelled("dynamic compliance along the softest direction", "m/N", "posture curve_hz")
    magnitude_std: FloatArray = labelled("its standard deviation", "m/N", "posture curve_hz")
    quantities: tuple[Quantity, ...] = labelled(entry="name")
    load: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cutting_coefficient: float = 0.0
    is_path: bool = False
    sliding: tuple[bool, ...] = ()

    def __getitem__(self, name: str) -> Quantity:
        """A quantity by its name."""
        return {quantity.name: quantity for quantity in self.quantities}[name]

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def softest(self) -> IntArray:
        """Numbers (Q,) of the postures, the softest first."""
        return np.argsort(-self["softest_compliance"].value, kind="stable")

    @property
    def limiting_springs(self) -> tuple[str, ...]:
        """The spring with the largest part in the softest direction of each posture."""
        return (
            tuple(self.springs[i] for i in np.argmax(self.compliance_fraction, axis=1))
            if self.springs
            else ("",) * len(self)
        )


def map_workspace(
    fitted: Result | Family,
    angles: FloatArray,
    cut: Cut | None = None,
    *,
    frame: str | None = None,
    lines_hz: FloatArray | None = None,
    name: str = "",
    is_path: bool = False,
) -> WorkspaceMap:
    """The map of postures (Q, n_u) of a fitted robot; StudyError where none of them has an equilibrium.

    fitted: or its family in the axes of the base, built before.  frame: by default `tool`, else the last one.
    lines_hz (F,): by default LINES of them over the modes.
    """
    cut = cut or Cut()
    family = fitted if isinstance(fitted, Family) else fitted.family(PredictionPorts(frame=frame, axes="world"))
    lines = default_lines(family, angles) if lines_hz is None else np.asarray(lines_hz, float)
    curve = np.geomspace(lines[0], lines[-1], CURVE_LINES)
    rows, rests = [], np.zeros(len(angles), bool)
    for i, point in enumerate(angles):
        with suppress(StudyError):
            rows.append(answers(family, _posture(family, point), lines, curve, cut))
            rests[i] = True
    if not rests.any():
        raise StudyError(
            "robot/no-equilibrium",
            f"robot {family.robot.name} finds no rest in any of the {len(angles)} postures; they may be outside the "
            "reach of its loops, or its springs too soft for its weight",
        )
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    quantities = tuple(Quantity(key, text, unit, *columns.pop(key).T) for key, (unit, text) in QUANTITIES.items())
    driven = family.robot.driven
    return WorkspaceMap(
        name=name or family.robot.name, frame=family.frame, joints=tuple(joint.name for joint in driven),
        angles=angles[rests], asked=np.flatnonzero(rests), refused=tuple(np.flatnonzero(~rests).tolist()),
        springs=family.model.springs, curve_hz=curve, quantities=quantities, load=cut.load,
        cutting_coefficient=cut.cutting_coefficient, is_path=is_path, sliding=tuple(joint.slides for joint in driven),
        **columns,
    )  # fmt: skip


def _posture(family: Family, angles: FloatArray) -> Configuration:
    return Configuration("posture", angles, family.request.payload is not False)


def default_lines(family: Family, angles: FloatArray) -> FloatArray:
    """LINES lines (F,) from half the first natural frequency of some postures to twice their sixth, or last."""
    samples: list[FloatArray] = []
    for point in angles[:: max(1, len(angles) // 20)][:20]:
        with suppress(StudyError):
            samples.append(family.at(_posture(family, point)).modes().freq_hz[:6])
    freq_hz = np.concatenate(samples) if samples else np.array([2.0, 50.0])
    return np.geomspace(freq_hz.min() / 2, 2 * freq_hz.max(), LINES)
