// Keyboard shortcuts: each is a control's `aria-keyshortcuts`, and works where that control can be seen. A sheet lists them.

import { h, kept } from "./dom.js";

const SHORTCUTS = [
  ["Esc Esc", "Stop the robot and all work"],
  ["?", "This list"],
  ["G", "Gallery"], ["N", "New painting"], ["C", "Calibrate"],
  ["U", "Use this plan"], ["A", "Make another plan"],
  ["P", "Pause after this stroke, or continue"], ["L", "Look at the canvas and replan"], ["M", "Mark a part of the canvas"], ["B", "Paint on the canvas yourself"],
  ["1 2 3", "Show the goal, the plan or the painting"],
  ["← →", "On a slider: one step"],
];

const typing = (target) => target.closest("input:not([type=range], [type=radio], [type=checkbox]), textarea, select, [role=application], [contenteditable]") !== null;

/** The control that a key stands for, of those that can be seen and used now. */
function control(key) {
  /** @type {NodeListOf<HTMLButtonElement>} */
  const meant = document.querySelectorAll(`[aria-keyshortcuts="${CSS.escape(key)}"]`);
  return [...meant].find((each) => !each.disabled && each.checkVisibility());
}

/** Listens for shortcuts; returns the button that opens the list. */
export function shortcuts() {
  let on = kept.get("shortcuts") !== false; // single letters may be in somebody's way (speech input): they can be turned off
  const box = h("input", { type: "checkbox", checked: on, onchange: () => { on = box.checked; kept.set("shortcuts", on); } });
  const sheet = h("section", { id: "shortcuts", class: "sheet-of-keys", popover: "auto", "aria-labelledby": "shortcuts-title" },
    h("h2", { id: "shortcuts-title" }, "Keyboard shortcuts"),
    h("dl", {}, SHORTCUTS.map(([keys, words]) => h("div", {}, h("dt", {}, keys.split(" ").map((key) => h("kbd", {}, key))), h("dd", {}, words)))),
    h("label", { class: "check" }, box, h("span", {}, "Use shortcuts of one letter")),
    h("button", { type: "button", class: "quiet", onclick: () => sheet.hidePopover() }, "Close"));
  document.body.append(sheet);
  const opener = h("button", { type: "button", class: "quiet help", title: "Keyboard shortcuts", "aria-label": "Keyboard shortcuts", "aria-keyshortcuts": "?", onclick: () => sheet.togglePopover() }, "?");
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || event.key.length !== 1 || typing(event.target)) return;
    if (!on && event.key !== "?") return;
    const meant = control(event.key.toLowerCase());
    if (!meant) return;
    event.preventDefault();
    meant.focus();
    meant.click();
  });
  return opener;
}
