// The gallery: every painting that was begun in this studio.

import * as api from "./api.js";
import { h, show } from "./dom.js";

const STAGES = {
  planning: "being planned", planned: "planned", preparing: "starting", mixing: "being painted", painting: "being painted",
  paused: "paused", finishing: "making the film", finished: "", stopped: "stopped", failed: "failed",
};

export function gallery(house) {
  const shelf = h("ul", { class: "shelf", "aria-busy": "true" });
  const element = h("section", { class: "gallery" },
    h("div", { class: "welcome" },
      h("p", { class: "label" }, "The studio"),
      h("h1", {}, "What do you want to paint?"),
      h("p", { class: "lede" }, "Set a goal. The robot plans every stroke and shows you the plan. Then you paint it together."),
      h("p", {}, h("a", { class: "button", href: "#/new" }, "Start a painting"))),
    shelf);
  house.attempt(async () => {
    const paintings = await api.get("/api/paintings");
    show(shelf, paintings.map(card));
    shelf.removeAttribute("aria-busy");
  });
  return { element };
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
