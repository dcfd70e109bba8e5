"""Chromium for the tests of the page: one for each module."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from browsing import chromium, deadline


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with deadline(), chromium() as opened:
        yield opened
