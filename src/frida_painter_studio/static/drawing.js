// A drawing as data: its lines, what was undone, and how it is seen through a zoom; the pad puts it on the screen.

/**
 * One line of a drawing. points: pixels of the sheet and the pen's pressure in [0, 1]; width: a share of the
 * sheet's shorter side; pen: whether the pressure was measured; fill: whether what the line goes around belongs to it.
 * @typedef {{ points: number[][], color: string, width: number, erase: boolean, pen: boolean, fill?: boolean }} Line
 */

/** The lines of a drawing, with undo and redo; clearing can be undone as well. */
export class Drawing {
  /** @type {Line[]} */
  lines = [];
  /** @type {Line[][]} */
  #before = [];
  /** @type {Line[][]} */
  #after = [];

  get canUndo() { return this.#before.length > 0; }
  get canRedo() { return this.#after.length > 0; }
  /** Whether anything is left of it that was drawn, not erased. */
  get empty() { return !this.lines.some((line) => !line.erase); }

  /** @param {Line} line */
  add(line) { this.#change([...this.lines, line]); }
  /** Fills what the last line goes around; this can be undone. */
  fillLast() {
    const last = this.lines.at(-1);
    if (last) this.#change([...this.lines.slice(0, -1), { ...last, fill: true }]);
  }
  clear() { if (this.lines.length) this.#change([]); }

  /** Takes back the line that is being drawn, as if it had not been begun. */
  drop() { this.lines = this.#before.pop() ?? []; }

  undo() { this.#step(this.#before, this.#after); }
  redo() { this.#step(this.#after, this.#before); }

  /** @param {Line[]} lines */
  #change(lines) {
    this.#before.push(this.lines);
    this.#after = [];
    this.lines = lines;
  }

  /** @param {Line[][]} from @param {Line[][]} to */
  #step(from, to) {
    const lines = from.pop();
    if (!lines) return;
    to.push(this.lines);
    this.lines = lines;
  }
}

export const MAX_ZOOM = 8;

/**
 * What a zoomed sheet shows: `scale`, and where its top-left corner lies, in shares of the window's sides.
 * @typedef {{ scale: number, x: number, y: number }} View
 */

/** The whole sheet. @type {View} */
export const WHOLE = { scale: 1, x: 0, y: 0 };

const within = (low, value, high) => Math.min(high, Math.max(low, value));

/**
 * Zooms by a factor around a place of the window, given in shares of its sides; the place stays under the finger.
 * @param {View} view @param {number} factor @param {number[]} around
 * @returns {View}
 */
export function zoomed(view, factor, [x, y]) {
  const scale = within(1, view.scale * factor, MAX_ZOOM);
  const grown = scale / view.scale;
  return kept({ scale, x: x - (x - view.x) * grown, y: y - (y - view.y) * grown });
}

/** Moves the sheet under the window, by shares of its sides. @param {View} view @returns {View} */
export const moved = (view, across, down) => kept({ ...view, x: view.x + across, y: view.y + down });

/** No part of the window is ever without sheet. @param {View} view @returns {View} */
const kept = ({ scale, x, y }) => ({ scale, x: within(1 - scale, x, 0), y: within(1 - scale, y, 0) });

/**
 * A view in which a place of the sheet (in shares of its sides) can be seen; the same where it can be already.
 * @param {View} view @param {number[]} place @returns {View}
 */
export function following(view, [x, y]) {
  const at = (share, corner) => share * view.scale + corner;
  const by = (share, corner) => within(0.05, at(share, corner), 0.95) - at(share, corner);
  return moved(view, by(x, view.x), by(y, view.y));
}

const MIN_INSIDE = 0.005; // of the sheet; less is a thick dot
const MAX_GAP = 0.3; // between the ends of a line that goes around something, as a share of the line's extent

/**
 * Whether a line goes around a part of the sheet: its ends are near each other, and there is something between.
 * @param {number[][]} points @param {number} width @param {number} height of the sheet
 */
export function goesAround(points, width, height) {
  const sides = [0, 1].map((axis) => points.map((point) => point[axis]));
  const extent = Math.hypot(...sides.map((values) => values.reduce((most, value) => Math.max(most, value), -Infinity) - values.reduce((least, value) => Math.min(least, value), Infinity)));
  const [[x0, y0], [x1, y1]] = [points[0], points[points.length - 1]];
  const twice = points.reduce((sum, [x, y], index) => { const [nextX, nextY] = points[(index + 1) % points.length]; return sum + x * nextY - nextX * y; }, 0);
  return Math.hypot(x1 - x0, y1 - y0) <= MAX_GAP * extent && Math.abs(twice) / 2 >= MIN_INSIDE * width * height;
}

/**
 * The points from one place to another, so close that a smoothed line does not cut the corner.
 * @param {number[]} from @param {number[]} to
 */
export function between([x0, y0], [x1, y1], pieces = 4) {
  return Array.from({ length: pieces }, (_, index) => {
    const share = (index + 1) / pieces;
    return [x0 + share * (x1 - x0), y0 + share * (y1 - y0), 0.5];
  });
}
