// Questions of a machine's setup: choose one of several things, guide the tip to a place, type an address.

import { h, svg } from "./dom.js";

const KEYS = {
  ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowUp: [1, 1], ArrowDown: [1, -1], PageUp: [2, 1], PageDown: [2, -1], w: [2, 1], s: [2, -1],
};
const WAYS = [
  { label: "Away", axis: 1, sign: 1, shown: "↑", place: "1 / 2" }, { label: "Left", axis: 0, sign: -1, shown: "←", place: "2 / 1" },
  { label: "Right", axis: 0, sign: 1, shown: "→", place: "2 / 3" }, { label: "Near", axis: 1, sign: -1, shown: "↓", place: "3 / 2" },
  { label: "Raise", axis: 2, sign: 1, shown: "▲", place: "1 / 5" }, { label: "Lower", axis: 2, sign: -1, shown: "▼", place: "3 / 5" },
];
const FIRST_STEP = 1;
const DRAWINGS = {
  servo: "M5 12H43M5 32H43M20 12V32M28 12V32M17 18H31V27H17ZM24 27V37",
  axis: "M6 38H42M10 38V12H38V38M18 12V22H30V12M24 22V31M21 31H27",
  arm: "M9 38H21M15 38V30L13 16 30 9 35 20M35 20V27M32 27H38",
  hand: "M10 36C12 26 20 26 24 20L36 8 40 12 28 24C24 30 20 36 10 36Z",
};

/** The drawing of a kind of machine. @param {string} kind */
export const machineDrawing = (kind) => svg("svg", { viewBox: "0 0 48 44", class: "drawing", "aria-hidden": "true" }, svg("path", { d: DRAWINGS[kind] ?? DRAWINGS.axis }));

/** The step that the next press makes: it shrinks whenever the direction along an axis is reversed. */
export class Stride {
  /** @param {number[]} steps in metres, the largest first */
  constructor(steps) {
    this.steps = steps;
    this.index = Math.min(FIRST_STEP, steps.length - 1);
    /** @type {Record<number, number>} */
    this.last = {};
  }

  get step() { return this.steps[this.index]; }

  /** Takes the next larger (-1) or smaller (1) step. @param {number} by */
  change(by) { this.index = Math.min(this.steps.length - 1, Math.max(0, this.index + by)); }

  /** The move of a press, [x, y, z] in metres. @param {number} axis @param {number} sign */
  press(axis, sign) {
    if ((this.last[axis] ?? sign) !== sign) this.change(1);
    this.last[axis] = sign;
    return [0, 1, 2].map((each) => (each === axis ? sign * this.step : 0));
  }
}

const millimetres = (metres) => `${(1000 * metres).toFixed(1)}`;
const words = (step) => `${Number((1000 * step).toFixed(2))} mm`;

/**
 * The tip is guided; `answer(values)` sends a move or the end. Returns the card, and what shows the next question of it.
 * @param {any} asked @param {boolean} may @param {(values: object) => Promise<any>} answer
 */
export function guideCard(asked, may, answer) {
  const stride = new Stride(asked.steps);
  let waiting = false; // for the next question: the machine moves
  const place = h("p", { class: "place" });
  const remark = h("p", { class: "remark", role: "status" });
  const step = h("output", {});
  const keys = h("div", { class: "pad-of-keys" }, WAYS.map(({ label, axis, sign, shown, place: at }) =>
    h("button", { type: "button", class: "key", "aria-label": label, disabled: !may, style: { gridArea: at }, onclick: () => move(axis, sign) }, shown)),
    h("small", { style: { gridArea: "2 / 5" } }, "height"));
  const group = h("div", { class: "guide", tabIndex: 0, role: "group", "aria-label": "Guide the tip" }, keys, h("div", {}, place,
    h("p", { class: "strides" }, h("button", { type: "button", class: "key", "aria-label": "Smaller steps", disabled: !may, onclick: () => change(1) }, "−"), step,
      h("button", { type: "button", class: "key", "aria-label": "Larger steps", disabled: !may, onclick: () => change(-1) }, "+"))));
  const done = h("button", { type: "button", class: "button", "data-for": "operate", disabled: !may, onclick: settle }, "It is there");

  async function send(values) {
    if (!may || waiting) return;
    waiting = true;
    group.classList.add("moving");
    if (await answer(values) === undefined) release(); // it was refused: nothing moved
  }

  function release() { waiting = false; group.classList.remove("moving"); }

  function move(axis, sign) {
    if (waiting) return;
    const by = stride.press(axis, sign);
    step.textContent = words(stride.step);
    send({ move: by });
  }

  function change(by) { stride.change(by); step.textContent = words(stride.step); }

  function settle() { send({ settled: true }); }

  function update(next) {
    release();
    const [x, y, z] = next.position.map(millimetres);
    place.replaceChildren(...[["x", x], ["y", y], ["z", z]].flatMap(([axis, value]) => [h("small", {}, axis), h("strong", {}, value)]));
    remark.textContent = next.remark ?? "";
    remark.hidden = !next.remark;
    step.textContent = words(stride.step);
  }

  function onkey(event) {
    if (event.target.matches("input, textarea, select") || event.ctrlKey || event.metaKey || event.altKey) return;
    const way = KEYS[event.key];
    if (way) move(way[0], way[1]);
    else if (event.key === "+" || event.key === "-") change(event.key === "+" ? -1 : 1);
    else if (event.key.toLowerCase() === "o" && event.target === group) settle();
    else return;
    event.preventDefault();
  }
  document.addEventListener("keydown", onkey);
  update(asked);
  const element = h("div", { class: "asked" }, h("p", { class: "text" }, asked.text), group, remark,
    h("p", { class: "label keys-help" }, "Arrow keys move the tip, Page Up and Page Down raise and lower it. A step shrinks when you turn back; + and − change it. O: it is there."),
    h("p", {}, done));
  return { element, update, close: () => document.removeEventListener("keydown", onkey) };
}

/** One of several things is chosen. @param {any} asked @param {boolean} may @param {(values: object) => Promise<any>} answer */
export function chooseCard(asked, may, answer) {
  const long = asked.things.some((thing) => thing.length > 4);
  const things = h("ul", { class: long ? "things" : "things short" }, asked.things.map((thing, index) => h("li", {},
    h("button", { type: "button", class: "thing", disabled: !may, "aria-current": index === asked.proposal ? "true" : undefined, onclick: () => answer({ choice: index }) },
      asked.drawings.length ? machineDrawing(asked.drawings[index]) : null,
      h("span", {}, thing, asked.notes.length ? h("small", {}, asked.notes[index]) : null)))));
  return h("div", { class: "asked wide-asked" }, h("p", { class: "text" }, asked.text), things);
}

/** An address on the network is typed. @param {any} asked @param {boolean} may @param {(values: object) => Promise<any>} answer */
export function addressCard(asked, may, answer) {
  const input = h("input", { type: "text", inputMode: "url", autocapitalize: "off", spellcheck: false, "aria-label": "Address", placeholder: asked.example, maxLength: 150 });
  const give = () => { if (input.value.trim()) answer({ address: input.value.trim() }); };
  input.addEventListener("keydown", (event) => { if (event.key === "Enter") give(); });
  return h("div", { class: "asked" }, h("p", { class: "text" }, asked.text),
    h("p", { class: "pair" }, input, h("button", { type: "button", class: "button", disabled: !may, onclick: give }, "Connect")));
}
