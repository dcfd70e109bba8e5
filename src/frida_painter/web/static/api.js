// Speaking to the studio. Whatever goes wrong becomes an Error whose message is a sentence to show.

const page = random(); // of this page, as long as it is open
let csrf = "";
let ahead = 0; // seconds that the studio's clock is ahead of this browser's

const OFFLINE = "The studio does not answer. Look whether it is still running in its terminal.";

async function answer(promise) {
  let response;
  try {
    response = await promise;
  } catch {
    throw new Error(OFFLINE);
  }
  const body = await response.json().catch(() => ({}));
  if (!response.ok) {
    const sentence = typeof body.sentence === "string" ? body.sentence : `The studio refused (${response.status}).`;
    throw Object.assign(new Error(sentence), { led: Boolean(body.led) });
  }
  return body;
}

function random() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** What every order carries: the studio's sign, which page gives it, a number of its own, and when it was given. */
function signs() {
  return { "X-CSRF-Token": csrf, "X-Page": page, "X-Nonce": random(), "X-Given": String(Date.now() / 1000 + ahead) };
}

/** What the studio can do, and who we are; to be asked first. */
export async function enter() {
  const studio = await answer(fetch("/api/studio"));
  csrf = studio.csrf;
  ahead = studio.now - Date.now() / 1000;
  return studio;
}

export const get = (path) => answer(fetch(path));

export const post = (path, record = {}) =>
  answer(fetch(path, { method: "POST", headers: { "Content-Type": "application/json", ...signs() }, body: JSON.stringify(record) }));

/** Says that this page is left: it leads no longer. Nobody waits for an answer. */
export function leave() {
  if (csrf) fetch("/api/lead/back", { method: "POST", keepalive: true, headers: signs() }).catch(() => {});
}

/** Gives a picture (File or Blob) to the studio; returns its id. */
export async function upload(blob) {
  if (blob.size > 32 * 2 ** 20) throw new Error("This file is larger than 32 MB; make the picture smaller first.");
  const headers = { "Content-Type": "application/octet-stream", ...signs() };
  return (await answer(fetch("/api/pictures", { method: "POST", headers, body: blob }))).id;
}

export const picture = (id) => `/api/pictures/${id}`;
export const file = (painting, place, name) => `/paintings/${painting}/${place}/${name}`;

/** Follows a painting, or the calibration: `hear` gets its state whenever it changes, `connected` whether the studio is there. */
export function follow(path, hear, connected) {
  const source = new EventSource(`${path}/events`);
  source.onmessage = (event) => hear(JSON.parse(event.data));
  source.onopen = () => connected(true);
  source.onerror = () => connected(false);
  return () => source.close();
}
