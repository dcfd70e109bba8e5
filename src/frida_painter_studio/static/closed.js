// The page of a browser that the studio does not know, or that cannot reach it: how to get in, and Stop.

import { armStop, canStop } from "./stop.js";

const AGAIN = 3000; // ms

/** @param {string} id */
const part = (id) => /** @type {HTMLElement} */ (document.getElementById(id));
const said = (sentence) => { part("connection").textContent = sentence; };

part("stop").hidden = !canStop();
if (canStop()) {
  part("no-stop").textContent = "If a robot moves and nothing answers to Stop, use its own emergency stop.";
  armStop(part("stop"), said, {
    pressed: () => said(""),
    arrived: () => said("The stop has arrived."),
    dangerous: () => true, // nothing tells here that nobody could be hurt
    harmless: async () => false,
  });
}

/** Whether the studio answers, though it does not know this page. */
const answers = () => fetch("/api/work", { cache: "no-store" }).then(() => true, () => false);

/** @param {boolean} here */
function tell(here) {
  part("unknown").hidden = !here;
  part("away").hidden = here;
  document.title = here ? "Open the studio with its link" : "The studio does not answer";
}

const first = await answers();
tell(first);
if (!first) setInterval(async () => { if (await answers()) location.reload(); }, AGAIN);
