"""The controllers of logs without torques, whose references are the inputs of the responses."""

from dataclasses import replace

import numpy as np

from elastid.experiment.specs.logs import RecordedSpec
from elastid.frf.lines import reference_steps
from elastid.logs.repair.clock_drift import MAX_CLOCK_ERROR
from elastid.record import Record, ReferenceLoop, ZohTorque
from elastid.response import Response
from elastid.robot import Robot
from elastid.simulation.controller import loop_of, sampled_responses
from elastid.simulation.reference_path import ReferencePath
from elastid.simulation.spec import ReferencePathSpec


def with_reference_loop(response: Response, recorded: RecordedSpec, robot: Robot, record: Record) -> Response:
    """Return a response to references with the loop of each motor, as the controller of the study closes it.

    A log at the cycle of the references folds the images of their steps.  In a faster log, the references contain the
    interpolation that a record shows, and take the rest of their path.  Without a path each acts from its sample to
    the next.  The exact velocity of an inertia under held torques is its angle times
    2 (1 - 1/z) / [T (1 + 1/z)].  The systematic errors by motor friction are known for torques alone and left out.
    """
    controller = recorded.controller
    assert controller is not None  # of logs with commands alone
    rate_hz = controller.tick_hz or recorded.known_rate_hz
    path = controller.reference or ReferencePathSpec(1 / rate_hz, "hold")
    steps, interpolation = reference_steps(record)
    if controller.reference is None:
        steps, interpolation = 1, "hold"
    elif interpolation == "linear":  # the log is behind the interpolator
        path = replace(path, cycle=steps / record.rate_hz, interpolation=interpolation)
    spec = replace(controller.spec, reference=replace(path, velocity_feedforward=controller.velocity_feedforward))
    joints, motors, loop = robot.driven_names, robot.motor_locations, loop_of(controller, robot.n_u)
    freq_hz, log_hz = response.freq_hz, 0.0
    if path.cycle_samples(rate_hz) > 1 and abs(path.cycle * recorded.known_rate_hz - 1) < MAX_CLOCK_ERROR:
        log_hz = recorded.known_rate_hz
        none = np.zeros((2, len(freq_hz), len(motors)), complex)
        images_hz = np.abs(ReferenceLoop(motors, rate_hz, freq_hz, none, none, log_hz).images_hz(freq_hz))
        freq_hz = np.unique(np.concatenate([freq_hz, images_hz[np.isfinite(images_hz)]]))
    pairs = [
        sampled_responses(joints, gains, spec, freq_hz, rate_hz, "position")
        for gains in (replace(loop, kd=0 * loop.kd), replace(loop, kp=0 * loop.kp))
    ]
    feedback, feedforward = (np.stack(group) for group in zip(*pairs, strict=True))
    path_to_log = ReferencePath(ReferencePathSpec(steps / record.rate_hz, interpolation), record.rate_hz)
    feedforward /= path_to_log.response(freq_hz)[:, None]
    if controller.velocity == "exact":
        feedback[1] *= 2 / (1 + np.exp(-2j * np.pi * freq_hz[:, None] / rate_hz))
    sampled = tuple(location.startswith(("motor ", "joint ")) for location in response.outputs)
    if (motion := response.motion) is not None:
        at = [motors.index(motor) for motor in motion.motors]
        terms = loop.kp * loop.ki, loop.kp + loop.kd * loop.ki, loop.kd
        motion = replace(motion, feedback=np.stack([np.diag(term[at]) for term in terms]))
    return replace(
        response, controller=ReferenceLoop(motors, rate_hz, freq_hz, feedback, feedforward, log_hz),
        hold=ZohTorque((rate_hz,) * len(motors), sampled), motion=motion, bias=None,
    )  # fmt: skip
