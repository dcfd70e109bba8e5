from collections.abc import Callable
from pathlib import Path
from uuid import uuid4

import pytest
from hypothesis import settings

from snapshots import Snapshots

settings.register_profile("suite", deadline=None)
settings.load_profile("suite")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--renew-snapshots", action="store_true", help="write tests/snapshots/*.png anew; look at them!")


@pytest.fixture(autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stops are latched, and robots locked, for one test only and never for the person who runs it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / "state" / uuid4().hex))


@pytest.fixture
def snapshot(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., None]:
    """snapshot(name, picture): fails unless the picture [3, H, W] looks like tests/snapshots/<name>.png."""
    folder = Path(__file__).parent / "snapshots"
    return Snapshots(folder, tmp_path, renew=request.config.getoption("--renew-snapshots")).check
