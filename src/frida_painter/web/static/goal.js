// A goal on the page: its kinds, the picture or words that stand for it, and the list of all its parts.

import * as api from "./api.js";
import { h } from "./dom.js";

export const KINDS = {
  text: { label: "Text", verb: "Paint this text", button: "Text" },
  image: { label: "Picture", verb: "Paint this picture", button: "Picture" },
  style: { label: "Style", verb: "Use the style of this picture", button: "Style" },
  sketch: { label: "Drawing", verb: "Follow the lines of this drawing", button: "Drawing" },
  semantic: { label: "Picture content", verb: "Paint what this picture shows, not its pixels", button: "Picture content" },
};
const FIRST = ["image", "sketch", "semantic", "text", "style"]; // what stands for a goal of several parts

/** Weights that a person can choose, with their words. @type {[number, string][]} */
export const weights = [[0.2, "very low"], [0.5, "low"], [1, "normal"], [2, "high"], [5, "very high"]];

/** The index of the weight that is nearest to a number. @param {number} weight */
export const nearestWeight = (weight) =>
  weights.reduce((best, [known], index) => (Math.abs(Math.log(known / weight)) < Math.abs(Math.log(weights[best][0] / weight)) ? index : best), 0);

/** The part that stands for the whole goal; a text counts once it has words. @param {Term[]} terms */
export const mainTerm = (terms) => FIRST.map((kind) => terms.find((term) => term.kind === kind && (term.picture || term.words?.trim()))).find(Boolean);

/** All parts of a goal, each with its picture, what is done with it, and its weight where there are several. @param {Term[]} terms */
export function goalList(terms) {
  return h("ul", { class: "terms goal-list", "aria-label": "The goal" }, terms.map((term) => h("li", {},
    term.picture ? h("img", { src: api.picture(term.picture), alt: KINDS[term.kind]?.label ?? term.kind }) : h("span", { class: "quote", "aria-hidden": "true" }, "“"),
    h("div", {}, h("p", {}, term.words ?? KINDS[term.kind]?.verb ?? term.kind),
      terms.length > 1 ? h("small", {}, `weight: ${weights[nearestWeight(term.weight)][1]}`) : null))));
}
