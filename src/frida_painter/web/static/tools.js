// Painting together: pause, look, protect a part, leave strokes out, take turns, change what was said.

import * as api from "./api.js";
import { wishForm } from "./composer.js";
import { h, show, slider } from "./dom.js";
import { pad } from "./pad.js";

export function togetherTools(house, here, wish, onPad) {
  const element = h("div", { class: "together" });
  const say = (kind, count = 0) => house.attempt(() => api.post(`/api/paintings/${here.id}/say`, { kind, count }));
  const may = house.role === "operate";
  let shown = "";
  let turnsWanted = 5;

  const button = (label, work, kind = "second") => h("button", { type: "button", class: `button ${kind}`, disabled: !may, onclick: work }, label);

  const photograph = (state) => (state.painting.photograph ? api.file(here.id, "live", state.painting.photograph) : "");

  function protecting(state) {
    const sheet = pad({ shape: wish.width / wish.height, mask: true, background: photograph(state) });
    const done = () => { shown = ""; onPad(null); update(state); };
    async function hand(only) {
      const blob = await sheet.picture();
      if (!blob) return house.notice("Nothing is drawn yet: draw over the part of the canvas that you mean.");
      await house.attempt(async () => api.post(`/api/paintings/${here.id}/region`, { picture: await api.upload(blob), only }));
      return done();
    }
    onPad(sheet.element);
    show(element, h("h2", {}, "Draw over the part you mean"), sheet.tools,
      h("p", { class: "stack" }, button("The robot must not touch this", () => hand(false), "wide"), button("The robot may touch only this", () => hand(true), "second wide")),
      h("button", { type: "button", class: "quiet", onclick: done }, "Leave it"));
  }

  /** A drawing over the photograph of the canvas, to go by from now on. */
  function drawing(state, use) {
    const sheet = pad({ shape: wish.width / wish.height, background: photograph(state) });
    const done = async () => {
      const blob = await sheet.picture();
      if (!blob) { house.notice("Nothing is drawn yet."); return; }
      onPad(null);
      use(blob);
    };
    onPad(h("div", {}, sheet.element, sheet.tools, h("p", { class: "pair" }, button("Use this drawing", done, ""), h("button", { type: "button", class: "quiet", onclick: () => onPad(null) }, "Leave it"))));
  }

  function leavingOut(left) {
    let strokes = Math.min(left, 10);
    return h("details", {}, h("summary", {}, "Leave strokes out"),
      slider({ label: "The last strokes of the plan", min: 1, max: left, value: strokes, words: (value) => `${value} of ${left}`, oninput: (value) => { strokes = value; } }),
      button("Leave them out", () => say("leave out", strokes)));
  }

  function changing(state) {
    const changed = structuredClone(state.painting.wish ?? wish);
    const form = wishForm(house, changed, () => {}, { goalsOnly: true, ondraw: (use) => drawing(state, use) });
    return h("details", {}, h("summary", {}, "Change what was said"), h("p", {}, "The canvas and the paints stay as they are; the strokes that are left are planned towards the new goal."),
      form.element, button("Plan towards this", () => house.attempt(() => api.post(`/api/paintings/${here.id}/goal`, changed)), "second wide"));
  }

  function turns(state) {
    const on = state.painting.turns > 0;
    return h("details", {}, h("summary", {}, on ? `Taking turns: ${state.painting.turns} strokes, then you` : "Take turns"),
      slider({ label: "The robot paints", min: 1, max: 50, value: state.painting.turns || turnsWanted, words: (value) => `${value} strokes, then you`, oninput: (value) => { turnsWanted = value; } }),
      h("p", { class: "pair" }, button(on ? "Change" : "Take turns", () => say("turns", turnsWanted)), on ? button("No more turns", () => say("turns", 0)) : null));
  }

  function pausing() {
    const pause = button("Pause after this stroke", async () => {
      pause.disabled = true;
      pause.textContent = "It will pause after this stroke";
      if (await say("pause")) return;
      pause.disabled = false;
      pause.textContent = "Pause after this stroke";
    }, "second wide");
    return pause;
  }

  function update(state) {
    const { painting } = state;
    const left = painting.of - painting.done;
    const key = JSON.stringify([painting.status, painting.held, painting.turns, painting.region, painting.remark, left && painting.status === "paused" ? left : 0]);
    if (key === shown || (painting.status === "paused" && shown === "drawing")) return;
    shown = key;
    onPad(null);
    const remark = painting.remark ? h("p", { class: "remark", role: "alert" }, painting.remark) : null;
    if (painting.status === "paused") {
      show(element, remark, h("p", {}, painting.reason),
        h("p", { class: "stack" }, button("Go on", () => say("go on"), "wide"), button("Look at the canvas and plan again", () => say("look"), "second wide"),
          button(painting.region ? "Protect another part" : "Protect a part", () => { shown = "drawing"; protecting(state); }, "second wide"),
          painting.region ? button("Protect nothing any more", () => say("free"), "second wide") : null),
        left > 0 ? leavingOut(left) : null, changing(state), turns(state));
    } else if (painting.held && !["stopped", "failed", "finished"].includes(painting.status)) {
      show(element, remark, h("p", {}, "It does what you asked for, and waits for you then."));
    } else if (["painting", "planning", "mixing"].includes(painting.status)) {
      show(element, remark, h("p", { class: "stack" }, pausing()), turns(state));
    } else {
      show(element);
    }
  }

  return { element, update };
}
