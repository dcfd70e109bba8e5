// "Finished": the painting, its film, what it was meant to be, and what to take along.

import * as api from "./api.js";
import { canvasView } from "./canvasview.js";
import { summary } from "./composer.js";
import { count, h, mainAction, show } from "./dom.js";
import { goalList, mainTerm } from "./goal.js";
import { beforeAfter, cardFacts, paintingCard } from "./keepsake.js";
import { whoPainted } from "./painters.js";

const FILES = [
  ["painting.png", "The painting, to print"], ["card.jpg", "A card to show"], ["film.mp4", "The timelapse film"], ["palette.png", "The palette, to print"],
  ["strokes.svg", "The strokes, for plotters and Inkscape (SVG)"], ["strokes.gcode", "The strokes for GRBL machines (G-code, waits at every dip)"],
  ["strokes.csv", "The strokes as a table (CSV)"], ["plan.json", "The plan"],
];
const OF_PAINTERS = [["painters.png", "Who painted what (PNG)"], ["painters.csv", "Every stroke and its painter (CSV)"], ["painters.json", "Every pixel and its stroke (JSON)"]];

/** @param {House} house @param {Here} here @param {State & { painting: PaintState }} first */
export function finishedStage(house, here, first) {
  const { painting } = first;
  const { progress } = painting;
  const replanned = painting.planning.replanned?.shown;
  const plan = /** @type {PlanState} */ (first.plans.find((each) => each.number === painting.plan));
  const { wish } = plan;
  const terms = painting.wishes.goals.at(-1)?.wish.terms ?? wish.terms; // as they were changed while it was painted
  const results = painting.end.results ?? [];
  const whole = painting.end.results !== null;
  const place = (name) => api.file(here.id, "painting", name);
  const best = whole ? place(results.includes("canvas") ? "canvas.png" : "painting.png") : painting.pictures.photograph && api.shown(here.id, painting.pictures.photograph);
  const canvas = canvasView(wish, ["goal", "plan", "painting"]);
  canvas.goal(terms);
  canvas.picture("plan", replanned ? api.file(here.id, "live", `${replanned.prefix}plan.jpg`) : api.file(here.id, plan.number, "plan.jpg"), "The plan");
  if (best) canvas.picture("painting", best, `The painting: ${here.title}`);
  canvas.captions({
    plan: best ? "The plan" : "There is no photograph. This is the plan.",
    painting: !house.watched ? "As it should look. There was no camera, and nobody looked." : whole ? "The painting, photographed" : "The canvas, as it was photographed last",
  });

  const verdict = {
    finished: `${count(progress.painted, "stroke", "strokes")} are on the canvas.`,
    stopped: `You stopped after ${count(progress.painted, "stroke", "strokes")} of ${progress.of || plan.made?.strokes}.${house.simulated ? "" : " Look at the robot before anything else."}`,
    failed: `It failed after ${count(progress.painted, "stroke", "strokes")} of ${progress.of || plan.made?.strokes}.`,
  }[painting.status];

  async function again() {
    const begun = await house.attempt(() => api.post("/api/paintings", { ...wish, title: here.title === "Untitled" ? "" : here.title }));
    if (begun) location.hash = `#/p/${begun.id}`;
  }

  const goOn = h("button", { type: "button", class: "button wide", onclick: async () => {
    goOn.disabled = true;
    const begun = await house.attempt(() => api.post(`/api/paintings/${here.id}/resume`));
    if (!begun) goOn.disabled = false;
  } }, "Continue this painting");
  const looksFirst = house.watched ? "The robot photographs the canvas before it paints." : "Put the canvas exactly where it was: nobody looks.";
  const rest = !first.resumable || house.role !== "operate" ? null : [mainAction(goOn), h("p", { class: "label beneath" }, painting.status === "stopped" && !house.simulated
    ? `Look at the robot first. Press Enter in the studio's terminal beside it, then continue here within a minute. ${looksFirst}`
    : `${looksFirst} It asks you if it is not sure whether a stroke was painted.`)];

  const term = mainTerm(terms);
  const palette = (replanned ?? plan.made)?.palette ?? [];
  const keepsakes = !best || !progress.painted ? null : h("div", { class: "keepsakes" },
    term?.picture ? beforeAfter({ before: api.picture(term.picture), crop: term.crop, after: best, shape: wish.width / wish.height }) : null,
    paintingCard({ title: here.title || "Untitled", picture: best, notice: house.notice, paints: palette.map((paint) => paint.hex),
      facts: cardFacts({ strokes: progress.painted, paints: palette.length, begun: here.begun }) }));
  const easel = h("div", { class: "easel" }, canvas.element, canvas.slider, canvas.caption,
    results.includes("film") ? h("video", { controls: true, playsInline: true, preload: "metadata", poster: best, src: place("film.mp4"), "aria-label": "Timelapse film of the painting, without sound" })
      : whole && progress.painted ? h("p", { class: "label beneath" }, "There is no timelapse film. It could not be written; the disk may be full.") : null,
    results.includes("painters") ? whoPainted(place, api.get) : null,
    results.includes("arm") ? h("video", { controls: true, playsInline: true, preload: "metadata", src: place("arm.mp4"), "aria-label": "Film of the simulated arm at work, without sound" }) : null);
  const panel = h("div", { class: "panel" }, h("h1", {}, here.title || "Finished"), h("p", {}, verdict), h("p", { class: "label" }, summary(wish, plan.made), `, seed ${wish.seed}`), rest, h("h2", {}, "The goal"), goalList(terms),
    whole ? [h("h2", {}, "Downloads"), h("ul", { class: "files" }, [...FILES, ...(results.includes("painters") ? OF_PAINTERS : [])].filter(([name]) => !["card.jpg", "film.mp4"].includes(name) || results.includes(name.split(".")[0])).map(([name, label]) => h("li", {}, h("a", { href: place(name), download: name }, label))),
      h("li", {}, h("a", { href: `/api/paintings/${here.id}/everything.zip`, download: "painting.zip" }, "Everything, with a page about the painting (ZIP)")))] : null,
    h("p", { class: "actions" },
      h("button", { type: "button", class: "button second", "data-for": "plan", onclick: again }, "Paint again"),
      deleteButton(house, here, "Delete")));
  return { elements: [easel, panel, ...(keepsakes ? [keepsakes] : [])], update() {} };
}

/** @param {House} house @param {Here} here @param {string} label */
function deleteButton(house, here, label) {
  return h("button", { type: "button", class: "quiet danger", "data-for": "operate", onclick: async () => {
    if (!window.confirm(`Delete "${here.title}" with everything in its folder? This cannot be undone.`)) return;
    if (await house.attempt(() => api.post(`/api/paintings/${here.id}/delete`))) location.hash = "#/";
  } }, label);
}

/** A painting whose files are gone. @param {House} house @param {Here} here */
export function lostStage(house, here) {
  const panel = h("div", { class: "panel" });
  let shown = "";

  /** @param {State} state */
  function update(state) {
    const key = `${state.stage} ${state.working}`;
    if (key === shown) return;
    shown = key;
    show(panel, h("h1", {}, here.title || "Untitled"),
      h("p", {}, state.working ? "The robot is still in the painter's hands. Nothing of what it does now is kept." : state.stage === "lost" ? "There is nothing left to show or to continue." : "It cannot be shown here."),
      h("p", { class: "actions" }, state.working ? null : deleteButton(house, here, "Remove it from the gallery")));
  }
  return { elements: [panel], update };
}
