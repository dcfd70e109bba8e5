// The service worker: the page can be installed, says that the studio is away when it is, and shows notifications. It keeps
// nothing else: what the page shows is always the studio's own.

const AWAY = "away-1";

self.addEventListener("install", (event) => {
  event.waitUntil(caches.open(AWAY).then((cache) => cache.add("/static/offline.html")).then(() => self.skipWaiting()));
});
self.addEventListener("activate", (event) => event.waitUntil(self.clients.claim()));
self.addEventListener("fetch", (event) => {
  if (event.request.mode !== "navigate") return;
  event.respondWith(fetch(event.request).catch(() => caches.match("/static/offline.html")));
});
self.addEventListener("notificationclick", (event) => {
  event.notification.close();
  event.waitUntil(self.clients.matchAll({ type: "window" }).then(([open]) => (open ? open.focus() : self.clients.openWindow("/"))));
});
