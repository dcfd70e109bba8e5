// "Set the goal": what to paint, and how.

import * as api from "./api.js";
import { shape } from "./canvasview.js";
import { choices, count, duration, h, kept, reveal, show, slider } from "./dom.js";
import { toPaint, toPlan } from "./estimate.js";
import { KINDS, mainTerm, nearestWeight, weights } from "./goal.js";
import { pad } from "./pad.js";

const LATER = { text: "text", style: "a style", sketch: "a drawing", semantic: "the content of a picture" }; // what may need a network first
const FIRST = { text: "+ Text", image: "+ Picture", style: "+ Style" };
const STROKES = [15, 30, 50, 80, 120, 160, 200, 250, 300, 400, 500, 650, 800, 1000];
const MINUTES = [null, 10, 15, 20, 30, 45, 60, 90, 120, 180, 240]; // of the robot
const SIZES = [["14 × 11 in", 355.6, 279.4], ["A4", 297, 210], ["A3", 420, 297], ["30 × 30 cm", 300, 300], ["20 × 20 cm", 200, 200]];
const BRUSHES = [["", "usual"], ["broad", "broad"], ["medium", "medium"], ["fine", "fine"], ["broad,medium", "broad, medium"], ["broad,medium,fine", "broad, medium, fine"], ["auto", "best suited"]]
  .map(([value, label]) => ({ value, label }));
const FOCUS = [
  { value: "faces", label: "faces", title: "Faces matter most in a picture, where there are any" },
  { value: "subject", label: "the subject", title: "What the picture shows, as networks see it, and edges matter most" },
  { value: "none", label: "all alike", title: "Every place of a picture is worth the same" },
];
const PRESETS = [
  { label: "Quick study", strokes: 80, colors: 6, replans: 2, effort: 0.5 },
  { label: "Normal", strokes: 300, colors: 12, replans: 4, effort: 1 },
  { label: "Detailed", strokes: 800, colors: 16, replans: 8, effort: 1.5 },
];

/** @returns {Wish} */
export const fresh = () => ({
  title: "", terms: [], initial: [], strokes: 300, colors: 12, width: 355.6, height: 279.4, brushes: "", replans: 4, ground: null, on_canvas: false, focus: "faces", sharpness: 0.3, drying: 20, minutes: null, effort: 1, seed: 0,
});

/**
 * The form for a wish; `wish` is changed as the person goes, `changed` is called after that. `ondraw` opens a drawing pad and
 * hands on what was drawn.
 * @param {House} house @param {Wish} wish @param {() => void} changed
 * @param {{ goalsOnly?: boolean, ondraw?: ((use: (blob: Blob) => Promise<void>) => void) | null }} options
 */
export function wishForm(house, wish, changed, { goalsOnly = false, ondraw = null } = {}) {
  const cards = h("ul", { class: "terms" });
  const how = h("div", { class: "how" });
  const time = h("p", { class: "label time", role: "status" });
  const first = h("ul", { class: "terms" });
  const chooser = h("input", { type: "file", accept: "image/*", hidden: true });
  let more = false; // whether more settings are shown
  let adding = { kind: "image", terms: wish.terms };
  wish.initial ??= [];
  if (house.canvas && !goalsOnly) [wish.width, wish.height] = house.canvas;

  async function add(kind, blob, terms = wish.terms) {
    const id = await house.attempt(() => api.upload(blob));
    if (!id) return;
    terms.push({ kind, picture: id, weight: 1 });
    if (terms === wish.terms && !wish.title && blob.name) wish.title = blob.name.replace(/\.[^.]*$/, "").replace(/[_-]+/g, " ").slice(0, 80);
    await shapeLike(id);
    draw();
    drawHow();
    changed();
  }

  let proportions = 0; // width over height of the first picture, 0 where there is none or it is to be cropped

  /** The canvas takes the first picture's proportions within its size, so that nothing of it is cropped. */
  async function shapeLike(id) {
    if (wish.terms.length !== 1 || house.canvas) return;
    const image = new Image();
    image.src = api.picture(id);
    await image.decode().catch(() => {});
    if (!image.naturalWidth) return;
    proportions = image.naturalWidth / image.naturalHeight;
    [wish.width, wish.height] = within(wish.width, wish.height);
  }

  /** The largest canvas in the picture's proportions within a sheet of that size, put upright or on its side like it. */
  function within(width, height) {
    if (!proportions) return [width, height];
    const [across, down] = proportions > 1 === width > height ? [width, height] : [height, width];
    const tall = Math.min(down, across / proportions);
    return [tall * proportions, tall].map((side) => Math.round(side * 10) / 10);
  }

  chooser.addEventListener("change", () => {
    for (const blob of chooser.files) add(adding.kind, blob, adding.terms);
    chooser.value = "";
  });

  function adder(kind, terms = wish.terms, label = `+ ${KINDS[kind].button}`) {
    const { ready, advice } = house.abilities[kind];
    return h("button", {
      type: "button", class: "add", "data-kind": terms === wish.terms ? kind : null, disabled: !ready, title: advice,
      onclick: () => {
        if (kind === "text") { addText("", terms); (terms === wish.terms ? cards : first).querySelector("li:last-child input[type=text]").focus(); }
        else if (kind === "sketch" && ondraw) ondraw((blob) => add(kind, blob));
        else choose(kind, terms);
      },
    }, label);
  }

  /** What has to be fetched before everything can be asked for; nothing where all is here. */
  function fetching() {
    const kinds = Object.keys(LATER).filter((kind) => kind in house.abilities && !house.abilities[kind].ready);
    if (!kinds.length) return null;
    const names = [...new Set(kinds.flatMap((kind) => house.abilities[kind].fetch))];
    const words = kinds.map((kind) => LATER[kind]);
    const told = words.length > 1 ? `${words.slice(0, -1).join(", ")} or ${words.at(-1)}` : words[0];
    return h("p", { class: "label advice" }, `To paint from ${told}, the program needs networks that are not installed. Run this command once in a terminal, then reload this page:`,
      h("code", {}, `frida-painter models fetch ${names.join(" ")}`));
  }

  function card(term, terms) {
    return h("li", {},
      term.picture ? h("img", { src: api.picture(term.picture), alt: KINDS[term.kind].label }) : h("span", { class: "quote", "aria-hidden": "true" }, "“"),
      h("div", {},
        term.kind === "text"
          ? h("input", { type: "text", maxLength: 300, value: term.words, placeholder: "a sailing ship at dusk", "aria-label": "What to paint", oninput: (event) => { term.words = event.target.value; changed(); } })
          : h("p", {}, terms === wish.terms ? KINDS[term.kind].verb : "The painting starts from this and keeps its composition"),
        terms !== wish.terms ? null : slider({ label: "Weight", min: 0, max: weights.length - 1, value: nearestWeight(term.weight), words: (index) => weights[index][1],
          oninput: (index) => { term.weight = weights[index][0]; changed(); } })),
      h("button", { type: "button", class: "quiet remove", "aria-label": `Remove: ${KINDS[term.kind].label}`, title: "Remove",
        onclick: () => { terms.splice(terms.indexOf(term), 1); draw(); changed(); } }, "×"));
  }

  function drawHow() {
    const same = (preset) => ["strokes", "colors", "replans", "effort"].every((name) => preset[name] === wish[name]);
    const nearest = STROKES.reduce((best, strokes, index) => (Math.abs(strokes - wish.strokes) < Math.abs(STROKES[best] - wish.strokes) ? index : best), 0);
    const set = (name) => (value) => { wish[name] = value; tellTime(); changed(); };
    tellTime();
    show(how,
      choices({ legend: "Detail", name: "preset", value: PRESETS.findIndex(same),
        options: PRESETS.map((preset, index) => ({ value: index, label: preset.label })),
        onchange: (index) => { const { label, ...values } = PRESETS[index]; Object.assign(wish, values); drawHow(); changed(); } }),
      h("details", { open: more, ontoggle: (event) => { more = event.target.open; } },
        h("summary", {}, "More settings"),
        slider({ label: "Strokes", min: 0, max: STROKES.length - 1, value: nearest, words: (index) => String(STROKES[index]), oninput: (index) => set("strokes")(STROKES[index]) }),
        slider({ label: "Paints to mix", min: 1, max: 24, value: wish.colors, oninput: set("colors") }),
        slider({ label: "Replans", min: 0, max: 12, value: wish.replans, words: (looks) => (looks ? `${looks} times it looks at the canvas and replans` : "none"), oninput: set("replans") }),
        choices({ legend: "Brush", name: "brushes", value: wish.brushes, options: BRUSHES, onchange: set("brushes") }),
        choices({ legend: "Canvas at the start", name: "ground", value: wish.on_canvas ? "as it is" : wish.ground ?? (house.simulated ? "usual" : "white"),
          options: [...(house.simulated ? [{ value: "usual", label: "usual", title: "Toned for words alone and for a picture of 100 strokes or more, otherwise white" }] : []),
            { value: "white", label: "white" }, { value: "auto", label: "toned", title: `A colour that suits the picture${house.simulated ? "" : "; you tone the canvas, by a recipe"}` },
            ...(house.simulated ? [] : [{ value: "as it is", label: "as it is", title: "Paint on what is there: a toned ground, an old painting, or what you painted" }])],
          onchange: (value) => { wish.on_canvas = value === "as it is"; wish.ground = value === "usual" ? null : value === "auto" ? "auto" : "white"; changed(); } }),
        choices({ legend: "Most careful with", name: "focus", value: wish.focus ?? "faces", options: FOCUS, onchange: set("focus") }),
        slider({ label: "Sharpness", min: 0, max: 10, value: Math.round(10 * (wish.sharpness ?? 0.3)),
          words: (tenths) => (tenths ? `${tenths / 10} times sharper than the picture` : "as sharp as the picture"), oninput: (tenths) => set("sharpness")(tenths / 10) }),
        house.simulated ? null : slider({ label: "Drying", min: 5, max: 60, value: wish.drying ?? 20, words: (minutes) => `${minutes} minutes between two layers`, oninput: set("drying") }),
        house.robot === "human" ? null : slider({ label: "Robot's time", min: 0, max: MINUTES.length - 1, value: Math.max(0, MINUTES.indexOf(wish.minutes ?? null)),
          words: (index) => (MINUTES[index] ? `at most ${MINUTES[index]} minutes` : "as long as it takes"), oninput: (index) => set("minutes")(MINUTES[index]) }),
        h("div", { class: "field" }, h("span", {}, "Start from another picture or text"), first,
          h("div", { class: "adders", role: "group", "aria-label": "Start from" }, Object.entries(FIRST).map(([kind, label]) => adder(kind, wish.initial, label)))),
        h("label", { class: "field" }, h("span", {}, "Canvas"), house.canvas ? h("span", {}, `${Math.round(wish.width)} × ${Math.round(wish.height)} mm, from the workspace file of the robot`) : canvasChoice()),
        h("label", { class: "field" }, h("span", {}, "Seed"), h("span", { class: "pair" },
          h("input", { type: "number", min: 0, max: 2147483647, step: 1, value: wish.seed, onchange: (event) => { wish.seed = Math.max(0, Math.min(2147483647, Math.trunc(Number(event.target.value)) || 0)); event.target.value = wish.seed; changed(); } }),
          h("small", {}, "The same seed gives the same painting. Another seed gives a different one.")))));
  }

  /** How long it will take, from how long the last paintings took here. */
  function tellTime() {
    show(time, `${house.pace.known ? "About" : "At a first guess,"} ${duration(toPlan(house.pace, wish))} to plan, and ${duration(toPaint(house.pace, wish))} to paint.`);
  }

  function canvasChoice() {
    const sides = (width, height) => [Math.max(width, height), Math.min(width, height)];
    const near = (/** @type {number[]} */ [long, short]) => Math.abs(long - Math.max(wish.width, wish.height)) < 0.15 && Math.abs(short - Math.min(wish.width, wish.height)) < 0.15;
    const place = SIZES.findIndex(([, width, height]) => near(sides(...within(width, height))));
    const turned = wish.height > wish.width;
    const set = (index, upright) => {
      const [, width, height] = SIZES[Math.max(0, index)];
      [wish.width, wish.height] = within(...(upright ? [height, width] : [width, height]));
      changed();
      drawHow();
    };
    const crop = () => { proportions = 0; set(place, turned); };
    return h("span", { class: "pair" },
      h("select", { onchange: (event) => set(event.target.selectedIndex, turned) }, SIZES.map(([name], index) => h("option", { selected: index === place }, name))),
      proportions
        ? h("button", { type: "button", class: "quiet", title: "The canvas has the aspect ratio of the picture. Use the whole sheet instead and crop the picture.", onclick: crop }, "Use the whole sheet")
        : h("button", { type: "button", class: "quiet", onclick: () => set(place, !turned) }, "Rotate"));
  }

  function draw() {
    show(cards, wish.terms.map((term) => card(term, wish.terms)));
    show(first, wish.initial.map((term) => card(term, wish.initial)));
    if (!how.hasChildNodes()) drawHow();
  }

  drawHow();
  const element = h("div", { class: "wish" },
    goalsOnly ? null : h("label", { class: "field title" }, h("span", {}, "Title"), h("input", { type: "text", maxLength: 80, value: wish.title, placeholder: "Untitled", oninput: (event) => { wish.title = event.target.value; changed(); } })),
    cards,
    h("div", { class: "adders", role: "group", "aria-label": "Add to the goal" }, Object.keys(KINDS).filter((kind) => kind in house.abilities).map((kind) => adder(kind))),
    fetching(),
    chooser, goalsOnly ? null : [how, time]);
  draw();

  /** Lets a person choose a file for a goal of that kind. */
  function choose(kind, terms = wish.terms) {
    adding = { kind, terms };
    chooser.click();
  }

  function addText(words, terms = wish.terms) {
    terms.push({ kind: "text", words, weight: 1 });
    draw();
    changed();
  }

  return { element, add, addText, choose, drawButton: () => element.querySelector("[data-kind=sketch]") };
}

const DRAFT = "draft"; // under which name a goal is kept until its plan is asked for

/** The goal that was left unfinished, without pictures that are gone; null where there is none. */
async function draft() {
  const left = kept.get(DRAFT);
  if (!left?.terms) return null;
  const here = async (term) => !term.picture || (await fetch(api.picture(term.picture)).catch(() => ({ ok: false }))).ok;
  const still = async (terms) => { const known = await Promise.all(terms.map(here)); return terms.filter((_, index) => known[index]); };
  return { ...fresh(), ...left, terms: await still(left.terms), initial: await still(left.initial ?? []) };
}

/** The first view of a new painting. */
export function composer(house) {
  const element = h("section", { class: "workbench" });
  let close = () => {};
  let left = false;
  Promise.all([draft(), house.refresh()]).then(([wish]) => {
    if (left) return;
    const opened = composing(house, wish ?? fresh());
    close = opened.close;
    show(element, ...opened.elements);
    house.entered(element);
  });
  return { element, close: () => { left = true; close(); } };
}

function composing(house, wish) {
  const mount = h("div", { class: "mount drop" });
  const button = h("button", { type: "button", class: "button wide", disabled: true, onclick: begin }, "Make a plan");
  const missing = h("p", { class: "label beneath", role: "status" });
  const over = h("button", { type: "button", class: "quiet", onclick: startOver }, "Start over");
  const form = wishForm(house, wish, changed, { ondraw: sketch });
  const caption = h("p", { class: "caption" }, "The canvas");
  const easel = h("div", { class: "easel" }, mount, caption);

  /** A drawing pad in place of the canvas, over the first picture, if any. */
  function sketch(use) {
    const first = wish.terms.find((term) => term.kind === "image");
    const drawing = pad({ shape: wish.width / wish.height, background: first ? api.picture(first.picture) : "" });
    const back = () => { show(easel, mount, caption); reveal(form.element, form.drawButton() ?? form.element); };
    const done = h("button", { type: "button", class: "button", onclick: async () => {
      const blob = await drawing.picture();
      if (!blob) { house.notice("Nothing is drawn yet."); return; }
      await use(blob);
      back();
    } }, "Use this drawing");
    show(easel, drawing.element, drawing.tools, h("p", { class: "pair" }, done, h("button", { type: "button", class: "quiet", onclick: back }, "Cancel")));
    drawing.open();
  }

  function changed() {
    const title = form.element.querySelector(".title input");
    if (title && !title.value && wish.title) title.value = wish.title;
    shape(mount, wish);
    const term = mainTerm(wish.terms);
    const shown = term ? `${term.picture ?? ""}/${term.words ?? ""}` : "";
    if (mount.dataset.shown !== shown) {
      mount.dataset.shown = shown;
      show(mount, term?.picture ? h("img", { src: api.picture(term.picture), alt: "The picture to paint" })
        : term ? h("p", { class: "words" }, term.words)
          : h("button", { type: "button", class: "invitation", onclick: () => form.choose("image") },
            h("span", {}, "Choose a picture"), h("small", {}, "or drop or paste one here. Text, styles and drawings can be added in the form.")));
    }
    const wordless = [...wish.terms, ...wish.initial].some((each) => each.kind === "text" && !each.words.trim());
    missing.textContent = wordless ? "Enter the text first, or remove it." : wish.terms.length ? "" : "There is no goal yet. Add text, a picture or a drawing.";
    button.disabled = Boolean(missing.textContent) || house.role === "watch";
    const begun = Boolean(wish.terms.length || wish.initial.length || wish.title);
    over.hidden = !begun;
    kept.set(DRAFT, begun ? wish : null);
  }

  function startOver() {
    kept.set(DRAFT, null);
    window.dispatchEvent(new HashChangeEvent("hashchange"));
  }

  async function begin() {
    button.disabled = true;
    const words = wish.terms.find((term) => term.words)?.words.trim().slice(0, 80);
    const begun = await house.attempt(() => api.post("/api/paintings", { ...wish, title: wish.title || words || "" }));
    button.disabled = false;
    if (!begun) return;
    kept.set(DRAFT, null);
    location.hash = `#/p/${begun.id}`;
  }

  /** A picture, or text, that was copied elsewhere. */
  function paste(event) {
    const files = [...(event.clipboardData?.files ?? [])].filter((file) => file.type.startsWith("image/"));
    if (files.length) {
      event.preventDefault();
      for (const file of files) form.add("image", file);
      return;
    }
    const text = event.clipboardData?.getData("text/plain").trim();
    if (!text || event.target.closest?.("input, textarea")) return;
    event.preventDefault();
    if (house.abilities.text?.ready) form.addText(text.replace(/\s+/g, " ").slice(0, 300));
    else house.notice("There is no picture in the clipboard. To paint from text, a network has to be installed first.");
  }

  mount.addEventListener("dragover", (event) => { event.preventDefault(); mount.classList.add("over"); });
  mount.addEventListener("dragleave", () => mount.classList.remove("over"));
  mount.addEventListener("drop", (event) => {
    event.preventDefault();
    mount.classList.remove("over");
    for (const blob of event.dataTransfer.files) form.add("image", blob);
  });
  document.addEventListener("paste", paste);
  changed();
  const panel = h("aside", { class: "panel" }, h("h1", {}, "Set the goal"), h("p", {}, "Tell the robot what to paint: text, pictures, a style or your own drawing. You can combine several goals. The weight says how much each one counts."), form.element, button, missing, over);
  return { elements: [steps("say"), easel, panel], close: () => document.removeEventListener("paste", paste) };
}

const STEPS = [["say", "Set the goal"], ["plan", "Review the plan"], ["prepare", "Prepare"], ["paint", "Paint"], ["done", "Finished"]];

/** Where one is on the way to a painting; `end` is how it ended, where that was in another way. */
export function steps(current, end) {
  const place = STEPS.findIndex(([name]) => name === current);
  return h("ol", { class: "steps", "aria-label": "Steps to a painting" }, STEPS.map(([name, label], index) =>
    h("li", { class: index < place ? "past" : "", "aria-current": index === place ? "step" : null }, (name === "done" && end) || label)));
}

/** "fine brush", "broad, medium brushes", "usual brushes". @param {string} brushes */
const brushWords = (brushes) => `${BRUSHES.find(({ value }) => value === brushes)?.label ?? brushes} ${["broad", "medium", "fine"].includes(brushes) ? "brush" : "brushes"}`;

/** What was wished, in a line. */
export const summary = (wish) => `${count(wish.strokes, "stroke", "strokes")}, ${count(Math.min(wish.colors, wish.strokes), "paint", "paints")}, ${brushWords(wish.brushes)}`;
