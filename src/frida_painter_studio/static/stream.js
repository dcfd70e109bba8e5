// Following what happens: one connection for all pages of a browser, whatever it offers for that.

import { Hub } from "./stream-hub.js";
import { key, random } from "./session.js";

const WORD = 5000; // ms between a page's signs of life
const LOST = 15000; // ms after which the page that leads is taken to be gone

/** By a worker that all pages share. */
class ByWorker {
  constructor(tell, connected, failed) {
    const worker = new SharedWorker("/static/stream-worker.js", { type: "module", name: "studio" });
    worker.onerror = failed; // its script did not come
    this.port = worker.port;
    this.port.onmessage = ({ data }) => (data.topic ? tell(data.topic, data.state) : connected(data.connected, data.sentence));
    addEventListener("pagehide", () => this.port.postMessage({ bye: true }));
  }

  want(topics) { this.port.postMessage({ topics, key: key() }); }
}

/** Where there are no such workers (phones): the page that was looked at last has the connection, and tells the others. */
class ByPages {
  #me = random();
  #leader = "";
  #heard = 0;
  #others = new Map(); // page -> { topics, heard }
  #topics = [];

  constructor(tell, connected) {
    this.channel = new BroadcastChannel("studio");
    this.tell = tell;
    this.hub = new Hub(
      (topic, state) => { this.channel.postMessage({ topic, state }); tell(topic, state); },
      (isConnected, sentence) => { this.channel.postMessage({ connected: isConnected, sentence }); connected(isConnected, sentence); },
    );
    this.channel.onmessage = ({ data }) => this.#hear(data, connected);
    addEventListener("pagehide", () => this.channel.postMessage({ gone: this.#me }));
    addEventListener("pageshow", () => this.#look());
    document.addEventListener("visibilitychange", () => this.#look());
    this.#look();
  }

  want(topics) {
    this.#topics = topics;
    this.channel.postMessage({ page: this.#me, topics });
    if (this.#leader === this.#me) this.#settle();
    else if (Date.now() - this.#heard > LOST) this.#look();
  }

  #look() { if (document.visibilityState === "visible") this.#lead(); }

  #lead() {
    this.#leader = this.#me;
    this.channel.postMessage({ leader: this.#me });
    this.#settle();
  }

  #settle() {
    for (const [page, other] of this.#others) if (Date.now() - other.heard > 40 * WORD) this.#others.delete(page);
    this.hub.want([...this.#topics, ...[...this.#others.values()].flatMap((other) => other.topics)], key());
    this.channel.postMessage({ leads: this.#me });
  }

  #hear(data, connected) {
    if (data.leader) {
      this.#leader = data.leader;
      this.hub.want([], key());
      this.channel.postMessage({ page: this.#me, topics: this.#topics });
    } else if (data.page && this.#leader === this.#me) {
      this.#others.set(data.page, { topics: data.topics, heard: Date.now() });
      this.#settle();
    } else if (data.gone) {
      this.#others.delete(data.gone);
      if (data.gone === this.#leader) this.#look();
    } else if (data.topic && this.#topics.includes(data.topic)) this.tell(data.topic, data.state);
    else if ("connected" in data) connected(data.connected, data.sentence);
    if (data.leader || data.leads || data.topic) this.#heard = Date.now();
  }
}

const following = new Map(); // a number for each -> { topic, hear, connected }
let stream = null;
let count = 0;

function open() {
  const tell = (topic, state) => { for (const each of [...following.values()]) if (each.topic === topic) each.hear(state); };
  const connected = (...how) => { for (const each of [...following.values()]) each.connected(...how); };
  const byPages = () => new ByPages(tell, connected);
  return "SharedWorker" in window ? new ByWorker(tell, connected, () => { stream = byPages(); wanted(); }) : byPages();
}

const wanted = () => stream?.want([...following.values()].map((each) => each.topic));

/**
 * Follows a topic: a painting's id, "calibration", or "paintings". hear(state) is called at once and with every change,
 * connected(whether, sentence) when the studio is there or not. Returns what ends it.
 * @param {string | undefined} topic @param {(state: any) => void} hear @param {(there: boolean, sentence: string) => void} connected
 */
export function follow(topic, hear, connected = () => {}) {
  if (!stream) {
    stream = open();
    setInterval(wanted, WORD);
    addEventListener("pageshow", wanted);
  }
  count += 1;
  const number = count;
  following.set(number, { topic, hear, connected });
  wanted();
  return () => { following.delete(number); wanted(); };
}
