// The image: its pixels, overlays, zoom, and the pointer.

import { drawOverlay, makeOverlay } from "./overlays.js";

const MAX_ZOOM = 64;
const MIN_SIDE = 6; // smallest height and width of a reduced image in CSS pixels
const MARGIN = 12; // around an image that fits, in CSS pixels

const limitScale = (scale) => Math.min(MAX_ZOOM, Math.max(1 / MAX_ZOOM, scale));

export class Stage {
  constructor(canvas, onPointer, onZoom, onPainted) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.pixels = document.createElement("canvas");
    this.pixelContext = this.pixels.getContext("2d", { alpha: false });
    this.overlays = new Map();
    this.onPointer = onPointer;
    this.onZoom = onZoom;
    this.onPainted = onPainted;
    this.scale = 1;
    this.x = 0; // position of the image's corner in device pixels
    this.y = 0;
    this.isFitted = true;
    this.pointer = null;
    this.header = null;
    this.waiting = null;
    addEventListener("resize", () => this.resize());
    new ResizeObserver(() => this.resize()).observe(canvas); // other parts of the page may grow
    this.takeBackground();
    this.resize();
  }

  /** Show an image at the next repaint. A newer one replaces it. */
  show(header, bytes) {
    const isFirst = this.waiting === null;
    this.waiting = { header, bytes };
    if (isFirst) requestAnimationFrame(() => this.paint());
  }

  paint() {
    const { header, bytes } = this.waiting;
    this.waiting = null;
    const { width, height, channels } = header;
    const isNewSize = this.pixels.width !== width || this.pixels.height !== height || !this.header;
    if (isNewSize) {
      this.pixels.width = width;
      this.pixels.height = height;
      this.data = new ImageData(width, height);
    }
    const words = new Uint32Array(this.data.data.buffer);
    if (channels === 1) {
      for (let i = 0; i < words.length; i++) words[i] = 0xff000000 | (bytes[i] * 0x010101);
    } else {
      for (let i = 0, j = 0; i < words.length; i++, j += 3) {
        words[i] = 0xff000000 | (bytes[j + 2] << 16) | (bytes[j + 1] << 8) | bytes[j];
      }
    }
    this.pixelContext.putImageData(this.data, 0, 0);
    this.header = header;
    this.bytes = bytes;
    if (isNewSize && this.isFitted) this.fit();
    this.draw();
    this.onPainted(header, bytes);
  }

  setOverlay(kind, header, bytes) {
    this.overlays.set(kind, makeOverlay(kind, header, bytes));
    this.draw();
  }

  removeOverlay(kind) {
    if (this.overlays.delete(kind)) this.draw();
  }

  /** Take the background of the theme. */
  takeBackground() {
    this.background = getComputedStyle(this.canvas.parentElement).backgroundColor;
    this.draw();
  }

  resize() {
    const ratio = devicePixelRatio || 1;
    const width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.canvas.width = width;
    this.canvas.height = height;
    if (this.isFitted) this.fit();
    this.draw();
  }

  draw() {
    const { context, canvas, pixels } = this;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.background;
    context.fillRect(0, 0, canvas.width, canvas.height);
    if (!this.header) return;
    // Enlarged pixels stay sharp. A reduced image is averaged.
    context.imageSmoothingEnabled = this.scale < 1;
    context.imageSmoothingQuality = "high";
    const box = [this.x, this.y, ...this.extent];
    context.drawImage(pixels, ...box);
    for (const overlay of this.overlays.values()) drawOverlay(context, overlay, box);
    if (this.pointer && document.activeElement === canvas && this.isKeyboard) this.drawPointer();
  }

  /** The width and the height of the image in device pixels. A thin one stays visible. */
  get extent() {
    const least = this.scale < 1 ? MIN_SIDE * (devicePixelRatio || 1) : 0;
    return [this.pixels.width, this.pixels.height].map((length) => Math.max(length * this.scale, least));
  }

  /** Return the place of a row and a column in device pixels. */
  placeOf([row, column]) {
    const [width, height] = this.extent;
    return [this.x + ((column + 0.5) * width) / this.pixels.width, this.y + ((row + 0.5) * height) / this.pixels.height];
  }

  drawPointer() {
    const { context, scale } = this;
    const side = Math.max(scale, 9);
    const middle = this.placeOf(this.pointer);
    context.lineWidth = 3;
    context.strokeStyle = "#000a";
    context.strokeRect(middle[0] - side / 2, middle[1] - side / 2, side, side);
    context.lineWidth = 1.5;
    context.strokeStyle = "#fff";
    context.strokeRect(middle[0] - side / 2, middle[1] - side / 2, side, side);
  }

  /** Show the whole image, as large as the stage and the largest zoom allow. */
  fit() {
    if (!this.header) return;
    const margin = MARGIN * (devicePixelRatio || 1);
    const { width, height } = this.pixels;
    const largest = Math.min((this.canvas.width - margin) / width, (this.canvas.height - margin) / height);
    // Whole factors show all pixels alike, unless much of the stage stays empty.
    const whole = Math.floor(largest);
    this.scale = limitScale(whole >= 3 ? whole : largest);
    this.center();
    this.isFitted = true;
    this.changed();
  }

  center() {
    const [width, height] = this.extent;
    this.x = Math.round((this.canvas.width - width) / 2);
    this.y = Math.round((this.canvas.height - height) / 2);
  }

  /** The point around which keys zoom in device pixels: the pointer, if it is visible, or the middle. */
  get anchor() {
    const place = this.pointer && this.placeOf(this.pointer);
    const { width, height } = this.canvas;
    const isVisible = place && place[0] >= 0 && place[1] >= 0 && place[0] < width && place[1] < height;
    return isVisible ? place : [width / 2, height / 2];
  }

  /** Zoom by a factor around a point in device pixels. */
  zoom(factor, point = this.anchor) {
    const [width, height] = this.extent;
    this.scale = limitScale(this.scale * factor);
    this.x = point[0] - ((point[0] - this.x) * this.extent[0]) / width;
    this.y = point[1] - ((point[1] - this.y) * this.extent[1]) / height;
    this.isFitted = false;
    this.changed();
  }

  actualSize() {
    this.scale = 1;
    this.center();
    this.isFitted = false;
    this.changed();
  }

  pan(x, y) {
    this.x += x;
    this.y += y;
    this.isFitted = false;
    this.changed();
  }

  changed() {
    this.draw();
    this.onZoom(this.scale);
  }

  /** Return the row and the column at a point in CSS pixels, or null outside of the image. */
  locate(x, y) {
    if (!this.header) return null;
    const ratio = devicePixelRatio || 1;
    const [width, height] = this.extent;
    const column = Math.floor(((x * ratio - this.x) * this.header.width) / width);
    const row = Math.floor(((y * ratio - this.y) * this.header.height) / height);
    const isInside = row >= 0 && column >= 0 && row < this.header.height && column < this.header.width;
    return isInside ? [row, column] : null;
  }

  point(place, isKeyboard = false) {
    this.pointer = place;
    this.isKeyboard = isKeyboard;
    this.onPointer(place);
    if (isKeyboard) this.draw();
  }

  /** Move the pointer by rows and columns, for the keyboard. */
  movePointer(rows, columns) {
    if (!this.header) return;
    const { height, width } = this.header;
    const [row, column] = this.pointer ?? [Math.floor(height / 2), Math.floor(width / 2)];
    const limit = (value, size) => Math.min(size - 1, Math.max(0, value));
    this.point([limit(row + rows, height), limit(column + columns, width)], true);
    this.reveal(this.placeOf(this.pointer));
  }

  /** Move the image so that a place of it is visible, unless it is already. */
  reveal(place) {
    const margin = (MARGIN / 3) * (devicePixelRatio || 1);
    const [x, y] = [this.canvas.width, this.canvas.height].map(
      (size, axis) => Math.max(margin - place[axis], 0) + Math.min(size - margin - place[axis], 0),
    );
    if (x || y) this.pan(Math.round(x), Math.round(y));
  }
}
