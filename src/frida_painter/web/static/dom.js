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

/** Puts children into an element in place of what it holds, unless they would say the same. */
export function show(element, ...children) {
  element.replaceChildren(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
}

export const count = (number, one, many) => `${number} ${number === 1 ? one : many}`;

/** Seconds as a person says them. */
export function duration(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return `${Math.max(5, Math.ceil(whole / 5) * 5)} s`;
  if (whole < 3600) return `${Math.round(whole / 60)} min`;
  return `${Math.floor(whole / 3600)} h ${Math.round((whole % 3600) / 60)} min`;
}

/** A slider with a label, and a word or two for its value. */
export function slider({ label, min, max, step = 1, value, words = String, oninput, hint }) {
  const output = h("span", { class: "value", "aria-hidden": "true" }, words(value)); // (an <output> would take the label)
  const input = h("input", {
    type: "range", min, max, step, value,
    oninput: () => { output.textContent = words(Number(input.value)); input.setAttribute("aria-valuetext", output.textContent); oninput(Number(input.value)); },
  });
  input.setAttribute("aria-valuetext", words(value));
  return h("label", { class: "slider" }, h("span", { class: "row-between" }, h("span", {}, label), output), input, hint ? h("small", {}, hint) : null);
}

/** A group of choices of which one holds. */
export function choices({ legend, name, options, value, onchange }) {
  return h("fieldset", { class: "choices" }, h("legend", {}, legend), h("div", { class: "segments" }, options.map((option) =>
    h("label", { title: option.title ?? "" },
      h("input", { type: "radio", name, value: option.value, checked: option.value === value, onchange: () => onchange(option.value) }),
      h("span", {}, option.label)))));
}
