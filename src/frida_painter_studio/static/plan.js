// "Review the plan" and "Prepare": plans as they grow, side by side, stroke by stroke; then the palette to mix.

import * as api from "./api.js";
import { canvasView } from "./canvasview.js";
import { summary, variantsInWords, wishForm } from "./composer.js";
import { count, duration, h, mainAction, reveal, show } from "./dom.js";
import { asPainted, corrected, toPaint } from "./estimate.js";
import { goalList } from "./goal.js";
import { pad } from "./pad.js";
import { placeOf } from "./queue.js";

const TAKEN = [["strokes.svg", "The strokes, for plotters and Inkscape (SVG)"], ["strokes.gcode", "The strokes for GRBL machines (G-code)"], ["palette.png", "The palette, to print"]];

/** @param {House} house @param {Here} here @param {State} first */
export function planStage(house, here, first) {
  const canvas = canvasView(first.plans[0].wish, ["goal", "plan"]);
  const scrub = h("input", { type: "range", min: 0, max: 1, value: 1, "aria-label": "Strokes painted so far" });
  const scrubbing = h("div", { class: "scrub" }, scrub, h("output", {}));
  const easel = h("div", { class: "easel" }, canvas.element, scrubbing, canvas.slider, canvas.caption);
  const goals = h("div", {});
  const changes = new Map(); // of goals, by plan, as a person is making them
  const panel = h("div", { class: "panel" });
  const others = h("ul", {});
  const said = h("p", { class: "label", role: "status" });
  const strip = h("section", { class: "plans", "aria-label": "Plans" }, said, others);
  const padPlace = h("div", { class: "easel", hidden: true });
  const strokes = new Map();
  let state = first;
  let chosen = null;
  let newest = 0;
  let drawn = "";
  let stopWaiting = () => {};
  let allowStart = () => {}; // while "Prepare" is shown: the planner's process may take a moment to end after its plan

  const nameOf = ({ number, wish }) => `Plan ${number}${wish.variant ? `: ${wish.variant}` : ""}`;

  /** How long painting a plan takes; the first one that was made measures this machine. */
  function timeOf(plan) {
    const sized = ({ wish, made }) => ({ ...wish, ...made });
    const first = sized(state.plans.find(({ made }) => made) ?? plan);
    return duration(toPaint(corrected(house.pace, first, first.seconds), asPainted(house, sized(plan))));
  }

  const current = () => /** @type {PlanState} */ (state.plans.find((plan) => plan.number === chosen));

  scrub.addEventListener("input", () => { canvas.fade(1); scrubbed(); });

  async function strokesOf(plan) {
    if (!strokes.has(plan.number)) strokes.set(plan.number, api.get(api.file(here.id, plan.number, `${plan.made.prefix}strokes.json`)).catch(() => null));
    return strokes.get(plan.number);
  }

  async function scrubbed() {
    const plan = current();
    if (!plan.made) return;
    const done = Number(scrub.value);
    const whole = done >= plan.made.strokes;
    const frame = plan.made.frames.reduce((best, after) => (after <= done ? after : best), 0);
    scrubbing.querySelector("output").textContent = `${done} of ${plan.made.strokes}`;
    canvas.picture("plan", api.file(here.id, plan.number, whole ? "plan.jpg" : `after-${frame}.jpg`), whole ? "The finished plan" : `The canvas after ${done} strokes`);
    canvas.captions({ plan: plan.wish.together ? "The bare canvas" : whole ? nameOf(plan) : `${nameOf(plan)}, after ${count(frame, "stroke", "strokes")}${done === frame ? "" : `; the outlined stroke is number ${done}`}` });
    const paths = await strokesOf(plan);
    if (plan !== current() && plan.number !== chosen) return;
    const paint = paths && done > 0 ? plan.made.palette[paths.paint[done - 1]] : null;
    canvas.highlight(paths, whole || done === 0 ? null : done - 1, paint?.hex ?? "#000");
  }

  function choose(number) {
    chosen = number;
    const plan = current();
    if (plan.made) {
      scrub.max = plan.made.strokes;
      scrub.value = plan.made.strokes;
    }
    drawn = "";
    update(state, "plan");
  }

  function planCard(plan) {
    const picture = plan.made ? api.file(here.id, plan.number, `after-${plan.made.frames.at(-1)}.jpg`) : plan.growing && api.file(here.id, plan.number, plan.growing);
    const words = {
      waiting: "waits in the queue", failed: "failed", stopped: "stopped",
      planning: plan === growing() ? `${Math.round(100 * plan.share)} %` : "comes next",
      ready: plan.wish.variant && plan.made ? `${summary(plan.wish, plan.made)}, ${house.pace.known ? "about" : "roughly"} ${timeOf(plan).replace(" ", "\u00a0")}`
        : `${Math.round(100 * (plan.made?.nearer ?? 0))} % closer to the goal than a bare canvas`,
    }[plan.status];
    return h("li", {}, h("button", { type: "button", "data-name": plan.number, "aria-pressed": String(plan.number === chosen), onclick: () => choose(plan.number) },
      h("span", { class: "frame" }, picture ? h("img", { src: picture, alt: "" }) : h("span", { class: "bare" })),
      h("strong", {}, nameOf(plan)), h("small", {}, words)));
  }

  const growing = () => state.plans.find((plan) => plan.status === "planning");

  /** The plans of the last order: one, or variants. */
  const ordered = () => state.plans.slice(state.plans.map((plan) => plan.beside).lastIndexOf(false));

  function tellVariants(order = ordered()) {
    const made = order.filter((plan) => plan.made).length;
    const sentence = order.length < 2 ? "" : `Ready: ${made} of ${order.length} variants.${made ? " Choose one." : ""}`;
    if (said.textContent !== sentence) said.textContent = sentence; // it is read aloud
  }

  /** Plans again, when the pictures of the wish have been taken in. @param {{ settled: () => Promise<boolean> } | null} form */
  async function another(wish, form = null, variants = false) {
    if (form && !(await form.settled())) return;
    await house.attempt(() => api.post(`/api/paintings/${here.id}/plans${variants ? "?variants=true" : ""}`, wish));
  }

  function paletteList(plan) {
    const changes = Object.entries(plan.made.mixing ?? {}).map(([what, words]) => h("p", { class: "label" }, `${what}: ${words}`));
    const list = h("ol", { class: "palette" }, plan.made.palette.map((paint) =>
      h("li", {}, h("b", { style: { background: paint.hex } }), h("span", {}, h("strong", {}, String(paint.number)), ` ${paint.hex}`),
        plan.wish.together ? null : h("small", {}, `${count(paint.strokes, "stroke", "strokes")}, ${paint.share < 0.005 ? "hardly any" : `${Math.round(100 * paint.share)} %`}`))));
    return h("div", {}, list, ...changes);
  }

  /** Recipes by brush in the order of work, and the tubes to buy; a plan of an older program has only its palette. */
  function mixingTable(plan) {
    if (!plan.made.brushes) return paletteList(plan);
    const row = (mixture) => h("li", {}, h("b", { style: { background: mixture.hex } }), h("span", {}, h("strong", {}, String(mixture.well)), ` ${mixture.hex}`), h("small", {}, mixture.amount),
      h("p", { class: "recipe" }, mixture.recipe, mixture.near ? "" : " · not exact", mixture.also ? ` · ${mixture.also}` : ""));
    return h("div", {}, ...plan.made.brushes.flatMap((brush) => [h("h2", {}, brush.title), h("ol", { class: "palette" }, brush.mixtures.map(row))]),
      h("h2", {}, "To buy"), h("ul", {}, plan.made.shopping.map((tubes) => h("li", {}, tubes))));
  }

  const wished = (plan) => [plan.wish.variant && !plan.made ? null : h("p", { class: "label" }, summary(plan.wish, plan.made)), h("h2", {}, "The goal"), goals];

  /** The form for another plan with another goal, open if it was begun. */
  function changing(plan) {
    if (!changes.has(plan.number)) changes.set(plan.number, structuredClone(plan.wish));
    const wish = changes.get(plan.number);
    const open = JSON.stringify(wish) !== JSON.stringify(plan.wish);
    const form = wishForm(house, wish, () => {}, { ondraw: (use) => sketch(plan, use) });
    return h("details", { open, "data-for": "plan" }, h("summary", {}, "Change the goal"), form.element,
      h("button", { type: "button", class: "button second wide", disabled: state.working, onclick: () => another(wish, form) }, "Plan with these changes"));
  }

  function planning(plan) {
    show(panel, h("h1", {}, plan.wish.together ? "Prepare" : "Review the plan"),
      h("p", {}, plan.wish.together ? "The program chooses paints to begin with. The robot does not move yet." : "The program plans the strokes: it places them, optimises them and chooses the colours. The robot does not move yet."),
      h("progress", { max: 1, "aria-label": "Planning" }), h("p", { class: "left label" }), wished(plan));
  }

  /** A drawing over the plan, which becomes a part of the goal of another plan. */
  function sketch(plan, use) {
    const sheet = pad({ shape: plan.wish.width / plan.wish.height, background: plan.made ? api.file(here.id, plan.number, "plan.jpg") : "" });
    const back = () => { padPlace.hidden = true; easel.hidden = false; drawn = ""; update(state, "plan"); reveal(panel, panel.querySelector("details[open] [data-kind=sketch]") ?? panel); };
    const done = async () => {
      const blob = await sheet.picture();
      if (!blob) { house.notice("Nothing is drawn yet."); return; }
      if (await use(blob)) back();
    };
    show(padPlace, sheet.element, sheet.tools, h("p", { class: "pair" }, h("button", { type: "button", class: "button", onclick: done }, "Use this drawing"), h("button", { type: "button", class: "quiet", onclick: back }, "Cancel")));
    padPlace.hidden = false;
    easel.hidden = true;
    sheet.open();
  }

  /** Nobody has time for the plan yet. */
  function waiting(plan) {
    const place = h("p", { class: "label" });
    const tell = () => {
      const at = placeOf(house.work.latest, here.id);
      place.textContent = house.work.latest.held ? "The queue was stopped. In the gallery you can let it go on." : at > 1 ? `${at - 1} in the queue before it.` : "It is next.";
    };
    tell();
    stopWaiting = house.work.listen(tell);
    show(panel, h("h1", {}, "Review the plan"), h("p", {}, "The painter is busy with other paintings. This plan waits in the queue and is begun by itself."), place,
      h("p", { "data-for": "plan" }, h("button", { type: "button", class: "button second", onclick: () => unqueue() }, "Remove from the queue")), wished(plan));
  }

  const unqueue = () => house.attempt(() => api.post(`/api/queue/${here.id}/remove`));

  function ready(plan) {
    const again = { ...plan.wish, seed: (Math.max(...state.plans.map((other) => other.wish.seed)) + 1) % 2147483647 };
    show(panel, h("h1", {}, "Review the plan"),
      h("p", {}, "This is what the robot will paint. Move the slider under the canvas to see the plan stroke by stroke."),
      plan.made ? h("p", { class: "label" }, `Painting it takes ${house.pace.known ? "about" : "very roughly"} ${timeOf(plan)}${house.pace.known ? "" : "; nothing was painted here yet from which it could be known"}.`) : null,
      plan.made ? mainAction(h("button", { type: "button", class: "button wide", "data-for": "operate", "aria-keyshortcuts": "u", onclick: () => here.go("prepare") }, `Use plan ${plan.number}`)) : null,
      house.role === "plan" && plan.made ? h("p", { class: "label" }, "You plan here. Somebody who may move the robot starts the painting.") : null,
      h("h2", { "data-for": "plan" }, "Other plans"),
      h("p", { class: "actions-row", "data-for": "plan" },
        h("button", { type: "button", class: "button second", disabled: state.working, "aria-keyshortcuts": "a", onclick: () => another(again) }, "Make another plan"),
        h("button", { type: "button", class: "quiet", disabled: state.working, onclick: () => another(again, null, true) }, variantsInWords(house)),
        plan.wish.variant ? h("button", { type: "button", class: "quiet", disabled: state.working, onclick: () => another({ ...again, variant: "" }) }, "One plan as usual") : null),
      changing(plan), wished(plan), (plan.made?.remarks ?? []).map((sentence) => h("p", { class: "label" }, sentence)),
      plan.made ? [h("h2", {}, "The palette"), paletteList(plan), h("h2", {}, "Downloads"), h("ul", { class: "files" }, TAKEN.map(([name, label]) => h("li", {}, h("a", { href: api.file(here.id, plan.number, name), download: name }, label))))] : null);
  }

  /** A drawing without a goal has no plan: those who may not prepare it are told how it begins. */
  function drawing(plan) {
    show(panel, h("h1", {}, "Draw together"),
      h("p", {}, "There is no plan to review. A person begins with strokes of their own, and the robot continues in their spirit."),
      h("p", {}, "Somebody who may move the robot prepares the easel and starts."),
      h("p", { class: "label" }, summary(plan.wish, plan.made)), h("h2", {}, "The palette"), paletteList(plan));
  }

  /** The planning was stopped, or it failed. */
  function broken(plan) {
    show(panel, h("h1", {}, plan.status === "stopped" ? "You stopped the planning" : "The planning failed"),
      h("p", {}, `Plan ${plan.number} is not finished${plan.status === "stopped" ? "" : "; what went wrong is said above"}.${house.role === "watch" ? "" : " Plan again, or change the goal first."}`),
      mainAction(h("button", { type: "button", class: "button wide", disabled: state.working, "data-for": "plan", "aria-keyshortcuts": "a", onclick: () => another(plan.wish) }, "Plan again")),
      changing(plan), wished(plan));
  }

  function prepare(plan) {
    const boxes = [];
    const allow = () => {
      const all = boxes.every((box) => box.checked);
      start.disabled = state.working || !all;
      first.textContent = all ? (state.stage === "planning" ? "Wait for the other variants, or press Stop." : "") : "Look at the easel first, and tick both boxes.";
    };
    const first = h("p", { class: "label", role: "status" });
    const start = h("button", { type: "button", class: "button wide", disabled: true, onclick: () => {
      start.disabled = true;
      house.attempt(() => api.post(`/api/paintings/${here.id}/start`, { plan: plan.number, ready: true })).then((begun) => { if (!begun) start.disabled = false; });
    } }, "Start painting");
    const check = (text) => {
      const box = h("input", { type: "checkbox", onchange: allow });
      boxes.push(box);
      return h("label", { class: "check" }, box, h("span", {}, text));
    };
    show(panel, h("h1", {}, "Prepare"),
      h("p", {}, `Mix ${count(plan.made.palette.length, "paint", "paints")}. Fill the wells brush by brush, in this order. The virtual studio fills its own wells.`),
      mixingTable(plan),
      h("p", { class: "label" }, "The recipes are for six common acrylics, computed from published pigment data. Test each mixture on paper first."),
      h("p", {}, "To print: ", ...(plan.made.brushes ? ["palette.png", "mixing.png", "shopping.png"] : ["palette.png"]).flatMap((file) => [h("a", { href: api.file(here.id, plan.number, file), download: file }, file.replace(".png", "")), " "])),
      h("div", { class: "checks" }, check("A bare canvas is on the easel."), check("The paints are in their wells. Water and rag are in place.")),
      mainAction(first, start),
      state.stage === "queued"
        ? h("p", { class: "label beneath" }, house.simulated ? "It waits in the queue, and is painted when those before it are done. " : "It waits in the queue. Start it when the easel is free and the canvas is bare. ",
          h("button", { type: "button", class: "quiet", "data-for": "operate", onclick: unqueue }, "Remove from the queue"))
        : h("button", { type: "button", class: "quiet later", "data-for": "operate", onclick: () => later(plan) }, "Paint it after the others (queue)"),
      plan.wish.together ? null : h("p", {}, h("button", { type: "button", class: "quiet", onclick: () => here.go("plan") }, "Back to the plan")));
    return allow;
  }

  const later = (plan) => house.attempt(() => api.post(`/api/paintings/${here.id}/start`, { plan: plan.number, ready: false, wait: true }));

  function update(next, step) {
    state = next;
    const last = /** @type {PlanState} */ (state.plans.at(-1)); // a painting begins with one
    if (chosen === null || last.number > newest) {
      newest = last.number;
      chosen = ordered()[0].number;
    }
    const plan = current();
    if (plan.wish.together && plan.made && step === "plan" && house.role === "operate") { queueMicrotask(() => here.go("prepare")); return; } // there is no plan to review
    const preparing = step === "prepare" && plan.made;
    const key = `${step}/${plan.number}/${plan.status}/${preparing || state.working}/${state.stage === "queued"}`;
    if (key !== drawn) {
      drawn = key;
      stopWaiting();
      allowStart = () => {};
      if (plan.made) { scrub.max = plan.made.strokes; if (step === "prepare" || Number(scrub.value) <= 1) scrub.value = plan.made.strokes; }
      canvas.goal(plan.wish.terms);
      show(goals, goalList(plan.wish.terms));
      if (preparing) allowStart = prepare(plan);
      else if (plan.status === "waiting") waiting(plan);
      else if (plan.status === "planning") planning(plan);
      else if (!plan.made) broken(plan);
      else if (plan.wish.together) drawing(plan);
      else ready(plan);
      if (plan.made) scrubbed();
    }
    allowStart();
    scrubbing.hidden = !plan.made || Boolean(preparing || plan.wish.together);
    strip.hidden = state.plans.length < 2 || Boolean(preparing);
    tellVariants();
    const cards = JSON.stringify(state.plans.map((other) => [other.number, other.status, Math.round(20 * other.share), other.number === chosen]));
    if (cards !== others.dataset.shown) {
      others.dataset.shown = cards;
      show(others, state.plans.map(planCard));
    }
    if (!plan.made) {
      canvas.highlight(null, null);
      canvas.picture("plan", plan.growing ? api.file(here.id, plan.number, plan.growing) : "", "The plan so far");
      const bar = panel.querySelector("progress");
      if (bar) {
        const begun = plan.share >= 0.02;
        if (begun) bar.value = plan.share;
        else bar.removeAttribute("value"); // it moves, but nowhere
        panel.querySelector(".left").textContent = plan !== growing() ? "comes next" : !begun && !(plan.share === 0 && plan.left) ? plan.said || "loading the planner and its networks" : `about ${duration(plan.left)} left`;
      }
    }
    if (!plan.made) canvas.captions({ plan: "The plan as far as it came" });
  }

  return { elements: [strip, easel, padPlace, panel], update, close: () => stopWaiting() };
}
