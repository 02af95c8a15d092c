"""The temperature of a joint from its power, and friction that follows it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from plants import published_friction
from plants.refusals import refused
from scipy.integrate import solve_ivp

from elastid.base.arrays import FloatArray
from elastid.friction_record import WarmUpLog
from elastid.friction_study.motion_signals import alike_speeds
from elastid.friction_study.result import thermal_numbers
from elastid.friction_study.warm_up import WarmUp, fit_warm_up, warm_up_note

# 45 min and 8 W/K; the published law in Nm on the link side, speeds of the motor in rad/s.
H, TIME_CONSTANT, AMBIENT = 8.0, 45 * 60.0, 34.0
SPEEDS = (8.0, 60.0, 200.0)


def power_at(t: float) -> float:
    """An hour and a half of work, half an hour of pause, then work at other powers."""
    minutes = t / 60
    return 240.0 if minutes < 90 else 0.0 if minutes < 120 else 160.0 if minutes < 180 else 300.0


def campaign(seed: int, second_share: float = 0.0, thermometer: bool = True) -> WarmUp:
    """Tests at three speeds every 5 minutes, 0.02 Nm a level, thermometer 0.5 K; temperatures by another integrator."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0, 4.0 * 3600 + 1, 60.0)
    constants = np.array([TIME_CONSTANT, 5 * 60.0])
    shares = np.array([1 - second_share, second_share])

    def rates(t: float, theta: FloatArray) -> FloatArray:
        return (power_at(t) - theta) / constants

    theta = solve_ivp(rates, (0, time_s[-1]), [0.0, 0.0], t_eval=time_s, max_step=30.0, rtol=1e-8).y
    T = AMBIENT + shares @ theta / H
    tests = np.repeat(np.arange(0, len(time_s), 5), len(SPEEDS))
    speeds = np.tile(SPEEDS, len(tests) // len(SPEEDS))
    torques = published_friction.torque(speeds, np.zeros_like(speeds), T[tests])
    levels = 26 * torques + 0.02 * rng.standard_normal(len(tests))
    power = np.array([power_at(t + 30) for t in time_s[:-1]])
    readings = T + 0.5 * rng.standard_normal(len(T)) if thermometer else np.full(len(T), np.nan)
    std = np.full(len(tests), 0.02)
    log = WarmUpLog("1", time_s, power, readings, 0.5, AMBIENT, AMBIENT)
    return WarmUp(log, tests, speeds, levels, std)


def first_half(whole: WarmUp) -> WarmUp:
    log, n = whole.log, len(whole.log.power) // 2
    early = whole.test <= n
    return replace(
        whole,
        log=replace(log, time_s=log.time_s[: n + 1], power=log.power[:n], temperature=log.temperature[: n + 1]),
        test=whole.test[early], test_speed=whole.test_speed[early], torque=whole.torque[early],
        torque_std=whole.torque_std[early],
    )  # fmt: skip


def without_tests(whole: WarmUp) -> WarmUp:
    none = np.zeros(0, int)
    return replace(whole, test=none, test_speed=none, torque=none, torque_std=none)


@pytest.mark.parametrize(
    ("thermometer", "tests"),
    [(True, True), (True, False), (False, True)],
    ids=["both", "thermometer", "friction alone, relative"],
)
def test_half_of_four_hours_has_the_numbers(thermometer: bool, tests: bool) -> None:
    first = first_half(campaign(0, thermometer=thermometer))
    model = fit_warm_up(first if tests else without_tests(first))
    assert model.time_constants[0] == pytest.approx(TIME_CONSTANT, rel=0.1)
    assert warm_up_note(model, first, "1") == ()
    numbers = [*thermal_numbers("1", model, first)]
    assert [number.symbol for number in numbers] == ["h", "C / h"][not thermometer :]
    for number in numbers:
        assert number.low * number.high == pytest.approx(number.value**2)
        assert np.log(number.high / number.value) == pytest.approx(1.96 * number.std / number.value, rel=1e-3)
    if thermometer:
        assert model.h == pytest.approx(H, rel=0.05)
    else:
        assert np.isnan(model.h)


@pytest.mark.slow
def test_a_second_node_is_taken_only_where_there_is_one() -> None:
    one = [fit_warm_up(campaign(seed)) for seed in range(8)]
    assert sum(len(model.time_constants) == 2 for model in one) <= 1
    two = fit_warm_up(campaign(1, second_share=0.3))
    assert sorted(two.time_constants) == pytest.approx([300.0, TIME_CONSTANT], rel=0.15)
    assert two.h == pytest.approx(H, rel=0.03)


@pytest.mark.slow
def test_stated_std_is_the_scatter() -> None:
    """ln h and ln C / h over 12 campaigns."""
    models = [fit_warm_up(without_tests(campaign(seed))) for seed in range(12)]
    single = [model for model in models if len(model.time_constants) == 1]
    scatter = np.std([[np.log(m.h), np.log(m.time_constants[0])] for m in single], axis=0, ddof=1)
    stated = np.mean([m.log_std[:2] for m in single], axis=0)
    assert np.all(scatter / stated > 0.5)
    assert np.all(scatter / stated < 1.7)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda w: replace(w, log=replace(w.log, power=-w.log.power)),
        lambda w: replace(w, log=replace(w.log, time_s=w.log.time_s[::-1])),
        lambda w: without_tests(replace(w, log=replace(w.log, temperature=np.nan * w.log.temperature))),
    ],
)
def test_a_warm_up_that_tells_nothing_is_refused(wrong: Callable[[WarmUp], WarmUp]) -> None:
    with refused("friction/warm-up", place="warm-up"):
        fit_warm_up(wrong(campaign(0)))


def test_tests_at_nearly_one_speed_are_at_one() -> None:
    """Measured speeds differ a little from pass to pass."""
    np.testing.assert_allclose(alike_speeds(np.array([1.0, 0.2, 1.02, 0.2])), [1.01, 0.2, 1.01, 0.2])
