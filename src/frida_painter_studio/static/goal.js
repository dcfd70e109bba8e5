// A goal on the page: its kinds, the picture or words that stand for it, and the list of all its parts.

import * as api from "./api.js";
import { smallCrop } from "./crop.js";
import { h } from "./dom.js";

/** @type {Record<string, { label: string; verb: string; button: string; words?: boolean }>} */
export const KINDS = {
  text: { label: "Text", verb: "Paint this text", button: "Text", words: true },
  image: { label: "Picture", verb: "Paint this picture", button: "Picture" },
  style: { label: "Style", verb: "Use the style of this picture", button: "Style" },
  sketch: { label: "Drawing", verb: "Follow the lines of this drawing", button: "Drawing" },
  semantic: { label: "Picture content", verb: "Paint what this picture shows, not its pixels", button: "Picture content" },
};

/** Adds the kinds of goals that the studio knows from other packages. @param {Record<string, Ability>} abilities */
export function learnKinds(abilities) {
  for (const [kind, { label, verb, words }] of Object.entries(abilities)) KINDS[kind] ??= { label, verb, button: label, words };
}

const FIRST = ["image", "sketch", "semantic", "text", "style"]; // what stands for a goal of several parts

/** Weights that a person can choose, with their words. @type {[number, string][]} */
export const weights = [[0.2, "very low"], [0.5, "low"], [1, "normal"], [2, "high"], [5, "very high"]];

/** The index of the weight that is nearest to a number. @param {number} weight */
export const nearestWeight = (weight) =>
  weights.reduce((best, [known], index) => (Math.abs(Math.log(known / weight)) < Math.abs(Math.log(weights[best][0] / weight)) ? index : best), 0);

/** The part that stands for the whole goal; a text counts once it has words. @param {Term[]} terms */
export const mainTerm = (terms) => [...new Set([...FIRST, ...Object.keys(KINDS)])].map((kind) => terms.find((term) => term.kind === kind && (term.picture || term.words?.trim()))).find(Boolean);

/** The small picture of a part of a goal, as it is cropped. @param {Term} term @param {string} alt */
export const termPicture = (term, alt) => h("img", { src: api.picture(term.picture), alt, style: smallCrop(term.crop) });

/** All parts of a goal, each with its picture, what is done with it, and its weight where there are several. @param {Term[]} terms */
export function goalList(terms) {
  if (!terms.length) return h("p", {}, "No goal: you draw together, and the robot continues in the spirit of your strokes.");
  return h("ul", { class: "terms goal-list", "aria-label": "The goal" }, terms.map((term) => h("li", {},
    term.picture ? termPicture(term, KINDS[term.kind]?.label ?? term.kind) : h("span", { class: "quote", "aria-hidden": "true" }, "“"),
    h("div", {}, h("p", {}, term.words ?? KINDS[term.kind]?.verb ?? term.kind), term.made ? h("small", {}, `${term.made}. `) : null,
      terms.length > 1 ? h("small", {}, `weight: ${weights[nearestWeight(term.weight)][1]}`) : null))));
}
