// "Teach a stroke": a person draws ten or more marks of one kind, and the planner can paint with strokes of that kind.

import * as api from "./api.js";
import { choices, count, h, mainAction, show, slider } from "./dom.js";
import { strokePad, thin } from "./strokepad.js";

const FEWEST = 10;
const SHEET = 120; // mm from the left to the right of the pad
const SHAPE = 4 / 3;
const WIDTHS = { fine: [0.008, 0.03], medium: [0.012, 0.05], broad: [0.02, 0.08] }; // of a mark on the pad
const EXACT = [0.0008, 0.0008 * SHAPE, 0.01]; // shares of the pad's sides, and of the press
const NAME = /^[a-z][a-z0-9-]{0,29}$/;

/** The points of a mark in millimetres, y up, as the studio takes them. @param {import("./strokepad.js").PenPoint[]} points */
export const inMillimetres = (points) => {
  const round = (/** @type {number} */ value, /** @type {number} */ digits) => Number(value.toFixed(digits));
  return points.map(([x, y, press, , , seconds]) => [round(SHEET * x, 2), round((SHEET / SHAPE) * (1 - y), 2), round(press, 3), round(seconds, 3)]);
};

/** @param {House} house */
export function teaching(house) {
  if (house.role !== "operate") return { element: h("section", { class: "workbench lost" }, h("h1", {}, "Teach a stroke"), h("p", {}, "To teach, ask whoever opened the studio for another link."), h("p", {}, h("a", { href: "#/" }, "To the gallery"))) };
  /** @type {{ points: import("./strokepad.js").PenPoint[], forget: () => void }[]} */
  const marks = [];
  const asked = { name: "", brush: "fine", press: 0.6, count: 40 };
  let working = false;

  const pad = strokePad({
    label: "Draw a mark", shape: SHAPE, press: () => asked.press,
    begin: () => (working ? null : { color: "#26262b", light: WIDTHS[asked.brush][0], hard: WIDTHS[asked.brush][1] }),
    done(points, forget) {
      const kept = thin(points, EXACT);
      if (kept.length < 2) { forget(); house.notice("A mark is a way, and not a dot: draw it in one go."); return; }
      marks.push({ points: filled(kept), forget });
      tell();
    },
  });

  const said = h("p", { class: "status", role: "status" });
  const trouble = h("div", { class: "trouble", role: "alert" });
  const missing = h("p", { class: "label beneath", role: "status" });
  const back = h("button", { type: "button", class: "quiet", onclick: () => { marks.pop()?.forget(); tell(); } }, "Remove the last mark");
  const all = h("button", { type: "button", class: "quiet", onclick: () => { for (const mark of marks.splice(0)) mark.forget(); tell(); } }, "Start over");
  const name = h("input", { type: "text", maxLength: 30, placeholder: "hook", "aria-label": "Name of the stroke", oninput: () => { asked.name = name.value.trim().toLowerCase(); tell(); } });
  const go = h("button", { type: "button", class: "button wide", onclick: begin }, "Teach this stroke");
  const known = h("div", { class: "taught" });
  const panel = h("div", { class: "panel" }, h("h1", {}, "Teach a stroke"),
    h("p", {}, `Draw ${FEWEST} or more marks of one kind, each in one go and in the same direction, over each other or beside each other. Their press and speed count. The virtual studio then paints the stroke, and learns how it looks.`),
    said, h("label", { class: "field" }, h("span", {}, "Name"), name),
    choices({ legend: "Brush", name: "taught-brush", value: asked.brush, options: Object.keys(WIDTHS).map((brush) => ({ value: brush, label: brush })), onchange: (value) => { asked.brush = value; } }),
    slider({ label: "Press", min: 5, max: 100, value: 60, words: (value) => `${value} % (a pen's own pressure counts as well)`, oninput: (value) => { asked.press = value / 100; } }),
    slider({ label: "Strokes to learn from", min: 0, max: 100, step: 10, value: asked.count, words: (value) => (value ? `${value} strokes of the virtual studio` : "none: a plain ribbon is expected"), oninput: (value) => { asked.count = value; } }),
    mainAction(missing, go), h("h2", {}, "Taught here"), known);
  const easel = h("div", { class: "easel" }, pad.element, h("p", { class: "label pad-help" }, pad.help), h("p", { class: "actions-row" }, back, all));

  /** The same way with points in between where two lie far apart: a straight mark needs more than its two ends. @param {import("./strokepad.js").PenPoint[]} points */
  function filled(points) {
    if (points.length >= 8) return points;
    const way = [];
    points.forEach((point, index) => {
      if (index) for (const share of [0.25, 0.5, 0.75]) way.push(point.map((value, axis) => points[index - 1][axis] + share * (value - points[index - 1][axis])));
      way.push(point);
    });
    return /** @type {import("./strokepad.js").PenPoint[]} */ (way);
  }

  function tell() {
    const few = FEWEST - marks.length;
    missing.textContent = working ? "" : few > 0 ? `${count(marks.length, "mark", "marks")} drawn, ${few} more to go.` : NAME.test(asked.name) ? `${marks.length} marks drawn.` : "Give it a name of small letters, digits and hyphens.";
    go.disabled = working || few > 0 || !NAME.test(asked.name);
    back.disabled = all.disabled = working || !marks.length;
    pad.element.classList.toggle("waits", working);
  }

  async function begin() {
    go.disabled = true;
    const wish = { name: asked.name, brush: asked.brush, count: asked.count, marks: marks.map((mark) => inMillimetres(mark.points)) };
    const begun = await house.attempt(() => api.post("/api/teaching/start", wish));
    if (begun) all.click();
    tell();
  }

  function hear(state) {
    house.active(state.working);
    working = state.working;
    said.textContent = working ? state.progress || "getting ready" : state.stopped ? `You stopped; ${state.name} was not learned.` : "";
    show(trouble, state.trouble ? h("p", {}, state.trouble) : null);
    const families = Object.entries(state.taught);
    show(known, families.length ? families.map(([family, { brush, sentence, picture }]) => h("figure", {}, h("img", { src: `/api/teaching/files/${picture}`, alt: `The marks of ${family}`, loading: "lazy" }),
      h("figcaption", {}, h("strong", {}, family), `, ${brush} brush. ${sentence} Choose it under "Shape of the marks" when you set a goal.`))) : h("p", { class: "label" }, "Nothing yet. The program brings a comma, a zigzag and a flourish along."));
    tell();
  }

  tell();
  const stopFollowing = api.follow(house, "/api/teaching", hear);
  return { element: h("section", { class: "workbench teaching" }, trouble, easel, panel), close() { stopFollowing(); } };
}
