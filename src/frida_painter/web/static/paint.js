// "Paint": the live photograph beside the plan, stroke by stroke, and what every look has changed.

import * as api from "./api.js";
import { canvasView } from "./canvasview.js";
import { count, duration, h, show } from "./dom.js";
import { togetherTools } from "./tools.js";

const WORDS = {
  preparing: "getting ready", mixing: "waiting for the paints", painting: "painting", planning: "looking at the canvas and replanning",
  paused: "paused", finishing: "making the timelapse film and the page", stopped: "stopped", finished: "finished", failed: "failed",
};

export function paintStage(house, here, first) {
  const wish = first.plans.find((plan) => plan.number === first.painting.plan).wish;
  const photograph = canvasView(wish);
  const plan = canvasView(wish);
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Strokes painted" });
  const said = h("p", { class: "status", role: "status" });
  const left = h("p", { class: "label" });
  const looks = h("ol", { class: "looks" });
  const easel = h("div", { class: "easel pair-of-canvases" },
    h("figure", {}, photograph.element, h("figcaption", {}, "The canvas, photographed")),
    h("figure", {}, plan.element, h("figcaption", {}, "The plan and the next stroke")));
  const padPlace = h("div", { class: "easel", hidden: true });
  const tools = togetherTools(house, here, wish, (drawing) => {
    show(padPlace, drawing);
    padPlace.hidden = !drawing;
    easel.hidden = Boolean(drawing);
  });
  const panel = h("aside", { class: "panel" }, h("h1", {}, "Paint together"), bar, said, left, tools.element, h("h2", {}, "Camera views"), looks);
  let strokes = { key: "", paths: null, palette: [], from: 0, place: "", prefix: "" };
  let shownLooks = "";

  /** The strokes that are being painted: of the first plan, or of the one made at the last look. */
  async function followPlan(state) {
    const { painting } = state;
    const made = painting.replanned;
    const source = made
      ? { key: made.prefix, place: "live", prefix: made.prefix, palette: made.palette, from: made.done, frames: made.frames }
      : ((base) => ({ key: "first", place: base.number, prefix: base.made.prefix, palette: base.made.palette, from: 0, frames: base.made.frames }))(state.plans.find((each) => each.number === painting.plan));
    if (source.key === strokes.key) return;
    strokes = { ...source, paths: null };
    strokes.paths = await api.get(api.file(here.id, source.place, `${source.prefix}strokes.json`)).catch(() => null);
  }

  function lookCard(look) {
    const picture = (name, caption) => h("figure", {}, h("img", { src: api.file(here.id, "live", look[name]), alt: `${caption}, after ${look.done} strokes`, loading: "lazy" }), h("figcaption", {}, caption));
    const gain = look.gain === undefined ? "" : look.gain > 0.005
      ? `It replanned the rest. It expects to come ${Math.round(100 * look.gain)} % closer to the goal than without replanning.`
      : "The canvas is as expected. The plan stays the same.";
    return h("li", {}, h("h3", {}, `After ${count(look.done, "stroke", "strokes")}`), gain ? h("p", {}, gain) : null,
      h("div", { class: "trio" }, picture("expected", "Expected"), picture("seen", "Seen"), picture("difference", "Difference")));
  }

  function update(state) {
    const { painting } = state;
    bar.value = painting.of ? painting.done / painting.of : 0;
    said.textContent = painting.status === "painting" ? `Stroke ${painting.done} of ${painting.of}` : `${painting.done ? `Stroke ${painting.done} of ${painting.of}: ` : ""}${WORDS[painting.status] ?? ""}`;
    left.textContent = painting.left && !["finishing", "paused"].includes(painting.status) ? `about ${duration(painting.left)} left` : "";
    if (painting.photograph) photograph.picture(api.file(here.id, "live", painting.photograph), `The canvas after ${painting.done} strokes`);
    const region = painting.region ? api.file(here.id, "live", painting.region.picture) : "";
    for (const canvas of [photograph, plan]) canvas.region(region, painting.region?.only);
    followPlan(state).then(() => {
      const growing = painting.status === "planning" && painting.growing;
      plan.picture(growing ? api.file(here.id, "live", painting.growing) : api.file(here.id, strokes.place, `${strokes.prefix}plan.jpg`), "The plan");
      const index = painting.done - strokes.from;
      const paint = strokes.paths && strokes.palette[strokes.paths.paint[index]];
      plan.highlight(strokes.paths, painting.status === "painting" ? index : null, paint?.hex);
    });
    tools.update(state);
    const key = JSON.stringify(painting.looks);
    if (key !== shownLooks) {
      shownLooks = key;
      show(looks, painting.looks.length ? [...painting.looks].reverse().map(lookCard) : h("li", { class: "label" }, "No photograph yet."));
    }
  }

  return { elements: [easel, padPlace, panel], update };
}
