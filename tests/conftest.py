from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from snapshots import Snapshots

settings.register_profile("suite", deadline=None)
settings.load_profile("suite")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--renew-snapshots", action="store_true", help="write tests/snapshots/*.png anew; look at them!")


@pytest.fixture
def snapshot(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., None]:
    """snapshot(name, picture): fails unless the picture [3, H, W] looks like tests/snapshots/<name>.png."""
    folder = Path(__file__).parent / "snapshots"
    return Snapshots(folder, tmp_path, renew=request.config.getoption("--renew-snapshots")).check
