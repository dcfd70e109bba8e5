"""Painting together by words in a real browser: a maker draws onto the canvas, and the painter is killed meanwhile."""

import json
import sys
from pathlib import Path

import pytest
from playwright.sync_api import expect

from browsing import (
    BEGIN,
    PATIENCE,
    SCREENSHOTS,
    WITH_CHROMIUM,
    chromium,
    complaints,
    deadline,
    drag,
    kill_worker,
    opened_studio,
    window,
)
from frida_painter import images
from frida_painter.event_log import EventLog
from support.boat import BOAT

pytestmark = [pytest.mark.slow, WITH_CHROMIUM, pytest.mark.timeout(560)]  # on a busy machine


def test_a_person_asks_for_a_boat_chooses_one_and_what_they_painted_stays(tmp_path: Path) -> None:
    (tmp_path / "boat.py").write_text(BOAT)
    maker = f"command:{sys.executable} {tmp_path / 'boat.py'} {{seed}} {{canvas}} {{out}} {{words}}"
    with (
        deadline(),
        opened_studio(tmp_path / "paintings", "--imagine", maker) as studio,
        chromium() as browser,
        window(browser, studio, 1280, 900) as page,
    ):
        painting = page.evaluate(BEGIN)
        page.get_by_role("button", name="Use plan 1").click(timeout=3 * PATIENCE)
        for box in page.locator(".check input").all():
            box.check()
        page.get_by_role("button", name="Start painting").click()
        pause = page.get_by_role("button", name="Pause after this stroke")
        expect(pause).to_be_visible(timeout=3 * PATIENCE)
        pause.click()
        page.get_by_role("button", name="Paint on the canvas yourself").click()
        drag(page, (0.1, 0.15), (0.5, 0.2), (0.9, 0.15))
        expect(page.get_by_text("1 stroke of yours")).to_be_visible()
        page.get_by_role("button", name="Back to the painting").click()
        page.get_by_text("Change it by words").click()
        page.get_by_label("What shall change").fill("add a boat")
        page.get_by_label("What shall change").press("Enter")
        shelf = page.get_by_role("list", name="Pictures of add a boat")
        expect(shelf.get_by_role("button")).to_have_count(4, timeout=3 * PATIENCE)
        expect(page.get_by_text("What you painted stays as it is in all of them.")).to_be_visible()
        shelf.get_by_role("button").first.scroll_into_view_if_needed()
        page.screenshot(path=SCREENSHOTS / "by-words-proposed.png")
        assert complaints(page) == []
        (folder,) = studio.folder.glob(f"*-{painting[:6]}")
        kill_worker(folder)
        page.get_by_role("button", name="Continue this painting").click()
        expect(shelf).to_have_count(0)  # it is taken up
        expect(shelf.get_by_role("button")).to_have_count(4, timeout=3 * PATIENCE)
        shelf.get_by_role("button", name="Paint towards picture 2 of 4, seed").press("Enter")
        expect(page.get_by_text("Made from “add a boat” by command")).to_be_visible(timeout=3 * PATIENCE)
        expect(page.get_by_role("button", name="Continue", exact=True)).to_be_visible(timeout=3 * PATIENCE)
        page.screenshot(path=SCREENSHOTS / "by-words-chosen.png")
        page.get_by_role("button", name="Continue", exact=True).click()
        expect(page.get_by_text("8 strokes are on the canvas")).to_be_visible(timeout=3 * PATIENCE)
        page.screenshot(path=SCREENSHOTS / "by-words-painted.png")
    kinds = [entry["kind"] for entry in EventLog.read(folder / "painting/journal")]
    made, changed, resumed = (kinds.index(kind) for kind in ("pictures_made", "goal_changed", "session_resumed"))
    assert kinds.index("region_protected") < made < resumed < changed
    result = json.loads((folder / "painting/result.json").read_text())
    (change,) = result["goal_changes"]
    assert "“add a boat” by command" in change["goal"][0] and 0 < change["strokes"] < 8
    assert "add a boat" in (folder / "painting/index.html").read_text()
    assert json.loads((folder / "painting/changes/2/goal/1/making.json").read_text())["because"] == "a person chose it"
    canvas, chosen = (images.load(folder / "painting/changes/1" / name) for name in ("canvas.png", "add-a-boat-2.png"))
    changes = (canvas - chosen).abs().mean(0) > 0.1
    assert changes.any() and not changes[: canvas.shape[1] // 4].any(), "the boat, and nothing of the person's stroke"
