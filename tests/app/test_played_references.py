"""A plan of references, played to an emulated robot by the code of the page, and its log."""

import csv
import re
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace as Message
from typing import Any, cast
from unittest.mock import Mock

import numpy as np
from plants.paths import ROOT

from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.robot import Body, Joint, Motor, Robot
from elastid.simulation.spec import ControllerSpec, GainsSpec, ReferencePathSpec
from elastid.store.trajectory import write_references

PAGE = ROOT / "scripts" / "docs" / "pages" / "howto" / "connect.rst"
RATIO, TORQUE_CONSTANT, INERTIA = 100.0, 0.5, 20.0 + 4.0
K_P, K_V, T_I = 20.0, 600.0, 0.08
TICKS, TICK_S = 4, 0.001  # of the drive, in a cycle of 4 ms


def player(name: str = "play", **names: Any) -> Callable[..., None]:
    """A player of the page; names: of the classes that it needs."""
    page = PAGE.read_text(encoding="utf-8")
    for code in re.findall(r"code-block:: python\n\n((?:   .*\n|\n)+)", page):
        exec("\n".join(line[3:] for line in code.splitlines()), names)
    return cast(Callable[..., None], names[name])


class Emulator:
    """An axis with a cascade at 1 kHz that is asked for a correction every 4 ms and reaches it one cycle later."""

    def __init__(self, start: float) -> None:
        self.start, self.q, self.v, self.integral, self.torque = start, start, 0.0, 0.0, 0.0
        self.target, self.before, self.last = 0.0, start, start

    def cycle(self, correction: float) -> None:
        """Four samples of the drive; its torque is held between them."""
        for k in range(1, TICKS + 1):
            wanted = self.start + self.target + (correction - self.target) * k / TICKS
            error = K_P * (wanted - self.q) + (wanted - self.before) / TICK_S - (self.q - self.last) / TICK_S
            self.before, self.last = wanted, self.q
            self.torque = K_V * (error + self.integral / T_I)
            self.integral += error * TICK_S
            self.q += self.v * TICK_S + self.torque / INERTIA * TICK_S**2 / 2
            self.v += self.torque / INERTIA * TICK_S
        self.target = correction

    def serve(self, port: int, cycles: int) -> list[int]:
        """Send the state, receive the correction of this cycle; cycles whose answer has another counter."""
        wrong = []
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            link.settimeout(5.0)
            for ipoc in range(100_000, 100_000 + 4 * cycles, 4):
                current = self.torque / RATIO / TORQUE_CONSTANT
                state = f'<AIPos A1="{np.degrees(self.q):.9f}"/><MACur A1="{current:.9f}"/><IPOC>{ipoc}</IPOC>'
                link.sendto(f'<Rob Type="KUKA">{state}</Rob>'.encode(), ("127.0.0.1", port))
                answer = link.recv(4096).decode()
                correction = re.search(r'A1="([^"]+)"', answer)
                wrong += [ipoc] * (f"<IPOC>{ipoc}</IPOC>" not in answer)
                self.cycle(np.radians(float(correction[1])))
        return wrong


def test_page_player_gives_emulated_robot_planned_torque(tmp_path: Path) -> None:
    """No cycle wrong or lost, at rest at the end; planned spectrum within 3 %; inertia by the log within 3 %."""
    path = ReferencePathSpec(0.004, unit="deg")
    gains = GainsSpec(position_gain=K_P, velocity_gain=K_V, integral_time=T_I)
    controller = ControllerSpec(kind="cascade", gains=gains, reference=path)
    joint = Joint("1", "z", motor=Motor(4.0 / RATIO**2, RATIO))
    robot = Robot("axis", (Body("link", joints=(joint,), mass=1, inertia=20),), gravity=(0, 0, 0))
    excitation = MultisineSpec(1000.0, 1.0, (2.0, 30.0), 20.0, inject="position")
    spec = ExperimentSpec({"home": (0.3,)}, 1, simulated=SimulatedSpec(controller=controller))
    loop = closed_loop_of(robot, controller, 1000.0, "position")
    plan = make_plan(excitation, spec, robot, 0, closed_loop=loop)
    write_references(tmp_path / "run.csv", plan, plan.experiments[0], spec.as_simulated(), robot)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        port = int(link.getsockname()[1])  # a free one
    cycles, emulator = plan.run_samples // TICKS, Emulator(0.3)
    play = threading.Thread(target=player(), args=(tmp_path / "run.csv", tmp_path / "log.csv", port))
    play.start()
    while not (tmp_path / "log.csv").exists():
        play.join(0.01)
    wrong = emulator.serve(port, cycles)
    play.join()
    assert wrong == []
    with (tmp_path / "log.csv").open() as file:
        head, *rows = csv.reader(file)
    log = np.array(rows, float)
    assert head == ["IPOC", "AIPos.A1", "MACur.A1"]
    assert len(log) == cycles
    np.testing.assert_allclose(log[:, 0], 100_000 + 4 * np.arange(cycles))
    np.testing.assert_allclose(log[-1, 1], np.degrees(0.3), atol=0.05)
    first = (plan.first_sample + plan.transient_periods * plan.period_samples) // TICKS
    U = np.fft.rfft(log[first:][:500, 2].reshape(2, 250).mean(axis=0))[plan.lines] / 125 * RATIO * TORQUE_CONSTANT
    planned = plan.R[0, 0, 0, :, 0]
    assert np.linalg.norm(np.abs(U) - np.abs(planned)) < 0.03 * np.linalg.norm(planned)
    Q = np.fft.rfft(np.radians(log[first:][:500, 1]).reshape(2, 250).mean(axis=0))[plan.lines] / 125
    low = plan.freq_hz < 15
    np.testing.assert_allclose(np.abs(U / (2 * np.pi * plan.freq_hz) ** 2 / Q)[low], INERTIA, rtol=0.03)


def test_egm_and_rtde_players_send_row_per_message() -> None:
    """Stubs of the messages, without a robot: rows in order; time, positions and currents."""
    rows, written = [[1.0, 2.0], [3.0, 4.0]], []
    joints = Message(joints=[5.0, 6.0])
    state = Message(header=Message(tm=4), feedBack=Message(joints=joints), timestamp=4, actual_q=[5, 6])
    state.actual_current = [7, 8]
    answers = [Message(header=Message(), planned=Message(joints=Message(joints=[]))) for _ in rows]
    for answer in answers:
        answer.SerializeToString = lambda answer=answer: answer.planned.joints.joints
    link, connection = Mock(recvfrom=lambda _: (b"", "robot")), Mock(receive=lambda: state)
    write = lambda *values: written.append(values)  # noqa: E731
    player("play_egm", EgmRobot=Mock(FromString=lambda _: state), EgmSensor=iter(answers).__next__)(link, rows, write)
    player("play_rtde")(connection, rows, write)
    assert [call.args[0] for call in link.sendto.call_args_list] == rows
    assert [call.args[0] for call in connection.send.call_args_list] == rows
    assert written == [(4, 5, 6)] * 2 + [(4, 5, 6, 7, 8)] * 2
