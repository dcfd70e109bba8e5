// "Calibrate": the five procedures by which an easel is got to know, step by step.

import * as api from "./api.js";
import { choices, h, show, slider, svg } from "./dom.js";
import { questionCard } from "./question.js";
import { oneBrush } from "./settings.js";

const PROCEDURES = {
  canvas: { title: "Canvas position", tells: "The camera takes a photograph and the program finds the corners of the canvas. You confirm them.",
    drawing: "M8 10 40 6 42 34 6 36ZM8 7v6M5 10h6M40 3v6M37 6h6M42 31v6M39 34h6M6 33v6M3 36h6" },
  robot: { title: "Robot position", tells: "The robot paints sixteen small dots. The program measures where they are and corrects the offset.",
    drawing: "M6 6H42V36H6ZM14 14h.1M24 14h.1M34 14h.1M14 21h.1M24 21h.1M34 21h.1M14 28h.1M24 28h.1M34 28h.1" },
  color: { title: "Camera colours", tells: "The camera photographs a colour checker of 24 known colours. The program corrects the camera's colours.",
    drawing: "M6 8H42V34H6ZM6 17H42M6 25H42M15 8V34M24 8V34M33 8V34" },
  brush: { title: "Brush height", tells: "The program finds the heights of the lightest touch and the hardest press, or you set them with jog keys.",
    drawing: "M24 3V20M19 20H29L27 32 24 38 21 32ZM8 38H40" },
  strokes: { title: "Brush strokes", tells: "The robot paints strokes of all shapes on paper, photographs each, and trains the stroke model on them.",
    drawing: "M6 12C16 4 22 20 32 10M10 24C20 16 30 30 42 22M6 36C18 28 24 40 38 32" },
};
const STATUS = { waiting: "waiting", busy: "running", failed: "failed", stopped: "stopped" };

export function calibration(house) {
  const questions = questionCard(house, "/api/calibration", picture);
  const found = h("div", { class: "easel found" });
  const said = h("p", { class: "status", role: "status" });
  const trouble = h("div", { class: "trouble", role: "alert" });
  const list = h("ol", { class: "procedures" });
  const asked = { brush: "broad", count: 60 };
  const all = h("button", { type: "button", class: "button wide", "data-for": "operate", onclick: () => begin(Object.keys(PROCEDURES)) }, "Run all five procedures");
  const brush = choices({ legend: house.simulated ? "Brush" : "Brush in the holder", name: "calibrated-brush", value: asked.brush, options: oneBrush(house), onchange: (name) => { asked.brush = name; } });
  const how = house.simulated ? h("details", {}, h("summary", {}, "More settings"), brush, countSlider()) : h("div", {}, brush, countSlider());
  const panel = h("div", { class: "panel" }, h("h1", {}, "Calibrate the easel"),
    h("p", {}, house.simulated
      ? "The virtual studio needs no calibration. Here you can try the calibration of a real easel. The virtual studio provides paper, paint and colour checker by itself."
      : "Calibrate before the first painting on this easel, and whenever the camera, the canvas or the brush was moved."),
    said, all, list, how);
  let shown = "";

  function picture(name) { return `/api/calibration/files/${name}`; }

  function countSlider() {
    return slider({ label: "Strokes to train on", min: 20, max: 400, step: 20, value: asked.count, oninput: (value) => { asked.count = value; } });
  }

  async function begin(what) {
    const begun = await house.attempt(() => api.post("/api/calibration/start", { what, ...asked }));
    if (begun) window.scrollTo(0, 0);
  }

  function procedure(each, working) {
    const { title, tells, drawing } = PROCEDURES[each.name];
    const when = each.dated ? `last run on ${new Date(each.dated).toLocaleDateString(undefined, { day: "numeric", month: "long", year: "numeric" })}` : "never run";
    const state = each.status === "done" ? when : STATUS[each.status] ?? when;
    return h("li", { class: each.status },
      svg("svg", { viewBox: "0 0 48 44", class: "drawing", "aria-hidden": "true" }, svg("path", { d: drawing })),
      h("div", {}, h("h2", {}, title), h("p", {}, each.status === "done" && each.sentence ? each.sentence : tells),
        h("p", { class: "label" }, each.fault ? `${each.fault}.` : each.old ? `${state}; consider repeating it` : state)),
      h("button", { type: "button", class: "quiet", "data-for": "operate", disabled: working, "aria-label": `Run: ${title}`, onclick: () => begin([each.name]) }, each.dated ? "Run again" : "Run"));
  }

  function hear(state) {
    house.active(state.working);
    questions.update(state.question);
    const busy = state.procedures.find((each) => each.status === "busy");
    said.textContent = !state.working ? "" : state.question ? "It waits for your answer." : state.progress || (busy ? `${PROCEDURES[busy.name].title}: running` : "getting ready");
    const key = JSON.stringify([state.procedures, state.working, state.trouble]);
    if (key === shown) return;
    shown = key;
    all.disabled = state.working;
    how.hidden = state.working;
    show(trouble, state.trouble ? h("p", {}, state.trouble) : null);
    show(list, state.procedures.map((each) => procedure(each, state.working)));
    const pictures = state.procedures.filter((each) => each.picture).reverse();
    show(found, pictures.length ? pictures.map((each) => h("figure", {}, h("img", { src: `${picture(each.picture)}?${each.dated}-${state.version}`, alt: PROCEDURES[each.name].title }), h("figcaption", {}, `${PROCEDURES[each.name].title}. ${each.sentence}`)))
      : h("div", { class: "mount empty" }, h("p", {}, "The results will be shown here.")));
  }

  const stopFollowing = api.follow(house, "/api/calibration", hear);
  return { element: h("section", { class: "workbench calibration" }, trouble, questions.element, found, panel), close() { questions.close(); stopFollowing(); } };
}
