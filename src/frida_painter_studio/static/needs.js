// When a person is needed, and telling them although they look elsewhere: in the title, and as a notification.

/**
 * What somebody has to come for, as it stands: `key` changes whenever there is something new; null where nobody is needed.
 * @param {State} state of a painting @param {string} title of it
 * @returns {{ key: string, text: string } | null}
 */
export function need(state, title) {
  const { painting, question, working, trouble } = state;
  const pause = painting?.wishes.pause;
  if (question && working) return { key: `question ${question.id}`, text: `${title}: a question. ${question.text}` };
  if (painting?.status === "paused") return { key: `paused ${painting.progress.painted} ${pause?.cause}`, text: pause?.cause === "turn" ? `${title}: it is your turn to paint.` : `${title} has paused. ${pause?.reason ?? ""}`.trim() };
  if (trouble && !working) return { key: `trouble ${trouble}`, text: `${title}: ${trouble}` };
  if (painting?.status === "finished" && !working) return { key: "finished", text: `${title} is finished.` };
  const ready = state.plans?.filter((plan) => plan.status === "ready").length;
  if (!painting && !working && ready) return { key: `planned ${ready}`, text: `${title}: a plan is ready for you to look at.` };
  return null;
}

/**
 * What somebody has to come for, as far as the queue is concerned: a real robot paints nothing by itself.
 * @param {import("./queue.js").Work} work @param {boolean} simulated
 * @returns {{ key: string, text: string } | null}
 */
export function turn({ working, queue, held }, simulated) {
  const next = queue.find((waiting) => waiting.job === "paint");
  if (simulated || held || working.length || !next) return null;
  return { key: `turn ${next.painting}`, text: `It is the turn of ${next.title}: put up a bare canvas, then start it.` };
}

/** Tells of needs that arise while the page is open; those that are there when it is opened are seen anyway. */
export class Herald {
  /** @type {string | null} */
  #known = null;
  #title = "";

  /** @param {{ key: string, text: string } | null} arisen */
  tell(arisen) {
    const key = arisen?.key ?? "";
    const first = this.#known === null;
    if (key === this.#known) return;
    this.#known = key;
    this.seen();
    if (!arisen || first || !away()) return;
    this.#title = document.title;
    document.title = `● ${document.title}`;
    document.addEventListener("visibilitychange", this.seen, { once: true });
    window.addEventListener("focus", this.seen, { once: true });
    notify(arisen.text);
  }

  /** Somebody looks at the page again. */
  seen = () => {
    if (this.#title && !away()) { document.title = this.#title; this.#title = ""; }
  };
}

const away = () => document.visibilityState === "hidden" || !document.hasFocus();

/** Whether notifications can be had, but nobody was asked yet. */
export const mayAsk = () => "Notification" in window && window.isSecureContext && Notification.permission === "default";

export const ask = () => Notification.requestPermission();

async function notify(text) {
  if (!("Notification" in window) || Notification.permission !== "granted") return;
  const options = { body: text, icon: "/static/icon-192.png", tag: "needed" };
  const worker = await navigator.serviceWorker?.getRegistration();
  if (worker) await worker.showNotification("frida-painter", options); // a phone has no other way
  else new Notification("frida-painter", options).onclick = () => window.focus();
}
