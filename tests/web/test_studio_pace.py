from pathlib import Path

from frida_painter.event_log import FEED, EventLog
from frida_painter.web.painting_store import PaintingStore
from frida_painter.web.studio_pace import pace

MADE = {"nearer": 0.5, "prefix": "", "frames": [0, 20], "palette": [], "mixtures": []}


def test_the_pace_is_that_of_the_last_painting(tmp_path: Path) -> None:
    store = PaintingStore(tmp_path)
    guessed = pace(store, real_time=False)
    assert pace(store, real_time=True).painting > guessed.painting
    writer = EventLog(store.begin("A").folder.feed, FEED)
    writer.append({"kind": "wished", "at": 0.0, "plan": 1, "wish": {"effort": 0.5}})
    writer.append({"kind": "planned", "at": 0.0, "plan": 1, "strokes": 20, "seconds": guessed.loading + 30.0, **MADE})
    writer.append({"kind": "begun", "at": 100.0, "plan": 1, "of": 20})
    for done in range(1, 21):
        writer.append({"kind": "stroke", "at": 100.0 + 2 * done, "done": done, "of": 20, "left": 1.0})
    writer.append({"kind": "finished", "at": 200.0, "film": True})
    writer.close()
    found = pace(store, real_time=False)
    assert (found.planning, found.painting) == (3.0, 2.0)
    EventLog(store.begin("B").folder.feed, FEED).append({"kind": "plan_made", "at": "yesterday"})
    assert pace(store, real_time=False) == found
