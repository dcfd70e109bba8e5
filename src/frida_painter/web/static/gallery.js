// The gallery: every painting that was begun in this studio.

import * as api from "./api.js";
import { h, show } from "./dom.js";

const STAGES = {
  planning: "being planned", planned: "planned", preparing: "about to begin", mixing: "being painted", painting: "being painted",
  paused: "paused", finishing: "nearly done", finished: "", stopped: "stopped", failed: "broken off",
};

export function gallery(house) {
  const shelf = h("ul", { class: "shelf", "aria-busy": "true" });
  const element = h("section", { class: "gallery" },
    h("div", { class: "welcome" },
      h("p", { class: "label" }, "The studio"),
      h("h1", {}, "What shall we paint?"),
      h("p", { class: "lede" }, "Say what you would like to see. The robot plans every stroke and shows you, and when you are ready, you paint it together."),
      h("p", {}, h("a", { class: "button", href: "#/new" }, "Begin a painting"))),
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
