"""Entry point of `python -m frida_painter` and of the command `frida-painter`; handles signals before other imports.

Ctrl-C, SIGTERM and a closed terminal end the program with one sentence at any moment. During a painting they
have other meanings (frida_painter_cli/stop_signal.py).
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # `python -m` puts the current folder there, which may hold anybody's files

import os
import signal
from contextlib import suppress
from types import FrameType
from typing import NoReturn


def main() -> NoReturn:
    """Runs the command line. The exit status after a signal is 128 plus its number, as usual."""
    terminal = tuple(filter(os.isatty, (0, 1, 2)))
    heard: list[int] = []

    def end(number: int, frame: FrameType | None) -> NoReturn:
        heard.append(number)
        raise KeyboardInterrupt

    from frida_painter.system.operating_system import HANGUP, SIGNALS, why_unfit

    if why := why_unfit():
        sys.exit(f"frida-painter: {why}")
    signals = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]  # as by nohup
    for number in signals:
        signal.signal(number, end)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a console may not know every letter
            stream.reconfigure(errors="replace")
    try:
        from frida_painter.system import python_process

        python_process.isolate()
        from frida_painter_cli import commands

        commands.main()
    except KeyboardInterrupt:
        pass
    except SystemExit as ended:
        if not (heard and ended.code == 128 + signal.SIGINT):  # Typer's status for every signal
            raise
    for number in signals:  # the program ends already; further signals change nothing
        signal.signal(number, signal.SIG_IGN)
    cause = heard[0] if heard else signal.SIGINT
    if cause == HANGUP:
        from frida_painter_cli.stop_signal import leave_terminal

        leave_terminal(terminal)
    with suppress(OSError):
        print(f"\nfrida-painter: it was ended ({signal.Signals(cause).name}); nothing more is done.", file=sys.stderr)
    sys.exit(128 + cause)


if __name__ == "__main__":
    main()
