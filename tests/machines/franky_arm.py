"""A Franka of franky-sim in a process of its own, with a brush in its hand and a table under it.

The server, its protocol and its dynamics are franky-sim's. Added here: the spring-loaded brush and the table of the
scene, the force estimate that a real arm reports (the simulator leaves it 0), the robot modes and errors that it does
not simulate, and a trace of the true joint angles.

    with FrankyArm(folder) as arm: FrankaRobot(arm.address, ...)
"""

import json
import os
import queue
import select
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np

HAND_TO_FINGERTIPS = 0.1034
"""Metres from the hand to its fingertips: the arm's own tool frame."""
BRUSH = 0.1
"""Metres from the fingertips to the tip of the brush."""
HEIGHT = 0.1
"""Height of the table's top at TABLE_AT, metres."""
TABLE_AT = (0.5, 0.0)
STIFFNESS = 300.0
"""N/m of the brush's hairs along its handle."""
_GEOM = "the tip of the brush"


class FrankyArm:
    """The process. Arguments are those of `_serve`, by name.

    address: at which it answers; every one has another, so that several tests may run
    trace: file of the joint angles at every millisecond of the simulation
    """

    def __init__(self, folder: Path, **scene: Any) -> None:
        self.trace = folder / "joints.bin"
        self._scene = {"trace": str(self.trace), **scene}
        self._told: list[str] = []

    def __enter__(self) -> Self:
        command = [sys.executable, "-u", __file__, json.dumps(self._scene)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=self.trace.parent
        )
        assert self.process.stdout is not None and self.process.stdin is not None
        ready, self.address = self.process.stdout.readline().split()
        assert ready == "ready"
        threading.Thread(target=self._listen, daemon=True).start()
        self._wait_until(lambda: self.trace.exists() and len(self.joints()) > 0)  # on a busy machine it begins later
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        for pipe in (self.process.stdin, self.process.stdout):
            pipe.close()

    def kill(self) -> None:
        """Ends the simulation as a power cut would."""
        self.process.kill()
        self.process.wait()

    def order(self, **what: Any) -> None:
        """Sets `mode` (name of a RobotMode), `errors` (numbers), `abort` (name of a MoveStatus), `reject`, ...

        `guide`: file of joint angles, float64 [n, 7], along which a person leads it, one row a millisecond
        """
        done = f"done {json.dumps(what)}"
        before = self._told.count(done)
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()
        self._wait_until(lambda: self._told.count(done) > before)

    def recoveries(self) -> int:
        """Number of times that somebody asked the arm to recover from its errors by itself."""
        return sum(line == "recovered" for line in list(self._told))

    def stops(self) -> list[tuple[int, float]]:
        """Each command to stop that reached the arm: its millisecond, and when, by time.monotonic()."""
        told = [line.split() for line in list(self._told) if line.startswith("stop ")]
        return [(int(step), float(when)) for _, step, when in told]

    def moves(self) -> int:
        """Number of motions that were begun."""
        return sum(line == "move" for line in list(self._told))

    def joints(self) -> np.ndarray:
        """True joint angles [n, 7], one row for each millisecond since the start."""
        rows = np.fromfile(self.trace, np.float64)
        return rows[: len(rows) // 7 * 7].reshape(-1, 7)

    def tip(self) -> np.ndarray:
        """True position of the tip now, [3] metres."""
        size = 7 * 8
        whole = self.trace.stat().st_size // size
        return tip_positions(np.fromfile(self.trace, np.float64, 7, offset=(whole - 1) * size)[None])[0]

    def _wait_until(self, is_so: Callable[[], bool]) -> None:
        until = time.monotonic() + 30
        while not is_so():
            assert self.process.poll() is None and time.monotonic() < until
            time.sleep(0.002)

    def _listen(self) -> None:
        for line in self.process.stdout:
            self._told.append(line.strip())


def table_height(place: np.ndarray, tilt: tuple[float, float]) -> np.ndarray:
    """Returns the height of a tilted table at places [n, 2], metres."""
    return HEIGHT + (place - np.array(TABLE_AT)) @ np.array(tilt)


def joint_frames(joints: np.ndarray) -> list[np.ndarray]:
    """Returns the frames [n, 4, 4] of the seven joints for angles [n, 7], by the table that Franka publishes.

    Neither the simulator's model nor the driver's is used. (Denavit-Hartenberg in Craig's convention: a, d, alpha.)
    """
    table = [(0, 0.333, 0), (0, 0, -np.pi / 2), (0, 0.316, np.pi / 2), (0.0825, 0, np.pi / 2)]
    table += [(-0.0825, 0.384, -np.pi / 2), (0, 0, np.pi / 2), (0.088, 0, np.pi / 2)]
    frames, frame = [], np.broadcast_to(np.eye(4), (len(joints), 4, 4))
    for joint, (a, d, alpha) in enumerate(table):
        cos, sin, zero = np.cos(joints[:, joint]), np.sin(joints[:, joint]), np.zeros(len(joints))
        ca, sa = np.cos(alpha), np.sin(alpha)
        rows = [[cos, -sin, zero, zero + a], [sin * ca, cos * ca, zero - sa, zero - sa * d],
                [sin * sa, cos * sa, zero + ca, zero + ca * d], [zero, zero, zero, zero + 1]]  # fmt: skip
        frame = frame @ np.moveaxis(np.array(rows), 2, 0)
        frames.append(frame)
    return frames


def tip_positions(joints: np.ndarray, brush: float = BRUSH) -> np.ndarray:
    """Returns the tip [n, 3] for joint angles [n, 7]. The hand's own turn moves no point of its axis."""
    frame = joint_frames(joints)[-1]
    return frame[:, :3, 3] + (0.107 + HAND_TO_FINGERTIPS + brush) * frame[:, :3, 2]


def _serve(
    trace: str,
    lockstep: bool = True,
    table: bool = True,
    tilt: tuple[float, float] = (0.0, 0.0),
    bias: float = 1.5,
    noise: float = 0.15,
    sign: float = -1.0,
    stiffness: float = STIFFNESS,
    start: list[float] | None = None,
    address: str | None = None,
) -> None:
    """Runs the simulation until it is killed.

    lockstep: while the arm moves, each millisecond waits for the client's command, so that a busy computer changes
        nothing; without it the server keeps its own time
    tilt: slope of the table along x and y
    bias, noise, sign: of the reported force, N; libfranka counts forces of the robot on its surroundings as positive
    stiffness: of the brush
    start: joint angles
    address: of this computer, 127.x.x.x; None for one that nobody uses
    """
    import xml.etree.ElementTree as ET

    import mujoco
    from franky_sim import SimulationServer, franka_robot_protocol
    from franky_sim.franka_robot_server import FrankaRobotServer
    from franky_sim.mujoco_simulator import MujocoSimulator

    now: dict[str, Any] = {"mode": None, "errors": (), "reject": None}
    chance = np.random.default_rng(0)
    plain_state = FrankaRobotServer.robot_state.fget
    felt = np.zeros(6)
    step = 0
    led: deque[np.ndarray] = deque()

    def state(server: Any) -> Any:
        told = plain_state(server).replace(
            O_F_ext_hat_K=tuple(sign * felt + np.r_[0, 0, bias, 0, 0, 0] + chance.normal(0, noise, 6))
        )
        if now["mode"]:
            flags = tuple(number in now["errors"] for number in range(41))
            told = told.replace(
                robot_mode=franka_robot_protocol.RobotMode[now["mode"]], errors=flags, reflex_reason=flags
            )
        return told

    def recover(command: Any, server: Any) -> None:
        print("recovered")
        command.reply(franka_robot_protocol.AutomaticErrorRecoveryStatus.kSuccess)

    plain_move = franka_robot_protocol.MoveCommand.handle

    def move(command: Any, server: Any) -> None:
        print("move")
        if now["reject"] or now["mode"]:  # an arm that is not idle takes no motion
            command.reply(franka_robot_protocol.MoveStatus[now["reject"] or "kCommandNotPossibleRejected"])
        else:
            plain_move(command, server)

    plain_stop = franka_robot_protocol.StopMoveCommand.handle

    def stop(command: Any, server: Any) -> None:
        print("stop", step, time.monotonic())
        plain_stop(command, server)

    FrankaRobotServer.robot_state = property(state)
    franka_robot_protocol.StopMoveCommand.handle = stop
    franka_robot_protocol.AutomaticErrorRecoveryCommand.handle = recover
    franka_robot_protocol.MoveCommand.handle = move

    with MujocoSimulator() as sim:
        robot = sim.add_robot(**({"initial_q": start} if start else {}))
        if table:
            turn = f"{tilt[1]} {-tilt[0]} 0"  # about x and y, small angles
            top = ET.SubElement(sim.worldbody, "body", pos=f"{TABLE_AT[0]} {TABLE_AT[1]} {HEIGHT}", euler=turn)
            ET.SubElement(top, "geom", type="box", size="0.3 0.4 0.02", pos="0 0 -0.02")
        hand = next(body for body in sim.worldbody.iter("body") if body.get("name") == "robot0_hand")
        brush = ET.SubElement(hand, "body", pos=f"0 0 {HAND_TO_FINGERTIPS + BRUSH}")
        ET.SubElement(brush, "joint", type="slide", axis="0 0 1", range="-0.02 0", limited="true",
                      stiffness=str(stiffness), damping="2", armature="0", frictionloss="0.05")  # fmt: skip
        ET.SubElement(brush, "inertial", mass="0.005", pos="0 0 0", diaginertia="1e-6 1e-6 1e-6")
        ET.SubElement(
            brush, "geom", name=_GEOM, type="sphere", size="0.002", pos="0 0 -0.002", group="3", solref="0.002 1"
        )
        sink = Path(trace).open("wb", buffering=0)  # noqa: SIM115 (the process is killed)

        def after(simulation: Any) -> None:
            nonlocal step
            step += 1
            if led:  # a hand is stronger than the arm's own hold
                simulation.data.qpos[robot._qpos_addrs] = led.popleft() if len(led) > 1 else led[0]  # and stays there
                simulation.data.qvel[robot._dof_addrs] = 0.0
            sink.write(np.array(robot.inner_state.q).tobytes())
            model, data, total, one = simulation.model, simulation.data, np.zeros(3), np.zeros(6)
            for number in range(data.ncon):
                contact = data.contact[number]
                if tip in (contact.geom1, contact.geom2):
                    mujoco.mj_contactForce(model, data, number, one)
                    force = contact.frame.reshape(3, 3).T @ one[:3]
                    total += force if contact.geom2 == tip else -force
            felt[:3] += 0.02 * (total - felt[:3])  # the arm's estimate is filtered, over some 50 ms

        sim.register_post_step_callback(after)
        number = os.getpid()
        places = [f"127.{41 + turn}.{number // 250 % 250}.{1 + number % 250}" for turn in range(50)]
        with SimulationServer(sim, hostname_candidates=[address] if address else places) as server:
            tip = mujoco.mj_name2id(sim.model, mujoco.mjtObj.mjOBJ_GEOM, _GEOM)

            orders: queue.SimpleQueue[str] = queue.SimpleQueue()

            def listen() -> None:
                for line in sys.stdin:
                    orders.put(line.strip())
                os._exit(0)  # whoever started it is gone

            def obey(line: str) -> None:
                what = json.loads(line)
                abort = what.get("abort")
                now.update(what)
                if what.get("guide"):
                    led.extend(np.fromfile(what["guide"]).reshape(-1, 7))
                arm = server.robot_servers[0]
                if abort and arm.current_motion_id:
                    number = arm.current_motion_id
                    arm.stop_motion(send_preemption_signal=False)
                    arm.reset_current_motion_id()
                    franka_robot_protocol.MoveCommand.send_response(
                        arm._tcp_socket,
                        franka_robot_protocol.RobotCommand.kMove,
                        number,
                        franka_robot_protocol.MoveStatus[abort],
                    )
                print("done", line)

            threading.Thread(target=listen, daemon=True).start()
            print("ready", robot.hostname)
            while True:
                while not orders.empty():
                    obey(orders.get())
                for one in server.robot_servers:  # `run_once`, but while it moves one step for each command
                    one.process_commands()
                sim.step()
                began = time.monotonic()
                for one in server.robot_servers:
                    one.send_state()
                    if lockstep and one.current_motion_id:
                        select.select([one._FrankaServer__udp_socket], [], [], 0.1)
                if not (lockstep and one.current_motion_id):
                    time.sleep(max(0.0, 0.001 - (time.monotonic() - began)))


if __name__ == "__main__":
    _serve(**json.loads(sys.argv[1]))
