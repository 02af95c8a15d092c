"""Torques, motions and shapes of friction of all experiments of one configuration, at lines excited or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.frf.distortion import detection_lines, interpolated
from elastid.frf.friction.shapes import Shape, motion_of, shape_samples
from elastid.frf.lines import analysed_lines, lines_are_known
from elastid.frf.matrices import adjoint
from elastid.frf.period_selection import trusted
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, period_spectra
from elastid.record import Record

# So many lines of a configuration, evenly taken, give the levels as well as all.
_MAX_LINES = 400


@dataclass(frozen=True)
class Net:
    """What the motors' net torque leaves of a configuration: residuals e (F, n_m, K) in Nm and shapes X (F, n_f, K).

    e = (U - G^-1 Y) Q and X = Phi Q, Q being the projector that takes the span of the net torques out of the K
    experiments; at unexcited lines Q = 1.  So e = X f for the levels f of the friction in U.
    """

    e: ComplexArray
    X: ComplexArray


@dataclass(frozen=True)
class ConfigurationSpectra:
    """Amplitudes of K experiments at F lines: U (F, n_m, K), Y (F, n_m, K) of the same motors, Phi (F, n_f, K).

    excited (F,): where G = Y / U is found; at the other lines G is interpolated.  realisation (K,): of each experiment.
    """

    lines: IntArray
    excited: BoolArray
    U: ComplexArray
    Y: ComplexArray
    Phi: ComplexArray
    realisation: IntArray

    def with_shapes(self, chosen: IntArray) -> ConfigurationSpectra:
        """The same with some of its shapes."""
        return replace(self, Phi=self.Phi[:, chosen])

    def net(self, friction: ComplexArray) -> Net:
        """Residuals and shapes where `friction` (F, n_m, K) is taken out of U."""
        on = self.excited
        net = self.U - friction
        pseudo = adjoint(net[on]) @ np.linalg.inv(net[on] @ adjoint(net[on]))
        G = self.Y[on] @ pseudo
        e = self.U - np.linalg.solve(interpolated(self.lines, self.lines[on], G), self.Y)
        X = self.Phi.copy()
        # The span of the net torques is that of Y, too, as far as G maps one onto the other.
        e[on] -= (e[on] @ pseudo) @ net[on]
        X[on] -= (X[on] @ pseudo) @ net[on]
        return Net(e, X)


def gather_configuration(
    records: Sequence[Record], shapes: Sequence[Shape], spec: EstimatorSpec, planned: IntArray | None
) -> ConfigurationSpectra:
    """Mean spectra over the periods that can be trusted, of the records of one configuration, one record at a time.

    Raises DataError and StudyError as `analysed_lines` does.
    """
    first = records[0]
    known = lines_are_known(spec, planned)
    spectra = [RecordSpectra(each) if known else RecordSpectra(each).with_driver() for each in records]
    lines = analysed_lines(spectra, spec, planned)
    everywhere = np.union1d(lines, detection_lines(lines, first.half_wave))
    everywhere = everywhere[:: -(-len(everywhere) // _MAX_LINES)]
    excited = np.isin(everywhere, lines)
    inside = slice(int(np.argmax(excited)), len(excited) - int(np.argmax(excited[::-1])))
    everywhere, excited = everywhere[inside], excited[inside]
    columns = [first.outputs.index(place) for place in first.inputs]
    U, Y, Phi = [], [], []
    for each in spectra:
        found = period_spectra(each, everywhere, spec.quantity)
        kept = trusted(found.on(excited), spec).periods
        used = found.only(kept)
        Y.append(used.Y.mean(axis=0)[:, columns])
        U.append(used.U.mean(axis=0))
        Phi.append(_shape_amplitudes(each.record, shapes, everywhere)[kept].mean(axis=0))
    return ConfigurationSpectra(
        everywhere,
        excited,
        np.stack(U, axis=2),
        np.stack(Y, axis=2),
        np.stack(Phi, axis=2),
        np.array([record.realisation for record in records]),
    )


def _shape_amplitudes(record: Record, shapes: Sequence[Shape], lines: IntArray) -> ComplexArray:
    """Amplitudes (P, F, n_f) of the shapes in the periods of a record."""
    motions = {place: motion_of(record, place) for place in dict.fromkeys(shape.place for shape in shapes)}
    phi = shape_samples(record, motions, shapes)
    as_inputs = replace(
        record,
        inputs=tuple(f"shape {i}" for i in range(len(shapes))),
        u=phi,
        y=record.y[: len(phi)],
        r=None,
        hold="band-limited",
        hold_samples=(),
        input_units=(),
    )
    return RecordSpectra(as_inputs).amplitudes("u", lines)


def taken(levels: FloatArray, Phi: ComplexArray, motor_of: IntArray, n_m: int) -> ComplexArray:
    """Friction torque (F, n_m, K) of shapes (F, n_f, K) that act on motors motor_of (n_f,)."""
    torque = np.zeros((Phi.shape[0], n_m, Phi.shape[2]), dtype=np.complex128)
    for f, motor in enumerate(motor_of):
        torque[:, motor] += levels[f] * Phi[:, f]
    return torque
