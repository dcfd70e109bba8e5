"""What painting and resuming have in common at the terminal: how they end, what is told, and facts for the page."""

import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from rich.console import Console

from frida_painter.cli.progress import duration
from frida_painter.cli.real import VIRTUAL, Site
from frida_painter.cli.stopping import Stop
from frida_painter.config import PaintingSettings
from frida_painter.errors import CameraError, FridaError, Interrupted, PaintingPaused, RobotError, RobotStopped
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.report.recorder import Occasion
from frida_painter.runs import goals
from frida_painter.session.easel_process import state_folder
from frida_painter.session.easels import ARM_FILM, EaselOrder
from frida_painter.session.events import Notify, Paused, Stopped
from frida_painter.session.loop import Painting, PaintingSession
from frida_painter.session.names import TITLES
from frida_painter.virtual.table import PlacementError

PAUSE_FILE = "pause"
_GLANCE = 0.2  # seconds between two looks for it


def occasion(
    wanted: goals.Wanted,
    target: torch.Tensor | None,
    chosen: PaintingSettings,
    encoders: EncoderRegistry,
    site: Site = VIRTUAL,
) -> Occasion:
    """What page and record tell of a painting before it begins."""
    kind, first, _ = wanted.wishes[0]
    facts = (
        *wanted.facts,
        *((f"{choice.purpose.capitalize()} seen through", choice.used) for choice in encoders.choices),
        *((f"Better for {choice.purpose}", choice.better) for choice in encoders.choices if choice.better),
        *(("Remark", remark) for remark in encoders.remarks),
        ("Canvas", str(chosen.canvas)),
        ("Brush", chosen.brush),
        ("Looks and replans", str(chosen.replans)),
        ("Planned at", f"{chosen.render_height} rows"),
        ("Seed", str(chosen.seed)),
        ("Robot", TITLES.get(site.robot, site.robot)),
    )
    record = {
        **({"photo": first.name} if kind == "image" and isinstance(first, Path) else {}),
        "goal": [list(fact) for fact in wanted.facts],
        "encoders": [asdict(choice) for choice in encoders.choices],
        "remarks": list(encoders.remarks),
        **chosen.model_dump(mode="json"),
    }
    return Occasion(wanted.title, target, facts, record)


def order(
    settings: PaintingSettings,
    brush: str,
    folder: Path,
    placement_error: PlacementError | None,
    pace: float,
    site: Site = VIRTUAL,
    *,
    film_arm: bool = False,
    arm_meshes: Path | None = None,
) -> EaselOrder:
    """The easel that a painting is painted on: the virtual studio of its folder, or a real one.

    film_arm: whether a simulated arm is filmed at work; arm_meshes: the folder of shapes in which it is seen.
    """
    return EaselOrder(
        robot=site.robot,
        film=film_arm,
        meshes=None if arm_meshes is None else arm_meshes.absolute(),
        canvas=settings.canvas,
        brush=brush,
        seed=settings.seed,
        state=state_folder(),
        folder=folder.absolute(),
        pace=pace,
        placement_error=placement_error,
        workspace=None if site.workspace is None else site.workspace.absolute(),
        camera=site.camera,
    )


def tell_encoders(encoders: EncoderRegistry) -> None:
    """Says through which networks the goal is seen, and which would be better."""
    for choice in encoders.choices:
        better = f" (better: {choice.better})" if choice.better else ""
        print(f"Seeing {choice.purpose} through {choice.used}{better}.", file=sys.stderr)
    for remark in encoders.remarks:
        print(remark, file=sys.stderr)


@dataclass(frozen=True)
class Ending:
    """How a sitting ended: what came of it, None where nothing was seen yet, and the fault that ended it, if any."""

    painting: Painting | None
    trouble: FridaError | None = None

    def conclude(self, stop: Stop) -> None:
        """Leaves as a program that was asked to, or raises the fault; returns where neither was the case."""
        if stop.asked and (self.trouble is None or isinstance(self.trouble, RobotStopped)):
            sys.exit(stop.exit_status)
        if self.trouble is not None:
            raise self.trouble


def to_its_end(session: PaintingSession, paint: Callable[[], Painting], hear: Notify) -> Ending:
    """Paints; where robot, camera or the person give up on the way, what there is by then is kept as after a stop."""
    try:
        return Ending(paint())
    except (RobotError, CameraError, PaintingPaused, Interrupted) as trouble:
        so_far = session.so_far
        if so_far is not None:
            hear(Stopped(so_far.painted))
        return Ending(so_far, trouble)


@dataclass(frozen=True)
class Pauses:
    """When a painting pauses and when it goes on: by a file in its folder, or by a person's word at the terminal.

    Where there is neither, nobody answers, and the painting ends as it can be resumed.
    """

    folder: Path
    stop: Stop
    console: Console

    @property
    def file(self) -> Path:
        """As long as it is there, nothing is painted."""
        return self.folder / PAUSE_FILE

    def asked(self) -> bool:
        """Whether somebody wants a pause."""
        return self.file.exists()

    def go_on(self, paused: Paused) -> bool:
        """Waits until the painting may go on; False where it ends here."""
        if self.asked():
            self.console.print(f"Paused after {paused.done} strokes; to go on, remove {self.file}")
            while self.asked() and not self.stop.asked:
                time.sleep(_GLANCE)
            return not self.stop.asked
        if not sys.stdin.isatty():
            return False
        return confirm(f"Paused after {paused.done} strokes. {paused.reason}\nGo on?", default=True)


def confirm(question: str, *, default: bool) -> bool:
    """Asks at the terminal until the answer is yes, no or nothing. Raises Interrupted where nobody answers."""
    choice = "[Y/n]" if default else "[y/N]"
    while True:
        try:
            answer = input(f"{question} {choice} ").strip().lower()
        except (EOFError, KeyboardInterrupt) as end:
            raise Interrupted("Nobody answered, and nothing was painted; for scripts there is --yes.") from end
        if answer in ("", "y", "yes", "n", "no"):
            return answer[:1] == "y" if answer else default
        print("Type y or n.")


def tell(folder: Path, page: Path | None, painting: Painting | None, of: int, seconds: float) -> None:
    """Says what came of it, and where it is."""
    if page is None or painting is None:
        say(f"Stopped before there was a plan; nothing was painted. ({folder})")
        return
    painted = painting.painted
    begun = f"{painted} strokes" if painted == of else f"Stopped after {painted} of {of} strokes; what was made is kept"
    say(
        f"{begun} in {duration(seconds)}.",
        f"  The painting  {folder / 'painting.png'}",
        *([f"  The film      {folder / 'film.mp4'}"] if (folder / "film.mp4").exists() else []),
        *([f"  The arm       {folder / ARM_FILM}"] if (folder / ARM_FILM).exists() else []),
        f"  The page      {page}",
        *([f"  To go on      frida-painter resume {folder}"] if painted < of else []),
    )


def say(*lines: str) -> None:
    """Lines for people, on the standard output."""
    for line in lines:
        print(line)
