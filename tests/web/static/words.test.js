import assert from "node:assert/strict";
import { test } from "node:test";
import "./browser.js";
import { opacities } from "../../../src/frida_painter_studio/static/canvasview.js";
import { count, duration } from "../../../src/frida_painter_studio/static/dom.js";
import { brushWords } from "../../../src/frida_painter_studio/static/easelstate.js";
import { corrected, toPaint, toPlan } from "../../../src/frida_painter_studio/static/estimate.js";
import { KINDS, learnKinds, mainTerm, nearestWeight, weights } from "../../../src/frida_painter_studio/static/goal.js";
import { cardFacts, linesOf } from "../../../src/frida_painter_studio/static/keepsake.js";
import { outcome } from "../../../src/frida_painter_studio/static/paint.js";
import { placeOf } from "../../../src/frida_painter_studio/static/queue.js";
import { brushesInWords, holds, nearestStep, oneBrush } from "../../../src/frida_painter_studio/static/settings.js";
import { need, turn } from "../../../src/frida_painter_studio/static/needs.js";

test("durations are said as people say them", () => {
  const said = { 0: "5 s", 1: "5 s", 12: "15 s", 59: "60 s", 60: "1 min", 95: "2 min", 3600: "1 h 0 min", 5460: "1 h 31 min" };
  for (const [seconds, words] of Object.entries(said)) assert.equal(duration(Number(seconds)), words);
  assert.deepEqual([0, 1, 2].map((number) => count(number, "stroke", "strokes")), ["0 strokes", "1 stroke", "2 strokes"]);
});

test("one brush is chosen of those of the form, and all are named", () => {
  const options = [{ label: "usual", sets: { brushes: null } }, ...["broad", "mop", "broad, mop"].map((label) => ({ label, sets: { brushes: label.replace(" ", "") } }))];
  const house = /** @type {House} */ (/** @type {unknown} */ ({ form: { controls: [{ kind: "brushes", options }] } }));
  assert.deepEqual(oneBrush(house).map(({ value }) => value), ["broad", "mop"]);
  assert.deepEqual([null, "", "fine", "mop", "broad,medium"].map(brushesInWords), ["usual brushes", "usual brushes", "fine brush", "mop brush", "broad, medium brushes"]);
});

test("a slider stands at the nearest step, and a choice holds if all that it sets is so", () => {
  const steps = /** @type {[number | null, string][]} */ ([[null, "as long as it takes"], [10, ""], [30, ""]]);
  assert.deepEqual([null, 0, 12, 25, 900].map((minutes) => nearestStep(steps, minutes)), [0, 1, 1, 2, 2]);
  const wish = /** @type {Wish} */ (/** @type {unknown} */ ({ strokes: 80, effort: 0.5, brushes: "", ground: "white" }));
  for (const sets of [{ strokes: 80, effort: 0.5 }, { brushes: null }, { ground: "white", on_canvas: false }]) assert.ok(holds(wish, sets));
  for (const sets of [{ strokes: 80, effort: 1 }, { brushes: "fine" }, { ground: "white", on_canvas: true }]) assert.ok(!holds(wish, sets));
});

test("the sentence about a look says what it was for and does not claim that nothing changed", () => {
  const whys = ["region", "only", "freed", "goal", "asked", ""];
  const look = (/** @type {string} */ why, /** @type {number} */ gain) => ({ why, planned: { done: 1, strokes: 1, loss_before: 1, loss_after: 1 - gain, look: "plan.jpg", shown: /** @type {any} */ ({}) } });
  const sentences = whys.map((why) => outcome(look(why, 0)));
  assert.equal(new Set(sentences).size, whys.length);
  for (const sentence of sentences) assert.match(sentence, /replanned/);
  assert.match(outcome(look("region", -0.4)), /protected part.*40 % farther from the goal.*left out/);
  assert.match(outcome(look("", 0.31)), /31 % closer to the goal/);
  assert.match(outcome(look("goal", 0.1)), /closer to the new goal/);
  assert.doesNotMatch(outcome(look("", -0.2)), /left out/);
  assert.equal(outcome({ why: "asked", planned: null }), "", "nothing is said before it is known");
});

const PACE = { loading: 4, planning: 0.1, opening: 10, painting: 0.5, replanning: 0.02, known: false };
const SIZE = { strokes: 100, effort: 2, replans: 3 };

test("estimates count loading, strokes and looks", () => {
  assert.equal(toPlan(PACE, SIZE), 4 + 0.1 * 100 * 2);
  assert.equal(toPaint(PACE, SIZE), 10 + 50 + 0.02 * 2 * 100 * 1.5);
  assert.equal(toPaint(PACE, { ...SIZE, replans: 0 }), 60);
  assert.equal(toPaint(PACE, { strokes: 1, effort: 1, replans: 9 }), 10.5, "there is no look after the last stroke");
});

test("on a slow machine a guess follows what the plan took; what was measured stays", () => {
  assert.ok(toPaint(corrected(PACE, SIZE, 404), SIZE) > 2 * toPaint(PACE, SIZE));
  assert.equal(toPaint(corrected(PACE, SIZE, 5), SIZE), toPaint(PACE, SIZE), "a fast plan promises nothing");
  const known = { ...PACE, known: true };
  assert.equal(corrected(known, SIZE, 404), known);
});

test("a picture stands for a goal before words do, and empty words for nothing", () => {
  const [text, style, image] = [{ kind: "text", words: "a ship", weight: 1 }, { kind: "style", picture: "s", weight: 1 }, { kind: "image", picture: "i", weight: 1 }];
  assert.equal(mainTerm([text, style, image]), image);
  assert.equal(mainTerm([style, text]), text);
  assert.equal(mainTerm([{ ...text, words: " " }]), undefined);
  weights.forEach(([weight], index) => { assert.equal(nearestWeight(weight * 1.1), index); });
});

test("the slider fades from one layer to the next", () => {
  assert.deepEqual(opacities(3, 0), [1, 0, 0]);
  assert.deepEqual(opacities(3, 1), [1, 1, 0]);
  assert.deepEqual(opacities(3, 1.25), [1, 1, 0.25]);
  assert.deepEqual(opacities(3, 2), [1, 1, 1]);
});

test("the brush is clean in a pause and says what it carries else", () => {
  const palette = [{ number: 1 }, { number: 2 }];
  assert.equal(brushWords({ status: "paused", brush: { name: "", paint: 1, since_dip: 3 } }, palette), "clean");
  assert.equal(brushWords({ status: "painting", brush: { name: "", paint: null } }, palette), "no paint yet");
  assert.equal(brushWords({ status: "painting", brush: { name: "fine", paint: 1, since_dip: 0 } }, palette), "fine, paint 2, just dipped");
  assert.equal(brushWords({ status: "painting", brush: { name: "", paint: 1, since_dip: 0 } }, palette), "paint 2, just dipped");
  assert.equal(brushWords({ status: "painting", brush: { name: "", paint: 0, since_dip: 1 } }, palette), "paint 1, 1 stroke since the dip");
});

test("a person is needed for questions, pauses, faults, plans and what is done, each once", () => {
  const state = (more, painting = null) => ({ working: true, trouble: "", question: null, plans: [], painting: painting && { progress: { painted: 0 }, wishes: { pause: null }, ...painting }, ...more });
  const needs = [
    state({ question: { id: "q1", text: "Yes?" } }, { status: "painting" }),
    state({ question: { id: "q2", text: "Yes?" } }, { status: "painting" }),
    state({}, { status: "paused", progress: { painted: 3 }, wishes: { pause: { cause: "turn" } } }),
    state({}, { status: "paused", progress: { painted: 6 }, wishes: { pause: { cause: "turn" } } }),
    state({ working: false, trouble: "The camera is gone." }, { status: "failed" }),
    state({ working: false }, { status: "finished" }),
    state({ working: false, plans: [{ status: "ready" }] }),
    state({ working: false, plans: [{ status: "ready" }, { status: "ready" }] }),
  ].map((each) => need(each, "Cup"));
  assert.equal(new Set(needs.map((each) => each?.key)).size, needs.length);
  for (const each of needs) assert.match(each?.text ?? "", /^Cup/);
  assert.match(needs[2]?.text ?? "", /your turn/);
  const quiet = [state({}, { status: "painting" }), state({ plans: [{ status: "planning" }] }), state({}, { status: "finished" }), state({ working: false }, { status: "stopped" })];
  for (const each of quiet) assert.equal(need(each, "Cup"), null);
});

test("a painting's place in the queue counts from one, and is none where it does not wait", () => {
  const work = { working: [], held: false, queue: ["a", "b"].map((painting) => ({ painting, plan: 1, job: "plan", title: "" })) };
  assert.deepEqual(["a", "b", "c"].map((painting) => placeOf(work, painting)), [1, 2, 0]);
});

test("a real robot's queue needs a person when the easel is free, and a simulated one's never", () => {
  const queue = [{ painting: "a", plan: 1, job: "plan", title: "Cup" }, { painting: "b", plan: 1, job: "paint", title: "Boat" }];
  const work = { working: [], queue, held: false };
  assert.match(turn(work, false)?.text ?? "", /turn of Boat: put up a bare canvas/);
  for (const other of [{ ...work, working: ["c"] }, { ...work, held: true }, { ...work, queue: queue.slice(0, 1) }]) assert.equal(turn(other, false), null);
  assert.equal(turn(work, true), null);
});

test("a card says how it was painted, and a long title takes several lines", () => {
  assert.match(cardFacts({ strokes: 300, paints: 12, begun: "2026-11-25T10:00:00+00:00" }), /^300 strokes, 12 paints · .*2026/);
  assert.match(cardFacts({ strokes: 1, paints: 1, begun: "2026-11-25T10:00:00+00:00" }), /^1 stroke, 1 paint · /);
  const wide = (text) => text.length;
  assert.deepEqual(linesOf("A cup of coffee", wide, 8), ["A cup of", "coffee"]);
  assert.deepEqual(linesOf("Incomprehensibilities", wide, 8), ["Incomprehensibilities"], "one word is never cut");
});

test("kinds of goals of other packages come from the studio, and ours keep the page's words", () => {
  const ready = { ready: true, missing: [], fetch: [], advice: "" };
  learnKinds({
    mirror: { ...ready, label: "Mirror image", verb: "Make the painting its own mirror image", words: true },
    image: { ...ready, label: "Other", verb: "Other", words: false },
  });
  assert.equal(KINDS.mirror.button, "Mirror image");
  assert.ok(KINDS.mirror.words);
  assert.equal(KINDS.image.verb, "Paint this picture");
  assert.equal(mainTerm([{ kind: "mirror", words: "left-right", weight: 1 }]).kind, "mirror");
});
