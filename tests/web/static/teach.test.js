import assert from "node:assert/strict";
import { test } from "node:test";

import "./browser.js";

const { inMillimetres } = await import("../../../src/frida_painter_studio/static/teach.js");

test("a mark is told in millimetres, y up, with its press and its time", () => {
  assert.deepEqual(inMillimetres([[0, 1, 0.5, 0, 0, 0], [0.5, 0, 0.25, 0.3, 1, 0.1234]]), [[0, 0, 0.5, 0], [60, 90, 0.25, 0.123]]);
});
