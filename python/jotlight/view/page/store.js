// The state of the controls, which the address of the page contains after the #.

import { readAddress } from "./address.js";

const DEFAULTS = {
  start: 0,
  window: 1,
  method: "mle",
  compare: null,
  align: false,
  curve: "gamma",
  white: null,
  overlays: [],
  follow: false,
};
export const OVERLAYS = ["jots", "saturated", "uncertainty"];
const URL_DELAY = 400;

export class Store {
  constructor() {
    this.state = { ...DEFAULTS };
    this.listeners = [];
    this.timer = null;
  }

  /** Set the defaults of a capture, and then what an address states after the page. Return what is wrong in it. */
  begin(capture, hash) {
    this.defaults = { ...DEFAULTS, ...capture.state, follow: capture.live };
    const { stated, problem } = readAddress(hash.slice(1), capture, OVERLAYS);
    this.state = { ...this.defaults, ...stated };
    return problem;
  }

  /** Return the state as text for an address, without defaults. */
  text() {
    const params = new URLSearchParams();
    for (const [name, value] of Object.entries(this.state)) {
      if (JSON.stringify(value) === JSON.stringify(this.defaults[name])) continue;
      if (value === null) continue;
      const text = Array.isArray(value) ? value.join(",") : value === true ? "1" : value === false ? "0" : value;
      params.set(name, text);
    }
    return params.toString();
  }

  /** Change some values. `moving` says that another change follows soon, as while dragging. */
  set(changes, moving = false) {
    Object.assign(this.state, changes);
    for (const listener of this.listeners) listener(moving);
    this.remember();
  }

  remember() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      history.replaceState(null, "", `#${this.text()}`);
    }, URL_DELAY);
  }
}
