// What the painter wants to know of a person: yes or no, four corners to be dragged, a height to be set, a length, a place.

import * as api from "./api.js";
import { h, show, svg } from "./dom.js";
import { addressCard, chooseCard, guideCard } from "./guide.js";

const CORNERS = ["top left", "top right", "bottom right", "bottom left"];
const NUDGES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STEPS = [5, 1, 0.2]; // mm
const ZOOM = 5;

/** A card for the question of a state; `path` is where answers go, `picture(name)` where pictures are. */
export function questionCard(house, path, picture) {
  const element = h("section", { class: "question", role: "alert", hidden: true });
  const may = house.role === "operate";
  let shown = "";
  let leave = () => {};
  /** @type {((asked: any) => void) | null} */
  let goOn = null; // shows the next question of a dialogue in the same card

  const answer = (id, values) => house.attempt(() => api.post(`${path}/answer`, { question: id, ...values }));
  const button = (label, work, kind = "second") => h("button", { type: "button", class: `button ${kind}`, "data-for": "operate", disabled: !may, onclick: work }, label);

  function confirm(asked) {
    const yes = button("Yes", () => answer(asked.id, { yes: true }), asked.proposal ? "" : "second");
    const no = button("No", () => answer(asked.id, { yes: false }), asked.proposal ? "second" : "");
    show(element, h("div", { class: "asked" }, h("p", { class: "text" }, asked.text), h("p", { class: "pair" }, yes, no)),
      asked.picture ? h("img", { class: "evidence", src: picture(asked.picture), alt: "What the question is about" }) : null);
  }

  function corners(asked) {
    const places = asked.proposal ? asked.proposal.map((place) => [...place])
      : [[0.15, 0.15], [0.85, 0.15], [0.85, 0.85], [0.15, 0.85]].map(([x, y]) => [x * asked.columns, y * asked.rows]);
    let moved = !asked.proposal;
    const frame = cornerFrame(asked, picture(asked.picture), places, () => { moved = true; take.textContent = "These are the corners"; });
    const take = button(asked.proposal ? "Yes, these are the corners" : "These are the corners", () => answer(asked.id, { corners: moved ? places : asked.proposal }), "");
    show(element, h("div", { class: "asked" }, h("p", { class: "text" }, asked.text),
      h("p", { class: "label" }, "Drag the four handles, or move one with the arrow keys. Shift moves it by ten pixels."), h("p", {}, take)), frame);
  }

  function jog(asked) {
    const move = (millimetres) => answer(asked.id, { step: millimetres / 1000 });
    const height = (metres) => `${(1000 * metres).toFixed(1)} mm`;
    const share = (asked.height - asked.lowest) / Math.max(1e-9, asked.highest - asked.lowest);
    const key = (sign, step) => h("button", { type: "button", class: "key", disabled: !may, "aria-label": `${sign > 0 ? "Up" : "Down"} by ${step} mm`, onclick: () => move(sign * step) }, sign > 0 ? "▲" : "▼", h("small", {}, `${step}`));
    const keys = h("div", { class: "jog", tabIndex: 0, role: "group", "aria-label": "Jog keys" },
      h("div", { class: "keys" }, STEPS.map((step) => key(1, step)), STEPS.map((step) => key(-1, step))),
      h("div", { class: "gauge", "aria-hidden": "true" }, h("span", { style: { bottom: `${100 * Math.min(1, Math.max(0, share))}%` } })),
      h("p", {}, h("strong", {}, height(asked.height)), h("small", {}, `from ${(1000 * asked.lowest).toFixed(1)} to ${height(asked.highest)}`)));
    const onkey = (event) => {
      const sign = { ArrowUp: 1, ArrowDown: -1 }[event.key];
      if (!sign || !may || event.target.matches("input")) return;
      event.preventDefault();
      move(sign * (event.shiftKey ? 5 : event.altKey ? 0.2 : 1));
    };
    document.addEventListener("keydown", onkey);
    leave = () => document.removeEventListener("keydown", onkey);
    show(element, h("div", { class: "asked" }, h("p", { class: "text" }, asked.text), keys,
      asked.remark ? h("p", { class: "remark" }, asked.remark) : null,
      h("p", { class: "label" }, "The up and down arrow keys move the brush by 1 mm, with Shift by 5 mm, with Alt by 0.2 mm."),
      h("p", {}, button("The height is right", () => answer(asked.id, { settled: true }), ""))),
      asked.picture ? h("img", { class: "evidence", src: picture(asked.picture), alt: "Test strokes and their widths" }) : null);
  }

  function measure(asked) {
    const input = h("input", { type: "number", step: "any", min: 1000 * asked.lowest, max: 1000 * asked.highest, value: asked.proposal === null ? "" : Math.round(10000 * asked.proposal) / 10, "aria-label": "Millimetres" });
    const give = () => {
      if (input.value === "") house.notice("Measure the length and enter it in millimetres.");
      else answer(asked.id, { length: Number(input.value) / 1000 });
    };
    input.addEventListener("keydown", (event) => { if (event.key === "Enter") give(); });
    show(element, h("div", { class: "asked" }, h("p", { class: "text" }, asked.text.replace(" (metres)", "")),
      h("p", { class: "pair" }, input, h("span", { class: "label" }, "mm"), button("Save the length", give, ""))));
  }

  function guide(asked) {
    const card = guideCard(asked, may, (values) => answer(shown, values));
    leave = card.close;
    goOn = card.update;
    show(element, card.element);
  }

  const choose = (asked) => show(element, chooseCard(asked, may, (values) => answer(asked.id, values)));
  const address = (asked) => show(element, addressCard(asked, may, (values) => answer(asked.id, values)));

  function update(asked) {
    const key = asked?.id ?? "";
    if (key === shown) return;
    shown = key;
    if (goOn && asked?.again) { goOn(asked); return; }
    leave();
    leave = () => {};
    goOn = null;
    element.hidden = !asked;
    if (!asked) { show(element); return; }
    ({ confirm, corners, jog, measure, guide, choose, address })[asked.kind]?.(asked);
    const first = { measure: "input", address: "input", jog: ".jog", guide: ".guide", choose: '.thing[aria-current="true"], .thing' }[asked.kind] ?? ".button:not(.second)";
    element.querySelector(first)?.focus({ preventScroll: true });
  }

  return { element, update, close: () => leave() };
}

/** A photograph with four handles; `places` are changed as they are dragged, (column, row) pixels. */
function cornerFrame(asked, url, places, moved) {
  const overlay = svg("svg", { viewBox: `0 0 ${asked.columns} ${asked.rows}`, class: "corners" });
  const outline = svg("polygon", {});
  const loupe = h("div", { class: "loupe", hidden: true, "aria-hidden": "true" }, svg("svg", { viewBox: "-10 -10 20 20" }, svg("path", { d: "M-10 0H-2M2 0H10M0 -10V-2M0 2V10" })));
  const frame = h("div", { class: "mount photograph" }, h("img", { src: url, alt: "The photograph" }), overlay, loupe);
  frame.style.aspectRatio = `${asked.columns} / ${asked.rows}`;
  frame.style.setProperty("--shape", asked.columns / asked.rows);
  loupe.style.backgroundImage = `url("${url}")`;
  const radius = asked.columns / 55;
  const handles = places.map((_, index) => svg("circle", { r: radius, tabindex: 0, role: "slider", "aria-label": `The ${CORNERS[index]} corner` }));

  function draw() {
    outline.setAttribute("points", places.map(([x, y]) => `${x + 0.5},${y + 0.5}`).join(" "));
    handles.forEach((handle, index) => {
      const [x, y] = places[index];
      handle.setAttribute("cx", x + 0.5);
      handle.setAttribute("cy", y + 0.5);
      handle.setAttribute("aria-valuetext", `column ${Math.round(x)}, row ${Math.round(y)}`);
    });
  }

  function put(index, x, y) {
    places[index] = [Math.min(asked.columns - 1, Math.max(0, x)), Math.min(asked.rows - 1, Math.max(0, y))];
    moved();
    draw();
    look(index);
  }

  /** Shows what lies under a handle, enlarged. */
  function look(index) {
    const [x, y] = places[index];
    const box = frame.getBoundingClientRect();
    const scale = (box.width / asked.columns) * ZOOM;
    const side = loupe.offsetWidth || 140;
    loupe.hidden = false;
    loupe.classList.toggle("left", x > asked.columns / 2);
    loupe.style.backgroundSize = `${asked.columns * scale}px ${asked.rows * scale}px`;
    loupe.style.backgroundPosition = `${side / 2 - (x + 0.5) * scale}px ${side / 2 - (y + 0.5) * scale}px`;
  }

  handles.forEach((handle, index) => {
    let grip = null;
    const at = (event) => {
      const box = overlay.getBoundingClientRect();
      return [((event.clientX - box.left) / box.width) * asked.columns - 0.5, ((event.clientY - box.top) / box.height) * asked.rows - 0.5];
    };
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      const [x, y] = at(event);
      grip = [places[index][0] - x, places[index][1] - y];
      look(index);
    });
    handle.addEventListener("pointermove", (event) => {
      if (!grip) return;
      const [x, y] = at(event);
      put(index, x + grip[0], y + grip[1]);
    });
    for (const end of ["pointerup", "pointercancel"]) handle.addEventListener(end, () => { grip = null; loupe.hidden = true; });
    handle.addEventListener("blur", () => { loupe.hidden = true; });
    handle.addEventListener("keydown", (event) => {
      const nudge = NUDGES[event.key];
      if (!nudge) return;
      event.preventDefault();
      const by = event.shiftKey ? 10 : 1;
      put(index, places[index][0] + by * nudge[0], places[index][1] + by * nudge[1]);
    });
  });
  overlay.append(outline, ...handles);
  draw();
  return frame;
}
