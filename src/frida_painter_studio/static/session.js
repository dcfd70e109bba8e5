// Who this page is to the studio: its key, which only pages of exactly this address and port can read (a cookie goes to
// every port of a host). It comes once, in the address, and is taken out of it at once.

const NAME = "studio-key";
const page = random(); // of this page, as long as it is open
let known = "";
let ahead = 0; // seconds that the studio's clock is ahead of this browser's

const handed = /^#key=([\w-]+)$/.exec(location.hash);
if (handed) {
  known = handed[1];
  keep(NAME, known);
  history.replaceState(null, "", `${location.pathname}${location.search}#/`);
}

/** Puts a text down for other pages of this address, where the browser lets us. */
export function keep(name, text) {
  try { localStorage.setItem(name, text); } catch { /* it holds for this page alone */ }
}

/** What was put down under that name, "" where nothing was. */
export function kept(name) {
  try { return localStorage.getItem(name) ?? ""; } catch { return ""; }
}

/** The key that goes with all that is asked. */
export const key = () => kept(NAME) || known;

/** Takes note of the studio's clock, seconds since 1970. */
export function setClock(now) { ahead = now - Date.now() / 1000; }

/** What every question carries. */
export const questionSigns = () => ({ "X-Page-Key": key() });

/** What every order carries: the key, which page gives it, a number of its own, and when it was given. */
export const orderSigns = () => ({ ...questionSigns(), "X-Page": page, "X-Nonce": random(), "X-Given": String(Date.now() / 1000 + ahead) });

export function random() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}
