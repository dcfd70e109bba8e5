// What a real camera sees now, beside the painting; nothing where it is not one that always has a picture.

import { h } from "./dom.js";

const BETWEEN = 1000; // ms
const RARELY = 15; // times as long, where there was none

/** @param {House} house @param {string} id of the painting */
export function liveCamera(house, id) {
  const image = h("img", { alt: "What the camera sees now" });
  const element = h("figure", { class: "from-camera", hidden: true }, image, h("figcaption", {}, "The camera, live"));
  let timer = 0;
  let asked = 0;
  let closed = false;

  function again(after) {
    clearTimeout(timer);
    if (!closed) timer = setTimeout(ask, after);
  }

  function ask() {
    if (document.visibilityState !== "visible") { again(BETWEEN); return; }
    asked += 1;
    image.src = `/api/paintings/${id}/camera?${asked}`;
  }
  image.addEventListener("load", () => { element.hidden = false; again(BETWEEN); });
  image.addEventListener("error", () => { element.hidden = true; again(RARELY * BETWEEN); });
  if (house.camera) ask();
  return { element, close: () => { closed = true; clearTimeout(timer); } };
}
