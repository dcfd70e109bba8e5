import pytest


@pytest.fixture(scope="module", autouse=True)
def _cheap_paintings(small_world: None) -> None:
    """Paintings of this room cost as little as those of `small_world`."""
