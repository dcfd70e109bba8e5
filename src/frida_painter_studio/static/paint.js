// "Paint": the live picture of the easel over plan and goal, stroke by stroke, and what every look has changed.

import * as api from "./api.js";
import { canvasView } from "./canvasview.js";
import { count, duration, h, show } from "./dom.js";
import { easelState } from "./easelstate.js";
import { goalList } from "./goal.js";
import { ask, mayAsk } from "./needs.js";
import { togetherTools } from "./tools.js";

const WORDS = {
  preparing: "getting ready", mixing: "waiting for the paints", painting: "painting", drying: "letting the paint dry", planning: "looking at the canvas and replanning",
  paused: "paused", finishing: "making the timelapse film and the page", stopped: "stopped", finished: "finished", failed: "failed",
};

const WHY = {
  region: "It replanned the rest so that no stroke touches the protected part.",
  only: "It replanned the rest so that all strokes lie in the marked part.",
  freed: "The protection is removed, and it replanned the rest.",
  goal: "The goal has changed, and it replanned the rest.",
  asked: "You asked for a look, and it replanned the rest.",
  "": "It replanned the rest.",
};

/**
 * What came of a look. `why` is what a person had asked for before it ("" for a look of its own); the loss of `planned`
 * tells by which share of what was missing the new rest comes nearer to the goal than the old one; null where there is no
 * new one (yet). Without a goal (`together`) there is nothing to come nearer to.
 * @param {Pick<Look, "why" | "planned">} look @param {boolean} together
 */
export function outcome({ why, planned }, together = false) {
  if (!planned?.look || together) return "";
  const gain = planned.loss_before > 0 ? 1 - planned.loss_after / planned.loss_before : 0;
  const share = Math.round(100 * Math.abs(gain));
  const goal = why === "goal" ? "the new goal" : "the goal";
  const compared = share === 0 ? `The new strokes come as close to ${goal} as the old ones.`
    : gain > 0 ? `The new strokes come ${share} % closer to ${goal} than the old ones.`
      : `The new strokes end ${share} % farther from ${goal} than the old ones${why === "region" || why === "only" ? ", because a part is left out" : ""}.`;
  return `${WHY[why] ?? WHY[""]} ${compared}`;
}

const BETWEEN = 1000; // ms
const RARELY = 15; // times as long, where there was none

/**
 * What a real camera sees now, beside the painting; nothing where it is not one that always has a picture.
 * @param {House} house @param {string} id of the painting
 */
function liveCamera(house, id) {
  const image = h("img", { alt: "What the camera sees now" });
  const element = h("figure", { class: "from-camera", hidden: true }, image, h("figcaption", {}, "The camera, live"));
  let timer = 0;
  let asked = 0;
  let closed = false;

  function again(after) {
    clearTimeout(timer);
    if (!closed) timer = setTimeout(ask, after);
  }

  function ask() {
    if (document.visibilityState !== "visible") { again(BETWEEN); return; }
    asked += 1;
    image.src = `/api/paintings/${id}/camera?${asked}`;
  }
  image.addEventListener("load", () => { element.hidden = false; again(BETWEEN); });
  image.addEventListener("error", () => { element.hidden = true; again(RARELY * BETWEEN); });
  if (house.camera) ask();
  return { element, close: () => { closed = true; clearTimeout(timer); } };
}

/** @param {House} house @param {Here} here @param {State & { painting: PaintState }} first */
export function paintStage(house, here, first) {
  const { wish } = /** @type {PlanState} */ (first.plans.find((plan) => plan.number === first.painting.plan));
  const canvas = canvasView(wish, ["goal", "plan", "painting"]);
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Strokes painted" });
  const said = h("p", { class: "status", role: "status" });
  const left = h("p", { class: "label" });
  const looks = h("ol", { class: "looks" });
  const parts = easelState(house.simulated ? "Simulated robot" : `Robot ${house.robot.split(":")[0]}`);
  const live = liveCamera(house, here.id);
  const easel = h("div", { class: "easel" }, canvas.element, canvas.slider, canvas.caption, parts.element, live.element);
  const padPlace = h("div", { class: "easel", hidden: true });
  const tools = togetherTools(house, here, wish, (drawing) => {
    show(padPlace, drawing);
    padPlace.hidden = !drawing;
    easel.hidden = Boolean(drawing);
  });
  const goals = h("div", {});
  const tellMe = h("button", { type: "button", class: "quiet", hidden: !mayAsk(), onclick: async () => { await ask(); tellMe.hidden = !mayAsk(); } }, "Notify me when I am needed");
  const panel = h("div", { class: "panel" }, h("h1", {}, "Paint together"), bar, said, left, tools.element, tellMe, h("h2", {}, "The goal"), goals, h("h2", {}, "Camera views"), looks);
  /** @type {{ key: string, paths: Strokes | null, palette: Paint[], from: number, place: string | number, prefix: string }} */
  let strokes = { key: "", paths: null, palette: [], from: 0, place: "", prefix: "" };
  let shownLooks = "";
  let shownGoal = "";

  /** The strokes that are being painted: of the first plan, or of the one made at the last look. */
  async function followPlan(state) {
    const { painting } = state;
    const { replanned } = painting.planning;
    const source = replanned
      ? { key: replanned.shown.prefix, place: "live", ...replanned.shown, from: replanned.done }
      : ((base) => ({ key: "first", place: base.number, prefix: base.made.prefix, palette: base.made.palette, from: 0, frames: base.made.frames }))(state.plans.find((each) => each.number === painting.plan));
    if (source.key === strokes.key) return;
    strokes = { ...source, paths: null };
    strokes.paths = await api.get(api.file(here.id, source.place, `${source.prefix}strokes.json`)).catch(() => null);
  }

  function lookCard(/** @type {Look} */ look) {
    const picture = (name, words) => h("figure", {}, h("img", { src: api.file(here.id, name === "found" ? "live" : "painting", name === "found" ? look.found : look.pictures[name]), alt: `${words}, after ${look.done} strokes`, loading: "lazy" }), h("figcaption", {}, words));
    const came = outcome(look, wish.together);
    return h("li", {}, h("h3", {}, `After ${count(look.done, "stroke", "strokes")}`), came ? h("p", {}, came) : null, ...look.touch.map((sentence) => h("p", {}, sentence)),
      h("div", { class: "trio" }, picture("expected", "Expected"), picture("seen", "Seen"), look.found ? picture("found", "What you painted") : picture("difference", "Difference")));
  }

  function update(state) {
    const { painting } = state;
    const { progress, pictures, wishes } = painting;
    const dries = (progress.drying?.left ?? 0) * progress.pace;
    bar.value = progress.of ? progress.painted / progress.of : 0;
    const wait = painting.status === "drying" && dries ? `, ${duration(dries)} more` : "";
    bar.hidden = wish.together;
    said.textContent = wish.together ? `${progress.painted ? `${count(progress.painted, "stroke", "strokes")} of the robot; ` : ""}${wishes.pause?.cause === "turn" && painting.status === "paused" ? "your turn" : WORDS[painting.status] ?? ""}${wait}` : painting.status === "painting" ? `Stroke ${progress.painted} of ${progress.of}` : `${progress.painted ? `Stroke ${progress.painted} of ${progress.of}: ` : ""}${WORDS[painting.status] ?? ""}${wait}`;
    left.textContent = painting.left && !["finishing", "paused"].includes(painting.status) ? `about ${duration(painting.left)} left` : painting.status === "preparing" ? painting.said : "";
    if (pictures.photograph) canvas.picture("painting", api.shown(here.id, pictures.photograph), `The canvas after ${progress.painted} strokes`);
    const next = painting.status === "painting" ? ", and the next stroke" : "";
    canvas.captions({
      plan: wish.together ? "The canvas as it began" : pictures.photograph || !house.watched ? "The plan" : "The plan. The first photograph of the easel comes soon.",
      painting: house.watched ? `The easel, as it was photographed last${next}` : `There is no camera: the canvas as it should look now${next}`,
    });
    const region = wishes.region ? api.file(here.id, "regions", wishes.region.drawing) : "";
    canvas.region(region, wishes.region?.only);
    const terms = wishes.goals.at(-1)?.wish.terms ?? wish.terms;
    const goal = JSON.stringify(terms);
    if (goal !== shownGoal) {
      shownGoal = goal;
      canvas.goal(terms);
      show(goals, goalList(terms));
    }
    followPlan(state).then(() => {
      const growing = painting.status === "planning" && painting.planning.growing;
      canvas.picture("plan", growing ? api.file(here.id, "live", painting.planning.growing) : api.file(here.id, strokes.place, `${strokes.prefix}plan.jpg`), "The plan");
      const index = progress.painted - strokes.from;
      const paint = strokes.paths && strokes.palette[strokes.paths.paint[index]];
      canvas.highlight(strokes.paths, painting.status === "painting" ? index : null, paint?.hex);
    });
    parts.update(painting, state.plans.find((each) => each.number === painting.plan).made.palette);
    tools.update(state);
    const key = JSON.stringify(pictures.looks);
    if (key !== shownLooks) {
      shownLooks = key;
      show(looks, pictures.looks.length ? [...pictures.looks].reverse().map(lookCard) : h("li", { class: "label" }, house.watched ? "No look yet: the robot has not compared the canvas with the plan." : "There is no camera. Nobody looks at the canvas, and the plan is painted as it is."));
    }
  }

  return { elements: [easel, padPlace, panel], update, close: live.close };
}
