"""`python -m frida_painter` is the command `frida-painter`: signals are heard before anything else is loaded.

Ctrl-C, SIGTERM and a terminal that is closed end the program in one sentence at any moment. While something is
painted, they mean more (cli/stop_signal.py).
"""

import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn


def main() -> NoReturn:
    """Runs the command line; the exit status after a signal is 128 and its number, by custom."""
    terminal = tuple(filter(os.isatty, (0, 1, 2)))
    heard: list[int] = []

    def end(number: int, frame: FrameType | None) -> NoReturn:
        heard.append(number)
        raise KeyboardInterrupt

    signals = [number for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if _ends(number)]
    for number in signals:
        signal.signal(number, end)
    try:
        from frida_painter.cli import commands

        commands.main()
    except KeyboardInterrupt:
        pass
    except SystemExit as ended:
        if not (heard and ended.code == 128 + signal.SIGINT):  # which is what Typer makes of every signal
            raise
    for number in signals:  # it ends, and once is enough
        signal.signal(number, signal.SIG_IGN)
    _say_farewell(heard[0] if heard else signal.SIGINT, terminal)


def _ends(number: int) -> bool:
    """Whether a signal is not ignored, as nohup has it."""
    return signal.getsignal(number) is not signal.SIG_IGN


def _say_farewell(number: int, terminal: tuple[int, ...]) -> NoReturn:
    from frida_painter.cli.stop_signal import leave_terminal

    if number == signal.SIGHUP:
        leave_terminal(terminal)
    with suppress(OSError):
        print(f"\nfrida-painter: it was ended ({signal.Signals(number).name}); nothing more is done.", file=sys.stderr)
    sys.exit(128 + number)


if __name__ == "__main__":
    main()
