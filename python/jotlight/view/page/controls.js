// The controls: from their values to the state, and back.

import { toast, warn } from "./messages.js";
import { format } from "./plots.js";
import { OVERLAYS } from "./store.js";

const get = (id) => document.getElementById(id);
const MAX_STOPS = 8; // as the slider
const LENGTHS = 200; // maximum number of lengths on the slider of the window, whose ratios are alike

export class Controls {
  constructor(store) {
    this.store = store;
    this.reference = null; // white at exposure 0
    this.automatic = null; // the white that the server chose
    this.network = null; // the network that was used last
    this.isPlaying = false;
    this.shown = null; // the first frame and the number of frames of the image that is shown
    this.connect();
  }

  /** Fill the controls for a capture. Texts of the capture never become HTML. */
  begin(capture) {
    this.capture = capture;
    this.frames = [capture.first, capture.end];
    get("title").textContent = get("title").title = capture.title;
    document.title = `${capture.title} – jotlight`;
    get("software").textContent = capture.software;
    const methods = capture.methods.filter((method) => !method.quality);
    const sizes = capture.methods.filter((method) => method.quality);
    const usable = sizes.find((method) => !method.reason);
    const network = { name: "network", title: "network", reason: usable ? null : sizes[0]?.reason };
    const entries = [...methods.slice(0, 2), network, ...methods.slice(2)];
    fill(get("method"), entries);
    get("method-reasons").replaceChildren(...reasons(usable ? [...entries, ...sizes] : entries));
    fill(get("quality"), sizes.map((method) => ({ ...method, title: method.quality })));
    fill(get("compare"), [{ name: "", title: "none" }, ...capture.methods.slice(1)]);
    fill(get("curve"), capture.curves.map((name) => ({ name, title: name })));
    get("sensor").replaceChildren(...capture.sensor.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
    write("sensor-note", capitalize(capture.sensor_note));
    write("sensor-assumed", capture.sensor_note ? "assumed" : "");
    get("provenance").replaceChildren(...capture.provenance.map((line) => element("li", line)));
    if (!capture.provenance.length) get("provenance").append(element("li", "no file"));
    write("timeline-caption", capitalize(capture.mean_reading));
    this.update();
  }

  connect() {
    const { store } = this;
    const onSlider = (id, change) => {
      get(id).addEventListener("input", () => change(true));
      get(id).addEventListener("change", () => change(false));
    };
    onSlider("start", (moving) => store.set({ start: Number(get("start").value), follow: false }, moving));
    onSlider("window", (moving) => this.setWindow(this.lengths[get("window").value], moving));
    get("window-number").addEventListener("change", () => this.typeWindow(Number(get("window-number").value)));
    onSlider("exposure", (moving) => this.setExposure(Number(get("exposure").value), moving));
    get("method").addEventListener("change", () => this.setMethod(get("method").value));
    get("quality").addEventListener("change", () => store.set({ method: get("quality").value }));
    get("compare").addEventListener("change", () => store.set({ compare: get("compare").value || null }));
    get("align").addEventListener("change", () => store.set({ align: get("align").checked }));
    get("curve").addEventListener("change", () => store.set({ curve: get("curve").value }));
    get("auto").addEventListener("click", () => store.set({ white: null }));
    for (const kind of OVERLAYS) {
      get(`overlay-${kind}`).addEventListener("change", () => this.toggleOverlay(kind));
    }
  }

  setMethod(name) {
    const usable = [...get("quality").options].filter((option) => !option.disabled).map((option) => option.value);
    const preferred = [this.network, this.capture.recommended].find((network) => usable.includes(network));
    this.store.set({ method: name === "network" ? (preferred ?? usable[0]) : name });
  }

  toggleOverlay(kind) {
    const { overlays } = this.store.state;
    const isShown = overlays.includes(kind);
    this.store.set({ overlays: isShown ? overlays.filter((each) => each !== kind) : [...overlays, kind] });
  }

  /** Set the window that was typed, and say so if it does not exist, or is no whole number of cycles. */
  typeWindow(length) {
    const { capture, largest } = this;
    const { cycle } = capture;
    if (!(length >= 1 && length <= largest)) warn(`A window has ${cycle} to ${largest} frames.`);
    this.setWindow(length || this.store.state.window);
    if (cycle > 1 && length % cycle) toast(`The exposures repeat every ${cycle} frames, so a window has a multiple of ${cycle}.`);
  }

  /** Keep the middle of the window where it is. */
  setWindow(length, moving = false) {
    const { start, window } = this.store.state;
    const next = Math.min(this.largest, this.wholeCycles(length));
    const middle = start + window / 2;
    this.store.set({ window: next, start: this.limit(middle - next / 2, next) }, moving);
  }

  /** Move by frames. If exposures repeat, the step is whole cycles, at least one. */
  moveBy(frames, moving = false) {
    const { start, window } = this.store.state;
    const step = Math.sign(frames) * this.wholeCycles(Math.abs(frames));
    this.store.set({ start: this.limit(start + step, window), follow: false }, moving);
  }

  limit(start, window) {
    const [first, end] = this.frames;
    const { cycle } = this.capture;
    const limited = Math.max(first, Math.min(end - window, start));
    return first + Math.round((limited - first) / cycle) * cycle;
  }

  /** Return the number of frames that is nearest to some number and whole cycles, at least one. */
  wholeCycles(frames) {
    const { cycle } = this.capture;
    return Number.isFinite(frames) ? Math.max(1, Math.round(frames / cycle)) * cycle : frames;
  }

  /** The largest window: all frames, in whole cycles. */
  get largest() {
    const { cycle } = this.capture;
    return Math.max(1, Math.floor((this.frames[1] - this.frames[0]) / cycle)) * cycle;
  }

  /** List the lengths that the slider of the window has. Each step changes the window. */
  listLengths() {
    const { largest } = this;
    if (this.lengths?.at(-1) === largest) return;
    const lengths = Array.from({ length: LENGTHS }, (_, step) => this.wholeCycles(largest ** (step / (LENGTHS - 1))));
    this.lengths = [...new Set(lengths)];
    get("window").max = this.lengths.length - 1;
  }

  setExposure(stops, moving = false) {
    // After a reload, the white in the address is the reference.
    this.reference ??= this.store.state.white;
    if (this.reference === null) return;
    // Without rounding, a step up and one down would not lead back to the automatic white.
    const limited = Math.max(-MAX_STOPS, Math.min(MAX_STOPS, Math.round(stops * 20) / 20));
    this.store.set({ white: this.reference * 2 ** -limited }, moving);
  }

  get exposure() {
    const { white } = this.store.state;
    return white === null || this.reference === null ? 0 : Math.log2(this.reference / white);
  }

  /** Keep the white that the server chose for automatic exposure. */
  keepWhite(white) {
    this.reference = this.automatic = white;
    Object.assign(this.store.state, { white });
    this.update();
    this.store.remember();
  }

  setFrames(first, end) {
    this.frames = [first, end];
    this.update();
  }

  /** Show the state in the controls. */
  update() {
    if (!this.capture) return;
    const { state } = this.store;
    const { cycle } = this.capture;
    const [first, end] = this.frames;
    const isNetwork = state.method.startsWith("network-");
    if (isNetwork) this.network = state.method;
    const start = get("start");
    start.min = first;
    start.max = Math.max(first, end - state.window);
    start.step = cycle;
    start.value = state.start;
    const isRunning = this.capture.live ? state.follow : this.isPlaying;
    // While the frames follow each other without end, they are not said.
    const place = `${framesText(state)} of ${end}`;
    start.setAttribute("aria-valuetext", isRunning ? "the frames follow each other" : place);
    this.writeRange();
    write("first-frame", first);
    write("last-frame", end - 1);
    this.listLengths();
    get("window").value = nearest(this.lengths, state.window);
    get("window").setAttribute("aria-valuetext", `${state.window} frames`);
    get("window-number").max = this.largest;
    get("window-number").min = get("window-number").step = cycle;
    if (document.activeElement !== get("window-number")) get("window-number").value = state.window;
    get("method").value = isNetwork ? "network" : state.method;
    get("quality").value = isNetwork ? state.method : "";
    this.setReason("quality", isNetwork ? "" : "only a network has qualities");
    get("compare").value = state.compare ?? "";
    const ofCounts = state.method === "counts" ? "choose a method other than the counts" : "";
    this.setReason("compare", ofCounts);
    for (const option of get("compare").options) {
      const { reason } = this.capture.methods.find(({ name }) => name === option.value) ?? {};
      option.disabled = Boolean(reason) || (option.value === state.method && option.value !== state.compare);
    }
    this.setReason("align", this.capture.align_reason || ofCounts);
    get("align").checked = state.align;
    get("curve").value = state.curve;
    get("exposure").value = this.exposure;
    const sign = this.exposure >= 0 ? "+" : "−";
    const white = state.white === null ? "" : `, white ${format(state.white)}`;
    write("exposure-value", `${sign}${Math.abs(this.exposure).toFixed(2)} stops${white}`);
    get("exposure").setAttribute("aria-valuetext", get("exposure-value").textContent);
    get("auto").setAttribute("aria-pressed", String(state.white === null || state.white === this.automatic));
    for (const kind of OVERLAYS) get(`overlay-${kind}`).checked = state.overlays.includes(kind);
    const action = this.capture.live ? (isRunning ? "Pause" : "Follow") : isRunning ? "Pause" : "Play";
    write("play", isRunning ? "❚❚" : "▶");
    get("play").setAttribute("aria-label", action);
  }

  /** Name the frames of the image that is shown, which may be older than the controls. */
  writeRange() {
    const shown = this.shown ?? this.store.state;
    const { cycle } = this.capture;
    const gone = shown.start < this.frames[0] ? ", no longer in memory" : "";
    const cycles = cycle === 1 ? "" : ` · ${count(shown.window / cycle, "cycle")} of ${cycle} exposures`;
    write("range", `${capitalize(framesText(shown).replace(" to ", " – "))}${gone}${cycles}`);
  }

  setShown({ start, window }) {
    this.shown = { start, window };
    this.writeRange();
  }

  /** Disable a control for a reason, which the page states, or enable it. */
  setReason(id, reason) {
    get(id).disabled = Boolean(reason);
    get(id).dataset.reason = reason;
    write(`${id}-reason`, capitalize(reason));
  }

  /** Select the next usable option of a list. */
  next(id, step = 1) {
    const list = get(id);
    if (list.disabled) return;
    const options = [...list.options].filter((option) => !option.disabled);
    const place = options.findIndex((option) => option.value === list.value);
    list.value = options[(place + step + options.length) % options.length].value;
    list.dispatchEvent(new Event("change"));
  }
}

/** Write a text if it has changed, which spares the browser a new layout. */
export function write(id, text) {
  const node = get(id);
  if (node.textContent !== String(text)) node.textContent = text;
}

export const capitalize = (text) => text.charAt(0).toUpperCase() + text.slice(1);

/** Return the index of the value that is nearest to a target. */
const nearest = (values, target) =>
  values.reduce((best, value, index) => (Math.abs(value - target) < Math.abs(values[best] - target) ? index : best), 0);

const count = (number, name) => `${number} ${name}${number === 1 ? "" : "s"}`;

export function element(name, text) {
  const node = document.createElement(name);
  node.textContent = text;
  return node;
}

/** Return the name of the frames of a window. */
export function framesText({ start, window }) {
  return window === 1 ? `frame ${start}` : `frames ${start} to ${start + window - 1}`;
}

/** Return one line for each reason why some methods are not available. */
function reasons(entries) {
  const titles = new Map();
  for (const { title, reason } of entries) {
    if (reason) titles.set(reason, [...(titles.get(reason) ?? []), title]);
  }
  return [...titles].map(([reason, names]) => element("li", `${capitalize(names.join(", "))}: ${reason}`));
}

function fill(list, entries) {
  list.replaceChildren(
    ...entries.map(({ name, title, reason }) => {
      const option = element("option", reason ? `${title} (unavailable)` : title);
      option.value = name;
      option.disabled = Boolean(reason);
      if (reason) option.title = reason;
      return option;
    }),
  );
}
