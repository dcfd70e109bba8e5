// Building the page: elements, words and numbers.

/** An element with properties, listeners (`on...`) and children; texts are always texts. */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "style") Object.assign(element.style, value);
    else if (name === "class") element.className = value;
    else if (name in element && !name.startsWith("aria-")) element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** An SVG element. */
export function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/**
 * Puts children into an element in place of what it holds. Where the keyboard's focus was in it, the control of the same
 * name has it then, or else the first one: nobody is thrown back to the top of the page.
 */
export function show(element, ...children) {
  const held = document.activeElement;
  const name = held && held !== element && element.contains(held) ? named(held) : null;
  element.replaceChildren(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  if (name === null || element.contains(document.activeElement)) return;
  const controls = [...element.querySelectorAll("a[href], button:not(:disabled), input:not([hidden]), select, summary")];
  (controls.find((control) => named(control) === name) ?? controls[0])?.focus({ preventScroll: true });
}

const named = (control) => control.dataset.name ?? control.getAttribute("aria-label") ?? control.closest("label")?.textContent ?? control.textContent;

/** What a person does next in a view: on a phone it stays at the bottom of the screen, in reach of the thumb. */
export const mainAction = (...children) => h("div", { class: "main-action" }, ...children);

/** Scrolls something that was just opened into sight, and gives it the keyboard's focus. */
export function reveal(element, focused = element) {
  element.scrollIntoView({ block: "nearest" });
  focused.focus({ preventScroll: true });
}

/** The focus goes to the heading of a new view, so that keyboard and screen reader are where the eye is. */
export function focusHeading(element) {
  const heading = element.querySelector("h1");
  if (!heading) return;
  heading.tabIndex = -1;
  heading.focus({ preventScroll: true });
}

/** Something small that is kept on this browser between visits; null where there is none, or it cannot be kept at all. */
export const kept = {
  get(name) { try { return JSON.parse(localStorage.getItem(`frida-painter.${name}`) ?? "null"); } catch { return null; } },
  set(name, value) {
    try {
      if (value === null) localStorage.removeItem(`frida-painter.${name}`);
      else localStorage.setItem(`frida-painter.${name}`, JSON.stringify(value));
    } catch { /* a browser that keeps nothing */ }
  },
};

export const count = (number, one, many) => `${number} ${number === 1 ? one : many}`;

/** Seconds as a person says them. */
export function duration(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return `${Math.max(5, Math.ceil(whole / 5) * 5)} s`;
  if (whole < 3600) return `${Math.round(whole / 60)} min`;
  return `${Math.floor(whole / 3600)} h ${Math.round((whole % 3600) / 60)} min`;
}

/**
 * A slider with a label, and a word or two for its value.
 * @param {{ label: string, min: number, max: number, step?: number, value: number, words?: (value: number) => string | number,
 *   oninput: (value: number) => void, hint?: string }} options
 */
export function slider({ label, min, max, step = 1, value, words = String, oninput, hint }) {
  const output = h("span", { class: "value", "aria-hidden": "true" }, words(value)); // (an <output> would take the label)
  const input = h("input", {
    type: "range", min, max, step, value,
    oninput: () => { output.textContent = String(words(Number(input.value))); input.setAttribute("aria-valuetext", output.textContent); oninput(Number(input.value)); },
  });
  input.setAttribute("aria-valuetext", String(words(value)));
  return h("label", { class: "slider" }, h("span", { class: "row-between" }, h("span", {}, label), output), input, hint ? h("small", {}, hint) : null);
}

/** A picture of 36 x 24 in lines: how wide each is, and its path. @typedef {[number, string][]} Lines */

/** @param {Lines} lines */
const choicePicture = (lines) => svg("svg", { class: "choice-picture", viewBox: "0 0 36 24", "aria-hidden": "true" }, ...lines.map(([width, d]) => svg("path", { d, "stroke-width": width })));

/** A group of choices of which one holds. */
export function choices({ legend, name, options, value, onchange }) {
  return h("fieldset", { class: "choices" }, h("legend", {}, legend), h("div", { class: "segments" }, options.map((option) =>
    h("label", { title: option.title ?? "" },
      h("input", { type: "radio", name, value: option.value, checked: option.value === value, onchange: () => onchange(option.value) }),
      h("span", {}, option.picture ? choicePicture(option.picture) : null, option.label)))));
}
