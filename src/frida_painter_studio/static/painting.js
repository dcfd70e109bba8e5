// One painting, from its first plan to the last stroke: follows the studio, and shows the stage it is at.

import * as api from "./api.js";
import { steps } from "./composer.js";
import { h, show } from "./dom.js";
import { finishedStage, lostStage } from "./finished.js";
import { Herald, need } from "./needs.js";
import { paintStage } from "./paint.js";
import { planStage } from "./plan.js";
import { questionCard } from "./question.js";

const STAGES = { plan: planStage, prepare: planStage, paint: paintStage, done: finishedStage, lost: lostStage };

/** Which view shows a painting: by the status that the studio tells. @param {State} state */
function stageOf(state) {
  if (state.stage === "lost") return "lost";
  if (!state.painting) return state.plans.length ? "plan" : "lost";
  return !state.working && ["finished", "stopped", "failed"].includes(state.stage) ? "done" : "paint";
}

export function painting(house, id) {
  const element = h("section", { class: "workbench" });
  const trouble = h("div", { class: "trouble", role: "alert" });
  const asked = questionCard(house, `/api/paintings/${id}`, (name) => api.file(id, "live", name));
  const herald = new Herald();
  let stage = null;
  let name = "";
  let step = "";
  let title = "";
  let begun = ""; // when
  let last = null;

  function go(steps) { step = steps; if (last) hear(last); }

  function hear(state) {
    last = state;
    if (!title) {
      ({ title, begun } = state);
      document.title = `${title} · The studio`;
    }
    house.active(state.working);
    const next = stageOf(state);
    if (next !== name) {
      stage?.close?.();
      name = next;
      step = next;
      stage = STAGES[next](house, { id, get title() { return title; }, get begun() { return begun; }, go }, state);
    }
    const shown = name === "plan" ? step : name;
    element.classList.toggle("lost", name === "lost");
    const end = name === "done" ? { stopped: "Stopped", failed: "Failed" }[state.painting.status] : "";
    const entered = element.dataset.step !== `${name}/${shown}`;
    if (entered) {
      element.dataset.step = `${name}/${shown}`;
      element.replaceChildren(...(name === "lost" ? [] : [steps(shown, end)]), trouble, asked.element, ...stage.elements);
    }
    asked.update(state.question);
    show(trouble, state.trouble ? h("p", {}, state.trouble) : null);
    stage.update(state, shown);
    if (entered) house.entered(element);
    herald.tell(need(state, title));
  }

  const stopFollowing = api.follow(house, `/api/paintings/${id}`, hear);
  return {
    element,
    close() { stopFollowing(); stage?.close?.(); document.title = "The studio"; },
  };
}
