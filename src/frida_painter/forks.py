"""Forked processes: they compute with one thread, because the threads of their parent are not there."""

import os
import sys
from functools import cache


@cache
def prepare_forks() -> None:
    """Keeps PyTorch in processes that are forked from this one from waiting for ever for threads of this one.

    multiprocessing forks on Linux, and so does gymnasium's AsyncVectorEnv. PyTorch's own DataLoader does the same.
    """
    os.register_at_fork(after_in_child=_use_one_thread)


def _use_one_thread() -> None:
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)
