"""Events of the setup of a machine, for the page that shows it."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class SetupStarted:
    """A person began the setup of a machine, or goes on with it."""


@dataclass(frozen=True)
class SetupLeft:
    """A person left the setup of a machine; it can be continued."""

    sentence: str


@dataclass(frozen=True)
class SetupStands:
    """State of a machine's setup.

    title, robot: of the machine: for people, and for --robot
    easel: its name
    steps: "name", "text" and "done" of each, in order
    table: "lower", "upper", "canvas" (four corners), "wells", "water" and "rag", in millimetres of the robot's frame
    """

    title: str
    robot: str
    easel: str
    steps: list[dict[str, Any]]
    table: dict[str, Any]


@dataclass(frozen=True)
class SetupStepBegan:
    """A step of a machine's setup has begun."""

    name: str


@dataclass(frozen=True)
class MachineTold:
    """The controller told its settings: "text" and "weight" of each fact ("fact", "warning" or "refusal")."""

    facts: list[dict[str, str]]


@dataclass(frozen=True)
class SetupWritten:
    """Files of a finished setup, with the commands that use them.

    sheet: picture of both
    commands: "about" and "command" of each
    """

    workspace: str
    record: str
    sheet: str
    commands: list[dict[str, str]]
