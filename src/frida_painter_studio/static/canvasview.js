// The canvas in the middle of the page: goal, plan and painting over each other, with a slider that fades from one to the
// next, and over them the stroke that is meant and the part that is protected. The caption tells of the layer that is seen.

import * as api from "./api.js";
import { showCrop } from "./crop.js";
import { h, svg } from "./dom.js";
import { mainTerm } from "./goal.js";

const TITLES = { goal: "Goal", plan: "Plan", painting: "Painting" };

/** Gives an element the shape of the canvas. @param {HTMLElement} element @param {Wish} wish */
export function shape(element, wish) {
  element.style.aspectRatio = `${wish.width} / ${wish.height}`;
  element.style.setProperty("--shape", String(wish.width / wish.height));
}

/** How much each of `count` layers is seen, from the lowest, where the slider stands at `value` in [0, count - 1]. */
export const opacities = (count, value) => Array.from({ length: count }, (_, index) => (index ? Math.min(1, Math.max(0, value - index + 1)) : 1));

/** @param {Wish} wish @param {("goal" | "plan" | "painting")[]} names from the lowest layer to the highest */
export function canvasView(wish, names) {
  const layers = Object.fromEntries(names.map((name) => [name, { element: h("img", { alt: "", class: "picture" }), shown: "", wanted: "", caption: "" }]));
  const caption = h("p", { class: "caption" });
  const words = h("p", { class: "words layer", hidden: true });
  const overlay = svg("svg", { class: "overlay", "aria-hidden": "true" });
  const hatching = h("div", { class: "hatching", hidden: true });
  const element = h("div", { class: "mount" }, names.flatMap((name) => [layers[name].element, name === "goal" ? words : null]), hatching, overlay);
  shape(element, wish);
  const most = names.length - 1;
  const range = h("input", { type: "range", min: 0, max: most, step: 0.01, value: most, "aria-label": `Fade between ${names.map((name) => TITLES[name].toLowerCase()).join(", ")}` });
  const stops = names.map((name, index) => h("button", { type: "button", class: "quiet", disabled: true, "aria-keyshortcuts": String(index + 1), onclick: () => fade(index) }, TITLES[name]));
  const slider = h("div", { class: "fade" }, range, h("div", { class: "row-between" }, stops));
  range.addEventListener("input", () => fade(Number(range.value)));

  /** Shows the layer of that number; a number between two shows both. */
  function fade(value) {
    range.value = String(value);
    const nearest = Math.round(value);
    range.setAttribute("aria-valuetext", Number.isInteger(value) ? TITLES[names[value]] : `${TITLES[names[Math.floor(value)]]} and ${TITLES[names[Math.ceil(value)]]}`);
    opacities(names.length, value).forEach((opacity, index) => { layers[names[index]].element.style.opacity = String(opacity); });
    stops.forEach((stop, index) => { stop.setAttribute("aria-pressed", String(index === nearest)); });
    overlay.style.opacity = names[nearest] === "goal" ? "0" : "1";
    tell();
  }

  /** Tells of the highest layer that is seen: one whose picture has not come shows the one below. */
  function tell() {
    const nearest = Math.round(Number(range.value));
    const seen = names.filter((_, index) => index <= nearest && !stops[index].disabled).pop();
    const words = seen ? layers[seen].caption : "";
    if (caption.textContent !== words) caption.textContent = words;
  }

  /** Sets what is said under each layer. @param {Partial<Record<"goal" | "plan" | "painting", string>>} told */
  function captions(told) {
    for (const [name, words] of Object.entries(told)) layers[name].caption = words;
    tell();
  }

  /** Shows a picture once it is there; the one before stays until then. None for "". */
  async function picture(name, url, alt) {
    const layer = layers[name];
    layer.element.alt = alt;
    layer.wanted = url;
    if (url === layer.shown) return;
    if (!url) {
      layer.element.removeAttribute("src");
      layer.shown = url;
      stops[names.indexOf(name)].disabled = true;
      tell();
      return;
    }
    const next = new Image();
    next.src = url;
    try {
      await next.decode();
    } catch {
      return;
    }
    if (layer.wanted !== url) return;
    layer.shown = url;
    next.className = layer.element.className;
    next.alt = alt;
    next.style.cssText = layer.element.style.cssText; // how far it is seen, and how it is cropped
    layer.element.replaceWith(next); // and not its address: that would ask for the picture once more
    layer.element = next;
    stops[names.indexOf(name)].disabled = false;
    tell();
  }

  /** Shows what stands for a goal: its picture, or its words. @param {Term[]} terms */
  function goal(terms) {
    const term = mainTerm(terms);
    words.hidden = !term?.words;
    words.textContent = term?.words ?? "";
    showCrop(layers.goal.element, term?.crop);
    if (term?.picture) picture("goal", api.picture(term.picture), "The goal");
    else stops[names.indexOf("goal")].disabled = !term;
    tell();
  }

  /**
   * Draws one stroke over the picture; `strokes` as in strokes.json, none where index is not given.
   * @param {Strokes | null} strokes @param {number | null} index @param {string} [color]
   */
  function highlight(strokes, index, color) {
    overlay.replaceChildren();
    if (!strokes || index === null || index < 0 || index >= strokes.paths.length) return;
    overlay.setAttribute("viewBox", `0 0 1000 ${strokes.height}`);
    const points = strokes.paths[index].map((point) => point.join(",")).join(" ");
    const [x, y] = strokes.paths[index][0];
    overlay.append(
      svg("polyline", { points, class: "halo", "stroke-width": strokes.widths[index] + 10 }),
      svg("polyline", { points, class: "mark", stroke: color ?? "#000", "stroke-width": strokes.widths[index] }),
      svg("circle", { cx: x, cy: y, r: 5, class: "start" }));
  }

  /** Hatches what is protected: a picture light where it was drawn, or everything else with `only`. */
  function region(url, only) {
    hatching.hidden = !url;
    if (!url) return;
    hatching.style.maskImage = only ? `linear-gradient(#000 0 0), url("${url}")` : `url("${url}")`;
    hatching.style.maskMode = only ? "alpha, luminance" : "luminance";
    hatching.style.maskComposite = only ? "exclude" : "add";
  }

  captions({ goal: "The goal", plan: "The plan" });
  fade(most);
  return { element, slider, caption, captions, fade, picture, goal, highlight, region };
}
