// The state of the controls, which the address of the page contains after the #.

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
const OVERLAYS = ["jots", "saturated", "uncertainty"];
const URL_DELAY = 400;

export class Store {
  constructor() {
    this.state = { ...DEFAULTS };
    this.listeners = [];
    this.timer = null;
  }

  /** Set the defaults of a capture, and then what the address states. */
  begin(capture) {
    this.defaults = { ...DEFAULTS, ...capture.state, follow: capture.live };
    const stated = this.parse(location.hash.slice(1));
    // An address of another capture may name methods that do not serve this one.
    const usable = capture.methods.filter((method) => !method.reason).map((method) => method.name);
    const choices = { method: usable, compare: usable.slice(1), curve: capture.curves };
    for (const [name, values] of Object.entries(choices)) {
      if (!values.includes(stated[name])) delete stated[name];
    }
    stated.overlays = (stated.overlays ?? []).filter((kind) => OVERLAYS.includes(kind));
    if (!(stated.white > 1e-12 && stated.white < 1e12)) delete stated.white;
    this.state = { ...this.defaults, ...stated };
  }

  parse(text) {
    const found = {};
    for (const [name, value] of new URLSearchParams(text)) {
      if (["start", "window"].includes(name)) {
        if (/^\d{1,15}$/.test(value)) found[name] = Number(value);
      } else if (name === "white") {
        if (Number(value) > 0) found.white = Number(value);
      } else if (["align", "follow"].includes(name)) {
        found[name] = value === "1";
      } else if (name === "overlays") {
        found.overlays = value.split(",").filter(Boolean);
      } else if (["method", "compare", "curve"].includes(name)) {
        found[name] = value;
      }
    }
    return found;
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
