// Finished paintings of the project, for a gallery that is still empty: a person may paint one of them to begin with.

import * as api from "./api.js";
import { draftIsBegun, fresh, keepDraft } from "./composer.js";
import { h } from "./dom.js";

// frida_painter_studio/examples/README.md says where their pictures come from, and how they were painted.
const EXAMPLES = [
  { name: "coffee", title: "A cup of coffee" },
  { name: "cat", title: "Chelsea the cat" },
  { name: "rocket", title: "Before the launch" },
];
const STROKES = 300;

const goalOf = ({ name }) => `/examples/${name}-goal.jpg`;

/** Puts the goal of an example into the form for a new painting. @param {House} house */
async function take(house, example) {
  if (draftIsBegun() && !window.confirm(`Take the goal of “${example.title}”, and drop the goal that you have begun?`)) return;
  const begun = await house.attempt(async () => {
    const answer = await fetch(goalOf(example));
    if (!answer.ok) throw new Error("The picture of this example is missing; install the program again.");
    const picture = await answer.blob();
    return { id: await api.upload(picture), shape: await shapeOf(picture) };
  });
  if (!begun) return;
  const wish = fresh(house);
  const height = Math.round((10 * wish.width) / begun.shape) / 10;
  keepDraft({ ...wish, title: example.title, strokes: STROKES, height, terms: [{ kind: "image", picture: begun.id, weight: 1 }] });
  location.hash = "#/new";
}

/** Width over height. @param {Blob} picture */
async function shapeOf(picture) {
  const bitmap = await createImageBitmap(picture);
  const shape = bitmap.width / bitmap.height;
  bitmap.close();
  return shape;
}

/** The examples, each with what it was painted from. @param {House} house */
export function exampleShelf(house) {
  const card = (example) => {
    const button = h("button", { type: "button", class: "button second", "data-for": "plan", "aria-label": `Paint this one: ${example.title}`, onclick: async () => {
      button.disabled = true;
      await take(house, example);
      button.disabled = false;
    } }, "Paint this one");
    return h("li", {},
      h("span", { class: "frame" },
        h("img", { src: `/examples/${example.name}.jpg`, alt: `Painting of ${STROKES} strokes: ${example.title}` }),
        h("img", { class: "inset", src: goalOf(example), alt: "The photograph that it was painted from" })),
      h("strong", {}, example.title), h("small", {}, `${STROKES} strokes, painted by the virtual studio`), h("p", {}, button));
  };
  return h("section", { class: "examples", "aria-labelledby": "examples-title" },
    h("h2", { id: "examples-title" }, "Nothing is painted here yet. Begin with one of these:"), h("ul", { class: "shelf" }, EXAMPLES.map(card)));
}
