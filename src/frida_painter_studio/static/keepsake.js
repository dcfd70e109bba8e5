// What a finished painting leaves to show: goal and painting under a line that can be moved, and a card to print or save.

import { showCrop } from "./crop.js";
import { count, h } from "./dom.js";

const WIDTH = 1500; // pixels of the card that is saved
const MARGIN = 75;
const INK = "#23211e";
const SOFT = "#6a655d";
const SERIF = '"Iowan Old Style", "Palatino Linotype", Palatino, Georgia, serif';
const SANS = "system-ui, sans-serif";

/**
 * Two pictures of one canvas, and a line between them that follows pointer, finger and arrow keys.
 * @param {{ before: string, crop: number[] | null | undefined, after: string, shape: number }} options
 */
export function beforeAfter({ before, crop, after, shape }) {
  const goal = h("img", { src: before, alt: "Before: the goal" });
  showCrop(goal, crop);
  const range = h("input", { type: "range", min: 0, max: 100, value: 50, "aria-label": "Before and after: how much of the goal is shown", oninput: () => move() });
  const element = h("div", { class: "compare" }, h("img", { src: after, alt: "After: the painting" }), h("div", { class: "before" }, goal), range, h("span", { class: "line", "aria-hidden": "true" }));
  element.style.aspectRatio = String(shape);
  function move() {
    element.style.setProperty("--at", `${range.value}%`);
    range.setAttribute("aria-valuetext", `${range.value} % goal, ${100 - Number(range.value)} % painting`);
  }
  move();
  return h("figure", {}, element, h("figcaption", {}, "Before and after: move the line"));
}

/** What is written on a card. @param {{ strokes: number, paints: number, begun: string }} facts */
export function cardFacts({ strokes, paints, begun }) {
  const date = new Date(begun).toLocaleDateString(undefined, { day: "numeric", month: "long", year: "numeric" });
  return `${count(strokes, "stroke", "strokes")}, ${count(paints, "paint", "paints")} · ${date}`;
}

/**
 * A card with the painting: to print, to save, and to share where the browser can.
 * @param {{ title: string, picture: string, facts: string, paints: string[], notice: (sentence: string) => void }} options
 */
export function paintingCard({ title, picture, facts, paints, notice }) {
  const image = h("img", { src: picture, alt: `The painting: ${title}` });
  const file = `${title.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "").slice(0, 60) || "painting"}-card.png`;

  async function drawn() {
    await image.decode();
    const blob = await drawCard(image, title, facts, paints);
    return new File([blob], file, { type: "image/png" });
  }
  /** @param {(card: File) => unknown} work */
  const doing = (work) => async () => {
    try {
      await work(await drawn());
    } catch (/** @type {any} */ error) {
      if (error.name !== "AbortError") notice("The card cannot be made: the painting's picture did not come. Try again.");
    }
  };
  function save(/** @type {File} */ card) {
    const address = URL.createObjectURL(card);
    h("a", { href: address, download: card.name }).click();
    setTimeout(() => URL.revokeObjectURL(address), 60000);
  }
  const button = (label, onclick) => h("button", { type: "button", class: "button second", onclick }, label);
  const shares = navigator.canShare?.({ files: [new File([], "card.png", { type: "image/png" })] });
  return h("section", { class: "keepsake", "aria-labelledby": "card-title" }, h("h2", { id: "card-title" }, "A card"),
    h("div", { class: "card" }, image, h("p", { class: "card-title" }, title), h("p", { class: "card-facts" }, facts),
      h("p", { class: "card-paints", "aria-hidden": "true" }, paints.map((hex) => h("b", { style: { background: hex } })))),
    h("p", { class: "actions-row" }, button("Save the card", doing(save)), button("Print the card", () => window.print()),
      shares ? button("Share", doing((card) => navigator.share({ files: [card], title }))) : null));
}

/** The words of a title in lines that fit. @param {(text: string) => number} wide @param {number} room */
export function linesOf(text, wide, room) {
  const lines = [""];
  for (const word of text.split(/\s+/)) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (lines.at(-1) && wide(longer) > room) lines.push(word);
    else lines[lines.length - 1] = longer;
  }
  return lines;
}

/** @param {HTMLImageElement} image @param {string} title @param {string} facts @param {string[]} paints @returns {Promise<Blob>} */
function drawCard(image, title, facts, paints) {
  const room = WIDTH - 2 * MARGIN;
  const tall = Math.round((room * image.naturalHeight) / image.naturalWidth);
  const canvas = h("canvas", { width: WIDTH, height: 1 });
  const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const large = `60px ${SERIF}`;
  pen.font = large;
  const lines = linesOf(title, (text) => pen.measureText(text).width, room);
  canvas.height = MARGIN + tall + 100 + 72 * lines.length + 130 + MARGIN / 2; // (which forgets the font)
  pen.fillStyle = "#fff";
  pen.fillRect(0, 0, WIDTH, canvas.height);
  pen.drawImage(image, MARGIN, MARGIN, room, tall);
  let y = MARGIN + tall + 100;
  pen.fillStyle = INK;
  pen.font = large;
  for (const line of lines) { pen.fillText(line, MARGIN, y, room); y += 72; }
  pen.fillStyle = SOFT;
  pen.font = `32px ${SANS}`;
  pen.fillText(facts, MARGIN, y, room);
  const step = Math.min(54, room / Math.max(1, paints.length));
  paints.forEach((hex, index) => {
    pen.beginPath();
    pen.arc(MARGIN + step * (index + 0.5), y + 70, 0.4 * step, 0, 2 * Math.PI);
    pen.fillStyle = hex;
    pen.fill();
    pen.strokeStyle = "#0003";
    pen.stroke();
  });
  return new Promise((resolve, reject) => { canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("no card"))), "image/png"); });
}
