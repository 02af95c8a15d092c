"""Cases of advice in the messages of checks and commands, which no log is needed for."""

from __future__ import annotations

from collections.abc import Sequence

from elastid.study import load
from plants.advice import Case, Desk, case, pasted, refusal, rendered
from plants.two_axes import ROBOT, STUDY

# (module, advice): overrides that provoke the message at `check`, the section of the advice, what it tells besides.
AT_CHECK: dict[tuple[str, str], tuple[Sequence[str], str, Sequence[str]]] = {
    ("excitation/spec.py", "grid: full"): (
        ["excitation.phases=prbs", "experiment.realisations=1", "excitation.grid=odd-odd"], "excitation.", []),
    ("excitation/spec.py", "flat: information"): (
        ["excitation.least=0.2", "experiment.simulated.noise={torque_std: 1}"], "excitation.", []),
    ("excitation/spec.py", "phases: ‹›"): (
        ["excitation.phases=prbs", "excitation.flat=information", "experiment.realisations=1",
         "experiment.simulated.noise={torque_std: 1}"], "", ["excitation.phases=random"]),
    ("excitation/spec.py", "experiment.realisations: 1"): (
        ["excitation.phases=schroeder", "experiment.realisations=2"], "", []),
    ("excitation/spec.py", "phases: random"): (
        ["excitation.phases=schroeder", "experiment.realisations=2"], "excitation.", []),
    ("model/spec.py", "formulation: minimal"): (
        ["model.independent=[joint 1, joint 2, joint 1x, joint 2x]"], "model.", []),
    ("experiment/specs/simulated.py", "kind: cascade"): (
        ["experiment.simulated.controller={kind: pd, bandwidth_hz: 2, integral_time: 2}"],
        "experiment.simulated.controller.", []),
    ("experiment/specs/simulated.py", "limits: {torque: ...}"): (
        ["experiment.simulated.saturation=true"], "robot.bodies.0.joints.0.", []),
    ("fit/spec.py", "fixed: true"): (
        ["fit.parameters.k_1={prior: {std: 0}}"], "", ["fit.parameters.k_1={fixed: true}"]),
    ("fit/parameter_choice.py", "fit.robots: {A: [c1, c2], B: [c3]}"): (
        ["experiment.configurations={c1: [0, 0.2], c2: [0.5, 0.9], c3: [1, 1.4]}", "fit.parameters.k_1={per: robot}"],
        "", []),
    ("fit/parameter_choice.py", "per: robot"): (
        ["fit.parameters={k_*: {}, k_1@A: {start: 1e4}}"], "fit.parameters.k_1.",
        ["fit.robots={A: [a, b], B: [c, d]}"]),
    ("fit/parameter_choice.py", "start: 1"): (["fit.parameters.f_2x={start: 0}"], "fit.parameters.f_2x.", []),
    ("fit/parameter_choice.py", "tie: {to: k_1, by: ‹›}}"): (
        ["fit.ratios={rho: {start: 2}}"], "fit.parameters.k_2.", []),
    ("study/checks/experiment.py", "excitation.grid: odd"): (
        ["estimator.friction=coulomb", "experiment.realisations=1", "excitation.grid=full"], "", []),
    ("study/checks/experiment.py", "experiment.realisations: 2"): (
        ["estimator.friction=coulomb", "experiment.realisations=1", "excitation.grid=full"], "", []),
    ("study/checks/experiment.py", "orthogonal: zippered"): (
        ["experiment.experiments=1", "experiment.realisations=1", "excitation.phases=schroeder",
         "estimator.method=auto"], "excitation.", []),
    ("robot/measurement_chain.py", "sign: -1"): (
        ["robot.chain={gains: [{role: y, at: motor 1, gain: -1}]}"], "", ["robot.chain={}"]),
    ("robot/friction.py", "damping_velocity: ‹›"): (
        ["robot.bodies.0.joints.0.motor.friction={coulomb: 1, stiction: 2, stribeck_velocity: 0.1, "
         "lugre: {stiffness: 1e4, damping: 10}}"], "robot.bodies.0.joints.0.motor.friction.lugre.", []),
    ("robot/joint.py", "motion: translation"): (
        ["robot.bodies.0.joints.1.spring.stiffness=40 kN/m"], "robot.bodies.0.joints.1.", []),
}  # fmt: skip


def _at_check(module: str, text: str) -> Case:
    def followed(desk: Desk) -> None:
        faults, section, further = AT_CHECK[module, text]
        study = desk.write(study=STUDY, robot=ROBOT)
        advice = rendered(text, refusal(lambda: load(study, faults)))
        own = [pasted(advice, section)] if section or "." in advice.partition(":")[0] else []
        assert refusal(lambda: load(study, [*faults, *own, *further])) == ""

    followed.__name__ = f"{module}: {text}"
    return followed


for key in AT_CHECK:
    case(*key)(_at_check(*key))
