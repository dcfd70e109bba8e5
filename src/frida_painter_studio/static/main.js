// The page as a whole: which view is shown, the stop button, notices.

import * as api from "./api.js";
import { calibration } from "./calibration.js";
import { composer } from "./composer.js";
import { focusHeading, h, show } from "./dom.js";
import { gallery } from "./gallery.js";
import { Herald, turn } from "./needs.js";
import { painting } from "./painting.js";
import { WorkWatch } from "./queue.js";
import { setup } from "./setup.js";
import { shortcuts } from "./shortcuts.js";
import { armStop } from "./stop.js";
import { teaching } from "./teach.js";

/** @param {string} id */
const part = (id) => /** @type {HTMLElement} */ (document.getElementById(id));
const view = part("view");
const noticeBoard = part("notice");
const connection = part("connection");
const stopButton = part("stop");

const AWAY = "No connection. Trying again.";

const lost = { view: "", work: "" }; // sentences of a view that follows a painting, and of the watch over all work
const work = new WorkWatch((there) => { lost.work = there ? "" : AWAY; tellConnection(); });
let active = false;
let leave = () => {};
let first = true; // the page was just opened: the focus stays where the browser puts it
let noticeTimer = 0;

let noticeClosed = () => {}; // told when the notice that is shown goes
let noticeWhile = ""; // the reason of the notice that is shown

function tellConnection() {
  const sentence = lost.view || lost.work;
  if (connection.textContent !== sentence) connection.textContent = sentence; // it is read aloud
  if (!sentence && noticeWhile === "away") clearNotice();
}

function clearNotice() {
  clearTimeout(noticeTimer);
  noticeWhile = "";
  show(noticeBoard);
  const closed = noticeClosed;
  noticeClosed = () => {};
  closed();
}

/** Shows a sentence for a while, and what can be done about it. */
function notice(sentence, label = "", work = () => {}) {
  refuse(sentence, label, work);
  noticeTimer = setTimeout(clearNotice, 20000);
}

/**
 * Says why what a person wanted was not done, until it is closed, or its reason is gone: whoever looked away still learns of it.
 * `while_` names the reason: "away" as long as there is no connection, "now" as long as the studio does the same, "" for ever.
 */
function refuse(sentence, label = "", work = () => {}, closed = () => {}, while_ = "") {
  clearNotice();
  noticeClosed = closed;
  noticeWhile = while_;
  const does = label ? h("button", { type: "button", class: "quiet", onclick: () => { noticeClosed = () => {}; clearNotice(); work(); } }, label) : null;
  show(noticeBoard, h("div", {}, h("p", {}, sentence), does, h("button", { type: "button", class: "quiet", onclick: clearNotice }, "Close")));
}

/**
 * Does something that may fail, and shows the sentence if it does. If another browser is in control, a person may take over:
 * then it is done after all.
 */
async function attempt(work) {
  try {
    const done = await work();
    clearNotice();
    return done;
  } catch (/** @type {any} */ error) {
    if (!error.led) { refuse(error.message, "", undefined, undefined, error.away ? "away" : error.now ? "now" : ""); return undefined; }
    const again = async () => { await api.post("/api/lead"); return work(); };
    return new Promise((resolve) => { refuse(error.message, "Take control and continue", () => resolve(attempt(again)), () => resolve(undefined), "now"); });
  }
}

/** What views get: what they may ask of the page, and what the studio tells of itself. */
const house = /** @type {House} */ (/** @type {unknown} */ ({
  notice,
  attempt,
  connected(there, sentence) { lost.view = there ? "" : sentence || AWAY; tellConnection(); },
  /** Asks again what the studio can do, and how fast it is: both change while the page is open. */
  async refresh() { Object.assign(house, await api.get("/api/studio").catch(() => null)); },
  /** A view, or a step of one, has just been shown. */
  entered(element) {
    element.querySelector(".steps [aria-current]")?.scrollIntoView({ block: "nearest", inline: "center" }); // a phone has no room for all
    window.scrollTo(0, 0);
    if (!first) focusHeading(element);
  },
  /** Whether something is being done in the view that is shown; what is done elsewhere can be stopped there as well. */
  active(working) {
    active = working;
    stopButton.classList.toggle("live", active || work.latest.working.length > 0 || work.latest.queue.length > 0);
  },
  work,
}));

async function route() {
  leave();
  house.active(false);
  house.connected(true);
  clearNotice();
  const [, place = "", id = ""] = location.hash.split("/");
  const views = { "": gallery, new: composer, p: painting, calibrate: calibration, setup, teach: teaching };
  const page = views[place] ?? gallery;
  for (const link of document.querySelectorAll(".bar nav a")) {
    link.toggleAttribute("aria-current", link.getAttribute("href") === `#/${place}`);
  }
  const { element, close } = page(house, id);
  view.replaceChildren(element);
  leave = close ?? (() => {});
  house.entered(element);
  first = false;
}

/** Whether a machine could hurt somebody: the setup moves one at every easel. */
const dangerous = () => house.dangerous !== false || location.hash.startsWith("#/setup") || work.latest.working.includes("setup");

let moved = true; // whether a robot may have moved since Stop was pressed
/** Whether nothing moves, as far as the studio knows. */
async function stands() {
  const now = await api.get("/api/work").catch(() => null);
  if (!document.body.dataset.role || !now) return false;
  moved ||= now.moves;
  return !now.moves;
}

armStop(stopButton, notice, {
  pressed() { moved = work.latest.moves; view.inert = true; }, // all other buttons rest until it stands
  ended() { view.inert = false; },
  stands,
  dangerous,
  harmless: async () => (await stands()) && !(dangerous() && moved), // of a machine a person has to say that it stands still
});

document.querySelector(".bar nav")?.append(shortcuts());

try {
  Object.assign(house, await api.enter());
  document.body.dataset.role = house.role; // what a role may not do is not shown to it
  part("role").textContent = { watch: "You watch", plan: "You plan", operate: "" }[house.role] ?? "";
  window.addEventListener("hashchange", route);
  window.addEventListener("pagehide", api.leave);
  const herald = new Herald();
  work.listen((now) => { if (noticeWhile === "now") clearNotice(); house.active(active); herald.tell(turn(now, house.simulated)); });
  work.start();
  await route();
} catch (/** @type {any} */ error) {
  show(view, h("p", { class: "lede alone" }, error.message));
}

// Installing the page, and notifications on a phone, need it; where the browser has none, or the page came unencrypted
// over a network, all else works without.
navigator.serviceWorker?.register("/sw.js").catch(() => {});
