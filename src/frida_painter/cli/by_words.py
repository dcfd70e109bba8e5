"""Painting together by words at the terminal: the option, and the talk of a pause about pictures from the canvas."""

import select
import sys
from collections.abc import Callable
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from frida_painter.errors import ConfigError, FridaError, Interrupted

if TYPE_CHECKING:
    from frida_painter.runs.run import PaintingRun
    from frida_painter.session.making_events import PicturesMade

ProposeOption = Annotated[
    str | None,
    typer.Option(
        "--propose",
        metavar="NAME:TEXT",
        help="Picture maker for changes by words: while it paints, type what shall change and press Enter, then choose "
        "one of its pictures, which begin from the canvas; diffusers:FOLDER, or command:PROGRAM with {canvas}. "
        "[dim]nothing is proposed[/]",
        rich_help_panel="What to paint",
    ),
]
_GLANCE = 0.2  # seconds between two looks whether the person has stopped
_ASK = "What shall change? (Enter: paint on) "


def require_proposer(maker: str | None, *, together: bool) -> None:
    """Raises ConfigError if a maker is wanted that is not there or takes no canvas, or without a goal to change."""
    from frida_painter.runs.picture_making import require_canvas_maker

    if maker is not None and together:
        raise ConfigError("--propose changes a goal, and --together has none; leave out one.")
    if maker is not None:
        require_canvas_maker(maker)


class Proposer:
    """Talk with the person at the terminal, in the pauses of one painting.

    maker: as in `--imagine NAME:TEXT`
    stop_asked: returns True if the person stops all
    ask: shows a prompt and returns the typed line
    confirm: asks a question, and returns True for yes, which is proposed
    """

    def __init__(
        self,
        run: "PaintingRun",
        maker: str,
        stop_asked: Callable[[], bool],
        ask: Callable[[str], str],
        confirm: Callable[[str], bool],
    ) -> None:
        self._run, self._maker, self._stop_asked, self._ask, self._confirm = run, maker, stop_asked, ask, confirm
        self._typed, self._talking = "", False
        history = run.history
        self._owed: dict[str, Any] = {} if history is None else history.request
        self._proposed = None if history is None else history.proposed
        _tell(
            "To change the painting, type what shall change and press Enter, at any time."
            if sys.stdin.isatty()
            else "--propose waits for typed words, and nobody can type here."
        )

    def wants_pause(self) -> bool:
        """Returns True if the person has typed something, or if a talk broke off with the painting.

        Before the first plan there is nothing to change: what is typed waits.
        """
        so_far = None if self._run.session is None else self._run.session.so_far
        if self._talking or so_far is None or so_far.rest is None:
            return False
        if not self._typed and sys.stdin.isatty() and select.select([sys.stdin], [], [], 0)[0]:
            self._typed = read_line().strip()
        return bool(self._typed or self._owed or self._proposed)

    def talk(self) -> None:
        """Asks what shall change, until the person has nothing more to change; each trouble is one sentence."""
        self._talking = True  # what is typed while it plans again waits for the end of this talk
        try:
            self._take_up()
            while not self._stop_asked():
                typed, self._typed = self._typed, ""
                words = typed or self._ask(_ASK).strip()
                if not words:
                    return
                try:
                    self._propose(words)
                except FridaError as trouble:
                    print(trouble, file=sys.stderr)
        except (EOFError, KeyboardInterrupt) as end:
            raise Interrupted("Nobody answers any more; what was painted is kept.") from end
        finally:
            self._talking = False

    def _take_up(self) -> None:
        """Goes on with a talk that broke off: before its pictures, before the choice, or before the new plan."""
        owed, proposed, self._owed, self._proposed = self._owed, self._proposed, {}, None
        if owed.get("kind") == "choose":
            self._pursue(str(owed["file"]))
        elif owed.get("kind") == "propose":
            self._typed = str(owed["words"])
        elif proposed is not None:
            self._choose(proposed)

    def _propose(self, words: str) -> None:
        from frida_painter.runs.goal_item import read_prompt
        from frida_painter.runs.proposing import forbid, propose, record_making, union_of
        from frida_painter.session.person_events import RequestTaken

        words = read_prompt(words, "The change")
        session, folder = self._run.session, self._run.folder
        assert session is not None
        session.note(RequestTaken({"kind": "propose", "words": words}))
        own = session.person.find_own_paint()
        share = 0.0 if own is None else max(1.0, 100 * float(own.mean()))
        if own is not None and self._confirm(f"You painted about {share:.0f} % of the canvas. Shall it stay as it is?"):
            forbid(session, folder, union_of(session.planner.region, own), lambda drawing: None)
        try:
            making = propose(session, folder, words, self._maker, stop_asked=self._stop_asked, tell=_tell)
        except FridaError:
            session.note(RequestTaken({}))
            raise
        made = record_making(making, making.made_by, folder, [""] * len(making.pictures))
        session.note(made)
        self._choose(made)

    def _choose(self, made: "PicturesMade") -> None:
        """Asks for a picture of a making, and plans towards it; none is chosen by Enter."""
        folder, count = self._run.folder, len(made.pictures)
        _tell(f"Made from the canvas, {made.words!r}, by {made.maker}:")
        for number, one in enumerate(made.pictures, 1):
            _tell(f"  {number}  {folder / one['file']}  (seed {one['seed']})")
        prompt = f"Number of the one to paint (1 to {count}; Enter: none): "
        while line := self._ask(prompt).strip():
            if line.isdecimal() and 1 <= int(line) <= count:
                self._pursue(made.pictures[int(line) - 1]["file"])
                return
            _tell(f"Type a number from 1 to {count}, or nothing.")

    def _pursue(self, file: str) -> None:
        from frida_painter import storage
        from frida_painter.runs.picture_making import MAKING
        from frida_painter.runs.proposing import chosen_record, pursue
        from frida_painter.runs.spec import RunSpec
        from frida_painter.session.person_events import RequestTaken

        session, picture = self._run.session, self._run.folder / file
        assert session is not None
        session.note(RequestTaken({"kind": "choose", "file": file}))
        _tell("The rest is planned towards it, with the paints that are mixed.")
        storage.write_json(picture.parent / MAKING, chosen_record(picture))
        pursue(session, self._run.folder, RunSpec.of(goal=[{"image": str(Path(picture))}]), {})
        session.note(RequestTaken({}))


def ask_at_terminal(prompt: str, stop_asked: Callable[[], bool]) -> str:
    """Returns the line that is typed after a prompt; "" after Ctrl-D, which says no more than Enter.

    Raises EOFError if nobody can type, Interrupted after a stop.
    """
    print(prompt, end="", flush=True)
    while sys.stdin.isatty() and not select.select([sys.stdin], [], [], _GLANCE)[0]:
        if stop_asked():
            print()
            raise Interrupted("You stopped; what was painted is kept.")
    line = read_line()
    if not line and not sys.stdin.isatty():
        raise EOFError
    return line


def read_line() -> str:
    """Returns the next line that is typed; bytes that are no text become marks."""
    if not isinstance(sys.stdin, TextIOWrapper):
        return sys.stdin.readline()
    return sys.stdin.buffer.readline().decode(sys.stdin.encoding, "replace")


def _tell(sentence: str) -> None:
    print(sentence, file=sys.stderr)
