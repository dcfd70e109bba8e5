// "Your turn": a person paints on the canvas of the virtual studio, with the brushes and the paints of the robot.

import * as api from "./api.js";
import { choices, count, h, show, slider } from "./dom.js";
import { strokePad, thin } from "./strokepad.js";

const EXACT = [0.0001, 0.0001, 0.01, 0.035, 0.14]; // metres, metres, share of the press, radians, radians
const PRESSES = [[0.15, "barely touching"], [0.35, "lightly"], [0.6, "with some pressure"], [0.85, "pressed well"], [1, "pressed hard"]];

const words = (press) => PRESSES.find(([most]) => press <= most)?.[1] ?? PRESSES[4][1];

/** How wide a brush paints, in words. @param {PersonBrush} brush @param {number} press */
export const widthWords = (brush, press) => `${words(press)}, about ${Math.round(1000 * (brush.light + (brush.hard - brush.light) * press))} mm wide`;

/**
 * The pad with its tools. `say` sends a command; `close` is called when the person wants to see the page again.
 * @param {{ house: House, here: Here, wish: Wish, say: (command: Command) => Promise<any>, close: () => void }} options
 */
export function personBrush({ house, here, wish, say, close }) {
  const [across, up] = [wish.width / 1000, wish.height / 1000];
  /** @type {PaintState | null} */
  let painting = null;
  let chosen = { brush: "", paint: 0, press: 0.5 };
  let sent = 0; // strokes on their way to the canvas
  let known = "";
  /** @type {{ number: number, forget: () => void }[]} */
  const waiting = []; // sketches of strokes that are not on the photograph yet

  const brush = () => painting?.people.may_paint?.brushes.find((each) => each.name === chosen.brush) ?? null;
  const may = () => Boolean(painting?.wishes.paused && painting.people.may_paint?.wells.length);

  const pad = strokePad({
    label: "Paint on the canvas", shape: wish.width / wish.height, press: () => chosen.press,
    begin() {
      const held = brush();
      return held && may() ? { color: painting?.people.may_paint?.wells[chosen.paint] ?? "#000", light: held.light / across, hard: held.hard / across } : null;
    },
    done,
  });
  pad.surface.addEventListener("pointerdown", () => {
    if (!may()) house.notice("The robot is at work now, and nobody paints beside an arm that moves. Wait until it has paused.");
  });

  async function done(points, forget) {
    const number = (painting?.people.painted ?? 0) + ++sent;
    waiting.push({ number, forget });
    const kept = thin(points, [EXACT[0] / across, EXACT[1] / up, ...EXACT.slice(2)]);
    const laid = await say({ kind: "paint", brush: chosen.brush, paint: chosen.paint, points: kept });
    if (laid) return;
    forget();
    waiting.splice(waiting.findIndex((each) => each.forget === forget), 1);
    sent = Math.max(0, sent - 1);
  }

  const brushes = h("div", {});
  const paints = h("div", { class: "inks", role: "group", "aria-label": "Paint" });
  const width = h("p", { class: "label", role: "status" });
  const told = h("p", { class: "label" });
  const refused = h("div", {});
  const press = slider({ label: "Press", min: 5, max: 100, value: 50, words: (value) => words(value / 100), oninput: (value) => { chosen.press = value / 100; describe(); },
    hint: "A pen's own pressure counts as well." });
  const go = h("button", { type: "button", class: "button", onclick: () => { close(); say({ kind: "go on" }); } }, "Let the robot answer");
  const look = h("button", { type: "button", class: "button second", onclick: close }, "Back to the painting");
  const element = h("div", { class: "person-brush" }, h("h2", {}, "Your brush"), pad.element, refused,
    h("div", { class: "tools", role: "toolbar", "aria-label": "Brush and paint" }, brushes, paints, press), width, told,
    h("p", { class: "label pad-help" }, pad.help), h("p", { class: "actions-row" }, go, look));

  function describe() {
    const held = brush();
    width.textContent = held ? `The ${held.name} brush, paint ${chosen.paint + 1}, ${widthWords(held, chosen.press)}` : "";
  }

  function pick(changes) {
    chosen = { ...chosen, ...changes };
    [...paints.children].forEach((ink, index) => { ink.setAttribute("aria-pressed", String(index === chosen.paint)); });
    describe();
  }

  /** @param {PaintState} next */
  function update(next) {
    painting = next;
    const { may_paint, painted } = next.people;
    if (!may_paint && !painted) return;
    const person = may_paint ?? { brushes: [], wells: [] };
    const key = JSON.stringify([person.brushes, person.wells]);
    if (key !== known) {
      const opening = !known;
      known = key;
      const first = person.brushes.find((each) => each.name === next.brush.name) ?? person.brushes[person.brushes.length - 1];
      if (!brush() && first) chosen.brush = first.name;
      const darkest = Math.max(0, person.wells.length - 1);
      chosen.paint = opening && wish.together ? darkest : Math.min(chosen.paint, darkest); // a drawing begins with what is seen on white
      show(brushes, choices({ legend: "Brush", name: "person-brush", value: chosen.brush, onchange: (value) => pick({ brush: value }),
        options: person.brushes.map((each) => ({ value: each.name, label: each.name, title: `${Math.round(1000 * each.light)} to ${Math.round(1000 * each.hard)} mm wide` })) }));
      show(paints, person.wells.map((color, index) => h("button", { type: "button", class: "ink", style: { background: color }, "aria-label": `Paint ${index + 1}`, title: `Paint ${index + 1}`, onclick: () => pick({ paint: index }) })));
      pick({});
    }
    while (waiting.length && painted >= waiting[0].number) {
      const { forget } = /** @type {{ number: number, forget: () => void }} */ (waiting.shift());
      sent = Math.max(0, sent - 1);
      setTimeout(forget, 900); // its photograph follows within a moment
    }
    if (next.pictures.photograph) pad.show(api.shown(here.id, next.pictures.photograph));
    if (next.people.remark) waiting.splice(0).forEach((each) => { each.forget(); });
    if (next.people.remark) sent = 0;
    show(refused, next.people.remark ? h("p", { class: "remark", role: "alert" }, next.people.remark) : null);
    told.textContent = `${painted ? `${count(painted, "stroke", "strokes")} of yours on the canvas. ` : ""}Wet paint mixes with wet paint. Nothing can be undone: paint over it.`;
    element.classList.toggle("waits", !may());
  }

  /** Brings the pad into sight. */
  function open() {
    element.scrollIntoView({ block: "nearest" });
    pad.surface.focus({ preventScroll: true });
  }

  return { element, update, open };
}
