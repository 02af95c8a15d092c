"""Studies that cannot be measured live, refused before the robot moves."""

from __future__ import annotations

from elastid.app.stage_table import SIMULATED
from elastid.base.errors import StudyError
from elastid.study import Study


def require_one_robot_in_any_posture(study: Study, path: str) -> None:
    """StudyError for a study without a plan, or whose sections name configurations, which live chooses itself."""
    if study.kind != SIMULATED or study.excitation is None:
        raise StudyError(
            f"{path}: live plans experiments, which needs the sections excitation and experiment.simulated, whose "
            "controller and noise are those of the robot; a study of logs has none"
        )
    simulated, motors = study.experiment.as_simulated(), study.as_robot().motor_locations
    if missing := sorted({*motors} - {*(simulated.outputs or motors)}):
        raise StudyError(f"experiment.simulated.outputs: live needs the position of {', '.join(missing)}; add it")
    if simulated.carrier is not None and simulated.carrier.kind == "offset":
        raise StudyError("experiment.simulated.carrier: live has none of constant velocity; take sine or square")
    if study.fit.robots:
        raise StudyError("fit.robots: live identifies one robot; give each a study of its own")
    own = [name for name, parameter in study.fit.parameters.items() if parameter.per is not None]
    if own:
        raise StudyError(f"fit.parameters.{own[0]}.per: live chooses the configurations, so that no groups are known")
    if any(factor.configurations for factor in study.fit.weights.factors):
        raise StudyError("fit.weights.factors: live chooses the configurations; leave their names out of the factors")
    if study.experiment.without_payload:
        raise StudyError("experiment.without_payload: live measures all postures with the payload of the robot's file")
