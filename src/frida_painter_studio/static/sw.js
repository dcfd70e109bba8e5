// The service worker: the page can be installed, says that the studio is away when it is, and shows notifications. It keeps
// only the page for that, with its Stop: what the page shows is always the studio's own.

const AWAY = "away-2";
const PAGE = "/static/closed.html";
const PARTS = ["closed.js", "stop.js", "session.js", "base.css", "studio.css", "stop.css", "icon.svg"].map((name) => `/static/${name}`);

self.addEventListener("install", (event) => {
  event.waitUntil(caches.open(AWAY).then((cache) => cache.addAll([PAGE, ...PARTS])).then(() => self.skipWaiting()));
});
self.addEventListener("activate", (event) => {
  const forget = async () => { for (const name of await caches.keys()) if (name !== AWAY) await caches.delete(name); };
  event.waitUntil(forget().then(() => self.clients.claim()));
});
self.addEventListener("fetch", (event) => {
  const path = new URL(event.request.url).pathname;
  const kept = event.request.mode === "navigate" ? PAGE : PARTS.includes(path) ? path : null;
  if (kept) event.respondWith(fetch(event.request).catch(() => caches.match(kept)));
});
self.addEventListener("notificationclick", (event) => {
  event.notification.close();
  event.waitUntil(self.clients.matchAll({ type: "window" }).then(([open]) => (open ? open.focus() : self.clients.openWindow("/"))));
});
