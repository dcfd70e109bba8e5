"""Adam for the planner's two leaves, torch's own but for rounding (D. Kingma, J. Ba, ICLR 2015).

torch.optim.Adam loads PyTorch's compiler, whatever it is used for: more than a second of every command that plans.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from frida_painter.compiled import array, compiles_for

_EPSILON = 1e-8


class Adam:
    """Steps `leaves`, in place, along their gradients; betas: how long the means of slope and of its square last."""

    def __init__(self, leaves: Sequence[Tensor], betas: tuple[float, float]) -> None:
        self._leaves = list(leaves)
        self._betas = betas
        self._means = [torch.zeros_like(leaf) for leaf in self._leaves]
        self._squares = [torch.zeros_like(leaf) for leaf in self._leaves]
        self._steps = 0

    def forget_gradients(self) -> None:
        """Has the next gradients begin at nothing."""
        for leaf in self._leaves:
            leaf.grad = None

    @torch.no_grad()
    def step(self, rate: float) -> None:
        """One step of that rate for every leaf that has a gradient."""
        self._steps += 1
        first, second = self._betas
        length = rate / (1 - first**self._steps)
        spread = (1 - second**self._steps) ** 0.5
        for leaf, mean, square in zip(self._leaves, self._means, self._squares, strict=True):
            if leaf.grad is None:
                continue
            if compiles_for(leaf) and leaf.is_contiguous():
                from frida_painter.planning.variable_kernels import step

                state = (array(tensor).reshape(-1) for tensor in (leaf, leaf.grad, mean, square))
                step(*state, *map(array(leaf).dtype.type, (first, second, length, spread, _EPSILON)))
                torch.autograd.graph.increment_version(leaf)
            else:
                mean.lerp_(leaf.grad, 1 - first)
                square.mul_(second).addcmul_(leaf.grad, leaf.grad, value=1 - second)
                leaf.addcdiv_(mean, square.sqrt().div_(spread).add_(_EPSILON), value=-length)
