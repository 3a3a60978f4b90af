// Keyboard shortcuts. The list is also the help page, and it labels the controls.

import { keep, recall } from "./kept.js";
import { dismiss, warn } from "./messages.js";
import { nameOf, saySoon, stateOf } from "./speech.js";

const get = (id) => document.getElementById(id);
const part = (key) => document.querySelector(`summary[data-key="${key}"]`);

export class Keys {
  constructor({ store, controls, stage, actions }) {
    const click = (id) => () => get(id).click();
    const move = (sign, isLong) => (event) =>
      controls.moveBy(sign * (isLong ? store.state.window : 1), event.repeat);
    const zoom = () => get("zoom-actual");
    // Names, meaning, keys, what they do, and the control whose state is said then.
    this.entries = [
      ["Space", "play, or pause and follow a live capture", [" "], click("play")],
      ["← →", "one frame, or one cycle of exposures, back or forward", ["ArrowLeft", "ArrowRight"], (event) => move(event.key === "ArrowLeft" ? -1 : 1, false)(event)],
      ["Shift ← →", "one window back or forward", ["Shift+ArrowLeft", "Shift+ArrowRight"], (event) => move(event.key === "ArrowLeft" ? -1 : 1, true)(event)],
      ["Home End", "first or last window", ["Home", "End"], (event) => controls.moveBy(event.key === "Home" ? -Infinity : Infinity)],
      ["[ ]", "half or twice the window", ["[", "]"], (event) => controls.setWindow(store.state.window * (event.key === "[" ? 0.5 : 2))],
      ["w", "type the length of the window", ["w"], () => get("window-number").select()],
      ["m M", "next or previous method", ["m", "M"], (event) => controls.next("method", event.key === "m" ? 1 : -1)],
      ["q", "next quality of the network", ["q"], () => controls.next("quality"), () => get("quality")],
      ["a", "align a moving scene", ["a"], click("align"), () => get("align")],
      ["d D", "difference to the next or previous method", ["d", "D"], (event) => controls.next("compare", event.key === "d" ? 1 : -1), () => get("compare")],
      ["e E", "more or less exposure", ["e", "E"], (event) => controls.setExposure(controls.exposure + (event.key === "e" ? 0.25 : -0.25), event.repeat), () => get("exposure")],
      ["0", "automatic exposure", ["0"], click("auto"), () => get("exposure")],
      ["c", "next tone curve", ["c"], () => controls.next("curve"), () => get("curve")],
      ["j", "dead and hot jots", ["j"], click("overlay-jots"), () => get("overlay-jots")],
      ["s", "saturated pixels", ["s"], click("overlay-saturated"), () => get("overlay-saturated")],
      ["u", "uncertainty", ["u"], click("overlay-uncertainty"), () => get("overlay-uncertainty")],
      ["+ −", "zoom in or out", ["+", "=", "-"], (event) => stage.zoom(event.key === "-" ? 0.5 : 2), zoom],
      ["1", "one image pixel per screen pixel", ["1"], click("zoom-actual"), zoom],
      ["f", "fit the image", ["f"], click("zoom-fit"), zoom],
      ["Alt arrows", "move the image", ["Alt+ArrowLeft", "Alt+ArrowRight", "Alt+ArrowUp", "Alt+ArrowDown"], (event) => pan(stage, event)],
      ["i", "go to the image, where arrow keys move the pointer", ["i"], () => get("image").focus()],
      ["p t x", "save as PNG, TIFF, or EXR", ["p", "t", "x"], (event) => get({ p: "save-png", t: "save-tif", x: "save-exr" }[event.key]).click()],
      ["k", "copy the command line", ["k"], click("copy-command")],
      ["y", "copy the Python code", ["y"], click("copy-python")],
      ["l", "copy a link", ["l"], click("copy-link")],
      ["5 … 9", "open or close a part of the controls", ["5", "6", "7", "8", "9"], (event) => part(event.key).click(), (key) => part(key)],
      ["v", "next theme", ["v"], click("theme"), () => get("theme")],
      ["Esc", "dismiss a message, and leave a list or a field, which uses letters and arrows itself", ["Escape"], () => leave()],
      ["?", "this list", ["?", "h"], actions.help],
    ];
    this.stage = stage;
    this.controls = controls;
    this.byKey = new Map(this.entries.flatMap(([, , keys, run, subject]) => keys.map((key) => [key, { run, subject }])));
    document.addEventListener("keydown", (event) => this.press(event));
    this.releaseControls();
    get("letters").checked = recall("letters") !== "off";
    get("letters").addEventListener("change", () => this.switchLetters());
    get("dismiss").addEventListener("click", dismiss);
    this.switchLetters();
    get("shortcut-list").replaceChildren(...this.entries.map(describe));
  }

  /** Turn the keys of single characters on or off, which speech recognition presses by mistake. */
  switchLetters() {
    keep("letters", get("letters").checked ? "on" : "off");
    for (const control of document.querySelectorAll("[data-key]")) {
      const { key } = control.dataset;
      control.dataset.title ??= control.title || nameOf(control);
      const isOn = get("letters").checked || !isCharacter(key);
      control.title = isOn ? `${control.dataset.title} (${key})` : control.dataset.title;
      if (isOn) control.setAttribute("aria-keyshortcuts", spell(key));
      else control.removeAttribute("aria-keyshortcuts");
    }
  }

  /** Let a control that was used with the mouse or a finger not keep the keys. */
  releaseControls() {
    let isPointed = false;
    document.addEventListener("pointerdown", () => (isPointed = true), true);
    document.addEventListener("keydown", () => (isPointed = false), true);
    for (const [name, controls] of [["change", "select, input[type=checkbox]"], ["click", "button, summary"]]) {
      document.addEventListener(name, ({ target }) => {
        if (isPointed) target.closest(controls)?.blur(); // the target may be a part of the control
      });
    }
  }

  press(event) {
    const { target } = event;
    // Many keyboards need AltGr, or Option, for brackets. Alt with a letter belongs to the browser.
    const isAltGraph = event.getModifierState("AltGraph");
    if ((event.ctrlKey && !isAltGraph) || event.metaKey || get("shortcuts").open) return;
    if (event.altKey && !isAltGraph && /^[\p{L}\p{N} ]$/u.test(event.key)) return;
    const isTyping = target.matches("input[type=number]");
    if (isTyping && ["Enter", "Escape"].includes(event.key)) target.blur();
    const isSlider = target.matches("input[type=range]");
    const usesKey = target.matches("select, summary") || (target.matches("button, input[type=checkbox]") && event.key === " ");
    const isArrow = event.key.startsWith("Arrow") || ["Home", "End"].includes(event.key);
    if (isTyping || (isSlider && isArrow && !event.altKey)) return;
    if (usesKey && (event.key === " " || event.key === "Enter" || (target.matches("select") && (isArrow || event.key.length === 1)))) return;
    if (target === this.stage.canvas && isArrow && !event.altKey) {
      this.movePointer(event);
      event.preventDefault();
      return;
    }
    const prefix = !event.key.startsWith("Arrow") ? "" : event.altKey ? "Alt+" : event.shiftKey ? "Shift+" : "";
    const key = withoutCapsLock(event);
    const { run, subject } = this.byKey.get(prefix + key) ?? {};
    // Before the capture is known, there is nothing to change.
    if (!run || !this.controls.capture || (isCharacter(key) && !get("letters").checked)) return;
    event.preventDefault();
    const control = subject?.(key);
    if (control?.disabled) {
      warn(`${nameOf(control)} is unavailable: ${control.dataset.reason}`);
      return;
    }
    run({ key, repeat: event.repeat });
    if (control) saySoon("control", stateOf(control));
  }

  movePointer(event) {
    const size = event.shiftKey ? 10 : 1;
    const steps = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1], Home: [0, -1e9], End: [0, 1e9] };
    const [rows, columns] = steps[event.key];
    this.stage.movePointer(rows * size, columns * size);
  }
}

function leave() {
  dismiss();
  document.activeElement.blur();
}

/** Return whether a key is one that people type in a text. */
const isCharacter = (keys) => keys.split(" ").every((key) => key.length === 1 && !"←→".includes(key));

/** Return the key as without Caps Lock, which would turn "next" into "previous". */
function withoutCapsLock(event) {
  const { key } = event;
  if (!/^[a-z]$/i.test(key) || !event.getModifierState("CapsLock")) return key;
  return key === key.toLowerCase() ? key.toUpperCase() : key.toLowerCase();
}

function pan(stage, event) {
  const steps = { ArrowUp: [0, 40], ArrowDown: [0, -40], ArrowLeft: [40, 0], ArrowRight: [-40, 0] };
  stage.pan(...steps[event.key].map((value) => value * (devicePixelRatio || 1)));
}

/** Return keys by the names that aria-keyshortcuts has for them. */
function spell(keys) {
  const names = { "←": "ArrowLeft", "→": "ArrowRight", "+": "Plus", "−": "-", Esc: "Escape" };
  return keys.split(" ").map((key) => names[key] ?? key).join(" ");
}

function describe([keys, text]) {
  const row = document.createElement("div");
  const name = document.createElement("dt");
  for (const key of keys.split(" ")) {
    const mark = document.createElement("kbd");
    mark.textContent = key;
    name.append(mark, " ");
  }
  const meaning = document.createElement("dd");
  meaning.textContent = text;
  row.append(name, meaning);
  return row;
}
