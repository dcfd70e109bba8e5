"""Work of picture makers in a process of its own: the child's side of a task, which loads no network by itself.

The folder of a task has these files:

task.json: the task.
answer.json: the answer, written last.
fault: the sentence for the person, if there is no answer.
"""

import os
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from frida_painter import storage
from frida_painter.errors import FridaError

TASK, ANSWER, FAULT = "task.json", "answer.json", "fault"
TOLD = "frida-painter: "
"""Beginning of the lines of the standard error that are told to the person."""
_LONGEST = 160  # characters of a foreign library's message


def run_task(work: Callable[[Mapping[str, Any], Path], Mapping[str, Any]], subject: str) -> None:
    """Does the task in the folder that the command line names, and ends the process.

    work: returns the answer, from the task and its folder
    subject: beginning of the sentence about a failure that `work` did not foresee
    The process also ends if its parent does.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()
    folder = Path(sys.argv[1])
    try:
        storage.write_json(folder / ANSWER, work(storage.read_json(folder / TASK, "a task"), folder))
    except FridaError as fault:
        sentence = str(fault)
    except Exception as failure:  # foreign libraries may raise anything
        why = " ".join(f"{type(failure).__name__}: {failure}".split())[:_LONGEST].rstrip(".")
        sentence = f"{subject} failed ({why}); name another, or try it without frida-painter."
    else:
        return
    storage.write_text(folder / FAULT, sentence)
    sys.exit(1)


def tell(sentence: str) -> None:
    """Tells the person a sentence."""
    print(f"{TOLD}{sentence}", file=sys.stderr, flush=True)


def _end_with_parent() -> None:
    while os.read(0, 1):  # ends when the parent does, which holds the other end; sys.stdin would hold a lock at exit
        pass
    os._exit(1)
