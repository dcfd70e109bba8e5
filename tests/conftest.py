import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import uuid4

import cv2
import pytest
import torch
from hypothesis import settings

from downloads import pytest_terminal_summary as pytest_terminal_summary  # what was skipped, and why
from killing import forked_easels, fresh_easels
from snapshots import Snapshots

settings.register_profile("suite", deadline=None)
settings.register_profile("quick", deadline=None, max_examples=10)  # `make quick` asks for it
settings.load_profile("suite")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--renew-snapshots", action="store_true", help="write tests/snapshots/*.png anew; look at them!")


def pytest_configure(config: pytest.Config) -> None:
    """One thread for each test process, and for whatever it starts, as `prepare_process` has it for people.

    Two workers with a pool of threads each wait for one another on two cores: the same tests then take up to
    six times the processor time, and their sums come in another order on every machine.
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # of processes that are started from here, xdist's workers too
    # Under nohup a program ignores that its terminal was closed; the tests ask what it does where it does not.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # of a run in the background of a script
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not torch.cuda.is_available():
        os.environ["TRITON_INTERPRET"] = "1"  # read when Triton is imported, by whatever imports it first
    torch.set_num_threads(1)
    cv2.setNumThreads(1)


@pytest.fixture(scope="session", autouse=True)
def _forked_easels() -> Iterator[None]:
    """Easels' processes load nothing again; where they are started as people have them, tests ask for `fresh_easel`."""
    with forked_easels():
        yield


@pytest.fixture
def fresh_easel() -> Iterator[None]:
    """Easels' processes are started as people have them, by an interpreter of their own."""
    with fresh_easels():
        yield


@pytest.fixture(autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stops are latched, and robots locked, for one test only and never for the person who runs it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / "state" / uuid4().hex))


@pytest.fixture
def snapshot(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., None]:
    """snapshot(name, picture): fails unless the picture [3, H, W] looks like tests/snapshots/<name>.png."""
    folder = Path(__file__).parent / "snapshots"
    return Snapshots(folder, tmp_path, renew=request.config.getoption("--renew-snapshots")).check
