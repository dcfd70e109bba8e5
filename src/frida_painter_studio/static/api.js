// Speaking to the studio. Whatever goes wrong becomes an Error whose message is a sentence to show; `away` if there was no
// answer, `now` if it cannot be done as long as the studio does what it does, `led` if another browser is in control.

import { key, orderSigns, questionSigns, setClock } from "./session.js";
import { setStopWay } from "./stop.js";
import * as stream from "./stream.js";

const OFFLINE = "The studio does not answer. Look whether it is still running in its terminal.";

async function answer(promise) {
  let response;
  try {
    response = await promise;
  } catch {
    throw Object.assign(new Error(OFFLINE), { away: true });
  }
  const body = await response.json().catch(() => ({}));
  if (!response.ok) {
    const sentence = typeof body.sentence === "string" ? body.sentence : `The studio refused (${response.status}).`;
    throw Object.assign(new Error(sentence), { led: Boolean(body.led), now: response.status === 409 });
  }
  return body;
}

/** What the studio can do, and who we are; to be asked first. */
export async function enter() {
  const studio = await get("/api/studio");
  setClock(studio.now);
  setStopWay(studio.stop);
  return studio;
}

/** @param {string} path @param {number} [patience] ms after which it is given up */
export const get = (path, patience) => answer(fetch(path, { headers: questionSigns(), signal: patience ? AbortSignal.timeout(patience) : null }));

export const post = (path, record = {}) =>
  answer(fetch(path, { method: "POST", headers: { "Content-Type": "application/json", ...orderSigns() }, body: JSON.stringify(record) }));

/** Says that this page is left: it leads no longer. Nobody waits for an answer. */
export function leave() {
  if (key()) fetch("/api/lead/back", { method: "POST", keepalive: true, headers: orderSigns() }).catch(() => {});
}

const SHARP = 2048; // pixels of the longer side that the studio keeps
const MANY = 12e6; // pixels or bytes of a picture that is made smaller first

/** Gives a picture (File or Blob) to the studio; returns its id. */
export async function upload(blob) {
  const headers = { "Content-Type": "application/octet-stream", ...orderSigns() };
  return (await answer(fetch("/api/pictures", { method: "POST", headers, body: await smaller(blob) }))).id;
}

async function smaller(blob) {
  const image = await createImageBitmap(blob).catch(() => null);
  if (!image || (image.width * image.height < MANY && blob.size < MANY)) return blob;
  const less = Math.min(1, SHARP / Math.max(image.width, image.height));
  const canvas = new OffscreenCanvas(Math.ceil(less * image.width), Math.ceil(less * image.height));
  const pen = /** @type {OffscreenCanvasRenderingContext2D} */ (canvas.getContext("2d"));
  pen.imageSmoothingQuality = "high";
  pen.drawImage(image, 0, 0, canvas.width, canvas.height);
  return canvas.convertToBlob();
}

export const picture = (id) => `/api/pictures/${id}`;
export const file = (painting, place, name) => `/paintings/${painting}/${place}/${name}`;
/** The photograph that the journal of a painting names: of the film, or of a look. */
export const shown = (painting, name) => file(painting, name.includes("/") ? "sketchbook" : "painting", name.split("/").pop());

/**
 * Reads a state and follows it (a painting, a job, the gallery): `hear` gets it at once and whenever it changes. Returns what ends that.
 * @param {House} house @param {string} path @param {(state: any) => void} hear
 */
export function follow(house, path, hear) {
  let closed = false;
  let end = () => {};
  house.attempt(async () => {
    const state = await get(path);
    if (closed) return;
    hear(state);
    end = stream.follow(path.split("/").pop(), hear, house.connected);
  });
  return () => { closed = true; end(); };
}
