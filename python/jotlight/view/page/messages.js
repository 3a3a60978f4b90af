// Short messages at the bottom of the page.

const get = (id) => document.getElementById(id);
const MILLISECONDS = 4000;
let timer = null;

/** Show a message for a few seconds. */
export function toast(text) {
  show(text);
  timer = setTimeout(dismiss, MILLISECONDS);
}

/** Show a message about a problem, which stays until it is dismissed or replaced. */
export function warn(text) {
  show(text);
  get("dismiss").hidden = false;
}

export function dismiss() {
  show("");
}

function show(text) {
  clearTimeout(timer);
  get("dismiss").hidden = true;
  get("toast").textContent = text;
}
