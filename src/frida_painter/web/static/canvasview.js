// The canvas in the middle of the page: a picture, and over it the stroke that is meant.

import { h, svg } from "./dom.js";

/** Gives an element the shape of the canvas. */
export function shape(element, wish) {
  element.style.aspectRatio = `${wish.width} / ${wish.height}`;
  element.style.setProperty("--shape", wish.width / wish.height);
}

export function canvasView(wish) {
  const below = h("img", { alt: "", class: "picture" });
  const overlay = svg("svg", { class: "overlay", "aria-hidden": "true" });
  const hatching = h("div", { class: "hatching", hidden: true });
  const element = h("div", { class: "mount" }, below, hatching, overlay);
  shape(element, wish);
  let shown = "";
  let wanted = "";

  /** Shows a picture once it is there; the one before stays until then. */
  async function picture(url, alt) {
    below.alt = alt;
    wanted = url;
    if (url === shown || !url) return;
    const next = new Image();
    next.src = url;
    try {
      await next.decode();
    } catch {
      return;
    }
    if (wanted !== url) return;
    shown = url;
    below.src = url;
    element.classList.add("filled");
  }

  /** Draws one stroke over the picture; `strokes` as in strokes.json, none where index is not given. */
  function highlight(strokes, index, color) {
    overlay.replaceChildren();
    if (!strokes || index === null || index < 0 || index >= strokes.paths.length) return;
    overlay.setAttribute("viewBox", `0 0 1000 ${strokes.height}`);
    const points = strokes.paths[index].map((point) => point.join(",")).join(" ");
    const [x, y] = strokes.paths[index][0];
    overlay.append(
      svg("polyline", { points, class: "halo", "stroke-width": strokes.widths[index] + 10 }),
      svg("polyline", { points, class: "mark", stroke: color, "stroke-width": strokes.widths[index] }),
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

  return { element, picture, highlight, region };
}
