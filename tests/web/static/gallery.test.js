import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import "./browser.js";
import { SHAPES, STAGES } from "../../../src/frida_painter_studio/static/gallery.js";

const read = (path) => readFileSync(new URL(`../../../${path}`, import.meta.url), "utf8");
const css = ["base.css", "studio.css"].map((name) => read(`src/frida_painter_studio/static/${name}`)).join("\n");

test("each stage that the studio tells has words, a mark, and the mark a shape of its own", () => {
  const told = /stage: ([^;]*);/.exec(read("tools/page/state.d.ts"))?.[1].match(/"[^"]+"/g)?.map((name) => name.slice(1, -1)) ?? [];
  assert.ok(told.length > 10);
  assert.deepEqual(Object.keys(STAGES).sort(), told.sort());
  for (const [words, mark] of Object.values(STAGES)) assert.ok(words && SHAPES[mark], words);
  assert.equal(new Set(Object.values(SHAPES)).size, Object.keys(SHAPES).length);
});

const channels = (hex) => [1, 3, 5].map((place) => Number.parseInt(hex.slice(place, place + 2), 16) / 255);
const mixed = (a, b, share) => a.map((value, index) => share * value + (1 - share) * b[index]);
const luminance = (color) => color.map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4)).reduce((sum, value, index) => sum + [0.2126, 0.7152, 0.0722][index] * value, 0);
const contrast = (a, b) => { const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y); return (high + 0.05) / (low + 0.05); };

test("the words of a state can be read in both themes (WCAG AA: a contrast of 4.5)", () => {
  const variables = (name) => [...css.matchAll(new RegExp(`--${name}: (#[0-9a-f]{6})`, "g"))].map((match) => match[1]);
  const papers = variables("paper");
  assert.equal(papers.length, 2);
  const share = Number(/\.stage \{[^}]*var\(--mark\) (\d+)%/.exec(css)?.[1]) / 100;
  for (const mark of Object.keys(SHAPES)) {
    const given = new RegExp(`data-mark="${mark}"\\] \\{ --mark: (?:light-dark\\((#\\w{6}), (#\\w{6})\\)|var\\(--(\\w+)\\))`).exec(css);
    const colors = given?.[3] ? variables(given[3]) : [given?.[1] ?? "", given?.[2] ?? ""];
    colors.forEach((hex, theme) => {
      const [color, paper] = [channels(hex), channels(papers[theme])];
      const found = contrast(color, mixed(color, paper, share));
      assert.ok(found >= 4.5, `${mark} ${theme ? "dark" : "light"}: ${found.toFixed(2)}`);
    });
  }
});
