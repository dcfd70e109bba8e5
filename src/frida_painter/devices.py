"""What a GPU asks of code that a CPU does not: that nothing waits for it, and half precision where that is quicker."""

import ctypes
import sys
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from torch import Tensor

_COMPUTES_BFLOAT16 = (8, 0)  # compute capability, of Ampere and later


def sent(tensor: Tensor, device: torch.device) -> Tensor:
    """A tensor of the CPU on a device; a GPU is not waited for: the numbers are on their way when this returns."""
    if device.type == "cuda" and tensor.device.type == "cpu":
        tensor = tensor.pin_memory()
    return tensor.to(device, non_blocking=True)


class Constant:
    """A tensor that never changes, held in every precision and on every device in which it was asked for."""

    def __init__(self, tensor: Tensor) -> None:
        self._first = tensor
        self._held: dict[tuple[torch.device, torch.dtype], Tensor] = {}

    def like(self, other: Tensor) -> Tensor:
        """The tensor on the device and in the precision of another."""
        key = other.device, other.dtype
        if key not in self._held:
            self._held[key] = self._first.to(other)
        return self._held[key]


def half_precision(device: torch.device) -> AbstractContextManager[Any]:
    """Where networks compute in bfloat16: on GPUs that do so; elsewhere nothing changes.

    Its range is that of float32, so that slopes, which are small, stay what they are. float16 would lose them.
    """
    if device.type == "cuda" and torch.cuda.get_device_capability(device) >= _COMPUTES_BFLOAT16:
        return torch.autocast("cuda", dtype=torch.bfloat16)
    return nullcontext()


_KEPT, _LARGEST = 512 * 2**20, 32 * 2**20  # bytes that are kept, and of a block that is; mallopt allows no larger one
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8  # malloc.h


def prepare_process() -> None:
    """Has this process compute on one thread, and keep up to half a gigabyte of memory that it frees.

    Tensors are small, and torch's idle threads spin: on two cores, planning with torch's default took twice the time.
    An iteration of the planner frees and takes blocks of some MB, which glibc may hand back each time, for
    some 2,000 page faults; C libraries that cannot be told otherwise are left as they are. All threads take from one
    arena: of several, each would keep as much for itself.
    """
    torch.set_num_threads(1)
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):  # musl has none
        library.mallopt(_M_MMAP_THRESHOLD, _LARGEST)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT)
        library.mallopt(_M_ARENA_MAX, 1)
