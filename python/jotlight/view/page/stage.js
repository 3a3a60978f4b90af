// The image: its pixels, overlays, zoom, and the pointer.

import { themeColor } from "./plots.js";

const MAX_ZOOM = 64;

/** Return the red, green, and blue of a color of the theme. */
const readColor = (name) => themeColor(name).match(/\d+/g).slice(0, 3).map(Number);

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
    const canvas = document.createElement("canvas");
    canvas.width = header.width;
    canvas.height = header.height;
    const data = new ImageData(header.width, header.height);
    const [dead, hot, saturated, uncertain] = ["--dead", "--hot", "--saturated", "--uncertain"].map(readColor);
    for (let i = 0; i < bytes.length; i++) {
      if (bytes[i] === 0) continue;
      const color = kind === "saturated" ? saturated : kind === "uncertainty" ? uncertain : bytes[i] === 1 ? dead : hot;
      data.data.set(color, 4 * i);
      data.data[4 * i + 3] = kind === "uncertainty" ? Math.round((bytes[i] / 255) ** 2 * 220) : 255;
    }
    canvas.getContext("2d").putImageData(data, 0, 0);
    this.overlays.set(kind, { canvas, header, bytes });
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
    const width = pixels.width * this.scale;
    const height = pixels.height * this.scale;
    context.drawImage(pixels, this.x, this.y, width, height);
    for (const { canvas: overlay } of this.overlays.values()) {
      context.drawImage(overlay, this.x, this.y, width, height);
    }
    if (this.pointer && document.activeElement === canvas && this.isKeyboard) this.drawPointer();
  }

  drawPointer() {
    const { context, scale } = this;
    const [row, column] = this.pointer;
    const side = Math.max(scale, 9);
    const middle = [this.x + (column + 0.5) * scale, this.y + (row + 0.5) * scale];
    context.lineWidth = 3;
    context.strokeStyle = "#000a";
    context.strokeRect(middle[0] - side / 2, middle[1] - side / 2, side, side);
    context.lineWidth = 1.5;
    context.strokeStyle = "#fff";
    context.strokeRect(middle[0] - side / 2, middle[1] - side / 2, side, side);
  }

  fit() {
    if (!this.header) return;
    const margin = 12 * (devicePixelRatio || 1);
    const { width, height } = this.pixels;
    const largest = Math.min((this.canvas.width - margin) / width, (this.canvas.height - margin) / height);
    // Whole factors show all pixels alike, unless much of the stage stays empty.
    const whole = Math.floor(largest);
    this.scale = whole >= 3 ? whole : Math.max(largest, 1 / MAX_ZOOM);
    this.center();
    this.isFitted = true;
    this.changed();
  }

  center() {
    this.x = Math.round((this.canvas.width - this.pixels.width * this.scale) / 2);
    this.y = Math.round((this.canvas.height - this.pixels.height * this.scale) / 2);
  }

  /** Zoom by a factor around a point in device pixels. Default: the middle. */
  zoom(factor, point = [this.canvas.width / 2, this.canvas.height / 2]) {
    const before = this.scale;
    this.scale = Math.min(MAX_ZOOM, Math.max(1 / MAX_ZOOM, before * factor));
    this.x = point[0] - ((point[0] - this.x) * this.scale) / before;
    this.y = point[1] - ((point[1] - this.y) * this.scale) / before;
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
    const column = Math.floor((x * ratio - this.x) / this.scale);
    const row = Math.floor((y * ratio - this.y) / this.scale);
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
  }
}
