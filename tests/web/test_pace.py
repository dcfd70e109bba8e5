from pathlib import Path

from frida_painter.web.feed import Feed
from frida_painter.event_log import FEED, EventLog
from frida_painter.web.pace import pace
from frida_painter.web.painting_store import PaintingStore


def test_the_pace_is_that_of_the_last_painting(tmp_path: Path) -> None:
    store = PaintingStore(tmp_path)
    guessed = pace(store, real_time=False)
    assert pace(store, real_time=True).painting > guessed.painting
    writer = EventLog(store.begin("A").folder.feed, FEED)
    writer.append({"kind": "wished", "at": 0.0, "plan": 1, "wish": {"effort": 0.5}})
    writer.append({"kind": "planned", "at": 0.0, "plan": 1, "strokes": 20, "seconds": guessed.loading + 30.0})
    writer.append({"kind": "begun", "at": 100.0})
    for done in range(1, 21):
        writer.append({"kind": "stroke", "at": 100.0 + 2 * done})
    writer.append({"kind": "finished", "at": 200.0})
    writer.close()
    found = pace(store, real_time=False)
    assert (found.planning, found.painting) == (3.0, 2.0)
    broken = Feed(store.begin("B").folder)
    broken.tell("planned")
    assert pace(store, real_time=False) == found
