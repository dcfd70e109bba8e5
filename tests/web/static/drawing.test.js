import assert from "node:assert/strict";
import { test } from "node:test";
import { between, Drawing, following, goesAround, MAX_ZOOM, moved, WHOLE, zoomed } from "../../../src/frida_painter_studio/static/drawing.js";

const line = (erase = false) => ({ points: [[1, 1, 0.5]], color: "#000", width: 0.1, erase, pen: false });

test("undo and redo go back and forth, and a new line ends what could be redone", () => {
  const drawing = new Drawing();
  const [first, second, third] = [line(), line(), line()];
  drawing.add(first);
  drawing.add(second);
  drawing.undo();
  assert.deepEqual(drawing.lines, [first]);
  drawing.redo();
  assert.deepEqual(drawing.lines, [first, second]);
  drawing.undo();
  drawing.add(third);
  assert.equal(drawing.canRedo, false);
  drawing.redo();
  assert.deepEqual(drawing.lines, [first, third]);
});

test("clearing is undone as one step, and clearing nothing is no step", () => {
  const drawing = new Drawing();
  drawing.clear();
  assert.equal(drawing.canUndo, false);
  drawing.add(line());
  drawing.add(line());
  drawing.clear();
  assert.equal(drawing.lines.length, 0);
  drawing.undo();
  assert.equal(drawing.lines.length, 2);
});

test("what was only erased is an empty drawing", () => {
  const drawing = new Drawing();
  assert.equal(drawing.empty, true);
  drawing.add(line(true));
  assert.equal(drawing.empty, true);
  drawing.add(line());
  assert.equal(drawing.empty, false);
});

test("a line that a second finger broke off leaves no trace", () => {
  const drawing = new Drawing();
  drawing.add(line());
  const before = drawing.lines;
  drawing.add(line());
  drawing.drop();
  assert.equal(drawing.lines, before);
  assert.equal(drawing.canRedo, false);
});

test("the place under the finger stays there while zooming", () => {
  const around = [0.3, 0.8];
  const sheet = (view) => around.map((share, axis) => (share - [view.x, view.y][axis]) / view.scale);
  const once = zoomed(WHOLE, 2, around);
  const twice = zoomed(once, 1.7, around);
  for (const view of [once, twice]) sheet(view).forEach((share, axis) => { assert.ok(Math.abs(share - around[axis]) < 1e-9); });
});

test("no view leaves a part of the window empty", () => {
  let view = WHOLE;
  for (let step = 0; step < 500; step += 1) {
    const chance = () => (Math.sin(step * 12.9898 + view.scale) * 43758.5453) % 1;
    view = step % 2 ? zoomed(view, 0.4 + 2 * Math.abs(chance()), [Math.abs(chance()), 0.5]) : moved(view, chance(), -chance());
    assert.ok(1 <= view.scale && view.scale <= MAX_ZOOM);
    for (const corner of [view.x, view.y]) assert.ok(corner <= 1e-9 && corner + view.scale >= 1 - 1e-9);
  }
});

test("the cursor of the keyboard is always in sight", () => {
  let view = zoomed(WHOLE, 4, [0.5, 0.5]);
  for (const place of [[0, 0], [1, 0.2], [0.5, 1], [0.9, 0.9]]) {
    view = following(view, place);
    const seen = [place[0] * view.scale + view.x, place[1] * view.scale + view.y];
    for (const share of seen) assert.ok(-1e-9 <= share && share <= 1 + 1e-9);
  }
  assert.equal(following(view, [0.9, 0.9]).x, view.x);
});

test("points between two places end at the second one and are evenly spaced", () => {
  assert.deepEqual(between([0, 0], [8, 4], 4).map(([x, y]) => [x, y]), [[2, 1], [4, 2], [6, 3], [8, 4]]);
});

test("a line goes around a part if its ends meet and something lies between them", () => {
  const circle = (turn, radius) => Array.from({ length: 40 }, (_, index) => [500 + radius * Math.cos((index * turn) / 39), 400 + radius * Math.sin((index * turn) / 39), 0.5]);
  const around = (points) => goesAround(points, 1000, 800);
  assert.ok(around(circle(2 * Math.PI, 200)), "a circle");
  assert.ok(around(circle(1.9 * Math.PI, 200)), "one with a gap");
  assert.ok(around(circle(-2 * Math.PI, 200)), "the other way round");
  assert.ok(!around(circle(Math.PI, 200)), "half of one");
  assert.ok(!around(circle(2 * Math.PI, 20)), "a dot");
  assert.ok(!around([[0, 0, 0.5], [900, 700, 0.5], [0, 0, 0.5]]), "there and back");
  assert.ok(!around([[5, 5, 0.5]]), "a point");
});

test("filling what the last line goes around is a step that can be undone", () => {
  const drawing = new Drawing();
  drawing.add({ points: [[0, 0, 0.5]], color: "#000", width: 0.1, erase: false, pen: false });
  drawing.fillLast();
  assert.equal(drawing.lines.at(-1)?.fill, true);
  drawing.undo();
  assert.equal(drawing.lines.at(-1)?.fill, undefined);
  drawing.redo();
  assert.equal(drawing.lines.length, 1);
  assert.equal(drawing.lines[0].fill, true);
});
