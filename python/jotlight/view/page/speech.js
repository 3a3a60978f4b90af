// What screen readers say.

import { write } from "./controls.js";

const DELAY = 700;
let timer = null;

/** Say a text, unless it was the last one. */
export function say(text) {
  clearTimeout(timer);
  write("status", text);
}

/** Say a text after a while without another one, so that fast changes are not all said. */
export function saySoon(text) {
  clearTimeout(timer);
  timer = setTimeout(() => write("status", text), DELAY);
}
