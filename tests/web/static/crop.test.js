import assert from "node:assert/strict";
import { test } from "node:test";
import { largestCrop, moveCrop, reshapeCrop, sentCrop, zoomCrop, zoomOf } from "../../../src/frida_painter_studio/static/crop.js";

function* chance(seed, count) {
  let state = seed;
  for (let index = 0; index < count; index += 1) {
    state = (1103515245 * state + 12345) % 2147483648;
    yield state / 2147483648;
  }
}

test("whatever a person does, the part lies inside the picture and has the canvas's shape", () => {
  const numbers = [...chance(7, 4000)];
  const next = () => numbers.pop() ?? 0.5;
  for (let round = 0; round < 40; round += 1) {
    const picture = 0.3 + 3 * next();
    let canvas = 0.3 + 3 * next();
    let crop = largestCrop(picture, canvas);
    for (let step = 0; step < 12; step += 1) {
      const largest = largestCrop(picture, canvas);
      if (step % 3 === 0) crop = zoomCrop(crop, 0.3 + 2 * next(), [next(), next()], largest);
      else if (step % 3 === 1) crop = moveCrop(crop, 2 * next() - 1, 2 * next() - 1);
      else { canvas = 0.3 + 3 * next(); crop = reshapeCrop(crop, picture, canvas); }
      const sent = sentCrop(crop, largestCrop(picture, canvas)) ?? crop;
      const [left, top, width, height] = sent;
      assert.ok(left >= 0 && top >= 0 && width >= 0.01 && height >= 0.01 && left + width <= 1 + 1e-9 && top + height <= 1 + 1e-9, String(sent));
      assert.ok(Math.abs((width / height) * picture / canvas - 1) < 0.02, "the canvas's shape");
    }
  }
});

test("what lies under the finger stays there while one zooms, and follows it while one moves", () => {
  const largest = largestCrop(1.5, 1.5);
  const at = (crop, x, y) => [crop[0] + x * crop[2], crop[1] + y * crop[3]];
  const near = (a, b) => { a.forEach((value, index) => { assert.ok(Math.abs(value - b[index]) < 1e-9); }); };
  const zoomed = zoomCrop(largest, 2, [0.3, 0.6], largest);
  near(at(zoomed, 0.3, 0.6), at(largest, 0.3, 0.6));
  assert.equal(zoomOf(zoomed, largest), 2);
  near(at(moveCrop(zoomed, 0.1, -0.05), 0.4, 0.55), at(zoomed, 0.3, 0.6));
  assert.equal(sentCrop(zoomCrop(zoomed, 0.1, [0, 0], largest), largest), null, "all of it is what the studio takes by itself");
});
