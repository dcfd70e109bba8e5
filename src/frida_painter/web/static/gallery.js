// The gallery: every painting that was begun in this studio, and what waits for the painter.

import * as api from "./api.js";
import { h, show } from "./dom.js";
import { queueList } from "./queue.js";

const STAGES = {
  planning: "being planned", planned: "planned", waiting: "waits to be planned", preparing: "starting", mixing: "being painted", drying: "being painted", painting: "being painted",
  paused: "paused", finishing: "making the film", finished: "", stopped: "stopped", failed: "failed",
};

/** @param {House} house */
export function gallery(house) {
  const shelf = h("ul", { class: "shelf", "aria-busy": "true" });
  const queue = queueList(house);
  const element = h("section", { class: "gallery" },
    h("div", { class: "welcome" },
      h("p", { class: "label" }, "The studio"),
      h("h1", {}, "What do you want to paint?"),
      h("p", { class: "lede" }, "Set a goal. The robot plans every stroke and shows you the plan. Then you paint it together."),
      h("p", {}, h("a", { class: "button", href: "#/new" }, "Start a painting"))),
    queue.element, shelf);
  let shown = "";

  const fill = () => house.attempt(async () => {
    const paintings = await api.get("/api/paintings");
    const key = JSON.stringify(paintings);
    if (key === shown) return;
    shown = key;
    show(shelf, paintings.map(card));
    shelf.removeAttribute("aria-busy");
  });
  function hear(work) {
    queue.update(work);
    fill();
  }
  hear(house.work.latest);
  const close = house.work.listen(hear);
  return { element, close };
}

function card(painting) {
  const stage = STAGES[painting.stage] ?? "";
  const [place, name] = (painting.picture ?? "/").split("/");
  const begun = new Date(painting.begun).toLocaleDateString(undefined, { day: "numeric", month: "long", year: "numeric" });
  return h("li", {}, h("a", { href: `#/p/${painting.id}` },
    h("span", { class: "frame" }, painting.picture
      ? h("img", { src: api.file(painting.id, place, name), alt: "", loading: "lazy" })
      : h("span", { class: "bare" })),
    h("strong", {}, painting.title),
    h("small", {}, [begun, stage].filter(Boolean).join(" · "))));
}
