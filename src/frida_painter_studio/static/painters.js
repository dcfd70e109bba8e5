// Who painted what: the painting with the robot's part in blue and the person's in orange; a pixel tells its stroke.

import { h } from "./dom.js";

const NAMES = { robot: "the robot", person: "you", bare: "bare canvas" };

/**
 * The owner of a pixel in the runs of its row: 0 for bare canvas, n for the robot's stroke n, -n for the person's stroke n.
 * @param {number[][]} runs @param {number} column
 */
export function ownerAt(runs, column) {
  let passed = 0;
  for (const [owner, pixels] of runs) {
    passed += pixels;
    if (column < passed) return owner;
  }
  return 0;
}

/** Who painted a pixel, in words. @param {number} owner */
export const ownerWords = (owner) => (owner ? `Stroke ${Math.abs(owner)} of ${owner > 0 ? NAMES.robot : "yours"}` : "Bare canvas");

/** The view. @param {(name: string) => string} place of the files of the painting @param {(path: string) => Promise<any>} load */
export function whoPainted(place, load) {
  const said = h("p", { class: "label", role: "status" }, "Point at the picture to see whose stroke it is.");
  const picture = h("img", { src: place("painters.png"), alt: "The painting: the robot's part is blue, the person's part orange", loading: "lazy" });
  const key = h("p", { class: "caption painters-key" });
  const view = h("figure", { class: "painters" }, h("h2", {}, "Who painted what"), picture, key, said);
  let told = null;
  load(place("painters.json")).then((found) => {
    told = found;
    key.append(...["robot", "person", "bare"].map((painter) => h("span", { class: painter }, `${NAMES[painter]}: ${Math.round(100 * found.shares[painter])} % `)));
  }).catch(() => {});
  picture.addEventListener("pointermove", (event) => {
    if (!told) return;
    const box = picture.getBoundingClientRect();
    const row = Math.floor(((event.clientY - box.top) / box.height) * told.rows);
    const column = Math.floor(((event.clientX - box.left) / box.width) * told.columns);
    said.textContent = ownerWords(ownerAt(told.owner[Math.min(told.rows - 1, Math.max(0, row))], column));
  });
  return view;
}
