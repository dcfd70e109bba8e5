// "Set up a machine": a person guides its tip to canvas, wells and lightest touch; outlines and three strokes test it.

import * as api from "./api.js";
import { choices, h, show, svg } from "./dom.js";
import { questionCard } from "./question.js";
import { oneBrush } from "./settings.js";

const PATH = "/api/setup";
const TITLES = { canvas: "Canvas", touch: "Touch and press", surface: "Surface", paint: "Wells, water, rag", trace: "Outlines in the air", strokes: "Three strokes" };
const MOVING = 800; // ms for which a question stays while the machine moves to the next one

const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);

export function setup(house) {
  const questions = questionCard(house, PATH, (name) => `${PATH}/files/${name}`);
  const said = h("p", { class: "status", role: "status" });
  const trouble = h("div", { class: "trouble", role: "alert" });
  const picture = h("div", { class: "easel" });
  const work = h("div", {});
  const panel = h("aside", { class: "panel" }, h("h1", {}, "Set up a machine"), said, work);
  const asked = { brush: /** @type {string | null} */ (null), width: "", height: "", anew: false };
  let hiding = 0;
  let shown = "";

  const button = (label, act, kind = "") => h("button", { type: "button", class: `button ${kind}`, "data-for": "operate", onclick: act }, label);

  function begin(wish) { return house.attempt(() => api.post(`${PATH}/start`, wish)); }

  function beginNew() {
    const [width, height] = [asked.width, asked.height].map((side) => (side ? Number(side) : null));
    return begin({ width, height, brush: asked.brush, anew: asked.anew });
  }

  const side = (name, label) => h("input", { type: "number", min: 50, max: 2000, step: "any", value: asked[name], placeholder: label, "aria-label": `${capital(label)} of the canvas, mm`, oninput: (event) => { asked[name] = event.target.value; } });

  function intro(label) {
    return [button(label, beginNew, "wide"), h("details", {}, h("summary", {}, "More settings"),
      h("div", { class: "field" }, h("span", {}, "Size of the canvas in mm, if you know it. Two corners are then marked, not three."),
        h("span", { class: "pair" }, side("width", "width"), side("height", "height"))),
      choices({ legend: "Brush in the holder", name: "setup-brush", value: asked.brush ?? "fine", options: oneBrush(house), onchange: (brush) => { asked.brush = brush; } }),
      h("label", { class: "check" }, h("input", { type: "checkbox", checked: asked.anew, onchange: (event) => { asked.anew = event.target.checked; } }), h("span", {}, "Begin from the start, even if a setup of this machine was left")))];
  }

  const welcome = () => [
    h("p", {}, "For your own plotter, router, printer or arm. You choose a preset, guide the tip to the canvas and the wells, and find the lightest touch. Then the machine traces the outlines in the air and paints three strokes."),
    h("p", {}, "It takes about a quarter of an hour, and you can leave at any step. Stand beside the machine: it starts only after Enter was pressed in the studio's terminal there."),
    ...intro("Choose a machine")];

  function step(each, state) {
    const current = state.step === each.name;
    const status = current ? "now" : each.done ? "done" : "";
    const again = !state.working && each.done ? h("button", { type: "button", class: "quiet", "data-for": "operate", "aria-label": `Repeat: ${TITLES[each.name]}`, onclick: () => begin({ easel: state.stands.easel, step: each.name }) }, "Repeat") : null;
    return h("li", { class: status, "aria-current": current ? "step" : undefined },
      h("span", { class: "tick", "aria-hidden": "true" }, each.done ? "✓" : ""),
      h("div", {}, h("h2", {}, TITLES[each.name]), h("p", {}, capital(each.text))), again);
  }

  function facts(told) {
    if (!told.length) return null;
    const warnings = told.filter((fact) => fact.weight !== "fact");
    return h("details", { open: warnings.length > 0 }, h("summary", {}, warnings.length ? "What the machine told: please read" : "What the machine told"),
      h("ul", { class: "facts" }, told.map((fact) => h("li", { class: fact.weight }, fact.text))));
  }

  function finished(written) {
    return [h("p", { class: "status" }, "Your machine is set up."), written.commands.map((each) =>
      h("div", { class: "advice command" }, h("span", { class: "label" }, each.about), h("code", {}, each.command)))];
  }

  function panelOf(state) {
    const { stands, working, written } = state;
    if (!stands && !working) return welcome();
    const steps = stands ? h("ol", { class: "setup-steps" }, stands.steps.map((each) => step(each, state))) : null;
    const head = stands ? h("p", {}, h("strong", {}, stands.title), h("br"), h("span", { class: "label" }, stands.robot)) : null;
    const ways = working
      ? button("Leave, and continue later", () => { const { id } = now.question ?? {}; if (id) house.attempt(() => api.post(`${PATH}/answer`, { question: id, leave: true })); else house.notice("It moves. Leave when it asks the next question; Stop works at every moment."); }, "second")
      : h("div", { class: "stack" }, written || !stands ? null : button("Continue", () => begin({ easel: stands.easel }), "wide"),
        h("details", {}, h("summary", {}, "Another machine"), intro("Choose a machine")));
    return [head, written && !working ? finished(written) : null, steps, facts(state.facts), ways];
  }

  /** @type {any} */
  let now = {};

  function hear(state) {
    now = state;
    house.active(state.working);
    clearTimeout(hiding);
    if (state.question || !state.working) questions.update(state.question);
    else hiding = setTimeout(() => questions.update(null), MOVING);
    said.textContent = !state.working ? (state.left || (state.stopped ? "It was stopped." : "")) : state.question ? "" : state.remarks.at(-1) ?? "The machine is at work.";
    const tip = state.question?.kind === "guide" ? state.question.position : null;
    drawPicture(state, tip);
    const key = JSON.stringify([state.stands, state.step, state.working, state.trouble, state.facts, state.written, state.remarks]);
    if (key === shown) return;
    shown = key;
    const remarks = state.working && state.question ? state.remarks : [];
    show(trouble, [state.trouble, ...remarks].filter(Boolean).map((text) => h("p", {}, text)));
    show(work, ...panelOf(state).flat(2));
  }

  function drawPicture(state, tip) {
    const sheet = state.written && !state.working ? `${PATH}/files/${state.written.sheet}` : "";
    if (sheet) {
      if (!picture.querySelector(`img[src="${sheet}"]`)) show(picture, h("img", { class: "sheet", src: sheet, alt: "The workspace from above" }));
    } else if (state.stands) show(picture, table(state.stands.table, tip));
    else show(picture, h("div", { class: "mount empty" }, h("p", {}, "The machine's table will be shown here.")));
  }

  const stopFollowing = api.follow(house, PATH, hear);
  return { element: h("section", { class: "workbench calibration setup" }, trouble, questions.element, picture, panel), close() { clearTimeout(hiding); questions.close(); stopFollowing(); } };
}

/**
 * The machine's table from above: what the tip reaches, canvas, wells, water and rag, and the tip.
 * @param {{ lower: number[], upper: number[], canvas: number[][], wells: number[][], water: number[], rag: number[] }} told in mm
 * @param {number[] | null} tip in metres
 */
export function table(told, tip) {
  const [left, bottom] = told.lower;
  const [right, top] = told.upper;
  const [width, height] = [right - left, top - bottom];
  const margin = 0.03 * Math.max(width, height);
  const [u, v] = [(x) => x - left, (y) => top - y]; // y goes up on the table
  const unit = Math.max(width, height) / 60;
  const spot = (/** @type {string} */ kind, /** @type {number[]} */ [x, y], /** @type {string} */ label) =>
    svg("g", { class: kind }, svg("circle", { cx: u(x), cy: v(y), r: unit }), svg("text", { x: u(x), y: v(y), "font-size": unit * 1.2 }, label));
  const [first, second] = told.canvas;
  const middle = [0, 1].map((axis) => told.canvas.reduce((sum, corner) => sum + corner[axis], 0) / told.canvas.length);
  const long = (one, other) => Math.hypot(other[0] - one[0], other[1] - one[1]);
  const size = `${long(first, second).toFixed(0)} × ${long(second, told.canvas[2]).toFixed(0)} mm`;
  const parts = [
    svg("rect", { class: "reach", x: 0, y: 0, width, height }),
    svg("polygon", { class: "sheet-of-canvas", points: told.canvas.map(([x, y]) => `${u(x)},${v(y)}`).join(" ") }),
    svg("text", { class: "size", x: u(middle[0]), y: v(middle[1]), "font-size": unit * 2 }, size),
    ...told.wells.map((well, index) => spot("well", well, String(index + 1))),
    spot("water", told.water, "w"), spot("rag", told.rag, "r"),
  ];
  if (tip) {
    const [x, y] = [u(1000 * tip[0]), v(1000 * tip[1])];
    parts.push(svg("path", { class: "tip", d: `M${x - 2 * unit} ${y}h${4 * unit}M${x} ${y - 2 * unit}v${4 * unit}` }), svg("circle", { class: "tip", cx: x, cy: y, r: unit * 0.8 }));
  }
  const words = `The machine's table from above: a canvas of ${size}, ${told.wells.length} wells, water and rag${tip ? `; the tip at x ${(1000 * tip[0]).toFixed(1)}, y ${(1000 * tip[1]).toFixed(1)} mm` : ""}`;
  return svg("svg", { class: "table-above", viewBox: `${-margin} ${-margin} ${width + 2 * margin} ${height + 2 * margin}`, role: "img", "aria-label": words }, ...parts);
}
