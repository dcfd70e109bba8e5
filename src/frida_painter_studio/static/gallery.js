// The gallery: every painting that was begun in this studio, and what waits for the painter.

import * as api from "./api.js";
import { h, show, svg } from "./dom.js";
import { exampleShelf } from "./examples.js";
import { queueList } from "./queue.js";

// The words of each stage, and its mark: `busy` works, `waiting` has its turn later, `yours` needs a person.
export const STAGES = {
  planning: ["being planned", "busy"], "plan stopped": ["planning stopped", "stopped"], "plan failed": ["planning failed", "failed"],
  planned: ["planned", "yours"], waiting: ["waits to be planned", "waiting"], queued: ["waits to be painted", "waiting"],
  preparing: ["starting", "busy"], mixing: ["being painted", "busy"], drying: ["being painted", "busy"], painting: ["being painted", "busy"],
  replanning: ["being painted", "busy"], paused: ["paused", "yours"], finishing: ["making the film", "busy"],
  finished: ["finished", "done"], stopped: ["stopped", "stopped"], failed: ["failed", "failed"], lost: ["its folder was deleted", "failed"],
  reading: ["being read", "waiting"],
};
// Each mark has a shape too, for those who see no difference of colours.
export const SHAPES = {
  busy: "M8 2a6 6 0 1 0 6 6M8 5v3l2 2", waiting: "M5 3h6M5 13h6M6 3c0 3 4 7 4 10M10 3c0 3-4 7-4 10", yours: "M8 2l6 6-6 6-6-6z",
  done: "M3 8.5l3.5 3.5L13 4.5", stopped: "M4 4h8v8H4z", failed: "M8 2.5l6 11H2zM8 7v3M8 11.8v.2",
};

/** @param {House} house */
export function gallery(house) {
  const shelf = h("ul", { class: "shelf", "aria-busy": "true" });
  const queue = queueList(house);
  const examples = h("div", { hidden: true });
  const element = h("section", { class: "gallery" },
    h("div", { class: "welcome" },
      h("p", { class: "label" }, "The studio"),
      h("h1", {}, "What do you want to paint?"),
      h("p", { class: "lede" }, house.role === "watch" ? "Here you see how the robot plans and paints, stroke by stroke." : "Set a goal. The robot plans every stroke and shows you the plan. Then you paint it together."),
      house.role === "watch" ? h("p", {}, "You may watch here, and stop everything. To paint, ask whoever opened the studio for another link.")
        : h("p", {}, h("a", { class: "button", href: "#/new" }, "Start a painting"))),
    queue.element, examples, shelf);
  let shown = "", again = 0;

  const fill = () => house.attempt(async () => {
    const paintings = await api.get("/api/paintings");
    clearTimeout(again);
    if (paintings.some((/** @type {{ stage: string }} */ one) => one.stage === "reading")) again = setTimeout(fill, 500); // long ones, or many
    const key = JSON.stringify(paintings);
    if (key === shown) return;
    shown = key;
    show(shelf, paintings.map(card));
    if (!paintings.length && !examples.hasChildNodes()) show(examples, exampleShelf(house)); // only then are their pictures fetched
    examples.hidden = paintings.length > 0;
    shelf.removeAttribute("aria-busy");
  });
  function hear(work) {
    queue.update(work);
    fill();
  }
  hear(house.work.latest);
  const deaf = house.work.listen(hear);
  return { element, close() { deaf(); clearTimeout(again); } };
}

function card(painting) {
  const [words, mark] = STAGES[painting.stage] ?? [painting.stage, "waiting"];
  const stage = `${words}${painting.stage === "lost" && painting.working ? ", but it is being painted" : ""}`;
  const [place, name] = (painting.picture ?? "/").split("/");
  const begun = new Date(painting.begun).toLocaleDateString(undefined, { day: "numeric", month: "long", year: "numeric" });
  return h("li", {}, h("a", { href: `#/p/${painting.id}` },
    h("span", { class: "frame" }, painting.picture
      ? h("img", { src: api.file(painting.id, place, name), alt: "", loading: "lazy" })
      : h("span", { class: "bare" })),
    h("strong", {}, painting.title),
    h("small", { class: "about" }, h("span", { class: "stage", "data-mark": mark }, svg("svg", { viewBox: "0 0 16 16", "aria-hidden": "true" }, svg("path", { d: SHAPES[mark] })), stage), begun)));
}
