// Play: the window moves through the frames of a capture. A live capture is followed, or paused.

import { warn } from "./messages.js";

const FRAMES_PER_SECOND = 30;

export class Player {
  constructor(store, controls) {
    this.store = store;
    this.controls = controls;
    this.clock = null;
  }

  /** Play, or stop. */
  toggle() {
    const { controls, store } = this;
    if (controls.capture?.live) store.set({ follow: !store.state.follow });
    else if (controls.isPlaying) this.stop();
    else if (this.isWhole) warn("The window holds all frames. Shorten it to play.");
    else this.start();
  }

  start() {
    this.clock = setInterval(() => this.step(), 1000 / FRAMES_PER_SECOND);
    this.controls.isPlaying = true;
    this.controls.update();
  }

  stop() {
    if (!this.controls.isPlaying) return;
    clearInterval(this.clock);
    this.controls.isPlaying = false;
    this.store.set({}); // request the image at which it stops in full
  }

  /** Whether the window holds all frames. */
  get isWhole() {
    return this.store.state.window >= this.controls.largest;
  }

  step() {
    const { controls, store } = this;
    const { start, window } = store.state;
    if (this.isWhole) this.stop();
    else if (start + window >= controls.frames[0] + controls.largest) store.set({ start: controls.frames[0] }, true);
    else controls.moveBy(controls.wholeCycles(window / 4), true);
  }
}
