import assert from "node:assert/strict";
import { test } from "node:test";
import { ownerAt, ownerWords } from "../../../src/frida_painter_studio/static/painters.js";
import { thin, tiltOf } from "../../../src/frida_painter_studio/static/strokepad.js";

const ERRORS = [0.001, 0.001, 0.01, 0.03, 0.1];

test("a pen with a thousand points a second leaves those that its mark needs", () => {
  const points = Array.from({ length: 5000 }, (_, index) => { const t = index / 4999; return [t, 0.5 + 0.1 * Math.sin(6 * t), 0.3 + 0.4 * t, 0, 0, 5 * t]; });
  const kept = thin(points, ERRORS);
  assert.ok(kept.length > 5 && kept.length < 100, String(kept.length));
  assert.deepEqual([kept[0], kept.at(-1)], [points[0], points.at(-1)]);
  for (const [x, y] of points) {
    const after = kept.findIndex((point) => point[0] >= x);
    const [a, b] = [kept[Math.max(0, after - 1)], kept[after]];
    const share = b[0] > a[0] ? (x - a[0]) / (b[0] - a[0]) : 0;
    assert.ok(Math.abs(a[1] + share * (b[1] - a[1]) - y) < 0.003);
  }
});

test("a stroke of one point, and one that stays at its place with more press, keep what they are", () => {
  const dab = [[0.5, 0.5, 0.4, 0, 0, 0]];
  assert.deepEqual(thin(dab, ERRORS), dab);
  const pressed = [[0.5, 0.5, 0.1, 0, 0, 0], [0.5, 0.5, 0.9, 0, 0, 1], [0.5, 0.5, 0.1, 0, 0, 2]];
  assert.deepEqual(thin(pressed, ERRORS), pressed);
});

test("the tilt of a pen is the same however a browser tells it, and a mouse has none", () => {
  const [tilt, toward] = tiltOf({ pointerType: "pen", altitudeAngle: Math.PI / 3, azimuthAngle: 0 });
  const [other, way] = tiltOf({ pointerType: "pen", tiltX: 30, tiltY: 0 });
  assert.ok(Math.abs(tilt - other) < 1e-9 && Math.abs(toward - way) < 1e-9);
  assert.deepEqual(tiltOf({ pointerType: "mouse", altitudeAngle: 0.3, azimuthAngle: 1 }), [0, 0]);
});

test("a pixel's owner is found in the runs of its row, and told in words", () => {
  const runs = [[0, 3], [2, 2], [-1, 4]];
  assert.deepEqual([0, 2, 3, 4, 5, 8, 20].map((column) => ownerAt(runs, column)), [0, 0, 2, 2, -1, -1, 0]);
  assert.deepEqual([0, 2, -1].map(ownerWords), ["Bare canvas", "Stroke 2 of the robot", "Stroke 1 of yours"]);
});
