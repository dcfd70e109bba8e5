// A pad on which strokes are made by a pen, a finger, a pointer or the keyboard: each stroke is told as its points, with
// place, press, tilt and time. It keeps no drawing: whoever uses it says when a stroke that is shown may go.

import { h, svg } from "./dom.js";

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEP = 0.01; // of the longer side, for an arrow key
const OVER = 0.02; // share of a side by which a stroke may go over the edge
const HELP = "By keyboard: the arrow keys move the cross (Shift: five times as far), Space puts the brush down and lifts it.";

/**
 * One report of a pen: shares of the pad's width and height from its top-left corner, press in [0, 1], tilt in radians from
 * upright, the direction to which the pen leans in radians clockwise from the right, and seconds since the stroke began.
 * @typedef {[x: number, y: number, press: number, tilt: number, toward: number, seconds: number]} PenPoint
 */

/** A pen's tilt and its direction, from an event of any browser. @param {PointerEvent & { altitudeAngle?: number, azimuthAngle?: number }} event @returns {[number, number]} */
export function tiltOf(event) {
  if (event.pointerType !== "pen") return [0, 0];
  if (event.altitudeAngle !== undefined && event.azimuthAngle !== undefined) return [Math.max(0, Math.PI / 2 - event.altitudeAngle), event.azimuthAngle];
  const [x, y] = [Math.tan(((event.tiltX ?? 0) * Math.PI) / 180), Math.tan(((event.tiltY ?? 0) * Math.PI) / 180)];
  return [Math.atan(Math.hypot(x, y)), Math.atan2(y, x)];
}

/**
 * The points of a stroke that its mark needs: what lies between two of them differs from an even change by less than the
 * errors, each in the unit of its value; the first and the last point stay (Ramer, Douglas, Peucker).
 * @param {PenPoint[]} points @param {number[]} errors for place (x, y), press, tilt and direction @returns {PenPoint[]}
 */
export function thin(points, errors) {
  const way = points.map((point) => errors.map((error, axis) => point[axis] / error));
  const keep = new Set([0, points.length - 1]);
  const open = [[0, points.length - 1]];
  for (let range = open.pop(); range; range = open.pop()) {
    const [first, last] = range;
    const along = way[last].map((value, axis) => value - way[first][axis]);
    const length = Math.max(1e-12, along.reduce((sum, value) => sum + value * value, 0));
    let [most, farthest] = [1, -1];
    for (let index = first + 1; index < last; index += 1) {
      const off = way[index].map((value, axis) => value - way[first][axis]);
      const share = Math.min(1, Math.max(0, off.reduce((sum, value, axis) => sum + value * along[axis], 0) / length));
      const error = Math.hypot(...off.map((value, axis) => value - share * along[axis]));
      if (error > most) [most, farthest] = [error, index];
    }
    if (farthest < 0) continue;
    keep.add(farthest);
    open.push([first, farthest], [farthest, last]);
  }
  return [...keep].filter((index) => index >= 0).sort((one, other) => one - other).map((index) => points[index]);
}

/**
 * The pad. `label` names it; `shape` is width over height. `begin` is asked before each stroke and returns how it looks while
 * it is made: its colour, and the widths of its mark at the lightest and the hardest press as shares of the pad's width; or
 * null where no stroke may be made now. `press` is how hard a pointer without pressure presses, and the most of a pen.
 * `done` gets every finished stroke, and a function that takes its sketch off the pad.
 * @param {{ label: string, shape: number, begin: () => { color: string, light: number, hard: number } | null, press: () => number,
 *   done: (points: PenPoint[], forget: () => void) => void }} options
 */
export function strokePad({ label, shape, begin, press, done }) {
  const width = Math.round(shape >= 1 ? 1400 : 1400 * shape);
  const height = Math.round(width / shape);
  const surface = /** @type {HTMLCanvasElement} */ (h("canvas", { width, height, tabIndex: 0, role: "application", "aria-label": `${label}. ${HELP}` }));
  const context = /** @type {CanvasRenderingContext2D} */ (surface.getContext("2d"));
  const picture = h("img", { alt: "" });
  const cross = svg("svg", { class: "cross", viewBox: "-10 -10 20 20", "aria-hidden": "true" }, svg("path", { d: "M-10 0H-3M3 0H10M0 -10V-3M0 3V10" }), svg("circle", { r: 3 }));
  const ring = h("span", { class: "brush-ring", hidden: true, "aria-hidden": "true" });
  const said = h("p", { class: "label unseen", role: "status" });
  const element = h("div", { class: "mount pad stroke-pad" }, h("div", { class: "sheet" }, picture, surface, cross, ring), said);
  element.style.aspectRatio = String(shape);
  element.style.setProperty("--shape", String(shape));

  /** @typedef {{ points: PenPoint[], look: { color: string, light: number, hard: number }, pointer: number | null }} Stroke */
  /** @type {Set<Stroke>} */
  const shown = new Set();
  /** @type {Stroke | null} */
  let stroke = null;
  let began = 0;
  let pens = false; // a pen was seen: a finger or a palm beside it paints nothing
  let cursor = [0.5, 0.5];

  function draw() {
    requestAnimationFrame(() => {
      context.clearRect(0, 0, width, height);
      for (const each of shown) trace(each);
    });
  }

  /** @param {Stroke} each */
  function trace({ points, look }) {
    context.strokeStyle = context.fillStyle = look.color;
    context.lineCap = "round";
    const wide = (/** @type {PenPoint} */ point) => width * (look.light + (look.hard - look.light) * point[2]);
    points.forEach((point, index) => {
      const before = points[Math.max(0, index - 1)];
      context.beginPath();
      context.lineWidth = (wide(before) + wide(point)) / 2;
      context.moveTo(before[0] * width, before[1] * height);
      context.lineTo(point[0] * width + 0.01, point[1] * height);
      context.stroke();
    });
  }

  /** @param {PointerEvent} event @returns {PenPoint} */
  function place(event) {
    const box = surface.getBoundingClientRect();
    const pressed = event.pointerType === "pen" ? Math.min(1, Math.max(0, event.pressure)) : 1;
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height, pressed * press(), ...tiltOf(event), Math.max(0, (event.timeStamp - began) / 1000)];
  }

  const inside = (/** @type {PenPoint} */ [x, y]) => Math.min(x, y) >= -OVER && Math.max(x, y) <= 1 + OVER;

  /** @param {number | null} pointer @param {number} now @param {() => PenPoint} first */
  function start(pointer, now, first) {
    const look = begin();
    if (!look) return;
    began = now;
    stroke = { points: [first()], look, pointer };
    shown.add(stroke);
    draw();
  }

  function finish() {
    if (!stroke) return;
    const made = stroke;
    stroke = null;
    done(made.points, () => { shown.delete(made); draw(); });
  }

  function drop() {
    if (stroke) shown.delete(stroke);
    stroke = null;
    draw();
  }

  surface.addEventListener("pointerdown", (event) => {
    pens ||= event.pointerType === "pen";
    if (event.button > 0 || (pens && event.pointerType === "touch")) return;
    event.preventDefault();
    surface.focus({ preventScroll: true });
    if (stroke) { if (stroke.pointer !== null && event.pointerType === "touch") drop(); return; } // a second finger: no stroke
    surface.setPointerCapture(event.pointerId);
    start(event.pointerId, event.timeStamp, () => place(event));
  });
  surface.addEventListener("pointermove", (event) => {
    follow(event);
    if (!stroke || stroke.pointer !== event.pointerId) return;
    const known = event.getCoalescedEvents?.() ?? [];
    for (const each of known.length ? known : [event]) {
      const point = place(each);
      if (!inside(point)) { finish(); return; } // the brush has left the canvas
      stroke.points.push(point);
    }
    draw();
  });
  surface.addEventListener("pointerup", (event) => { if (stroke?.pointer === event.pointerId) finish(); });
  surface.addEventListener("pointercancel", (event) => { if (stroke?.pointer === event.pointerId) drop(); });
  surface.addEventListener("pointerleave", () => { ring.hidden = true; });

  /** Shows how wide the mark will be, under the pointer. @param {PointerEvent} event */
  function follow(event) {
    const look = event.pointerType === "touch" ? null : begin();
    ring.hidden = !look;
    if (!look) return;
    const box = surface.getBoundingClientRect();
    const across = box.width * (look.light + (look.hard - look.light) * press());
    Object.assign(ring.style, { width: `${across}px`, height: `${across}px`, left: `${event.clientX - box.left}px`, top: `${event.clientY - box.top}px`, borderColor: look.color });
  }

  function tell() {
    cross.style.left = `${100 * cursor[0]}%`;
    cross.style.top = `${100 * cursor[1]}%`;
    cross.classList.toggle("down", stroke?.pointer === null);
    said.textContent = `Brush ${stroke ? "down" : "up"}, ${Math.round(100 * cursor[0])} % from the left, ${Math.round(100 * cursor[1])} % from the top`;
  }

  const here = () => /** @type {PenPoint} */ ([...cursor, press(), 0, 0, Math.max(0, (performance.now() - began) / 1000)]);

  surface.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (ARROWS[event.key]) {
      const by = STEP * (event.shiftKey ? 5 : 1);
      cursor = cursor.map((value, axis) => Math.min(1, Math.max(0, value + by * ARROWS[event.key][axis] * (axis ? Math.max(1, shape) : Math.max(1, 1 / shape)))));
      if (stroke?.pointer === null) { stroke.points.push(here()); draw(); }
    } else if (event.key === " " || event.key === "Enter") {
      if (stroke?.pointer === null) finish();
      else if (!stroke) start(null, performance.now(), here);
    } else return;
    tell();
    event.preventDefault();
    event.stopPropagation();
  });
  surface.addEventListener("blur", () => { if (stroke?.pointer === null) finish(); });
  tell();

  /** Shows another picture under the strokes, once it is there. @param {string} url */
  async function show(url) {
    if (!url || picture.src.endsWith(url)) return;
    const next = new Image();
    next.src = url;
    await next.decode().catch(() => {});
    picture.src = url;
  }

  return { element, surface, show, help: HELP };
}
