import math
import time

import pytest

from frida_painter.errors import Interrupted
from frida_painter_studio import security as lead_module
from frida_painter_studio.security import Lead, Led

NONCE = "0123456789abcdef"


def test_one_browser_leads_until_another_takes_over() -> None:
    lead = Lead()
    lead.require("one", NONCE + "1", time.time())
    lead.require("one", NONCE + "2", time.time())
    with pytest.raises(Led, match="Another browser leads"):
        lead.require("two", NONCE + "3", time.time())
    lead.take_over("two", NONCE + "5", time.time())
    with pytest.raises(Interrupted, match="already"):
        lead.take_over("one", NONCE + "5", time.time())
    lead.require("two", NONCE + "3", time.time())
    with pytest.raises(Led):
        lead.require("one", NONCE + "4", time.time())


def test_whoever_asks_for_nothing_any_more_leads_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    lead = Lead()
    lead.require("one", NONCE + "1", time.time())
    now = time.monotonic()
    monkeypatch.setattr(lead_module.time, "monotonic", lambda: now + lead_module.KEPT_FOR + 1)
    lead.require("two", NONCE + "2", time.time())


def test_a_page_that_is_left_gives_the_lead_back_and_no_other_page_can() -> None:
    lead = Lead()
    lead.require("one", NONCE + "1", time.time(), "first page")
    assert not lead.give_back("two", "first page") and not lead.give_back("one", "another page")
    with pytest.raises(Led):
        lead.require("two", NONCE + "2", time.time(), "page of two")
    assert lead.give_back("one", "first page") and not lead.give_back("one", "first page")
    lead.require("one", NONCE + "3", time.time(), "reloaded")
    assert not lead.give_back("one", "first page"), "the page before the reload says so late"
    with pytest.raises(Led):
        lead.require("two", NONCE + "4", time.time(), "page of two")
    assert lead.give_back("one", "reloaded")
    lead.require("two", NONCE + "4", time.time(), "page of two")


@pytest.mark.parametrize(
    ("nonce", "late", "says"),
    [
        ("short", 0.0, "reload"), ("x" * 65, 0.0, "reload"), (NONCE, math.nan, "reload"), (NONCE, math.inf, "reload"),
        (NONCE, 11.0, "too long ago"), (NONCE, -11.0, "too long ago"),
    ],
)  # fmt: skip
def test_orders_that_are_old_or_nameless_are_refused(nonce: str, late: float, says: str) -> None:
    with pytest.raises(Interrupted, match=says):
        Lead().require("one", nonce, time.time() - late)


def test_each_order_is_done_once() -> None:
    lead = Lead()
    lead.require("one", NONCE, time.time())
    with pytest.raises(Interrupted, match="already"):
        lead.require("one", NONCE, time.time())
