// The state of robot, brush and wells, as the painting's own events tell it.

import { count, h, show } from "./dom.js";

const ROBOT = {
  preparing: "getting ready", mixing: "waits for the paints", painting: "painting", planning: "stands still; looking and replanning",
  paused: "stands still, arm aside", finishing: "done, stands still", finished: "done, stands still", stopped: "stopped", failed: "stopped after a fault",
};

/** Which brush the robot holds, and what that carries. @param {PaintState} painting @param {Paint[]} palette */
export function brushWords(painting, palette) {
  const brush = painting.brush.name ? `${painting.brush.name}, ` : "";
  if (painting.status === "paused") return `${brush}clean`;
  const paint = painting.brush.paint === null ? undefined : palette[painting.brush.paint];
  if (!paint) return `${brush}no paint yet`;
  const strokes = painting.brush.since_dip;
  return `${brush}paint ${paint.number}, ${strokes ? `${count(strokes, "stroke", "strokes")} since the dip` : "just dipped"}`;
}

/** A strip with the three of them; `palette` are the paints of the plan. */
export function easelState(robot) {
  const words = { robot: h("span", {}), brush: h("span", {}) };
  const swatch = h("b", { class: "swatch" });
  const wells = h("ol", { class: "wells", "aria-label": "Wells" });
  const element = h("dl", { class: "easel-state" },
    h("div", {}, h("dt", {}, "Robot"), h("dd", {}, words.robot)),
    h("div", {}, h("dt", {}, "Brush"), h("dd", {}, swatch, words.brush)),
    h("div", { class: "all-wells" }, h("dt", {}, "Wells"), h("dd", {}, wells)));
  let shown = "";

  function update(painting, palette) {
    words.robot.textContent = `${robot}: ${ROBOT[painting.status] ?? painting.status}`;
    words.brush.textContent = brushWords(painting, palette);
    const paint = painting.status === "paused" ? null : palette[painting.brush.paint ?? -1];
    swatch.style.background = paint?.hex ?? "transparent";
    const key = JSON.stringify([painting.brush.dips, painting.brush.paint, palette.map((each) => each.hex)]);
    if (key === shown) return;
    shown = key;
    show(wells, palette.map((each, index) => {
      const dips = painting.brush.dips[index] ?? 0;
      const told = `Paint ${each.number}: ${count(dips, "dip", "dips")}`;
      return h("li", { class: index === painting.brush.paint ? "used" : "", title: told }, h("b", { style: { background: each.hex }, "aria-hidden": "true" }), h("small", { "aria-label": told }, String(dips)));
    }));
  }

  return { element, update };
}
