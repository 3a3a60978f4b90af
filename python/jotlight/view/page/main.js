// The page: connects the controls, the image, and the server.

import { Connection } from "./connection.js";
import { Controls, capitalize, element, write } from "./controls.js";
import { addGestures } from "./gestures.js";
import { Keys } from "./keys.js";
import { toast, warn } from "./messages.js";
import { Player } from "./play.js";
import { Timeline, drawHistogram, forgetColors, format } from "./plots.js";
import { describeImage, showReadout, showLegend, showOverlayNotes } from "./readout.js";
import { addSharing } from "./share.js";
import { nameOf, say, saySoon } from "./speech.js";
import { Stage } from "./stage.js";
import { OVERLAYS, Store } from "./store.js";
import { addTheme } from "./theme.js";

const get = (id) => document.getElementById(id);
const HISTOGRAM_DELAY = 100;
const BUSY_DELAY = 500;
const store = new Store();
const controls = new Controls(store);
const player = new Player(store, controls);
const timeline = new Timeline(get("timeline"));
let capture = null;
let live = null; // the last facts of a live capture
let number = 0;
let isAsking = false;
let isMoving = false;
let patience = null;
let isBusy = false; // whether the page says that it waits for an image

const stage = new Stage(get("image"), onPointer, onZoom, onPainted);
addGestures(stage);

// Requests: at most one per repaint, so that a fast slider does not flood the server.

function ask(moving) {
  isMoving = moving;
  if (isAsking || !capture) return;
  isAsking = true;
  requestAnimationFrame(() => {
    isAsking = false;
    number += 1;
    if (isBusy) showBusy();
    else if (connection.isOpen) waitForImage();
    connection.send({ type: "view", id: number, moving: isMoving, state: store.state });
  });
}

store.listeners.push((moving) => {
  write("address-note", "");
  controls.update();
  drawTime();
  showBadge();
  for (const kind of OVERLAYS) {
    const isShown = store.state.overlays.includes(kind);
    // Jots stay where they are. Other overlays are those of one image.
    if (!isShown || kind !== "jots") stage.removeOverlay(kind);
    if (!isShown) saidOfOverlays.delete(kind);
  }
  showOverlayNotes(stage, store.state);
  ask(moving);
});

addEventListener("hashchange", (event) => {
  if (!capture) return; // the address is read when the capture is known
  // The page may have written its own address since then.
  const problem = store.begin(capture, new URL(event.newURL).hash);
  store.set({});
  write("address-note", problem);
});

let probing = false;
let isUnsaid = false; // whether the keyboard has moved the pointer, and its values are not said yet
function onPointer(place) {
  if (probing) return;
  probing = true;
  requestAnimationFrame(() => {
    probing = false;
    const [row, column] = stage.pointer ?? [null, null];
    isUnsaid = stage.isKeyboard && row !== null;
    connection.send({ type: "probe", row, column });
    if (row === null) showReadout(null);
  });
}

function onZoom(scale) {
  const text = `${Math.round(scale * 100)} %`;
  write("zoom-value", text);
  get("zoom-actual").ariaLabel = `Zoom: ${text}`;
}

let histogram = null;
function onPainted(header, bytes) {
  if (header.stage === "final") {
    // While the slider moves, a few histograms per second suffice.
    const isScheduled = histogram !== null;
    histogram = { header, bytes };
    if (!isScheduled) setTimeout(showHistogram, isMoving ? HISTOGRAM_DELAY : 0);
    speak(header);
  }
  controls.setShown(header);
  showLegend(stage, header);
  showNote(header);
  document.dispatchEvent(new CustomEvent("painted", { detail: header }));
}

function showHistogram() {
  const { header, bytes } = histogram;
  histogram = null;
  drawHistogram(get("histogram"), bytes, header);
  const texts = header.tone.axis.map(format);
  if (texts.join() === get("histogram-axis").dataset.texts) return;
  get("histogram-axis").dataset.texts = texts.join();
  get("histogram-axis").replaceChildren(...texts.map((text) => element("span", text)));
}

/** Return the image that the state asks for as a text. Counts are neither compared nor aligned. */
function describeRequest({ method, compare, align }) {
  const titles = new Map(capture.methods.map(({ name, title }) => [name, title]));
  const ofCounts = method === "counts";
  const other = compare && !ofCounts ? ` minus ${titles.get(compare)}` : "";
  return `${titles.get(method)}${other}${align && !ofCounts ? " of the aligned frames" : ""}`;
}

/** Show what the page waits for, until the image of the last request has arrived. */
function showBusy() {
  isBusy = true;
  get("stage-note").classList.remove("error");
  const text = `Waiting for ${describeRequest(store.state)}`;
  write("stage-note", text);
  say(text);
}

/** Say what the page waits for if no image arrives for a while. */
function waitForImage() {
  patience ??= setTimeout(showBusy, BUSY_DELAY);
}

function stopWaiting() {
  clearTimeout(patience);
  patience = null;
  isBusy = false;
}

function showNote(header) {
  const isLast = header.stage === "final" && header.id === number;
  if (isLast || !isBusy) stopWaiting();
  if (!isLast && !isBusy) waitForImage();
  if (!isBusy) {
    get("stage-note").classList.remove("error");
    write("stage-note", header.stage === "sample" ? "A part of the window is shown first" : "");
  }
  if (header.stage === "final") write("notes", header.notes.join("; "));
  const [name, value] = header.mean_reading;
  write("rate", `${header.title} · ${name} ${format(value)}`);
}

let saidOfImage = null;
const saidOfOverlays = new Map();
/** Say which image is shown. The images of a live capture, or of one that plays, follow each other without end. */
function speak(header) {
  if ((store.state.follow && !live?.ended) || controls.isPlaying) return;
  const text = describeImage(header);
  get("image").ariaLabel = text;
  if (text !== saidOfImage) saySoon("image", text);
  saidOfImage = text;
}

/** Say what an overlay found that was switched on. */
function speakOfOverlay(kind) {
  const [note, reason] = ["note", "reason"].map((part) => get(`${kind}-${part}`).textContent);
  const text = `${nameOf(get(`overlay-${kind}`))}: ${note}${reason ? `. ${reason}` : ""}`;
  if (text !== saidOfOverlays.get(kind)) saySoon(kind, text);
  saidOfOverlays.set(kind, text);
}

function drawTime() {
  const [first, end] = controls.frames;
  timeline.setView(first, end, store.state.start, store.state.window);
}

let saidOfLive = null;
/** Show whether the page follows a live capture, and how many frames have arrived. */
function showBadge() {
  if (!live) return;
  const { end, dropped, ended, problem } = live;
  const name = ended ? "Ended" : store.state.follow ? "Live" : "Paused";
  write("badge", problem || `${name}${ended ? ` at ${end}` : ` · ${end} frames`} · ${dropped || "none"} dropped`);
  // The numbers change all the time, so they are not said.
  const text = problem || `${name}${dropped ? ", with dropped frames" : ""}`;
  if (text !== saidOfLive) say(text);
  saidOfLive = text;
  get("badge").classList.toggle("lost", dropped > 0 || Boolean(problem));
  get("badge").hidden = false;
}

// Messages from the server.

let shown = 0;
const handlers = {
  hello(header) {
    const isFirst = capture === null;
    capture = header;
    if (isFirst) write("address-note", store.begin(header, location.hash));
    controls.begin(header);
    for (const part of document.querySelectorAll("[inert]")) part.inert = false;
    for (const kind of OVERLAYS) stage.removeOverlay(kind);
    drawTime();
    ask(false);
  },
  image(header, bytes) {
    if (header.id < shown) return; // an older request
    shown = header.id;
    if (header.is_auto && header.stage === "final" && store.state.white === null) controls.keepWhite(header.tone.white);
    const { start, window, follow } = store.state;
    // While the page is about to ask for another window, the image is that of the window before.
    if (!follow && !isAsking && header.id === number && (header.start !== start || header.window !== window)) {
      // The frames that the address or the slider asked for do not exist, or have left memory.
      const shownFrames = `${header.start} to ${header.start + header.window - 1}`;
      warn(`Frames ${start} to ${start + window - 1} are not available. The image is that of frames ${shownFrames}.`);
      Object.assign(store.state, { start: header.start, window: header.window });
      controls.update();
      drawTime();
    }
    if (follow) {
      Object.assign(store.state, { start: header.start });
      // The image is newer than the last message about the frames.
      controls.setFrames(controls.frames[0], header.start + header.window);
      drawTime();
    }
    stage.show(header, bytes);
  },
  overlay(header, bytes) {
    if (header.id !== number || !store.state.overlays.includes(header.kind)) return;
    stage.setOverlay(header.kind, header, bytes);
    showOverlayNotes(stage, store.state);
    speakOfOverlay(header.kind);
    if (stage.header) showLegend(stage, stage.header);
  },
  rates(header, bytes) {
    timeline.setRates(bytes);
    const each = header.frames === 1 ? "a frame" : `${header.frames} frames`;
    get("timeline-caption").textContent = `${capitalize(capture.mean_reading)}, ${each} at each point`;
  },
  live(header, bytes) {
    live = header;
    controls.setFrames(header.first, header.end);
    timeline.setRates(bytes);
    showBadge();
    if (header.remark && header.remark !== get("remark").textContent) toast(header.remark);
    write("remark", header.remark ?? "");
    drawTime();
  },
  values(header) {
    const text = showReadout(header.values);
    const [row, column] = stage.pointer ?? [];
    if (!isUnsaid || header.values?.row !== row || header.values.column !== column) return;
    saySoon("pointer", text);
    isUnsaid = false;
  },
  recipe(header) {
    copyRecipe(header);
  },
  error(header) {
    stopWaiting();
    get("stage-note").classList.add("error");
    get("stage-note").textContent = header.text;
    say(header.text);
  },
};

const connection = new Connection(
  (header, bytes) => handlers[header.type]?.(header, bytes),
  (isOpen, reason) => {
    stopWaiting();
    if (!isOpen) player.stop();
    write("stage-note", isOpen ? "" : reason);
    say(isOpen ? "Connected" : reason);
    if (isOpen) [number, shown] = [0, 0];
  },
);
const copyRecipe = addSharing(store, connection, () => capture);

// Zoom, theme, help.

get("play").addEventListener("click", () => player.toggle());
get("zoom-in").addEventListener("click", () => stage.zoom(2));
get("zoom-out").addEventListener("click", () => stage.zoom(0.5));
get("zoom-actual").addEventListener("click", () => stage.actualSize());
get("zoom-fit").addEventListener("click", () => stage.fit());

addTheme(get("theme"), () => {
  forgetColors();
  timeline.redraw();
  stage.takeBackground();
  redrawHistogram();
});
function redrawHistogram() {
  if (stage.header) drawHistogram(get("histogram"), stage.bytes, stage.header);
}
new ResizeObserver(redrawHistogram).observe(get("histogram"));
function help() {
  get("shortcuts").showModal();
  get("shortcuts").scrollTop = 0; // the focus is on the button at the end
}
get("help").addEventListener("click", help);
get("close-shortcuts").addEventListener("click", () => get("shortcuts").close());
new Keys({ store, controls, stage, actions: { help } });
