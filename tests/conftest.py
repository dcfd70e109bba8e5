import os
import signal
from collections.abc import Callable
from pathlib import Path
from uuid import uuid4

import cv2
import pytest
import torch
from hypothesis import settings

from snapshots import Snapshots

settings.register_profile("suite", deadline=None)
settings.load_profile("suite")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--renew-snapshots", action="store_true", help="write tests/snapshots/*.png anew; look at them!")


def pytest_configure(config: pytest.Config) -> None:
    """One thread for each test process, and for whatever it starts, as `prepare_process` has it for people.

    Two workers with a pool of threads each wait for one another on two cores: the same tests then take up to
    six times the processor time, and their sums come in another order on every machine.
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # of processes that are started from here, xdist's workers too
    # Under nohup a program ignores that its terminal was closed, and one that a script starts in the background ignores
    # Ctrl-C. Whatever it starts inherits that; the tests ask what a program does that ignores neither.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not torch.cuda.is_available():
        os.environ["TRITON_INTERPRET"] = "1"  # read when Triton is imported, by whatever imports it first
    torch.set_num_threads(1)
    cv2.setNumThreads(1)


@pytest.fixture(autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stops are latched, and robots locked, for one test only and never for the person who runs it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / "state" / uuid4().hex))


@pytest.fixture
def snapshot(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., None]:
    """snapshot(name, picture): fails unless the picture [3, H, W] looks like tests/snapshots/<name>.png."""
    folder = Path(__file__).parent / "snapshots"
    return Snapshots(folder, tmp_path, renew=request.config.getoption("--renew-snapshots")).check
