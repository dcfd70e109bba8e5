"""A person teaches three strokes on the page, and a painting is planned and painted with one of them."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from browsing import (
    PATIENCE,
    SCREENSHOTS,
    WITH_CHROMIUM,
    OpenStudio,
    chromium,
    complaints,
    deadline,
    drag,
    opened_studio,
    window,
)
from frida_painter.plan import Plan
from frida_painter.teaching.families import FamilyField, load_family, load_family_model

pytestmark = [pytest.mark.slow, WITH_CHROMIUM, pytest.mark.timeout(560)]  # on a busy machine

Shape = Callable[[float], tuple[float, float]]
SHAPES: dict[str, Shape] = {
    "hook": lambda t: (t, 0.0 if t < 0.7 else 2.0 * (t - 0.7)),
    "ess": lambda t: (t, 0.3 * math.sin(2 * math.pi * t)),
    "tick": lambda t: (t, 0.6 * abs(t - 0.35)),
}
PLAN = """async (family) => {
  const api = await import("/static/api.js");
  const sheet = document.createElement("canvas");
  [sheet.width, sheet.height] = [120, 90];
  const paper = sheet.getContext("2d");
  paper.fillStyle = "#fff"; paper.fillRect(0, 0, 120, 90);
  paper.strokeStyle = "#203060"; paper.lineWidth = 4;
  for (const y of [20, 45, 70]) { paper.beginPath(); paper.moveTo(15, y); paper.lineTo(80, y); paper.lineTo(100, y + 12); paper.stroke(); }
  const picture = await api.upload(await new Promise((resolve) => sheet.toBlob(resolve)));
  const wish = { title: family, strokes: 6, effort: 0.05, colors: 2, replans: 0, width: 160, height: 120, brushes: "fine" };
  const begun = await api.post("/api/paintings", { terms: [{ kind: "image", picture }], strokes_of: `${family}:50%`, ...wish });
  location.hash = `#/p/${begun.id}`;
  return begun.id;
}"""  # noqa: E501


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenStudio]:
    with opened_studio(tmp_path_factory.mktemp("studio") / "paintings") as opened:
        yield opened


@pytest.fixture(scope="module")
def page(studio: OpenStudio) -> Iterator[Page]:
    with deadline(), chromium() as browser, window(browser, studio, 1280, 860) as opened:
        yield opened


def draw(page: Page, name: str, marks: int) -> None:
    """Draws marks of one kind, each a little different."""
    random = np.random.default_rng(sum(map(ord, name)))
    for number in range(marks):
        size, tall = 0.2 * random.uniform(0.85, 1.15), random.uniform(0.8, 1.2)
        left, top = 0.06 + 0.3 * (number % 3), 0.15 + 0.2 * (number // 3)
        way = (SHAPES[name](t) for t in np.linspace(0, 1, 7))
        drag(page, *((left + size * x, top + size * tall * y) for x, y in way))


def teach(page: Page, name: str, strokes: int) -> None:
    page.evaluate("location.hash = '#/'")
    page.evaluate("location.hash = '#/teach'")
    draw(page, name, 9)
    expect(page.get_by_text("9 marks drawn, 1 more to go.")).to_be_visible()
    go = page.get_by_role("button", name="Teach this stroke")
    expect(go).to_be_disabled()
    draw(page, name, 1)
    page.get_by_label("Name of the stroke").fill(name)
    page.get_by_label("Strokes to learn from").fill(str(strokes))
    page.screenshot(path=SCREENSHOTS / f"teach-{name}.png")
    go.click()
    expect(page.locator(".taught figure", has_text=name)).to_be_visible(timeout=5 * PATIENCE)


def test_three_strokes_are_taught_and_one_is_painted_with(page: Page, studio: OpenStudio) -> None:
    for name, strokes in (("hook", 10), ("ess", 0), ("tick", 0)):
        teach(page, name, strokes)
    for sheet in page.locator(".taught img").all():
        sheet.scroll_into_view_if_needed()
        assert sheet.evaluate("async image => { await image.decode(); return image.naturalWidth; }") == 1200
    assert complaints(page) == []
    page.screenshot(path=SCREENSHOTS / "taught.png", full_page=True)
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.screenshot(path=SCREENSHOTS / "taught-phone.png")
    page.set_viewport_size({"width": 1280, "height": 860})
    families = studio.folder / "families"
    assert sorted(path.stem for path in families.glob("*.safetensors")) == ["ess", "hook", "tick"]
    assert isinstance(load_family_model(families / "hook.safetensors", "fine"), FamilyField), "it was painted"
    least, most = load_family(families / "ess.safetensors").size
    assert least < 0.024 < most, "a fifth of the pad, which is 120 mm wide"
    painting = page.evaluate(PLAN, "hook")
    page.get_by_role("button", name="Use plan 1").click(timeout=3 * PATIENCE)
    for box in page.locator(".check input").all():
        box.check()
    page.get_by_role("button", name="Start painting").click()
    expect(page.get_by_text("6 strokes are on the canvas")).to_be_visible(timeout=3 * PATIENCE)
    page.screenshot(path=SCREENSHOTS / "taught-painted.png")
    (folder,) = studio.folder.glob(f"*-{painting[:6]}")
    painted = Plan.load(folder / "painting")
    assert painted.kinds == ("fine", "fine+hook") and painted.layer_sizes == (3, 3)
    page.evaluate("location.hash = '#/new'")
    page.get_by_text("More settings").click()
    expect(page.locator("select option", has_text='the stroke "tick"')).to_have_count(1)
