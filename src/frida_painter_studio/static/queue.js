// What is being done in the whole studio, and what waits for it: asked now and then, whatever view is shown.

import * as api from "./api.js";
import { h, show } from "./dom.js";

const BETWEEN = 3000; // ms
const PATIENCE = 9000; // ms

/**
 * @typedef {{ painting: string, plan: number, job: "plan" | "paint", title: string }} Waiting
 * @typedef {{ working: string[], moves: boolean, queue: Waiting[], held: boolean }} Work
 */

/** Asks what is being done as long as the page is seen, and tells whoever listens when that, or the connection, has changed. */
export class WorkWatch {
  /** @type {Work} */
  latest = { working: [], moves: true, queue: [], held: false }; // as long as nobody knows, something may move
  /** @type {Set<(work: Work) => void>} */
  #listeners = new Set();
  /** @type {Promise<void> | null} */
  #asking = null;

  /** @param {(there: boolean) => void} connected hears after each question if the studio has answered */
  constructor(connected) { this.connected = connected; }

  start() {
    setInterval(() => { if (document.visibilityState === "visible") this.ask(); }, BETWEEN);
    for (const change of ["online", "offline"]) addEventListener(change, () => this.ask()); // the browser's network
    this.ask();
  }

  ask() {
    this.#asking ??= this.#ask().finally(() => { this.#asking = null; });
    return this.#asking;
  }

  async #ask() {
    const work = await api.get("/api/work", PATIENCE).catch(() => null);
    this.connected(work !== null);
    if (!work || JSON.stringify(work) === JSON.stringify(this.latest)) return;
    this.latest = work;
    for (const hear of this.#listeners) hear(work);
  }

  /** Has a function hear of changes; returns what ends that. @param {(work: Work) => void} hear */
  listen(hear) {
    this.#listeners.add(hear);
    return () => { this.#listeners.delete(hear); };
  }
}

/** At which place a painting waits, from 1; 0 where it does not. @param {Work} work @param {string} painting */
export const placeOf = (work, painting) => work.queue.findIndex((waiting) => waiting.painting === painting) + 1;

/** The list of what waits, with what can be done about it. @param {House} house */
export function queueList(house) {
  const element = h("section", { class: "queue", "aria-label": "Queue" });

  const change = (path) => house.attempt(async () => { await api.post(path); await house.work.ask(); });
  const button = (label, about, path) => h("button", { type: "button", class: "quiet", "data-for": "plan", "aria-label": `${label}: ${about}`, onclick: () => change(path) }, label);

  /** @param {Work} work */
  function update({ queue, held }) {
    element.hidden = queue.length === 0;
    show(element, h("h2", {}, "Queue"),
      held ? h("p", { class: "remark" }, "Somebody pressed Stop. Nothing of this is begun until you let it go on. ",
        h("button", { type: "button", class: "button second", "data-for": "operate", onclick: () => change("/api/queue/go-on") }, "Let the queue go on")) : null,
      h("ol", {}, queue.map(({ painting, job, title }, index) => h("li", {},
        h("span", {}, h("a", { href: `#/p/${painting}` }, title), h("small", {}, job === "plan" ? "to be planned" : house.simulated ? "to be painted" : "to be painted: put up a bare canvas, then start it")),
        index ? button("Put first", title, `/api/queue/${painting}/first`) : null,
        button("Remove", title, `/api/queue/${painting}/remove`)))));
  }

  return { element, update };
}
