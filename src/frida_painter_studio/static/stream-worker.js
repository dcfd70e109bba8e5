// One connection for all pages of this browser: it has only six for a host, and seven open pages would leave none.

import { Hub } from "./stream-hub.js";

const GONE = 200000; // ms without a word from a page (a hidden one speaks once a minute)
const pages = new Map(); // port -> { topics, heard }
const last = new Map(); // topic -> its state
let state = null;
let key = "";

const hub = new Hub(
  (topic, told) => {
    last.set(topic, told);
    for (const [port, page] of pages) if (page.topics.includes(topic)) port.postMessage({ topic, state: told });
  },
  (connected, sentence) => {
    state = { connected, sentence };
    for (const port of pages.keys()) port.postMessage(state);
  },
);

function settle() {
  for (const [port, page] of pages) if (Date.now() - page.heard > GONE) pages.delete(port);
  const topics = [...pages.values()].flatMap((page) => page.topics);
  for (const topic of last.keys()) if (!topics.includes(topic)) last.delete(topic);
  hub.want(topics, key);
}

/** @type {any} */ (self).onconnect = ({ ports: [port] }) => {
  port.onmessage = ({ data }) => {
    if (data.bye) pages.delete(port);
    else {
      const before = pages.get(port)?.topics ?? [];
      pages.set(port, { topics: data.topics, heard: Date.now() });
      key = data.key || key;
      if (state) port.postMessage(state);
      for (const topic of data.topics) if (last.has(topic) && !before.includes(topic)) port.postMessage({ topic, state: last.get(topic) });
    }
    settle();
  };
};
