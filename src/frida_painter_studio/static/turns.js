// "Take turns": when it is the person's turn, how the robot answers, and what becomes of the person's paint.

import { choices, h, slider } from "./dom.js";

/** Ways to answer, in words; one of another package goes by its name. @type {Record<string, string>} */
const WAYS = {
  alternate: "Go on with the goal", continue: "Continue what I began, in its spirit", fill: "Fill in what I closed", side: "Answer on the other side",
};
const OWN_KEEP = ["fill", "side"]; // they say themselves which part of the canvas is painted

/** What is agreed on, in a sentence. @param {{ strokes: number, minutes: number }} turns */
export function agreed({ strokes, minutes }) {
  const turn = minutes ? `${minutes} min` : strokes ? `${strokes} strokes` : "";
  return turn ? `Turns: the robot paints ${turn}, then you paint` : "Take turns";
}

/**
 * The form. Without a goal (`together`) they always take turns, and it is chosen how many strokes an answer has.
 * @param {House} house @param {Turns} turns @param {(command: Command) => Promise<any>} say @param {boolean} together
 */
export function turnForm(house, turns, say, together = false) {
  const on = turns.strokes > 0 || turns.minutes > 0;
  const wanted = { count: turns.strokes || 5, minutes: turns.minutes || 2, by: turns.minutes ? "minutes" : "strokes", policy: turns.policy, keep: turns.keep };
  const strokes = slider({ label: "The robot paints", min: 1, max: 50, value: wanted.count, words: (value) => `${value} strokes, then you`, oninput: (value) => { wanted.count = value; } });
  const minutes = slider({ label: "The robot paints", min: 1, max: 30, value: wanted.minutes, words: (value) => `${value} min, then you`, oninput: (value) => { wanted.minutes = value; } });
  const way = h("select", { onchange: () => { wanted.policy = way.value; keep.hidden = OWN_KEEP.includes(way.value); } },
    house.turns.filter((name) => !together || name !== "alternate").map((name) => h("option", { value: name, selected: name === wanted.policy }, WAYS[name] ?? name)));
  const keep = choices({ legend: "What you paint", name: "keep", value: wanted.keep, onchange: (value) => { wanted.keep = value; },
    options: [{ value: "protect", label: "stays as it is" }, { value: "welcome", label: "may be painted over" }] });
  keep.hidden = OWN_KEEP.includes(wanted.policy);
  const by = choices({ legend: "Change turns after", name: "turns-by", value: wanted.by, onchange: (value) => { wanted.by = value; length(); },
    options: [{ value: "strokes", label: "strokes" }, { value: "minutes", label: "minutes" }] });
  const length = () => { strokes.hidden = wanted.by !== "strokes"; minutes.hidden = wanted.by === "strokes"; };
  length();
  const order = (/** @type {number} */ count, /** @type {number} */ long) => say({ kind: "turns", count, minutes: long, policy: wanted.policy, keep: wanted.keep });
  const take = () => (wanted.by === "strokes" ? order(wanted.count, 0) : order(0, wanted.minutes));
  if (together) {
    by.hidden = minutes.hidden = true;
    strokes.hidden = false;
  }
  const button = (label, work) => h("button", { type: "button", class: "button second", onclick: work }, label);
  if (together) {
    return h("details", {}, h("summary", {}, "How the robot answers"), h("label", { class: "field" }, h("span", {}, "The robot's answer to what you paint"), way), keep, strokes,
      h("p", { class: "pair" }, button("Answer so", () => order(wanted.count, 0)), turns.strokes ? button("As many strokes as I painted", () => order(0, 0)) : null));
  }
  return h("details", {}, h("summary", {}, agreed(turns)),
    h("label", { class: "field" }, h("span", {}, "The robot's answer to what you paint"), way), keep, by, strokes, minutes,
    h("p", { class: "pair" }, button(on ? "Change" : "Take turns", take), on ? button("Stop taking turns", () => order(0, 0)) : button("Answer so, without turns", () => order(0, 0))));
}
