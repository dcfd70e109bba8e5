// "Set the goal": what to paint, and how.

import * as api from "./api.js";
import { shape } from "./canvasview.js";
import { count, duration, h, kept, mainAction, reveal, show, slider } from "./dom.js";
import { asPainted, toPaint, toPlan } from "./estimate.js";
import { KINDS, learnKinds, nearestWeight, termPicture, weights } from "./goal.js";
import { pictureMaking } from "./imagining.js";
import { pad } from "./pad.js";
import { goalPreview } from "./preview.js";
import { brushesInWords, group, SIZES, settingControl } from "./settings.js";

const LATER = { text: "text", style: "a style", sketch: "a drawing", semantic: "the content of a picture" }; // what may need a network first
const FIRST = ["text", "image", "style"];
/** A wish of a person who has changed nothing yet. @param {House} house @returns {Wish} */
export const fresh = (house) => ({ title: "", terms: [], initial: [], width: SIZES[0][1], height: SIZES[0][2], ...house.form.usual });

/**
 * The form for a wish; `wish` is changed as the person goes, `changed` is called after that. `ondraw` opens a drawing pad and
 * hands on what was drawn.
 * @param {House} house @param {Wish} wish @param {() => void} changed
 * @param {{ goalsOnly?: boolean, ondraw?: ((use: (blob: Blob) => Promise<string | undefined>) => void) | null }} options
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
  learnKinds(house.abilities);
  if (house.canvas && !goalsOnly) [wish.width, wish.height] = house.canvas;

  const making = house.makers.length && house.role !== "watch" ? pictureMaking(house, wish, begin) : null;

  /** A made picture takes the place of its words, and is painted by its content if the networks can; a CLIP reads the words beside it. */
  function begin(term, { id, made, read }) {
    for (const [terms, list] of [[wish.terms, cards], [wish.initial, first]]) {
      const at = terms.indexOf(term);
      if (at < 0) continue;
      if (!goalsOnly && !wish.title) wish.title = term.words.trim().slice(0, 80);
      const goal = terms === wish.terms;
      const stays = goal && read === "yes";
      const again = stays && terms[at - 1]?.made; // another picture of the same words
      const kind = goal && house.abilities.semantic?.ready ? "semantic" : "image";
      const picture = { kind, picture: id, weight: again ? terms[at - 1].weight : term.weight, made };
      terms.splice(again ? at - 1 : at, again || !stays ? 1 : 0, picture);
      if (stays && !again) term.weight /= 2;
      draw();
      changed();
      reveal(list.children[terms.indexOf(picture)], list.children[terms.indexOf(picture)].querySelector(".remove"));
    }
  }

  /** Words of which a picture could be made first: those that come without another picture. */
  const bare = () => (making && !wish.initial.length && wish.terms.every((each) => each.kind === "text" || each.kind === "style") ? wish.terms.find((each) => each.kind === "text") : undefined);

  const uploads = new Set(); // pictures on their way to the studio

  /** Takes in a picture; whoever needs the whole wish waits for it by `settled`. */
  async function add(kind, blob, terms = wish.terms) {
    const work = take(kind, blob, terms);
    uploads.add(work);
    changed();
    const id = await work;
    uploads.delete(work);
    changed();
    return id;
  }

  /** Waits for all pictures; whether each of them has arrived. */
  async function settled() {
    let all = true;
    while (uploads.size) all = (await Promise.all(uploads)).every(Boolean) && all;
    return all;
  }

  async function take(kind, blob, terms) {
    const id = await house.attempt(() => api.upload(blob));
    if (!id) return undefined;
    terms.push({ kind, picture: id, weight: 1 });
    if (terms === wish.terms && !wish.title && blob.name) wish.title = blob.name.replace(/\.[^.]*$/, "").replace(/[_-]+/g, " ").slice(0, 80);
    await shapeLike(id);
    draw();
    drawHow();
    changed();
    return id;
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

  function adder(kind, terms = wish.terms) {
    const { advice } = house.abilities[kind];
    const ready = house.abilities[kind].ready || (kind === "text" && making); // words that become a picture need no network here
    return h("button", {
      type: "button", class: "add", "data-kind": terms === wish.terms ? kind : null, disabled: !ready, title: advice,
      onclick: () => {
        if (KINDS[kind].words) { addText("", terms, kind); (terms === wish.terms ? cards : first).querySelector("li:last-child input[type=text]").focus(); }
        else if (kind === "sketch" && ondraw) ondraw((blob) => add(kind, blob));
        else choose(kind, terms);
      },
    }, `+ ${KINDS[kind].button}`);
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
      term.picture ? termPicture(term, KINDS[term.kind].label) : h("span", { class: "quote", "aria-hidden": "true" }, "“"),
      h("div", {},
        KINDS[term.kind].words
          ? h("input", { type: "text", maxLength: 300, value: term.words, placeholder: term.kind === "text" ? "a sailing ship at dusk" : KINDS[term.kind].verb, "aria-label": term.kind === "text" ? "What to paint" : KINDS[term.kind].label, oninput: (event) => { term.words = event.target.value; making?.tell(); changed(); } })
          : h("p", {}, terms === wish.terms ? KINDS[term.kind].verb : "The painting starts from this and keeps its composition"),
        term.made ? h("small", {}, term.made) : null,
        terms !== wish.terms ? null : slider({ label: "Weight", min: 0, max: weights.length - 1, value: nearestWeight(term.weight), words: (index) => weights[index][1],
          oninput: (index) => { term.weight = weights[index][0]; changed(); } }),
        terms !== wish.terms ? null : house.form.controls.filter(({ level }) => level === term.kind).map((control) => settingControl(control, wish, changed))),
      h("button", { type: "button", class: "quiet remove", "aria-label": `Remove: ${KINDS[term.kind].label}`, title: "Remove",
        onclick: () => { terms.splice(terms.indexOf(term), 1); draw(); changed(); } }, "×"),
      making && term.kind === "text" ? making.place(term) : null);
  }

  const own = { canvas: canvasField, goals: startField }; // controls that are more than a setting

  function drawHow() {
    const shown = (level, done) => house.form.controls.filter((control) => control.level === level).map((control) => ({ heading: control.group, element: (own[control.kind] ?? settingControl)(control, wish, done) }));
    const rest = shown("more", () => { tellTime(); changed(); });
    tellTime();
    show(how, shown("first", () => { drawHow(); changed(); }).map(({ element }) => element),
      h("details", { open: more, ontoggle: (event) => { more = event.target.open; } }, h("summary", {}, "More settings"),
        [...new Set(rest.map(({ heading }) => heading))].map((legend) => group(legend, rest.filter(({ heading }) => heading === legend).map(({ element }) => element)))));
  }

  function canvasField({ label }) {
    return h("label", { class: "field" }, h("span", {}, label), house.canvas ? h("span", {}, `${Math.round(wish.width)} × ${Math.round(wish.height)} mm, from the workspace file of the robot`) : canvasChoice());
  }

  function startField({ label }) {
    return h("div", { class: "field" }, h("span", {}, label), first,
      h("div", { class: "adders", role: "group", "aria-label": "Start from" }, FIRST.map((kind) => adder(kind, wish.initial))));
  }

  /** How long it will take, from how long the last paintings took here; nothing is promised before one was measured. */
  function tellTime() {
    if (wish.together) { show(time, `Up to ${wish.strokes} strokes of the robot, as long as you like to draw.`); return; }
    const about = house.pace.known ? `About ${duration(toPlan(house.pace, wish))} to plan, and ${duration(toPaint(house.pace, asPainted(house, wish)))} to paint, as the last ones took here.`
      : "How long it takes is measured on your first painting here, and told from then on.";
    show(time, `${about}${house.watched ? "" : " There is no camera: the plan is painted as it is, and nobody looks."}`);
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

  /** A painting without a goal: the person begins. It needs one brush, and no plan. */
  function drawTogether(on) {
    wish.together = on;
    if (on) {
      wish.terms.splice(0);
      wish.initial.splice(0);
      wish.minutes = null;
      wish.strokes_of = null;
      if (wish.ground === "auto") wish.ground = null;
      if (wish.brushes?.includes(",")) wish.brushes = null;
    }
    how.hidden = on;
    tellTime();
    draw();
    changed();
  }

  const noGoal = () => h("li", {}, h("span", { class: "quote", "aria-hidden": "true" }, "∞"),
    h("div", {}, h("p", {}, "No goal: we draw together"), h("small", {}, "You begin with strokes of your own. The robot continues in their spirit: your colours, directions, lengths and rhythm.")),
    h("button", { type: "button", class: "quiet remove", "aria-label": "Remove: no goal", title: "Remove", onclick: () => drawTogether(false) }, "×"));

  function draw() {
    show(cards, wish.together ? noGoal() : wish.terms.map((term) => card(term, wish.terms)));
    adders.hidden = advice.hidden = Boolean(wish.together);
    show(first, wish.initial.map((term) => card(term, wish.initial)));
    if (!how.hasChildNodes()) drawHow();
  }

  drawHow();
  const advice = h("div", {}, fetching());
  const adders = h("div", { class: "adders", role: "group", "aria-label": "Add to the goal" }, Object.keys(KINDS).filter((kind) => kind in house.abilities).map((kind) => adder(kind)),
    goalsOnly || !house.watched ? null : h("button", { type: "button", class: "add", onclick: () => drawTogether(true) }, "+ No goal"));
  const element = h("div", { class: "wish" },
    goalsOnly ? null : h("label", { class: "field title" }, h("span", {}, "Title"), h("input", { type: "text", maxLength: 80, value: wish.title, placeholder: "Untitled", oninput: (event) => { wish.title = event.target.value; changed(); } })),
    cards,
    adders,
    advice,
    chooser, goalsOnly ? null : [how, time]);
  how.hidden = Boolean(wish.together);
  draw();

  /** Lets a person choose a file for a goal of that kind. */
  function choose(kind, terms = wish.terms) {
    adding = { kind, terms };
    chooser.click();
  }

  function addText(words, terms = wish.terms, kind = "text") {
    terms.push({ kind, words, weight: 1 });
    draw();
    changed();
  }

  return { element, add, addText, choose, settled, isBusy: () => uploads.size > 0, bare, make: making?.make, close: () => making?.close(), drawTerms: draw, drawButton: () => element.querySelector("[data-kind=sketch]") };
}

const DRAFT = "draft"; // under which name a goal is kept until its plan is asked for

/** Keeps a goal for the form; null for none. @param {Wish | null} wish */
export const keepDraft = (wish) => kept.set(DRAFT, wish);

/** True if a goal was begun in the form and not planned yet. */
export const draftIsBegun = () => kept.get(DRAFT) !== null;

/** The goal that was left unfinished, without pictures that are gone; null where there is none. */
async function draft(house) {
  const left = kept.get(DRAFT);
  if (!left?.terms) return null;
  const here = async (term) => !term.picture || (await fetch(api.picture(term.picture)).catch(() => ({ ok: false }))).ok;
  const still = async (terms) => { const known = await Promise.all(terms.map(here)); return terms.filter((_, index) => known[index]); };
  return { ...fresh(house), ...left, terms: await still(left.terms), initial: await still(left.initial ?? []) };
}

/** The first view of a new painting. */
export function composer(house) {
  if (house.role === "watch") return { element: h("section", { class: "workbench lost" }, h("h1", {}, "You watch here"), h("p", {}, "To set a goal, ask whoever opened the studio for another link."), h("p", {}, h("a", { href: "#/" }, "To the gallery"))) };
  const element = h("section", { class: "workbench" });
  let close = () => {};
  let left = false;
  Promise.all([draft(house), house.refresh()]).then(([wish]) => {
    if (left) return;
    const opened = composing(house, wish ?? fresh(house));
    close = opened.close;
    show(element, ...opened.elements);
    house.entered(element);
  });
  return { element, close: () => { left = true; close(); } };
}

function composing(house, wish) {
  const mount = h("div", { class: "mount drop" });
  const button = h("button", { type: "button", class: "button wide", disabled: true, onclick: () => begin(false) }, "Make a plan");
  const several = h("button", {
    type: "button", class: "quiet", title: "Side by side, to choose one", onclick: () => begin(true),
  }, variantsInWords(house));
  const missing = h("p", { class: "label beneath", role: "status" });
  const over = h("button", { type: "button", class: "quiet", onclick: startOver }, "Start over");
  let doing = ""; // what the button says while it works
  let offered = ""; // words of which pictures are made before the plan
  let takeDrawing = async () => true; // takes in what is on the pad, while that is open; false if it could not
  const form = wishForm(house, wish, changed, { ondraw: sketch });
  const preview = goalPreview(wish, cropped);
  const easel = h("div", { class: "easel" }, mount, preview.element);

  function cropped() {
    form.drawTerms();
    changed();
  }

  /** A drawing pad in place of the canvas, over the first picture, if any. */
  function sketch(use) {
    const first = wish.terms.find((term) => term.kind === "image");
    const drawing = pad({ shape: wish.width / wish.height, background: first ? api.picture(first.picture) : "" });
    const back = () => { takeDrawing = async () => true; show(easel, mount, preview.element); reveal(form.element, form.drawButton() ?? form.element); };
    let taking = null; // once, though two buttons may ask for it
    const keep = () => {
      taking ??= (async () => {
        const blob = await drawing.picture();
        const lost = Boolean(blob) && !(await use(blob));
        taking = null; // what could not be taken in is still on the pad
        if (blob && !lost) back();
        return { drawn: Boolean(blob), lost };
      })();
      return taking;
    };
    takeDrawing = async () => !(await keep()).lost;
    const done = h("button", { type: "button", class: "button", onclick: async () => { if (!(await keep()).drawn) house.notice("Nothing is drawn yet."); } }, "Use this drawing");
    show(easel, drawing.element, drawing.tools, h("p", { class: "pair" }, done, h("button", { type: "button", class: "quiet", onclick: back }, "Cancel")));
    drawing.open();
  }

  function changed() {
    const title = form.element.querySelector(".title input");
    if (title && !title.value && wish.title) title.value = wish.title;
    shape(mount, wish);
    const shown = preview.update(mount);
    if (wish.together) show(mount, h("p", { class: "words" }, "You begin"));
    else if (!shown && !mount.querySelector(".invitation")) {
      show(mount, h("button", { type: "button", class: "invitation", onclick: () => form.choose("image") },
        h("span", {}, "Choose a picture"), h("small", {}, "or drop or paste one here. Text, styles and drawings can be added in the form.")));
    }
    const wordless = [...wish.terms, ...wish.initial].some((each) => KINDS[each.kind].words && !each.words.trim());
    const taking = form.isBusy();
    missing.textContent = wordless ? "Enter the text first, or remove it." : taking ? "The picture is on its way to the studio." : wish.terms.length || wish.together ? "" : "There is no goal yet. Add text, a picture or a drawing.";
    button.disabled = Boolean(doing) || (Boolean(missing.textContent) && !(taking && !wordless));
    several.disabled = button.disabled;
    several.hidden = Boolean(doing || wish.together);
    button.textContent = doing || (wish.together ? "Draw together" : "Make a plan");
    const begun = Boolean(wish.terms.length || wish.together || wish.initial.length || wish.title);
    over.hidden = !begun;
    keepDraft(begun ? wish : null);
  }

  function startOver() {
    keepDraft(null);
    window.dispatchEvent(new HashChangeEvent("hashchange"));
  }

  async function begin(/** @type {boolean} */ variants) {
    doing = "Taking in the picture …";
    changed();
    const whole = (await takeDrawing()) && (await form.settled());
    doing = whole && (wish.terms.length || wish.together) ? "Starting the plan …" : ""; // what could not be taken in was refused in words
    changed();
    if (!doing) return;
    const bare = form.bare();
    if (bare?.words && bare.words !== offered && await form.make?.(bare)) {
      offered = bare.words;
      doing = "";
      changed();
      house.notice("Pictures are made from the text first: choose one of them, or press Make a plan again to go on without.");
      return;
    }
    const words = wish.terms.find((term) => term.words)?.words.trim().slice(0, 80);
    const place = variants ? "/api/paintings?variants=true" : "/api/paintings";
    const begun = await house.attempt(() => api.post(place, { ...wish, title: wish.title || words || "" }));
    doing = "";
    changed();
    if (!begun) return;
    keepDraft(null);
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
    if (house.abilities.text?.ready || house.makers.length) form.addText(text.replace(/\s+/g, " ").slice(0, 300));
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
  const panel = h("div", { class: "panel" }, h("h1", {}, "Set the goal"), h("p", {}, "Tell the robot what to paint: text, pictures, a style or your own drawing. You can combine several goals. The weight says how much each one counts."), form.element, mainAction(missing, h("div", { class: "pair" }, button, several)), over);
  return { elements: [steps("say"), easel, panel], close: () => { document.removeEventListener("paste", paste); form.close(); } };
}

const STEPS = [["say", "Set the goal"], ["plan", "Review the plan"], ["prepare", "Prepare"], ["paint", "Paint"], ["done", "Finished"]];

/** Where one is on the way to a painting; `end` is how it ended, where that was in another way. */
export function steps(current, end) {
  const place = STEPS.findIndex(([name]) => name === current);
  return h("ol", { class: "steps", "aria-label": "Steps to a painting" }, STEPS.map(([name, label], index) =>
    h("li", { class: index < place ? "past" : "", "data-place": `${index + 1} of ${STEPS.length}`, "aria-current": index === place ? "step" : null }, (name === "done" && end) || label)));
}

/** @param {House} house */
export const variantsInWords = ({ variants }) => `${["", "One", "Two", "Three"][variants.length] ?? variants.length} variants`;

/** What was wished, or what its plan has, in a line. @param {Wish} wish @param {Made | null} [made] */
export function summary(wish, made) {
  const strokes = count(made?.strokes || wish.strokes, "stroke", "strokes");
  if (wish.together) return `Drawn together, without a goal; at most ${strokes} of the robot`;
  const paints = count(made?.palette.length || Math.min(wish.colors, wish.strokes), "paint", "paints");
  return `${strokes}, ${paints}${wish.variant ? "" : `, ${brushesInWords(wish.brushes)}`}`;
}
