import assert from "node:assert/strict";
import { test } from "node:test";
import "./browser.js";
import { Stride } from "../../../src/frida_painter_studio/static/guide.js";

const STEPS = [0.02, 0.01, 0.005, 0.002];

test("a step shrinks when the direction along its axis is reversed, and only then", () => {
  const stride = new Stride(STEPS);
  assert.deepEqual(stride.press(0, 1), [0.01, 0, 0]);
  assert.deepEqual(stride.press(0, 1), [0.01, 0, 0]);
  assert.deepEqual(stride.press(2, -1), [0, 0, -0.01], "another axis has its own direction");
  assert.deepEqual(stride.press(0, -1), [-0.005, 0, 0]);
  assert.deepEqual(stride.press(0, 1), [0.002, 0, 0]);
  assert.deepEqual(stride.press(0, -1), [-0.002, 0, 0], "the smallest step stays");
});

test("a step is made larger and smaller by hand, within the steps that there are", () => {
  const stride = new Stride(STEPS);
  for (let press = 0; press < 6; press += 1) stride.change(-1);
  assert.equal(stride.step, 0.02);
  for (let press = 0; press < 6; press += 1) stride.change(1);
  assert.equal(stride.step, 0.002);
});
