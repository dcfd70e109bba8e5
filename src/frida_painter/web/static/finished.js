// "Finished": the painting, its film, what it was meant to be, and what to take along.

import * as api from "./api.js";
import { canvasView } from "./canvasview.js";
import { summary } from "./composer.js";
import { count, h } from "./dom.js";
import { goalList } from "./goal.js";

const FILES = [
  ["painting.png", "The painting, photographed"], ["film.mp4", "The timelapse film"], ["palette.png", "The palette, to print"],
  ["strokes.svg", "The strokes, for plotters and Inkscape (SVG)"], ["strokes.gcode", "The strokes for GRBL machines (G-code, waits at every dip)"],
  ["strokes.csv", "The strokes as a table (CSV)"], ["plan.json", "The plan"],
];

/** @param {House} house @param {Here} here @param {State & { painting: PaintState }} first */
export function finishedStage(house, here, first) {
  const { painting } = first;
  const plan = /** @type {PlanState} */ (first.plans.find((each) => each.number === painting.plan));
  const { wish } = plan;
  const terms = (painting.wish ?? wish).terms; // as they were changed while it was painted
  const whole = painting.kept;
  const place = (name) => api.file(here.id, "painting", name);
  const best = whole ? place("painting.png") : painting.photograph && api.file(here.id, "live", painting.photograph);
  const canvas = canvasView(wish, ["goal", "plan", "painting"]);
  canvas.goal(terms);
  canvas.picture("plan", painting.replanned ? api.file(here.id, "live", `${painting.replanned.prefix}plan.jpg`) : api.file(here.id, plan.number, "plan.jpg"), "The plan");
  if (best) canvas.picture("painting", best, `The painting: ${here.title}`);
  const caption = h("p", { class: "caption" }, best ? "The painting, photographed" : "There is no photograph. This is the plan.");

  const verdict = {
    finished: `${count(painting.done, "stroke", "strokes")} are on the canvas.`,
    stopped: `You stopped after ${count(painting.done, "stroke", "strokes")} of ${painting.of}.${house.simulated ? "" : " Look at the robot before anything else."}`,
    failed: `It failed after ${count(painting.done, "stroke", "strokes")} of ${painting.of}.`,
  }[painting.status];

  async function again() {
    const begun = await house.attempt(() => api.post("/api/paintings", { ...wish, title: here.title === "Untitled" ? "" : here.title }));
    if (begun) location.hash = `#/p/${begun.id}`;
  }

  const goOn = h("button", { type: "button", class: "button wide", disabled: house.role !== "operate", onclick: async () => {
    goOn.disabled = true;
    const begun = await house.attempt(() => api.post(`/api/paintings/${here.id}/resume`));
    if (!begun) goOn.disabled = false;
  } }, "Continue this painting");
  const rest = painting.status === "finished" ? null : [goOn, h("p", { class: "label beneath" }, painting.status === "stopped" && !house.simulated
    ? "Look at the robot first. Press Enter in the studio's terminal beside it, then continue here within a minute. The robot photographs the canvas before it paints."
    : "The robot photographs the canvas before it paints. It asks you if it is not sure whether a stroke was painted.")];

  async function remove() {
    if (!window.confirm(`Delete "${here.title}" and all its pictures? This cannot be undone.`)) return;
    const gone = await house.attempt(() => api.post(`/api/paintings/${here.id}/delete`));
    if (gone) location.hash = "#/";
  }

  const easel = h("div", { class: "easel" }, canvas.element, canvas.slider, caption,
    painting.film ? h("video", { controls: true, playsInline: true, preload: "metadata", poster: best, src: place("film.mp4"), "aria-label": "Timelapse film of the painting, without sound" })
      : whole && painting.done ? h("p", { class: "label beneath" }, "There is no timelapse film. It could not be written; the disk may be full.") : null,
    painting.arm ? h("video", { controls: true, playsInline: true, preload: "metadata", src: place("arm.mp4"), "aria-label": "Film of the simulated arm at work, without sound" }) : null);
  const panel = h("aside", { class: "panel" }, h("h1", {}, here.title || "Finished"), h("p", {}, verdict), h("p", { class: "label" }, summary(wish), `, seed ${wish.seed}`), rest, h("h2", {}, "The goal"), goalList(terms),
    whole ? [h("h2", {}, "Downloads"), h("ul", { class: "files" }, FILES.filter(([name]) => name !== "film.mp4" || painting.film).map(([name, label]) => h("li", {}, h("a", { href: place(name), download: name }, label))),
      h("li", {}, h("a", { href: `/api/paintings/${here.id}/everything.zip`, download: "painting.zip" }, "Everything, with a page about the painting (ZIP)")))] : null,
    h("p", { class: "actions" },
      h("button", { type: "button", class: "button second", disabled: house.role === "watch", onclick: again }, "Paint again"),
      h("button", { type: "button", class: "quiet danger", disabled: house.role !== "operate", onclick: remove }, "Delete")));
  return { elements: [easel, panel], update() {} };
}
