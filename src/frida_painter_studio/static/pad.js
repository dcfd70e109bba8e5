// A drawing pad over a picture: pen, eraser, undo, redo, zoom, width, colour; by hand or by keyboard; for drawings, and for
// parts of the canvas.

import { h, reveal, show, slider, svg } from "./dom.js";
import { between, Drawing, following, goesAround, moved, WHOLE, zoomed } from "./drawing.js";
import { getStroke } from "./perfect-freehand.js";

const COLORS = [["#23211e", "Black"], ["#9a3b1f", "Red"], ["#d09a35", "Yellow"], ["#3f6b4d", "Green"], ["#2f4b7c", "Blue"], ["#ffffff", "White"]];
const MARKED = "#e2572b"; // how a marked part of the canvas is shown
const LONGEST = 1400; // pixels of the drawing that is handed in
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEP = 0.01; // of the longer side, for an arrow key
const HELP = "By keyboard: the arrow keys move the cross (Shift: five times as far), Space puts the pen down and lifts it, + and - zoom, Ctrl+Z undoes.";

/**
 * The pad; `shape` is width over height. With `mask` one draws a part of the canvas, which is handed in light on dark;
 * without, a drawing on white paper.
 * @param {{ shape: number, mask?: boolean, background?: string }} options
 */
export function pad({ shape, mask = false, background = "" }) {
  const width = Math.round(shape >= 1 ? LONGEST : LONGEST * shape);
  const height = Math.round(shape >= 1 ? LONGEST / shape : LONGEST);
  const surface = h("canvas", { width, height, tabIndex: 0, role: "application", "aria-label": `${mask ? "Mark a part of the canvas" : "Draw"}. ${HELP}` });
  const cross = svg("svg", { class: "cross", viewBox: "-10 -10 20 20", "aria-hidden": "true" }, svg("path", { d: "M-10 0H-3M3 0H10M0 -10V-3M0 3V10" }), svg("circle", { r: 3 }));
  const sheet = h("div", { class: "sheet" }, background ? h("img", { src: background, alt: "", class: mask ? "" : "faint" }) : null, surface, cross);
  const element = h("div", { class: "mount pad" }, sheet);
  element.style.aspectRatio = String(shape);
  element.style.setProperty("--shape", String(shape));
  const context = paper(surface);
  const drawing = new Drawing();
  let tool = { color: COLORS[0][0], width: mask ? 0.09 : 0.012, erase: false };
  let line = null;
  let view = WHOLE;
  let cursor = [width / 2, height / 2];
  const touching = new Map(); // pointers on the pad, by id, where they are on the screen

  function place(event) {
    const box = surface.getBoundingClientRect();
    const pressure = event.pointerType === "pen" ? event.pressure : 0.5;
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height, pressure];
  }

  /** @param {CanvasRenderingContext2D} target @param {import("./drawing.js").Line} line @param {string} [ink] */
  function trace(target, { points, color, erase, width: share, pen, fill }, ink) {
    const outline = getStroke(points, { size: share * Math.min(width, height), thinning: mask || erase ? 0 : 0.5, simulatePressure: !pen });
    target.globalCompositeOperation = erase ? "destination-out" : "source-over";
    target.fillStyle = ink ?? color;
    target.beginPath();
    for (const [x, y] of outline) target.lineTo(x, y); // (the first one begins the path)
    target.fill();
    if (fill) {
      target.beginPath();
      for (const [x, y] of points) target.lineTo(x, y);
      target.fill();
    }
    target.globalCompositeOperation = "source-over";
  }

  const question = h("div", { class: "ask-inside", role: "status" });
  let drawn = 0;
  function draw() {
    cancelAnimationFrame(drawn);
    drawn = requestAnimationFrame(() => {
      context.clearRect(0, 0, width, height);
      for (const each of drawing.lines) trace(context, each, mask ? MARKED : undefined);
    });
    undo.disabled = clear.disabled = !drawing.canUndo;
    redo.disabled = !drawing.canRedo;
  }

  /** The line is drawn; of one that goes around a part it is asked if the inside is meant as well. */
  function end() {
    const drawn = line;
    line = null;
    if (!mask || !drawn || drawn.erase || !goesAround(drawn.points, width, height)) return;
    const close = () => { show(question); surface.focus({ preventScroll: true }); };
    show(question, h("p", {}, "You drew around a part of the canvas. Does the inside belong to it?"), h("p", { class: "pair" },
      h("button", { type: "button", class: "button second", onclick: () => { drawing.fillLast(); draw(); close(); } }, "Mark the inside too"),
      h("button", { type: "button", class: "quiet", onclick: close }, "Only the line")));
  }

  function begin(point, pen) {
    show(question);
    line = { ...tool, points: [point], pen };
    drawing.add(line);
    draw();
  }

  function look(next) {
    view = next;
    sheet.style.transform = `translate(${100 * view.x}%, ${100 * view.y}%) scale(${view.scale})`;
    whole.textContent = `${Math.round(100 * view.scale)} %`;
    cross.style.setProperty("--zoom", String(view.scale));
  }

  const inWindow = (/** @type {number[]} */ [x, y]) => {
    const box = element.getBoundingClientRect();
    return [(x - box.left) / box.width, (y - box.top) / box.height];
  };
  const middle = (points) => [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
  const spread = (/** @type {number[][]} */ [a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);

  surface.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    surface.setPointerCapture(event.pointerId);
    touching.set(event.pointerId, [event.clientX, event.clientY]);
    if (touching.size === 1) begin(place(event), event.pointerType === "pen");
    else if (line) { drawing.drop(); line = null; draw(); } // a second finger: it zooms, and does not draw
    event.preventDefault();
    surface.focus({ preventScroll: true });
  });
  surface.addEventListener("pointermove", (event) => {
    if (!touching.has(event.pointerId)) return;
    const before = [...touching.values()];
    touching.set(event.pointerId, [event.clientX, event.clientY]);
    if (touching.size === 2) {
      const [from, to] = [before, [...touching.values()]].map((points) => points.map(inWindow));
      const [start, end] = [middle(from), middle(to)];
      look(zoomed(moved(view, end[0] - start[0], end[1] - start[1]), spread(to) / Math.max(1e-6, spread(from)), end));
      return;
    }
    if (!line) return;
    const known = event.getCoalescedEvents?.() ?? [];
    for (const each of known.length ? known : [event]) line.points.push(place(each));
    draw();
  });
  for (const lifted of ["pointerup", "pointercancel"]) {
    surface.addEventListener(lifted, (event) => { touching.delete(event.pointerId); end(); });
  }
  element.addEventListener("wheel", (event) => {
    const used = document.activeElement === surface;
    if (!event.ctrlKey && view.scale === 1 && !used) return; // the page scrolls
    event.preventDefault();
    const box = element.getBoundingClientRect();
    const zooms = event.ctrlKey || (used && !event.shiftKey && Math.abs(event.deltaY) > Math.abs(event.deltaX));
    look(zooms ? zoomed(view, Math.exp(-event.deltaY / (event.ctrlKey ? 200 : 600)), inWindow([event.clientX, event.clientY])) : moved(view, -event.deltaX / box.width, -event.deltaY / box.height));
  }, { passive: false });

  const center = [0.5, 0.5];
  const change = (work) => () => { work(); draw(); };
  const undoing = change(() => { show(question); drawing.undo(); });
  const redoing = change(() => { show(question); drawing.redo(); });

  function move(/** @type {number[]} */ [across, down], far) {
    const step = STEP * LONGEST * (far ? 5 : 1) / Math.sqrt(view.scale);
    const next = [Math.min(width, Math.max(0, cursor[0] + step * across)), Math.min(height, Math.max(0, cursor[1] + step * down))];
    if (line) { line.points.push(...between(cursor, next)); draw(); }
    cursor = next;
    look(following(view, [cursor[0] / width, cursor[1] / height]));
    tellCursor();
  }

  function tellCursor() {
    cross.style.left = `${(100 * cursor[0]) / width}%`;
    cross.style.top = `${(100 * cursor[1]) / height}%`;
    cross.classList.toggle("down", Boolean(line));
    said.textContent = `${line ? "Pen down" : "Pen up"}, ${Math.round((100 * cursor[0]) / width)} % from the left, ${Math.round((100 * cursor[1]) / height)} % from the top`;
  }

  surface.addEventListener("keydown", (event) => {
    const order = event.ctrlKey || event.metaKey;
    const key = event.key.toLowerCase();
    if (order && key === "z") (event.shiftKey ? redoing : undoing)();
    else if (order && key === "y") redoing();
    else if (order || event.altKey) return;
    else if (ARROWS[event.key]) move(ARROWS[event.key], event.shiftKey);
    else if (event.key === " " || event.key === "Enter") {
      if (line) end();
      else begin([...cursor, 0.5], false);
      tellCursor();
    } else if (key === "+" || key === "=") look(zoomed(view, 1.5, center));
    else if (key === "-") look(zoomed(view, 1 / 1.5, center));
    else if (key === "0") look(WHOLE);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  surface.addEventListener("blur", () => { line = null; });

  const button = (label, onclick, more = {}) => h("button", { type: "button", class: "quiet", onclick, ...more }, label);
  const undo = button("Undo", undoing, { title: "Ctrl+Z" });
  const redo = button("Redo", redoing, { title: "Ctrl+Y" });
  const clear = button("Clear", change(() => { show(question); drawing.clear(); }));
  const whole = button("100 %", () => look(WHOLE), { "aria-label": "Show the whole sheet" });
  const pen = button(mask ? "Brush" : "Pen", () => pick({ erase: false }));
  const eraser = button("Eraser", () => pick({ erase: true }));
  const inks = mask ? [] : COLORS.map(([color, name]) => h("button", { type: "button", class: "ink", style: { background: color }, "aria-label": name, title: name, onclick: () => pick({ color, erase: false }) }));
  const said = h("p", { class: "label unseen", role: "status" });

  function pick(changes) {
    tool = { ...tool, ...changes };
    pen.setAttribute("aria-pressed", String(!tool.erase));
    eraser.setAttribute("aria-pressed", String(tool.erase));
    inks.forEach((ink, index) => { ink.setAttribute("aria-pressed", String(!tool.erase && tool.color === COLORS[index][0])); });
  }

  const toolbar = h("div", { class: "tools", role: "toolbar", "aria-label": "Drawing tools" },
    inks.length ? h("span", { class: "inks" }, inks) : null, pen, eraser, undo, redo, clear,
    h("span", { class: "zoom", role: "group", "aria-label": "Zoom", title: "Also by the wheel, or by two fingers" },
      button("−", () => look(zoomed(view, 1 / 1.5, center)), { "aria-label": "Zoom out" }), whole, button("+", () => look(zoomed(view, 1.5, center)), { "aria-label": "Zoom in" })),
    slider({ label: "Width", min: 1, max: 20, value: Math.round(tool.width * (mask ? 100 : 500)), words: (value) => (value < 5 ? "fine" : value < 12 ? "medium" : "broad"), oninput: (value) => { tool.width = value / (mask ? 100 : 500); } }));
  const tools = h("div", { class: "under-pad" }, h("p", { class: "label pad-help" }, HELP), question, toolbar, said);
  pick({});
  look(WHOLE);
  draw();
  tellCursor();

  /** The drawing as a PNG; null where there is none. @returns {Promise<Blob | null>} */
  async function picture() {
    if (drawing.empty) return null;
    const handed = h("canvas", { width, height });
    const ground = paper(handed);
    ground.fillStyle = mask ? "#000" : "#fff";
    ground.fillRect(0, 0, width, height);
    const ink = h("canvas", { width, height });
    for (const each of drawing.lines) trace(paper(ink), each, mask ? "#fff" : undefined);
    ground.drawImage(ink, 0, 0);
    return new Promise((resolve) => handed.toBlob(resolve, "image/png"));
  }

  /** Brings the pad into sight, for the keyboard as well. */
  const open = () => reveal(element, surface);

  return { element, tools, picture, open };
}

/** @param {HTMLCanvasElement} canvas */
function paper(canvas) {
  return /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
}
