import subprocess
import sys

import pytest
import torch

from frida_painter.planning import optimize as adam_module
from frida_painter.planning.optimize import Adam

BETAS = (0.9, 0.98)


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "compiled"])
def test_its_steps_are_those_of_torch(monkeypatch: pytest.MonkeyPatch, compiled: bool) -> None:
    """Those of PyTorch's operations bit for bit, those of the compiled loops but for rounding."""
    monkeypatch.setattr(adam_module, "compiles_for", lambda leaf: compiled)
    random = torch.Generator().manual_seed(0)
    ours = [torch.randn(shape, generator=random).requires_grad_() for shape in ((300, 6), (12, 3))]
    torchs = [leaf.detach().clone().requires_grad_() for leaf in ours]
    adam, oracle = Adam(ours), torch.optim.Adam(torchs, betas=BETAS, foreach=True)
    for iteration in range(60):
        adam.forget_gradients()
        oracle.zero_grad()
        for leaves in (ours, torchs):
            sum((leaf.sin() * leaf * (iteration % 7 - 2.5)).sum() for leaf in leaves).backward()
        rate = 0.1 / (1 + iteration)
        oracle.param_groups[0]["lr"] = rate
        oracle.step()
        adam.step(rate)
        for one, other in zip(ours, torchs, strict=True):
            torch.testing.assert_close(one, other, atol=1e-5 if compiled else 0, rtol=0, msg=str(iteration))


def test_a_leaf_without_a_gradient_stays_where_it_is() -> None:
    moved, still = torch.ones(3, requires_grad=True), torch.ones(2, requires_grad=True)
    adam = Adam([moved, still])
    moved.sum().backward()
    adam.step(0.1)
    assert torch.equal(still.detach(), torch.ones(2)) and bool((moved < 1).all())


def test_planning_does_not_load_the_compiler() -> None:
    code = (
        "import sys, torch; from frida_painter.planning.optimize import Adam\n"
        "leaf = torch.ones(3, requires_grad=True); leaf.sum().backward(); Adam([leaf]).step(0.1)\n"
        "sys.exit('torch._dynamo' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
