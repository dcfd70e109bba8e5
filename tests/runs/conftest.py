import pytest


@pytest.fixture(scope="module", autouse=True)
def _cheap_paintings(request: pytest.FixtureRequest) -> None:
    """Paintings of this room cost as little as those of `small_world`, but for modules with TRUE_PHOTOGRAPHS."""
    if not getattr(request.module, "TRUE_PHOTOGRAPHS", False):
        request.getfixturevalue("small_world")
