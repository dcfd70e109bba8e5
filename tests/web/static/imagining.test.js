import assert from "node:assert/strict";
import { test } from "node:test";
import "./browser.js";

const { nextSeed, picturesOf } = await import("../../../src/frida_painter_studio/static/imagining.js");

const making = (words, seeds, best = 0, rule = "it is the first") => ({ words, maker: "fake", pictures: seeds.map((seed) => ({ picture: `made-${seed}.jpg`, seed })), best, rule, faults: [] });
const makings = [making("a hat", [3, 4]), making("a sea", [9]), making("a hat", [5, 6], 1, "it is the nearest to the words by a network")];

test("pictures of the same words stand together, the last ones first", () => {
  const pictures = picturesOf(makings, "a hat");
  assert.deepEqual(pictures.map((one) => one.seed), [5, 6, 3, 4]);
  assert.deepEqual(pictures.map((one) => one.best), [false, true, false, false], "the first of a making is not the nearest");
  assert.deepEqual(picturesOf(makings, "a cat"), []);
});

test("pictures that are made again have seeds of their own", () => {
  assert.equal(nextSeed(makings, "a hat", 0), 7);
  assert.equal(nextSeed(makings, "a cat", 12), 12);
  assert.equal(nextSeed([making("a hat", [2 ** 31 - 1])], "a hat", 0), 0);
});
