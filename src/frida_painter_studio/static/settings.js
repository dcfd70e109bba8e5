// Controls of the form: each asks for a setting, as the studio describes it, with a small picture for each choice.

import { choices, h, slider } from "./dom.js";

/** @type {[string, number, number][]} */
export const SIZES = [["14 × 11 in", 355.6, 279.4], ["A4", 297, 210], ["A3", 420, 297], ["30 × 30 cm", 300, 300], ["20 × 20 cm", 200, 200]];

const [BROAD, MEDIUM, FINE] = [7, 4, 1.6]; // widths of marks
const wave = (y) => `M5 ${y + 1}c8 -5 16 5 26 -1`;
const SHEET = "M6 3h24v18h-24z";

/** Pictures of choices, by the names that the studio tells. @type {Record<string, import("./dom.js").Lines>} */
const PICTURES = {
  "Quick study": [[BROAD, "M7 8c6-3 12 2 20-1"], [BROAD, "M10 18c6-3 10 1 18-1"]],
  Normal: [[MEDIUM, "M6 5c4-2 7 1 11-.5M20 5c3-1 6 1 10 0M8 12c5-2 8 1 12-.5M24 12c2-.5 3 .5 6 0M6 19c4-2 7 1 10-.5M20 19c4-1 6 1 9 0"]],
  Detailed: [[2, "M5 4c3-1 4 1 7 0M15 4c2-1 4 1 6 0M24 4c2-1 4 1 7 0M7 9c2-1 4 1 6 0M16 9c3-1 4 1 7 0M26 9c1-.5 3 .5 5 0M5 14c3-1 4 1 7 0M15 14c2-1 4 1 6 0M24 14c2-1 4 1 7 0M7 19c2-1 4 1 6 0M16 19c3-1 4 1 7 0M26 19c1-.5 3 .5 5 0"]],
  "usual brushes": [[1.2, "M6 4h24v16h-24z"], [3, "M11 12h14"]],
  broad: [[BROAD, wave(12)]],
  medium: [[MEDIUM, wave(12)]],
  fine: [[FINE, wave(12)]],
  "broad,medium": [[BROAD, wave(8)], [MEDIUM, wave(18)]],
  "broad,medium,fine": [[BROAD, wave(6)], [MEDIUM, wave(14)], [FINE, wave(20)]],
  "usual ground": [[1.2, SHEET], [1.2, "M30 3l-24 18M24 3l-18 13M30 8l-17 13"]],
  white: [[1.2, SHEET]],
  toned: [[1.2, SHEET], [11, "M12 12h12"]],
  "as it is": [[1.2, SHEET], [2.5, "M10 15c3-8 6 4 9-3s5-2 7 0"]],
};
/** One brush each, of those that the easel may hold. @param {House} house */
export const oneBrush = (house) => (house.form.controls.find(({ kind }) => kind === "brushes")?.options ?? []).filter(({ label, sets }) => Object.values(sets).every(Boolean) && !label.includes(",")).map(({ label }) => ({ value: label, label }));

/** "fine brush", "broad, medium brushes", "usual brushes". @param {string | null} names */
export const brushesInWords = (names) => `${names?.replaceAll(",", ", ") || "usual"} ${names && !names.includes(",") ? "brush" : "brushes"}`;

/** Settings that belong together. @param {string} legend @param {(Node | null)[]} settings */
export const group = (legend, settings) => h("fieldset", { class: "group" }, h("legend", {}, legend), settings);

/** Whether a wish has what a choice sets. @param {Wish} wish @param {Record<string, any>} sets */
export const holds = (wish, sets) => Object.entries(sets).every(([name, value]) => (wish[name] || null) === (value || null));

/** The index of the step that is nearest to a value; of the first one for no value. @param {[number | null, string][]} steps @param {number | null} value */
export function nearestStep(steps, value) {
  const away = (/** @type {[number | null, string]} */ [step]) => (step === null || value === null ? Number.POSITIVE_INFINITY : Math.abs(step - value));
  return steps.reduce((best, step, index) => (away(step) < away(steps[best]) ? index : best), 0);
}

/**
 * The control of a setting; `changed` is called after it has changed the wish.
 * @param {Control} control @param {Wish} wish @param {() => void} changed
 */
export function settingControl({ name, label, kind, help, range, steps, options }, wish, changed) {
  const take = (sets) => { Object.assign(wish, sets); changed(); };
  if (kind === "slider") return slider({ label, min: 0, max: steps.length - 1, value: nearestStep(steps, wish[name]), words: (index) => steps[index][1], oninput: (index) => take({ [name]: steps[index][0] }) });
  if (kind === "number") {
    const within = (text) => Math.max(range.ge, Math.min(range.le, Math.trunc(Number(text)) || 0));
    return h("label", { class: "field" }, h("span", {}, label), h("span", { class: "pair" },
      h("input", { type: "number", min: range.ge, max: range.le, step: 1, value: wish[name], onchange: (event) => { event.target.value = within(event.target.value); take({ [name]: within(event.target.value) }); } }), h("small", {}, help)));
  }
  if (kind === "words") return h("label", { class: "field" }, h("span", {}, label), h("span", { class: "pair" }, h("input", { type: "text", value: wish[name], onchange: (event) => take({ [name]: event.target.value.trim() || null }) }), h("small", {}, help)));
  const value = options.findIndex(({ sets }) => holds(wish, sets));
  if (kind === "families") {
    return h("label", { class: "field" }, h("span", {}, label), h("span", { class: "pair" },
      h("select", { onchange: (event) => take(options[event.target.selectedIndex].sets) }, options.map((option, index) => h("option", { selected: index === value }, option.label))),
      h("a", { href: "#/teach", "data-for": "operate" }, "Teach a stroke")));
  }
  return choices({ legend: label, name, value, options: options.map(({ label, title, picture }, index) => ({ value: index, label, title, picture: PICTURES[picture ?? ""] })),
    onchange: (index) => take(options[index].sets) });
}
