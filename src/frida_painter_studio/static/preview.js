// The goal as it will lie on the canvas, while a person puts it together: the photograph as it is cropped, which can be moved
// and zoomed; a drawing over it; and in words what else counts.

import * as api from "./api.js";
import { largestCrop, moveCrop, reshapeCrop, sentCrop, showCrop, zoomCrop, zoomOf } from "./crop.js";
import { h, show } from "./dom.js";
import { mainTerm, termPicture } from "./goal.js";

const ARROWS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const CENTER = [0.5, 0.5];
const HELP = "The arrow keys move the picture under the canvas (Shift: further), + and - zoom, 0 shows all of it.";
const NAMES = { image: "a picture", style: "the style of a picture", sketch: "a drawing", semantic: "the content of a picture" };

/**
 * What lies on the canvas, and what is told under it. `changed` is called when a person has cropped the picture.
 * @param {Wish} wish @param {() => void} changed
 */
export function goalPreview(wish, changed) {
  const image = h("img", { alt: "The picture to paint", draggable: false });
  const over = h("img", { class: "over", alt: "Your drawing over it", hidden: true });
  const view = h("div", { class: "crop-view", tabIndex: 0, role: "application", "aria-label": `The picture on the canvas. ${HELP}` }, image, over);
  const amount = h("span", {});
  const button = (label, name, work) => h("button", { type: "button", class: "quiet", "aria-label": name, onclick: work }, label);
  const zoom = h("span", { class: "zoom", role: "group", "aria-label": "Crop the picture" },
    button("−", "Zoom out", () => take(zoomCrop(crop, 1 / 1.25, CENTER, largest))), amount,
    button("+", "Zoom in", () => take(zoomCrop(crop, 1.25, CENTER, largest))), button("Show all of it", "Show all of the picture", () => take(largest)));
  const parts = h("span", { class: "parts" });
  const element = h("div", { class: "preview-caption" }, zoom, parts, h("p", { class: "unseen", role: "status" }));
  const said = element.querySelector("p");
  const touching = new Map(); // pointers, by id, where they are on the screen
  let term = null; // what is cropped
  let crop = [0, 0, 1, 1];
  let largest = crop;
  let picture = 0; // its shape, 0 as long as it is not here

  const canvasShape = () => wish.width / wish.height;

  function draw() {
    showCrop(image, crop);
    const scale = zoomOf(crop, largest);
    amount.textContent = `${Math.round(100 * scale)} %`;
    view.classList.toggle("fixed", crop[3] > 0.9999); // a finger moves the page then
    view.classList.toggle("loose", crop[2] < 0.9999 || crop[3] < 0.9999);
  }

  /** Shows a part of the picture; it is the goal when the person has `done`. */
  function take(next, done = true) {
    if (!picture || !term) return;
    crop = next;
    draw();
    if (!done) return;
    term.crop = sentCrop(crop, largest);
    if (said) said.textContent = term.crop ? `Cropped: ${Math.round(100 * crop[2])} % of its width and ${Math.round(100 * crop[3])} % of its height, beginning ${Math.round(100 * crop[0])} % from the left and ${Math.round(100 * crop[1])} % from the top` : "The picture as large as it fits";
    changed();
  }

  image.addEventListener("load", () => { picture = image.naturalWidth / image.naturalHeight; fit(); });

  /** After the canvas or the picture has changed. */
  function fit() {
    if (!picture || !term) return;
    largest = largestCrop(picture, canvasShape());
    crop = term.crop ? reshapeCrop(term.crop, picture, canvasShape()) : largest;
    term.crop = sentCrop(crop, largest);
    draw();
  }

  const inWindow = ([x, y]) => {
    const box = view.getBoundingClientRect();
    return [(x - box.left) / box.width, (y - box.top) / box.height];
  };
  view.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    view.setPointerCapture(event.pointerId);
    touching.set(event.pointerId, [event.clientX, event.clientY]);
  });
  view.addEventListener("pointermove", (event) => {
    if (!touching.has(event.pointerId)) return;
    const before = [...touching.values()].map(inWindow);
    touching.set(event.pointerId, [event.clientX, event.clientY]);
    const after = [...touching.values()].map(inWindow);
    const middle = (points) => [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
    const spread = (/** @type {number[][]} */ [a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
    const [from, to] = [middle(before), middle(after)];
    const moved = moveCrop(crop, to[0] - from[0], to[1] - from[1]);
    take(after.length === 2 ? zoomCrop(moved, spread(after) / Math.max(1e-6, spread(before)), to, largest) : moved, false);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    view.addEventListener(end, (event) => { if (touching.delete(event.pointerId)) take(crop); });
  }
  view.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && document.activeElement !== view) return; // the page scrolls
    event.preventDefault();
    take(zoomCrop(crop, Math.exp(-event.deltaY / (event.ctrlKey ? 200 : 600)), inWindow([event.clientX, event.clientY]), largest));
  }, { passive: false });
  view.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = ARROWS[event.key];
    const by = event.shiftKey ? 0.1 : 0.02;
    if (arrow) take(moveCrop(crop, by * arrow[0], by * arrow[1]));
    else if (event.key === "+" || event.key === "=") take(zoomCrop(crop, 1.25, CENTER, largest));
    else if (event.key === "-") take(zoomCrop(crop, 1 / 1.25, CENTER, largest));
    else if (event.key === "0") take(largest);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });

  /** What counts beside what is shown. @param {Term[]} terms */
  function tellParts(terms) {
    const more = terms.filter((each) => each !== term && (each.picture || each.words?.trim()) && each.words !== words.textContent);
    show(parts, more.length ? "With " : null, more.flatMap((each, index) => [
      index ? (index === more.length - 1 ? " and " : ", ") : null,
      each.words ? h("q", {}, each.words.trim()) : h("span", { class: "part" }, termPicture(each, ""), NAMES[each.kind] ?? each.kind)]));
  }

  const words = h("p", { class: "words" });

  /** Shows the goal as it is now in the canvas; false if there is nothing to show. @param {HTMLElement} mount */
  function update(mount) {
    const main = mainTerm(wish.terms);
    term = main?.picture ? main : null;
    words.textContent = main?.words?.trim() ?? "";
    const sketch = term?.kind === "image" ? wish.terms.find((each) => each.kind === "sketch") : undefined;
    over.hidden = !sketch;
    if (sketch?.picture && over.dataset.id !== sketch.picture) { over.dataset.id = sketch.picture; over.src = api.picture(sketch.picture); }
    const shown = term ? view : main ? words : null;
    if (shown && shown.parentElement !== mount) show(mount, shown);
    if (term && image.dataset.id !== term.picture) {
      image.dataset.id = term.picture ?? "";
      picture = 0;
      showCrop(image, null);
      image.src = api.picture(term.picture);
    }
    fit();
    zoom.hidden = !term;
    tellParts(wish.terms);
    return Boolean(shown);
  }

  return { element, update };
}
