// Painting together: pause, look, protect a part, leave strokes out, take turns, change what was said.

import * as api from "./api.js";
import { wishForm } from "./composer.js";
import { h, mainAction, reveal, show, slider } from "./dom.js";
import { byWords } from "./bywords.js";
import { pad } from "./pad.js";
import { personBrush } from "./personbrush.js";
import { turnForm } from "./turns.js";

export function togetherTools(house, here, wish, onPad) {
  const element = h("div", { class: "together", "data-for": "operate" });
  /** @param {Command} command */
  const say = (command) => house.attempt(() => api.post(`/api/paintings/${here.id}/say`, command));
  let shown = "";
  let latest = null;
  let drawing = false; // on the pad
  let changed = null; // the goal as a person is changing it
  let brush = null; // a person's own, while they paint

  const button = (label, work, kind = "second", key = "") => h("button", { type: "button", class: `button ${kind}`, onclick: work, "aria-keyshortcuts": key || null }, label);

  const photograph = (state) => (state.painting.pictures.photograph ? api.shown(here.id, state.painting.pictures.photograph) : "");

  /** A pad over the photograph of the canvas, in place of everything else until it is closed. */
  function drawOver(state, { title, mask, actions }) {
    const sheet = pad({ shape: wish.width / wish.height, mask, background: photograph(state) });
    const close = () => { drawing = false; onPad(null); element.hidden = false; shown = ""; update(latest); reveal(element, element.querySelector("button:not(:disabled), summary") ?? element); };
    const take = async (use) => {
      const blob = await sheet.picture();
      if (!blob) return house.notice("Nothing is drawn yet. Draw over the canvas first.");
      return (await use(blob)) ? close() : undefined; // what could not be sent is still on the pad
    };
    drawing = true;
    element.hidden = true;
    onPad(h("div", {}, h("h2", {}, title), sheet.element, sheet.tools, h("p", { class: "actions-row" }, actions.map(({ label, kind, use }) => button(label, () => take(use), kind)),
      h("button", { type: "button", class: "quiet", onclick: close }, "Cancel"))));
    sheet.open();
  }

  function protecting(state) {
    const hand = (only) => (blob) => house.attempt(() => api.upload(blob)).then((picture) => picture && say({ kind: "protect", picture, only }));
    drawOver(state, { title: "Mark a part of the canvas", mask: true,
      actions: [{ label: "Do not paint in this part", kind: "", use: hand(false) }, { label: "Paint only in this part", kind: "second", use: hand(true) }] });
  }

  /** A drawing over the photograph of the canvas, to go by from now on. */
  const sketching = (state, use) => drawOver(state, { title: "Draw over the canvas", mask: false, actions: [{ label: "Use this drawing", kind: "", use }] });

  /** A brush for the person, in place of everything else until it is put down. */
  function paintBeside(state) {
    const close = () => { brush = null; drawing = false; onPad(null); element.hidden = false; shown = ""; update(latest); };
    brush = personBrush({ house, here, wish, say, close });
    drawing = true;
    element.hidden = true;
    brush.update(state.painting);
    onPad(brush.element);
    brush.open();
  }

  /** Without a camera: a picture that a person took counts as a look. */
  function picturing() {
    const chooser = h("input", { type: "file", accept: "image/*,.heic,.heif", hidden: true });
    chooser.addEventListener("change", async () => {
      const [file] = chooser.files ?? [];
      const picture = file && await house.attempt(() => api.upload(file));
      if (picture) await say({ kind: "picture", picture });
      chooser.value = "";
    });
    return [button("Give a picture of the canvas and replan", () => chooser.click(), "second wide", "l"), chooser];
  }

  function leavingOut(left) {
    let strokes = Math.min(left, 10);
    return h("details", {}, h("summary", {}, "Skip strokes"),
      slider({ label: "The last strokes of the plan", min: 1, max: left, value: strokes, words: (value) => `${value} of ${left}`, oninput: (value) => { strokes = value; } }),
      button("Skip them", () => say({ kind: "leave out", count: strokes })));
  }

  function changing(state) {
    const begun = changed !== null;
    const now = { ...wish, ...state.painting.wishes.goals.at(-1)?.wish };
    changed ??= structuredClone(now);
    const form = wishForm(house, changed, () => {}, { goalsOnly: true, ondraw: (use) => sketching(state, use) });
    const replan = async () => { if ((await form.settled()) && (await say({ kind: "goal", terms: changed.terms, initial: changed.initial ?? [] }))) changed = null; };
    return h("details", { open: begun && JSON.stringify(changed) !== JSON.stringify(now) }, h("summary", {}, "Change the goal"), h("p", {}, "The canvas and the paints stay the same. The remaining strokes are replanned for the new goal."),
      form.element, button("Replan with this goal", replan, "second wide"));
  }

  const words = byWords(house, here, say);

  const turns = (state) => turnForm(house, state.painting.wishes.turns, say, wish.together);

  function pausing() {
    const pause = button("Pause after this stroke", async () => {
      if (pause.ariaDisabled === "true") return; // (a button that is disabled would lose the keyboard's focus)
      pause.ariaDisabled = "true";
      pause.textContent = "It will pause after this stroke";
      if (await say({ kind: "pause" })) return;
      pause.ariaDisabled = "false";
      pause.textContent = "Pause after this stroke";
    }, "second wide", "p");
    return pause;
  }

  function update(state) {
    const { painting } = state;
    const { progress, wishes, people } = painting;
    const wells = people.may_paint?.wells;
    latest = state;
    if (brush && wishes.paused) { brush.update(painting); return; }
    words.tell(painting);
    brush = null;
    const left = progress.of - progress.painted;
    const key = JSON.stringify([painting.status, wells, wishes.paused, wishes.turns, wishes.region, people.remark, left && painting.status === "paused" ? left : 0, wishes.request, wishes.proposed]);
    if (key === shown || (drawing && painting.status === "paused")) return;
    shown = key;
    drawing = element.hidden = false;
    onPad(null);
    const remark = people.remark ? h("p", { class: "remark", role: "alert" }, people.remark) : null;
    if (painting.status === "paused" && wish.together) {
      show(element, remark, h("p", {}, wishes.pause?.reason),
        mainAction(wells?.length ? button("Paint on the canvas", () => paintBeside(state), "wide", "b") : button("Let the robot answer", () => say({ kind: "go on" }), "wide", "p")),
        h("p", { class: "stack" }, wells?.length ? button("Let the robot answer", () => say({ kind: "go on" }), "second wide", "p") : null,
          button(wishes.region ? "Protect another part" : "Protect a part", () => protecting(state), "second wide", "m"),
          wishes.region ? button("Remove the protection", () => say({ kind: "free" }), "second wide") : null,
          button("The drawing is finished", () => say({ kind: "finish" }), "second wide")),
        turns(state));
    } else if (painting.status === "paused") {
      const byWord = words.place(painting);
      show(element, remark, h("p", {}, wishes.pause?.reason), wishes.proposed ? byWord : null,
        mainAction(button("Continue", () => say({ kind: "go on" }), "wide", "p")),
        h("p", { class: "stack" }, wells?.length ? button("Paint on the canvas yourself", () => paintBeside(state), "second wide", "b") : null,
          house.watched ? button("Look at the canvas and replan", () => say({ kind: "look" }), "second wide", "l") : picturing(),
          button(wishes.region ? "Protect another part" : "Protect a part", () => protecting(state), "second wide", "m"),
          wishes.region ? button("Remove the protection", () => say({ kind: "free" }), "second wide") : null),
        wishes.proposed ? null : byWord, left > 0 ? leavingOut(left) : null, changing(state), turns(state));
    } else if (wishes.paused && !["stopped", "failed", "finished"].includes(painting.status)) {
      show(element, remark, wishes.request.kind === "propose" ? words.making(painting) : h("p", {}, "It does what you asked for. Then it waits for you."));
    } else if (["painting", "drying", "planning", "mixing"].includes(painting.status)) {
      show(element, remark, mainAction(pausing()), turns(state));
    } else {
      show(element);
    }
  }

  return { element, update };
}
