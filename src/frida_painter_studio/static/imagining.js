// Pictures made from the words of a goal, by a picture maker that whoever opened the studio allowed: asked for, looked at
// while they are made, and chosen.

import * as api from "./api.js";
import { h, show } from "./dom.js";

const PLACE = "/api/imagining";

/** All pictures that were made of these words, the last ones first. @param {Making[]} makings @param {string} words */
export function picturesOf(makings, words) {
  const mine = makings.filter((making) => making.words === words).reverse();
  return mine.flatMap((making) => making.pictures.map((one, index) => ({ ...one, maker: making.maker, best: index === making.best && making.rule.startsWith("it is the nearest") })));
}

/** The seed of the next picture of these words: another one than all before. @param {Making[]} makings @param {string} words @param {number} first */
export function nextSeed(makings, words, first) {
  const seeds = makings.filter((making) => making.words === words).flatMap((making) => making.pictures.map((one) => one.seed));
  return seeds.length ? (Math.max(...seeds) + 1) % 2 ** 31 : first;
}

/**
 * Made pictures to choose from. @template {{ picture: string, seed: number }} P @param {string} words @param {P[]} pictures
 * @param {{ source: (picture: string) => string, name: (one: P, index: number) => string, note?: (one: P) => string, choose: (picture: string) => void }} of
 */
export function shelfOf(words, pictures, { source, name, note = () => "", choose }) {
  return h("ul", { class: "candidates", "aria-label": `Pictures of ${words}` }, pictures.map((one, index) => h("li", {},
    h("button", { type: "button", "aria-label": name(one, index), onclick: () => choose(one.picture) },
      h("img", { src: source(one.picture), alt: "" }), h("small", { "aria-hidden": "true" }, `seed ${one.seed}${note(one)}`)))));
}

/** A choice among the makers; nothing if there is one only. @param {House} house @param {string} chosen @param {(maker: string) => void} choose */
export const makerChoice = (house, chosen, choose) => house.makers.length > 1
  ? h("select", { "aria-label": "Picture maker", onchange: (event) => choose(event.target.value) }, house.makers.map((name) => h("option", { value: name, selected: name === chosen }, name)))
  : null;

/**
 * Places under the words of a form's goals where pictures of them are made and chosen; `chosen` takes the one that a person chose.
 * @param {House} house @param {Wish} wish @param {(term: Term, picture: { id: string, made: string, read: "yes" | "no" }) => void} chosen
 */
export function pictureMaking(house, wish, chosen) {
  /** @type {Map<HTMLElement, { term: Term, tell: () => void }>} */
  const places = new Map();
  let state = /** @type {ImaginingState | null} */ (null);
  let maker = house.makers[0];
  let asking = false;
  let awaited = 0; // version of the state from which on the last order is in it: what follows may begin with an older one

  function hear(/** @type {ImaginingState} */ told) {
    if (told.version < awaited) return;
    state = told;
    tell();
  }

  function tell() {
    for (const [element, place] of places) {
      if (element.isConnected) place.tell();
      else places.delete(element);
    }
  }

  /** Asks for pictures of the words of a goal; whether they are being made. */
  async function make(/** @type {Term} */ term) {
    if (asking) return false;
    const words = (term.words ?? "").trim();
    asking = true;
    const before = state?.version ?? 0;
    const seed = nextSeed(state?.makings ?? [], words, wish.seed);
    const begun = await house.attempt(() => api.post(`${PLACE}/start`, { words, maker, seed, width: wish.width, height: wish.height }));
    asking = false;
    if (begun) awaited = before + 1;
    return Boolean(begun);
  }

  async function choose(/** @type {Term} */ term, /** @type {string} */ picture) {
    const taken = await house.attempt(() => api.post(`${PLACE}/choose`, { picture }));
    if (taken) chosen(term, taken);
  }

  /** The place under the words of a goal. @param {Term} term */
  function place(term) {
    const element = h("div", { class: "making" });
    const ask = h("div", { class: "asking" });
    const said = h("p", { class: "label", role: "status" });
    const trouble = h("div", { class: "trouble", role: "alert" });
    const shelf = h("div", {});
    const names = makerChoice(house, maker, (name) => { maker = name; });
    const go = h("button", { type: "button", class: "quiet", title: `By ${house.makers.join(" or ")}`, onclick: () => make(term) }, "Make pictures from this text");
    const stop = h("button", { type: "button", class: "quiet", onclick: () => house.attempt(() => api.post(`${PLACE}/stop`)) }, "Stop making pictures");
    const bar = h("progress", { "aria-label": "Making pictures" });
    let shown = "";
    show(element, ask, bar, said, trouble, shelf);

    function tellPlace() {
      const words = (term.words ?? "").trim();
      const works = Boolean(state?.working);
      const mine = state?.words === words && words !== "";
      const pictures = picturesOf(state?.makings ?? [], words);
      bar.hidden = !(works && mine);
      const rests = !words || (works && !asking && (state?.version ?? 0) >= awaited);
      if (!rests) go.disabled = false;
      go.textContent = pictures.length ? "Make others, with another seed" : "Make pictures from this text";
      const wanted = works && mine ? [stop] : [go, names];
      if (ask.firstChild !== wanted[0]) show(ask, wanted);
      go.disabled = rests; // only now: a button that is disabled loses the focus, which the other one takes over
      const making = state?.makings.filter((each) => each.words === words).at(-1);
      said.textContent = works && mine ? state?.progress || `${state?.maker} begins.` : works ? "Pictures of other words are being made; wait until they are there."
        : mine && state?.stopped ? "You stopped the making." : making ? [`Made by ${making.maker}. Choose one to begin with.`, ...making.faults].join(" ") : "";
      const sentence = mine && !works ? state?.trouble ?? "" : "";
      if (trouble.textContent !== sentence) show(trouble, sentence ? h("p", {}, sentence) : null);
      const files = pictures.map((one) => one.picture).join(" ");
      if (files === shown) return;
      shown = files;
      show(shelf, pictures.length ? shelfOf(words, pictures, {
        source: (picture) => `${PLACE}/files/${picture}`, note: (one) => (one.best ? ", nearest" : ""), choose: (picture) => choose(term, picture),
        name: (one, index) => `Begin with picture ${index + 1} of ${pictures.length}, seed ${one.seed}${one.best ? ", the nearest to the words" : ""}`,
      }) : null);
    }

    places.set(element, { term, tell: tellPlace });
    tellPlace();
    return element;
  }

  return { place, tell, make, close: api.follow(house, PLACE, hear) };
}
