// A drawing pad over a picture: pen, eraser, undo, width, colour; for sketches, and for parts of the canvas.

import { h, show, slider } from "./dom.js";

const COLORS = ["#23211e", "#9a3b1f", "#d09a35", "#3f6b4d", "#2f4b7c", "#ffffff"];
const LONGEST = 1400; // pixels of the drawing that is handed in

/**
 * The pad; `shape` is width over height. With `mask` one draws a part of the canvas, which is handed in light on dark;
 * without, a drawing on white paper.
 */
export function pad({ shape, mask = false, background = "" }) {
  const surface = h("canvas", { tabIndex: 0, "aria-label": mask ? "Draw over a part of the canvas" : "Draw with the pen, a mouse or a finger" });
  const element = h("div", { class: "mount pad" }, background ? h("img", { src: background, alt: "", class: mask ? "" : "faint" }) : null, surface);
  element.style.aspectRatio = shape;
  element.style.setProperty("--shape", shape);
  const width = Math.round(shape >= 1 ? LONGEST : LONGEST * shape);
  const height = Math.round(shape >= 1 ? LONGEST / shape : LONGEST);
  surface.width = width;
  surface.height = height;
  const context = surface.getContext("2d");
  const lines = [];
  let tool = { color: COLORS[0], width: mask ? 0.09 : 0.012, erase: false };
  let line = null;

  const place = (event) => {
    const box = surface.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
  };

  function trace(target, { points, color, erase, width: share }, ink) {
    target.globalCompositeOperation = erase ? "destination-out" : "source-over";
    target.strokeStyle = ink ?? color;
    target.lineWidth = share * Math.min(width, height);
    target.lineCap = target.lineJoin = "round";
    target.beginPath();
    points.forEach(([x, y], index) => (index ? target.lineTo(x, y) : target.moveTo(x, y)));
    if (points.length === 1) target.lineTo(points[0][0] + 0.1, points[0][1]);
    target.stroke();
    target.globalCompositeOperation = "source-over";
  }

  function draw() {
    context.clearRect(0, 0, width, height);
    for (const each of lines) trace(context, each, mask ? "#e2572b" : undefined);
  }

  surface.addEventListener("pointerdown", (event) => {
    surface.setPointerCapture(event.pointerId);
    line = { ...tool, points: [place(event)] };
    lines.push(line);
    draw();
    event.preventDefault();
  });
  surface.addEventListener("pointermove", (event) => {
    if (!line) return;
    for (const each of event.getCoalescedEvents?.() ?? [event]) line.points.push(place(each));
    draw();
  });
  for (const end of ["pointerup", "pointercancel"]) surface.addEventListener(end, () => { line = null; });

  function undo() {
    lines.pop();
    draw();
  }
  surface.addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && event.key === "z") { undo(); event.preventDefault(); }
  });

  const tools = h("div", { class: "tools", role: "toolbar", "aria-label": "Drawing" });
  function drawTools() {
    const pick = (changes) => () => { tool = { ...tool, ...changes }; drawTools(); };
    show(tools,
      mask ? null : h("span", { class: "inks" }, COLORS.map((color) => h("button", { type: "button", class: "ink", style: { background: color }, "aria-label": `Colour ${color}`, "aria-pressed": String(!tool.erase && tool.color === color), onclick: pick({ color, erase: false }) }))),
      h("button", { type: "button", class: "quiet", "aria-pressed": String(!tool.erase), onclick: pick({ erase: false }) }, mask ? "Brush" : "Pen"),
      h("button", { type: "button", class: "quiet", "aria-pressed": String(tool.erase), onclick: pick({ erase: true }) }, "Eraser"),
      h("button", { type: "button", class: "quiet", onclick: undo }, "Undo"),
      h("button", { type: "button", class: "quiet", onclick: () => { lines.length = 0; draw(); } }, "Clear"),
      slider({ label: "Width", min: 1, max: 20, value: Math.round(tool.width * (mask ? 100 : 500)), words: (value) => (value < 5 ? "fine" : value < 12 ? "medium" : "broad"), oninput: (value) => { tool.width = value / (mask ? 100 : 500); } }));
  }
  drawTools();

  /** The drawing as a PNG; null where there is none. */
  async function picture() {
    if (!lines.some((each) => !each.erase)) return null;
    const sheet = h("canvas", { width, height });
    const paper = sheet.getContext("2d");
    paper.fillStyle = mask ? "#000" : "#fff";
    paper.fillRect(0, 0, width, height);
    const ink = h("canvas", { width, height });
    for (const each of lines) trace(ink.getContext("2d"), each, mask ? "#fff" : undefined);
    paper.drawImage(ink, 0, 0);
    return new Promise((resolve) => sheet.toBlob(resolve, "image/png"));
  }

  return { element, tools, picture };
}
