"""Six STS3215 servos on a bus, played over a pseudo-terminal from Feetech's protocol manual and memory table.

The sixth is that of the gripper.

A packet is FF FF, number, length, instruction, parameters and a checksum (the complement of the sum after the header).
A servo answers FF FF, number, length, error bits, data, checksum; nobody answers what goes to all (254). Positions are
4096 steps a turn, bit 15 the sign (huggingface/lerobot 2223). Numbers of two bytes begin with the lower one.

The arm around them is The Robot Studio's so101_new_calib.urdf; `tips` computes where its tip is, by matrices.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from machines.simulated_time import Cable

STEPS = 4096
BRUSH = 0.05
"""Metres from the fingertips to the tip of the brush."""
_PING, _READ, _WRITE, _SYNC_WRITE = 1, 2, 3, 0x83
_MODEL, _MIN_ANGLE, _MAX_ANGLE, _TORQUE, _GOAL, _POSITION, _VOLTAGE = 3, 9, 11, 40, 42, 56, 62
_SEEN = 1e-4  # radians that a joint moves between two entries of the trace

# Origins and fixed-axis angles of the joints in the published model, in its own frame, and the fingertips.
PUBLISHED = [
    ((0.0207909, -0.0230745, 0.0948817), (-3.14159, 0, 1.5708)),
    ((-0.0303992, -0.0182778, -0.0542), (-1.5708, -1.5708, 0)),
    ((-0.11257, -0.028, 0), (0, 0, 1.5708)),
    ((-0.1349, 0.0052, 0), (0, 0, -1.5708)),
    ((0, -0.0611, 0.0181), (1.5708, 0, 3.14159)),
]
_FINGERS = np.array([-0.0079, -0.000218, -0.0981])


def tips(joints: np.ndarray, beyond: float = BRUSH) -> np.ndarray:
    """Returns the tip [n, 3] for joint angles [n, 5], in a frame on the table below the first joint, x forward.

    beyond: metres of the brush beyond the fingertips
    """
    place, turn = np.zeros((len(joints), 3)), np.tile(np.eye(3), (len(joints), 1, 1))
    for angle, (origin, rpy) in zip(np.asarray(joints).T, PUBLISHED, strict=True):
        place = place + turn @ np.array(origin)
        turned = Rotation.from_rotvec(np.c_[0 * angle, 0 * angle, angle]).as_matrix()
        turn = turn @ Rotation.from_euler("xyz", rpy).as_matrix() @ turned
    x, y, z = (place + turn @ (_FINGERS - (0, 0, beyond)) - (0.0207909, -0.0230745, 0)).T
    return np.stack([-y, x, z], -1)


def _word(place: float) -> int:
    """Returns a position as a servo writes it."""
    step = round(place)
    return step if step >= 0 else 0x8000 | -step


class StsBus:
    """The bus. Implements simulated_time.Controller; it lives by that clock, or in a thread (Living).

    joints: radians at which the arm stands
    speed: radians per second of a servo
    play: radians by which a joint's load may lag behind its gear, half of it to each side

    dead: servos that are silent; stuck: that do not move; errors: bits that a servo reports
    noise: bytes before the next answer; chatters: before every answer; lose_every: of so many goals one is not heard
    """

    resets_when_opened = False
    cable: Cable

    def __init__(self, joints: np.ndarray, speed: float = 4.7, play: float = 0.0) -> None:
        self.place = np.round(np.array(joints, np.float64) * STEPS / (2 * np.pi) + STEPS / 2)
        self.speed, self.play = speed, play
        self.dead, self.stuck = set[int](), set[int]()
        self.grip = 2100  # where the gripper closes on the brush
        self.errors: dict[int, int] = {}
        self.noise, self.chatters, self.lose_every = b"", False, 0
        self.load = self.joints
        self.trace: list[np.ndarray] = [self.load]
        self.goals = 0
        self._heap, self._moves = b"", False
        self.restart()

    def restart(self) -> None:
        """Power comes: no servo holds, and each knows its angle."""
        self.registers = {number: bytearray(80) for number in range(1, 7)}
        for number in self.registers:
            for address, value in ((_MODEL, 777), (_MIN_ANGLE, 0), (_MAX_ANGLE, STEPS - 1), (_VOLTAGE, 74 + (31 << 8))):
                self.write(number, address, value)
            self.write(number, _GOAL, _word(self.place[number - 1]) if number < 6 else 0)
        self.write(6, _POSITION, self.grip)
        self._tell_positions()

    def write(self, number: int, address: int, value: int) -> None:
        """Sets a number of two bytes in a servo's memory."""
        self.registers[number][address : address + 2] = int(value).to_bytes(2, "little")

    @property
    def joints(self) -> np.ndarray:
        """Angles of the gears [5], as the servos know them."""
        return (self.place - STEPS / 2) * 2 * np.pi / STEPS

    def pass_time(self, seconds: float) -> None:
        far = self.speed * seconds * STEPS / (2 * np.pi)
        for number, registers in self.registers.items():
            word = int.from_bytes(registers[_GOAL : _GOAL + 2], "little")
            goal = -(word & 0x7FFF) if word & 0x8000 else word
            if number == 6:
                self.grip = goal if registers[_TORQUE] else self.grip
                continue
            if registers[_TORQUE] and number not in self.stuck and goal != self.place[number - 1]:
                self.place[number - 1] += np.clip(goal - self.place[number - 1], -far, far)
                self._moves = True
        if not self._moves:
            return
        self._moves = False
        self._tell_positions()
        self.load = np.clip(self.load, self.joints - self.play / 2, self.joints + self.play / 2)
        if np.abs(self.load - self.trace[-1]).max() >= _SEEN:
            self.trace.append(self.load)

    def _tell_positions(self) -> None:
        for number in range(1, 6):
            self.write(number, _POSITION, _word(self.place[number - 1]))

    def hear(self, content: bytes) -> None:
        self._heap += content
        while True:
            start = self._heap.find(b"\xff\xff")
            if start < 0 or len(self._heap) < start + 4 or len(self._heap) < start + 4 + self._heap[start + 3]:
                return
            end = start + 4 + self._heap[start + 3]
            packet, self._heap = self._heap[start:end], self._heap[end:]
            if packet[-1] == ~sum(packet[2:-1]) & 0xFF:
                self._obey(packet[2], packet[4], packet[5:-1])

    def _obey(self, number: int, instruction: int, given: bytes) -> None:
        if instruction == _SYNC_WRITE:
            address, length = given[0], given[1]
            self.goals += 1
            if self.lose_every and self.goals % self.lose_every == 0:
                return
            for at in range(2, len(given), length + 1):
                self.registers[given[at]][address : address + length] = given[at + 1 : at + 1 + length]
        elif number in self.registers and number not in self.dead:
            data = b""
            if instruction == _READ:
                data = bytes(self.registers[number][given[0] : given[0] + given[1]])
            elif instruction == _WRITE:
                self.registers[number][given[0] : given[0] + len(given) - 1] = given[1:]
            else:
                assert instruction == _PING
            body = bytes((number, len(data) + 2, self.errors.get(number, 0))) + data
            noise, self.noise = self.noise, b""
            before = b"\x00\xff\x13" if self.chatters else noise
            self.cable.say(before + b"\xff\xff" + body + bytes((~sum(body) & 0xFF,)))
