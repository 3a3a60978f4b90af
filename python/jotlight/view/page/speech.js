// What screen readers say.

import { write } from "./controls.js";

const DELAY = 700;
const waiting = new Map(); // the newest text of each subject
let timer = null;

/** Say a text, and all that waits. */
export function say(text) {
  waiting.set("now", text);
  flush();
}

/** Say a text about a subject after a while without another one, so that fast changes are not all said. */
export function saySoon(subject, text) {
  waiting.set(subject, text);
  clearTimeout(timer);
  timer = setTimeout(flush, DELAY);
}

function flush() {
  clearTimeout(timer);
  write("status", [...waiting.values()].join(". "));
  waiting.clear();
}

/** Return the name of a control: the text of its label, without notes. */
export function nameOf(control) {
  const label = control.labels?.[0] ?? control;
  const texts = [...label.childNodes].filter((node) => node.nodeType === Node.TEXT_NODE);
  return control.ariaLabel ?? texts.map((node) => node.textContent.trim()).join(" ").trim();
}

/** Return the name and the state of a control. */
export function stateOf(control) {
  const name = nameOf(control);
  if (control.matches("select")) return `${name}: ${control.selectedOptions[0]?.textContent ?? "none"}`;
  if (control.matches("[type=checkbox]")) return `${name}: ${control.checked ? "on" : "off"}`;
  if (control.matches("[type=range]")) return `${name}: ${control.getAttribute("aria-valuetext")}`;
  if (control.matches("summary")) return `${name}: ${control.parentElement.open ? "open" : "closed"}`;
  return name;
}
