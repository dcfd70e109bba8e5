// The stream of what happens in the studio, for any number of topics (a painting's id, "calibration", "paintings").

const SILENCE = 12000; // ms; the studio says every few seconds that it is there
const RESTARTED = "The studio was started again: open the link that its terminal shows. Stop still works on this page.";

/** Holds one connection for all topics that are wanted. tell(topic, state); connected(whether, a sentence or ""). */
export class Hub {
  #topics = "";
  #key = "";
  #ended = new AbortController();

  constructor(tell, connected) {
    this.tell = tell;
    this.connected = connected;
  }

  /** From now on these topics, asked for with that key; nothing happens where they were wanted already. */
  want(topics, key) {
    const wanted = [...new Set(topics)].sort().join("&of=");
    if (wanted === this.#topics && key === this.#key) return;
    [this.#topics, this.#key] = [wanted, key];
    this.#ended.abort();
    this.#ended = new AbortController();
    if (wanted) this.#keep(this.#ended.signal);
  }

  async #keep(ended) {
    for (let wait = 250; !ended.aborted; wait = Math.min(2 * wait, 4000)) {
      const cut = new AbortController();
      const end = () => cut.abort();
      ended.addEventListener("abort", end);
      try {
        const answer = await fetch(`/api/events?of=${this.#topics}`, { headers: { "X-Page-Key": this.#key }, signal: cut.signal });
        if (answer.status === 401 || answer.status === 403) {
          this.connected(false, RESTARTED);
          return;
        }
        if (answer.ok && answer.body) {
          this.connected(true, "");
          wait = 250;
          await this.#read(answer.body.getReader(), end);
        } else {
          const { sentence } = await answer.json().catch(() => ({}));
          this.connected(false, sentence ?? "");
        }
      } catch { /* it is tried again */ } finally {
        ended.removeEventListener("abort", end);
      }
      if (ended.aborted) return;
      this.connected(false, "");
      await new Promise((resolve) => setTimeout(resolve, wait));
    }
  }

  async #read(reader, end) {
    const decoder = new TextDecoder();
    let rest = "";
    let silence = setTimeout(end, SILENCE);
    try {
      for (;;) {
        const { done, value } = await reader.read();
        if (done) return;
        clearTimeout(silence);
        silence = setTimeout(end, SILENCE);
        const messages = (rest + decoder.decode(value, { stream: true })).split("\n\n");
        rest = messages.pop() ?? "";
        for (const message of messages) {
          const [, topic, data] = /^event: (.*)\ndata: (.*)$/.exec(message) ?? [];
          if (topic) this.tell(topic, JSON.parse(data));
        }
      }
    } finally {
      clearTimeout(silence);
    }
  }
}
