"""Result: a fit with the fitted robot in any posture."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import as_html, as_text
from elastid.base.errors import StudyError, index_of
from elastid.fit.verdict import Verdict
from elastid.model.spec import ModelSpec
from elastid.record import Configuration, Motion, Motors
from elastid.robot import Frame, Payload, Robot

if TYPE_CHECKING:
    # Modules with equations, which a page does not need.
    from elastid.fit.posture import Family, Posture, PredictionPorts
    from elastid.linear.fitted_model import Axes, FittedModel, ModelErrorFactor

# Std of a model-error factor relative to the step that would explain the misfit. The coverage of the intervals is in
# scripts/studies/prediction_anywhere.py.
RELATIVE_STD = 0.6


class Result(Verdict):
    """Estimate x (n_x,) with its covariance (n_x, n_x), and the fitted robot in any posture.

    parameters: names, units, scale, bounds and start values.  covariance: of x, the largest of several estimates
    (`estimate_uncertainty`); variances of unidentifiable parameters are infinite.  cost: V.  cost_expected: expected V
    of the measured noise alone.  cost_dof: 2 / cost_dof is the relative variance of V / cost_expected for a correct
    model; NaN if no noise was measured.  singular_values: of the Jacobian with columns of unit length, largest first.
    starts: searches, sorted by V.  n_converged_starts: number of searches that reached the best V.
    profile95, bootstrap95 (n_x, 2): further intervals in SI; NaN or no rows if not computed.
    indices: modification indices of fixed parameters, in sequence and alone, if V exceeds the noise.
    assumed_rigid: parts assumed rigid, whose elasticity is not detectable; empty without a diagnosis.
    presliding: estimated friction of motors at small motion; the covariance includes its uncertainty.
    verdicts (n,): sentence on each parameter of interest; empty if the fit ended without an optimum.
    model_error: relative to abs(G) in weights and covariance, the largest of the responses.
    configurations, information_fraction (Q, n_x), information_band_hz (n_x, 2), averaging_fraction (n_x,),
    persistent_fraction (n_x,): as in `Uncertainty`.
    linear: linearised model of each configuration at the estimate; empty if models are only compared.
    robot, equations: fitted robot and equations, for postures without a measurement.
    static, tool: agreement with static load tests and with responses at the tool; None without them.

    Examples
    --------
    >>> from elastid import Body, Joint, Motor, Robot, Spring, estimate, identify, simulate
    >>> joint = Joint("1", spring=Spring(100.0, damping=0.1), motor=Motor(0.01))
    >>> robot = Robot("bench", (Body("load", joints=(joint,), inertia=0.02),))
    >>> excitation = {"rate_hz": 500, "period": 1, "band_hz": [5, 50], "torque_rms": [1]}
    >>> experiment = {"configurations": {"bench": [0]}, "simulated": {"noise": {"torque_std": 0.01}}}
    >>> result = identify(estimate(simulate(robot, excitation=excitation, experiment=experiment)), robot, starts=2)
    >>> low, high = result.interval("k_1")  # N*m/rad
    >>> low < result["k_1"].value < high, result.status
    (True, 'converged')
    """

    __repr__, _repr_html_ = as_text, as_html

    def model(self, configuration: Configuration | str) -> "FittedModel":
        """Return the fitted model of a measured configuration: response, modes, state space.

        Raises UnknownNameError with the names of all configurations, and ValueError for a result without models.
        """
        if not self.linear:
            raise ValueError("this result holds no models: it only compares fits, or was written by an older elastid")
        names = [linear.configuration.name for linear in self.linear]
        name = configuration.name if isinstance(configuration, Configuration) else str(configuration)
        linear = self.linear[index_of(name, names, "fitted model of configuration")]
        from elastid.linear.fitted_model import FittedModel

        return FittedModel.of(linear, self.parameters, self.x, self.covariance)

    def at(
        self, posture: "Posture", inputs: Sequence[str] = (), outputs: Sequence[str] = (), *,
        motors: Motors = "locked", payload: Payload | Literal[False] | None = None, frame: Frame | str | None = None,
        axes: "Axes" = "own", quantity: Motion | None = None, controller: Any = None,
    ) -> "FittedModel":  # fmt: skip
        """Return the fitted model in any posture, in equilibrium under gravity: responses, modes and stiffness.

        posture: angles of the driven joints (n_u,) in rad or m, a mapping from their names, or the name of a
        measured configuration.  inputs: `force tool x`, `torque tool z` at any frame or body, `motor 1`; default the
        forces at the frame.  outputs: `frame tool x`, `accelerometer tool x`, `joint 1`, `motor 1`; default the motion
        of the frame.  motors: locked (brakes), free, or controlled by `controller`, a `ControllerSpec` or a
        `JointLoop`.  payload: replaces the payload of the robot; False removes it.  frame: for the stiffness and the
        defaults; `tool`, else the last frame, else the last body's centre of mass.  axes: `own` axes of frames, or axes
        of the base (world).  quantity: of outputs; default positions, or accelerations for accelerometers.  Raises
        StudyError for unknown locations or angles, and if the robot has no equilibrium.
        """
        from elastid.fit.posture import PredictionPorts, as_configuration

        ports = PredictionPorts(tuple(inputs), tuple(outputs), motors, payload, frame, axes, quantity, controller)
        family = self.family(ports, posture if isinstance(posture, str) else getattr(posture, "name", ""))
        return family.at(as_configuration(posture, family.robot, [linear.configuration for linear in self.linear]))

    def family(self, ports: "PredictionPorts", group: str = "") -> "Family":
        """Return the fitted models of many postures. group: name of the configuration whose group parameters apply."""
        from elastid.fit.posture import Family

        spec = self.equations or ModelSpec()
        estimates = self.parameters, self.x, self.covariance_of_prediction
        return Family.of(self.nominal_robot, spec, *estimates, ports, group, self.model_error_factors)

    @property
    def nominal_robot(self) -> Robot:
        """Robot model with its nominal parameters; raises StudyError for a result without a robot."""
        if self.robot is None:
            raise StudyError(
                "fit/no-robot",
                "this result contains no robot, because an older elastid wrote it. Fit again (`elastid run STUDY fit` "
                "or `elastid.identify(...)`)",
            )
        return self.robot

    def with_parameters(self, **values: float) -> "Result":
        """Return the result with replaced parameters, in SI: result.with_parameters(k_1=3e5).at("folded").

        Replaced parameters are exact; all others keep values and covariances.  Raises UnknownNameError for an unknown
        name, TypeError if a value is not a number, ValueError for a tied parameter or a value out of range.
        """
        x, free = self.x.copy(), self.parameters.free_names
        is_free = np.array([name not in values for name in free])
        for name, value in values.items():
            p = self.parameters[name]
            if p.tie is not None:
                raise ValueError(f"{name} is tied to {p.tie.to}; change {p.tie.to} instead")
            if not math.isfinite(value) or (p.log and value <= 0):
                raise ValueError(f"{name} = {value:g}: give a finite {'positive ' if p.log else ''}number in {p.unit}")
            if name in free:
                x[free.index(name)] = p.to_x(value)
        return replace(
            self,
            parameters=self.parameters.with_values({name: v for name, v in values.items() if name not in free}),
            x=x,
            covariance=np.where(is_free[:, None] & is_free, self.covariance, 0.0),
            profile95=np.where(is_free[:, None], self.profile95, np.nan) if len(self.profile95) else self.profile95,
            indices=tuple(replace(index, effects=np.where(is_free, index.effects, 0.0)) for index in self.indices),
            message=f"{self.message}; by hand: {', '.join(f'{name} = {value:.6g}' for name, value in values.items())}",
        )

    @property
    def covariance_of_prediction(self) -> FloatArray:
        """`covariance`, multiplied by (residuals / noise)^2 if the residual test fails without a single cause.

        The factor accounts for the disagreement between postures and bands.
        """
        is_unexplained = self.exceeds_noise and not self.has_single_cause
        return self.covariance * self.inflation_factor**2 if is_unexplained else self.covariance

    @property
    def model_error_factors(self) -> "tuple[ModelErrorFactor, ...]":
        """Parameters whose errors would explain the model error, with stds of `RELATIVE_STD` times their steps."""
        from elastid.linear.fitted_model import ModelErrorFactor

        if not self.exceeds_noise:
            return ()
        # A step explains the whole misfit. The 95 % interval of the factor covers 1.96 RELATIVE_STD = 1.18 steps.
        causes = [index for index in self.indices if index.place] or list(self.indices[:1])
        return tuple(
            ModelErrorFactor(
                RELATIVE_STD * np.nan_to_num(cause.effects, posinf=0.0, neginf=0.0), cause.members,
                tuple((RELATIVE_STD * cause.steps).tolist()), cause.log,
            )
            for cause in causes
        )  # fmt: skip
