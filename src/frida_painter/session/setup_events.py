"""Events of the setup of a machine, for the page that shows it."""

from typing import Any

from frida_painter.session.event import Written


class SetupStarted(Written):
    """A person began the setup of a machine, or goes on with it."""


class SetupLeft(Written):
    """A person left the setup of a machine; it can be continued."""

    sentence: str


class SetupStands(Written):
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


class SetupStepBegan(Written):
    """A step of a machine's setup has begun."""

    name: str


class MachineTold(Written):
    """The controller told its settings: "text" and "weight" of each fact ("fact", "warning" or "refusal")."""

    facts: list[dict[str, str]]


class SetupWritten(Written):
    """Files of a finished setup, with the commands that use them.

    sheet: picture of both
    commands: "about" and "command" of each
    """

    workspace: str
    record: str
    sheet: str
    commands: list[dict[str, str]]
