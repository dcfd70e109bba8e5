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
      if (!blob) return house.notice("Nothing is drawn yet. Draw over the part of the canvas first.");
      await house.attempt(async () => api.post(`/api/paintings/${here.id}/region`, { picture: await api.upload(blob), only }));
      return done();
    }
    onPad(sheet.element);
    show(element, h("h2", {}, "Mark a part of the canvas"), sheet.tools,
      h("p", { class: "stack" }, button("Do not paint in this part", () => hand(false), "wide"), button("Paint only in this part", () => hand(true), "second wide")),
      h("button", { type: "button", class: "quiet", onclick: done }, "Cancel"));
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
    onPad(h("div", {}, sheet.element, sheet.tools, h("p", { class: "pair" }, button("Use this drawing", done, ""), h("button", { type: "button", class: "quiet", onclick: () => onPad(null) }, "Cancel"))));
  }

  function leavingOut(left) {
    let strokes = Math.min(left, 10);
    return h("details", {}, h("summary", {}, "Skip strokes"),
      slider({ label: "The last strokes of the plan", min: 1, max: left, value: strokes, words: (value) => `${value} of ${left}`, oninput: (value) => { strokes = value; } }),
      button("Skip them", () => say("leave out", strokes)));
  }

  function changing(state) {
    const changed = structuredClone(state.painting.wish ?? wish);
    const form = wishForm(house, changed, () => {}, { goalsOnly: true, ondraw: (use) => drawing(state, use) });
    return h("details", {}, h("summary", {}, "Change the goal"), h("p", {}, "The canvas and the paints stay the same. The remaining strokes are replanned for the new goal."),
      form.element, button("Replan with this goal", () => house.attempt(() => api.post(`/api/paintings/${here.id}/goal`, changed)), "second wide"));
  }

  function turns(state) {
    const on = state.painting.turns > 0;
    return h("details", {}, h("summary", {}, on ? `Turns: the robot paints ${state.painting.turns} strokes, then you paint` : "Take turns"),
      slider({ label: "The robot paints", min: 1, max: 50, value: state.painting.turns || turnsWanted, words: (value) => `${value} strokes, then you`, oninput: (value) => { turnsWanted = value; } }),
      h("p", { class: "pair" }, button(on ? "Change" : "Take turns", () => say("turns", turnsWanted)), on ? button("Stop taking turns", () => say("turns", 0)) : null));
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
        h("p", { class: "stack" }, button("Continue", () => say("go on"), "wide"), button("Look at the canvas and replan", () => say("look"), "second wide"),
          button(painting.region ? "Protect another part" : "Protect a part", () => { shown = "drawing"; protecting(state); }, "second wide"),
          painting.region ? button("Remove the protection", () => say("free"), "second wide") : null),
        left > 0 ? leavingOut(left) : null, changing(state), turns(state));
    } else if (painting.held && !["stopped", "failed", "finished"].includes(painting.status)) {
      show(element, remark, h("p", {}, "It does what you asked for. Then it waits for you."));
    } else if (["painting", "planning", "mixing"].includes(painting.status)) {
      show(element, remark, h("p", { class: "stack" }, pausing()), turns(state));
    } else {
      show(element);
    }
  }

  return { element, update };
}
