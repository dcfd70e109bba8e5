// The page as a whole: which view is shown, the stop button, notices.

import * as api from "./api.js";
import { calibration } from "./calibration.js";
import { composer } from "./composer.js";
import { focusHeading, h, show } from "./dom.js";
import { gallery } from "./gallery.js";
import { Herald, turn } from "./needs.js";
import { painting } from "./painting.js";
import { WorkWatch } from "./queue.js";
import { shortcuts } from "./shortcuts.js";
import { armStop } from "./stop.js";

/** @param {string} id */
const part = (id) => /** @type {HTMLElement} */ (document.getElementById(id));
const view = part("view");
const noticeBoard = part("notice");
const connection = part("connection");
const stopButton = part("stop");

let studio = null;
const work = new WorkWatch();
let active = false;
let leave = () => {};
let first = true; // the page was just opened: the focus stays where the browser puts it
let noticeTimer = 0;

/** Shows a sentence for a while, and what can be done about it. */
function notice(sentence, label = "Close", work = () => {}) {
  refuse(sentence, label, work);
  noticeTimer = setTimeout(() => show(noticeBoard), 20000);
}

/** Says why what a person wanted was not done, until it is closed: whoever looked away still learns of it. */
function refuse(sentence, label = "Close", work = () => {}) {
  clearTimeout(noticeTimer);
  show(noticeBoard, h("p", {}, sentence), h("button", { type: "button", class: "quiet", onclick: () => { show(noticeBoard); work(); } }, label));
}

/** From now on this page has the robot do things. */
async function lead() {
  if (await attempt(() => api.post("/api/lead"))) notice("This page is in control now. Repeat your command.");
}

/** Does something that may fail, and shows the sentence if it does. */
async function attempt(work) {
  try {
    const done = await work();
    show(noticeBoard);
    return done;
  } catch (/** @type {any} */ error) {
    if (error.led) refuse(error.message, "Take control", lead);
    else refuse(error.message);
    return undefined;
  }
}

const house = {
  notice,
  attempt,
  get abilities() { return studio.abilities; },
  get role() { return studio.role; },
  get simulated() { return studio.simulated; },
  get robot() { return studio.robot; },
  get camera() { return studio.camera; },
  get canvas() { return studio.canvas; },
  get pace() { return studio.pace; },
  connected(there, sentence) { connection.textContent = there ? "" : sentence || "No connection. Trying again."; },
  /** Asks again what the studio can do, and how fast it is: both change while the page is open. */
  async refresh() { studio = await api.get("/api/studio").catch(() => studio); },
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
};

async function route() {
  leave();
  house.active(false);
  house.connected(true);
  show(noticeBoard);
  const [, place = "", id = ""] = location.hash.split("/");
  const views = { "": gallery, new: composer, p: painting, calibrate: calibration };
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

armStop(stopButton, notice, async () => {
  const now = await api.get("/api/work").catch(() => null);
  return studio?.simulated === true && now !== null && now.working.length === 0;
});

document.querySelector(".bar nav")?.append(shortcuts());

try {
  studio = await api.enter();
  window.addEventListener("hashchange", route);
  window.addEventListener("pagehide", api.leave);
  const herald = new Herald();
  work.listen((now) => { house.active(active); herald.tell(turn(now, studio.simulated)); });
  work.start();
  await route();
} catch (/** @type {any} */ error) {
  show(view, h("p", { class: "lede alone" }, error.message));
}

// Installing the page, and notifications on a phone, need it; where the browser has none, or the page came unencrypted
// over a network, all else works without.
navigator.serviceWorker?.register("/sw.js").catch(() => {});
