// The settings of a painting: what can be chosen, each choice with a small picture, and the groups that they stand in.

import { h } from "./dom.js";

export const STROKES = [15, 30, 50, 80, 120, 160, 200, 250, 300, 400, 500, 650, 800, 1000];
export const MINUTES = [null, 10, 15, 20, 30, 45, 60, 90, 120, 180, 240]; // of the robot
/** @type {[string, number, number][]} */
export const SIZES = [["14 × 11 in", 355.6, 279.4], ["A4", 297, 210], ["A3", 420, 297], ["30 × 30 cm", 300, 300], ["20 × 20 cm", 200, 200]];

/** The index of the nearest number of strokes that can be chosen. @param {number} strokes */
export const nearestStrokes = (strokes) => STROKES.reduce((best, each, index) => (Math.abs(each - strokes) < Math.abs(STROKES[best] - strokes) ? index : best), 0);

const [BROAD, MEDIUM, FINE] = [7, 4, 1.6]; // widths of marks
const wave = (y) => `M5 ${y + 1}c8 -5 16 5 26 -1`;

/** @type {{ value: string, label: string, picture: import("./dom.js").Lines }[]} */
const BRUSHES = [
  { value: "", label: "usual", picture: [[1.2, "M6 4h24v16h-24z"], [3, "M11 12h14"]] },
  { value: "broad", label: "broad", picture: [[BROAD, wave(12)]] },
  { value: "medium", label: "medium", picture: [[MEDIUM, wave(12)]] },
  { value: "fine", label: "fine", picture: [[FINE, wave(12)]] },
  { value: "broad,medium", label: "broad, medium", picture: [[BROAD, wave(8)], [MEDIUM, wave(18)]] },
  { value: "broad,medium,fine", label: "broad, medium, fine", picture: [[BROAD, wave(6)], [MEDIUM, wave(14)], [FINE, wave(20)]] },
];
const OURS = ["broad", "medium", "fine"];

/** One brush each: ours, and on a real easel those of other packages. @param {House} house */
export const oneBrush = (house) => [...OURS, ...(house.simulated ? [] : house.brushes.filter((name) => !OURS.includes(name)))].map((brush) => ({ value: brush, label: brush }));

/** Brushes of a painting. @param {House} house */
export const brushes = (house) => [...BRUSHES, ...oneBrush(house).slice(OURS.length).map((brush) => ({ ...brush, picture: /** @type {import("./dom.js").Lines} */ ([[MEDIUM, wave(12)]]) }))];

/** "fine brush", "broad, medium brushes", "usual brushes". @param {string} names */
export const brushesInWords = (names) => `${BRUSHES.find(({ value }) => value === names)?.label ?? names} ${names && !names.includes(",") ? "brush" : "brushes"}`;

/** @type {{ value: string, label: string, title: string, picture: import("./dom.js").Lines }[]} */
export const FOCUS = [
  { value: "faces", label: "faces", title: "Faces matter most in a picture, where there are any", picture: [[1.5, "M18 3a9 9 0 1 0 .01 0M15 9.5v.5M21 9.5v.5M14 15c2.5 2.5 5.5 2.5 8 0"]] },
  { value: "none", label: "all alike", title: "Every place of a picture is worth the same", picture: [[1.2, "M4 3h28v18h-28z"], [2.5, "M11 8v.1M18 8v.1M25 8v.1M11 16v.1M18 16v.1M25 16v.1"]] },
];
/** @type {{ label: string, strokes: number, colors: number, replans: number, effort: number, picture: import("./dom.js").Lines }[]} */
export const PRESETS = [
  { label: "Quick study", strokes: 80, colors: 6, replans: 2, effort: 0.5, picture: [[BROAD, "M7 8c6-3 12 2 20-1"], [BROAD, "M10 18c6-3 10 1 18-1"]] },
  { label: "Normal", strokes: 300, colors: 12, replans: 4, effort: 1, picture: [[MEDIUM, "M6 5c4-2 7 1 11-.5M20 5c3-1 6 1 10 0M8 12c5-2 8 1 12-.5M24 12c2-.5 3 .5 6 0M6 19c4-2 7 1 10-.5M20 19c4-1 6 1 9 0"]] },
  { label: "Detailed", strokes: 800, colors: 16, replans: 8, effort: 1.5, picture: [[2, "M5 4c3-1 4 1 7 0M15 4c2-1 4 1 6 0M24 4c2-1 4 1 7 0M7 9c2-1 4 1 6 0M16 9c3-1 4 1 7 0M26 9c1-.5 3 .5 5 0M5 14c3-1 4 1 7 0M15 14c2-1 4 1 6 0M24 14c2-1 4 1 7 0M7 19c2-1 4 1 6 0M16 19c3-1 4 1 7 0M26 19c1-.5 3 .5 5 0"]] },
];

const SHEET = "M6 3h24v18h-24z";

/** How the canvas may be at the start. @param {House} house @returns {{ value: string, label: string, title?: string, picture: import("./dom.js").Lines }[]} */
export const grounds = (house) => [
  ...(house.simulated ? [{ value: "usual", label: "usual", title: "Toned for words alone and for a picture of 100 strokes or more, otherwise white", picture: /** @type {import("./dom.js").Lines} */ ([[1.2, SHEET], [1.2, "M30 3l-24 18M24 3l-18 13M30 8l-17 13"]]) }] : []),
  { value: "white", label: "white", picture: [[1.2, SHEET]] },
  { value: "auto", label: "toned", title: `A colour that suits the picture${house.simulated ? "" : "; you tone the canvas, by a recipe"}`, picture: [[1.2, SHEET], [11, "M12 12h12"]] },
  ...(house.simulated || !house.watched ? [] : [{ value: "as it is", label: "as it is", title: "Paint on what is there: a toned ground, an old painting, or what you painted", picture: /** @type {import("./dom.js").Lines} */ ([[1.2, SHEET], [2.5, "M10 15c3-8 6 4 9-3s5-2 7 0"]]) }]),
];

/** Settings that belong together. @param {string} legend @param {(Node | null)[]} settings */
export const group = (legend, ...settings) => h("fieldset", { class: "group" }, h("legend", {}, legend), settings);
