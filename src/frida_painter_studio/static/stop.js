// Stop: by the button, or Escape twice. It is sent two ways at once, to a port of its own that nothing else uses and to
// the page's own; where neither answers, the page sends the person to the real emergency stop.

import { keep, kept, orderSigns } from "./session.js";

const WAY = "studio-stop"; // where it is put down: it outlives the studio's sessions
const UNTIL_DOUBT = 1500; // ms
const GIVE_UP = 30000;
const AGAIN = 1000;
const LOST = "The stop did not arrive. Use the emergency stop at the robot, or switch off its power, now.";
const LOST_SIMULATED = "The stop has not arrived yet. It is sent again every second.";
const UNHEARD = "The stop was sent, but the painter has not confirmed it. If the robot moves, use its emergency stop.";
const UNHEARD_SIMULATED = "The stop was sent, but the painter has not confirmed it yet.";
const TWICE = 700; // ms between two presses of Escape

let way = read();

function read() {
  try { return JSON.parse(kept(WAY)); } catch { return null; }
}

/** Takes note of where stops go, as the studio tells it: { port, secret }. */
export function setStopWay(told) {
  if (!told) return;
  way = told;
  keep(WAY, JSON.stringify(told));
}

/** Whether a stop can be sent from here though the studio's page does not know this browser. */
export const canStop = () => way !== null;

async function answer(promise) {
  const response = await promise;
  if (!response.ok) throw new Error(String(response.status));
  return response.json();
}

/** Sends it both ways; the first that is answered counts. */
function send(signal) {
  const ways = [answer(fetch("/api/stop", { method: "POST", headers: orderSigns(), keepalive: true, signal }))];
  if (way) {
    const address = `${location.protocol}//${location.hostname}:${way.port}/stop`;
    // Plain text and no headers: the browser asks nothing in advance.
    ways.unshift(answer(fetch(address, { method: "POST", body: way.secret, mode: "cors", credentials: "omit", keepalive: true, signal })));
  }
  return Promise.any(ways);
}

/**
 * Has the button and the keyboard stop everything.
 * @param {HTMLElement} button
 * @param {(sentence: string) => void} said shows what is of interest and no alarm
 * @param {{ pressed: () => void, arrived?: () => void, ended?: () => void, stands?: () => Promise<boolean>, dangerous: () => boolean,
 *   harmless: () => Promise<boolean> }} safety is told of a stop, its arrival and end; says whether nothing moves, whether a machine
 *   could hurt somebody, and whether nothing can move any more: then an alarm ends by itself
 */
export function armStop(button, said, safety) {
  const alarm = document.createElement("div");
  alarm.className = "stop-alarm";
  alarm.setAttribute("role", "alert");
  alarm.hidden = true;
  const words = document.createElement("p");
  const close = document.createElement("button");
  close.type = "button";
  close.addEventListener("click", () => { alarm.hidden = true; safety.ended?.(); });
  alarm.append(words, close);
  document.body.append(alarm);
  let pressing = 0;
  let watching = false;

  /** Below the header, for Stop itself stays in reach. */
  const place = () => { alarm.style.top = `${button.closest("header")?.getBoundingClientRect().bottom ?? 0}px`; };
  new ResizeObserver(place).observe(button.closest("header") ?? button);

  function warn(sentence) {
    words.textContent = sentence;
    close.textContent = safety.dangerous() ? "I have looked at the robot" : "Close";
    alarm.hidden = false;
    place();
    if (!watching) watchUntilHarmless();
  }

  async function watchUntilHarmless() {
    watching = true;
    while (!alarm.hidden) {
      await new Promise((resolve) => setTimeout(resolve, AGAIN));
      if (alarm.hidden || !(await safety.harmless()) || alarm.hidden) continue;
      pressing += 1; // it is not sent any more: it would stop what is begun later
      button.classList.remove("pressed");
      alarm.hidden = true;
      safety.ended?.();
      said("Everything has stopped.");
    }
    watching = false;
  }

  async function press() {
    pressing += 1;
    const number = pressing;
    const pressed = performance.now();
    let heard = false;
    said("Stopping everything.");
    safety.pressed();
    const lost = () => { if (number === pressing) warn(safety.dangerous() ? LOST : LOST_SIMULATED); };
    button.classList.add("pressed");
    const doubt = setTimeout(lost, UNTIL_DOUBT);
    while (number === pressing && performance.now() - pressed < GIVE_UP) {
      const cut = new AbortController();
      const patience = setTimeout(() => cut.abort(), 5000);
      const done = await send(cut.signal).catch(() => null);
      clearTimeout(patience);
      cut.abort(); // one way was enough: the other must not arrive when something else has been begun
      if (done) {
        clearTimeout(doubt);
        alarm.hidden = true;
        const late = (performance.now() - pressed) / 1000;
        if (done.heard < done.stopped) warn(safety.dangerous() ? UNHEARD : UNHEARD_SIMULATED);
        else {
          if (late > UNTIL_DOUBT / 1000) warn(`The stop arrived after ${late.toFixed(1)} s.${safety.dangerous() ? " Look at the robot." : ""}`);
          heard = done.stopped > 0;
          if (heard) safety.arrived?.();
          else said("Nothing is running.");
        }
        break;
      }
      lost();
      await new Promise((resolve) => setTimeout(resolve, AGAIN));
    }
    clearTimeout(doubt);
    if (number === pressing) setTimeout(() => button.classList.remove("pressed"), 1000);
    if (heard && safety.stands) said("The stop was heard. What is being done comes to a stand.");
    while (heard && safety.stands && number === pressing && performance.now() - pressed < GIVE_UP) {
      heard = !(await safety.stands());
      if (!heard) said("Everything has stopped.");
      await new Promise((resolve) => setTimeout(resolve, 300));
    }
    if (number === pressing) safety.ended?.();
  }

  let escaped = -TWICE;
  button.addEventListener("click", press);
  window.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || event.repeat) return;
    if (event.timeStamp - escaped < TWICE) press();
    escaped = event.timeStamp;
  }, true); // before any part of the page can keep it
}
