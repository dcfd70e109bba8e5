// "Change it by words": pictures that begin from the canvas are made, and the rest is planned towards the chosen one.

import * as api from "./api.js";
import { h } from "./dom.js";
import { makerChoice, shelfOf } from "./imagining.js";

/**
 * The form of a pause, with the pictures to choose from. `say` sends a command to the painter.
 * @param {House} house @param {Here} here @param {(command: Command) => Promise<any>} say
 */
export function byWords(house, here, say) {
  let typed = ""; // kept while the form is drawn anew
  let maker = house.makers[0];
  const said = h("p", { class: "label", role: "status" });

  async function choose(/** @type {string} */ picture) {
    const taken = await house.attempt(() => api.post(`/api/paintings/${here.id}/choose`, { picture }));
    if (!taken) return;
    const terms = [{ kind: "image", picture: taken.id, weight: 1, made: taken.made }];
    if (await say({ kind: "goal", terms, initial: [] })) typed = "";
  }

  function shelf(/** @type {PaintState} */ painting) {
    const { proposed } = painting.wishes;
    if (!proposed) return null;
    return h("div", {}, h("p", { role: "status" }, `“${proposed.words}”: choose the picture to paint from here on, ask for others, or continue without.`),
      proposed.faults.length ? h("p", { class: "label" }, proposed.faults.join(" ")) : null,
      shelfOf(proposed.words, proposed.pictures, {
        source: (picture) => api.file(here.id, "live", picture), choose: (picture) => choose(picture),
        name: (one, index) => `Paint towards picture ${index + 1} of ${proposed.pictures.length}, seed ${one.seed}`,
      }));
  }

  /** The place in a pause; nothing if no maker is allowed here. @param {PaintState} painting */
  function place(painting) {
    if (!house.makers.length) return null;
    const go = h("button", { type: "submit", class: "button second wide" }, painting.wishes.proposed ? "Make other pictures" : "Make pictures from the canvas");
    const field = h("input", { type: "text", maxLength: 300, value: typed, placeholder: "make it a stormy sea", "aria-label": "What shall change", oninput: (event) => { typed = event.target.value; go.disabled = !typed.trim(); } });
    const names = makerChoice(house, maker, (name) => { maker = name; });
    go.disabled = !typed.trim();
    const form = h("form", { class: "stack", onsubmit: (event) => { event.preventDefault(); if (typed.trim()) say({ kind: "propose", words: typed.trim(), maker }); } }, field, names, go);
    return h("details", { open: Boolean(painting.wishes.proposed || typed) }, h("summary", {}, "Change it by words"),
      h("p", {}, "A picture maker proposes pictures that begin from the canvas as it is. What you painted stays."), shelf(painting), form);
  }

  /** What stands in a pause while pictures are made. @param {PaintState} painting */
  const making = (painting) => h("div", { class: "making" }, h("p", {}, `Pictures of “${painting.wishes.request.words}” are being made from the canvas.`),
    h("progress", { "aria-label": "Making pictures from the canvas" }), said,
    h("button", { type: "button", class: "quiet", onclick: () => say({ kind: "end making" }) }, "Stop making pictures"));

  /** Tells the progress of a making. @param {PaintState} painting */
  const tell = (painting) => { said.textContent = painting.said; };

  return { place, making, tell };
}
