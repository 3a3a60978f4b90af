// The histogram of the image, and the firing rate over time.

const colors = new Map();

/** Forget the colors of the theme, after it has changed. */
export function forgetColors() {
  colors.clear();
}

/** Return a color of the theme, such as light-dark(...), in a form that a canvas accepts. */
export function themeColor(name) {
  if (!colors.has(name)) {
    const probe = document.createElement("span");
    probe.className = "color-probe";
    probe.style.color = `var(${name})`;
    document.body.append(probe);
    colors.set(name, getComputedStyle(probe).color);
    probe.remove();
  }
  return colors.get(name);
}

function prepare(canvas) {
  const ratio = devicePixelRatio || 1;
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

const LUMA = (red, green, blue) => (red * 77 + green * 150 + blue * 29) >> 8;

/** The place of a difference on its scale, from the colors blue, gray, and orange. */
const DIFFERENCE = (red, green, blue) =>
  Math.round(127.5 + (red < blue ? (red - blue) / 160 : (red - blue) / 190) * 127.5);

/** Draw how many pixels have each level. The height is the square root of the number. */
export function drawHistogram(canvas, bytes, { channels, tone }) {
  const { context, width, height } = prepare(canvas);
  const counts = new Float64Array(256);
  const convert = tone.curve === "difference" ? DIFFERENCE : LUMA;
  for (let i = 0; i < bytes.length; i += channels) {
    counts[channels === 3 ? convert(bytes[i], bytes[i + 1], bytes[i + 2]) : bytes[i]] += 1;
  }
  const bins = Math.min(128, width);
  const heights = new Float64Array(bins);
  for (let level = 0; level < 256; level++) heights[Math.floor((level * bins) / 256)] += counts[level];
  const inner = heights.slice(1, -1);
  const largest = Math.sqrt(Math.max(1, inner.reduce((a, b) => Math.max(a, b), 0)));
  context.fillStyle = themeColor("--plot");
  for (let bin = 0; bin < bins; bin++) {
    const size = Math.min(1, Math.sqrt(heights[bin]) / largest) * height;
    if (bin === bins - 1 || bin === 0) context.fillStyle = themeColor("--mark");
    else if (bin === 1) context.fillStyle = themeColor("--plot");
    context.fillRect((bin * width) / bins, height - size, width / bins, size);
  }
  canvas.setAttribute("aria-label", describeHistogram(counts, tone));
}

/** Return how many pixels lie at the ends of the scale. */
function describeHistogram(counts, { curve, axis }) {
  const total = counts.reduce((sum, count) => sum + count, 0);
  const percent = (part) => `${((100 * part) / total).toFixed(part / total < 0.1 ? 1 : 0)} %`;
  const [low, high] = [percent(counts[0]), percent(counts[255])];
  if (curve !== "difference") return `Histogram: ${low} of the pixels are black, ${high} are white`;
  const [first, last] = [axis[0], axis.at(-1)].map(format);
  return `Histogram of the difference: ${low} of the pixels are at ${first} or below, ${high} are at ${last} or above`;
}

export class Timeline {
  constructor(canvas) {
    this.canvas = canvas;
    this.rates = new Float32Array(0);
    this.plot = document.createElement("canvas");
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  setRates(bytes) {
    // The bytes follow a header, so they may not be aligned for numbers of four bytes.
    this.rates = new Float32Array(bytes.slice().buffer);
    this.redraw();
  }

  /** Draw again after the size, the theme, or the rates have changed. */
  redraw() {
    this.plot.width = 0;
    this.draw();
  }

  setView(first, end, start, window) {
    this.first = first;
    this.end = end;
    this.start = start;
    this.window = window;
    this.draw();
  }

  draw() {
    if (this.end === undefined) return;
    const { context, width, height } = prepare(this.canvas);
    const length = Math.max(1, this.end - this.first);
    const place = (frame) => ((frame - this.first) / length) * width;
    context.fillStyle = themeColor("--wash");
    const left = place(this.start);
    context.fillRect(left, 0, Math.max(2, place(this.start + this.window) - left), height);
    if (!this.rates.length) return;
    if (this.plot.width !== width || this.plot.height !== height) {
      this.plot.width = width;
      this.plot.height = height;
      this.drawRates(this.plot.getContext("2d"), width, height);
    }
    context.drawImage(this.plot, 0, 0);
  }

  drawRates(context, width, height) {
    const { rates } = this;
    let low = Infinity;
    let high = -Infinity;
    for (const rate of rates) {
      low = Math.min(low, rate);
      high = Math.max(high, rate);
    }
    // Noise must not look like a signal: the scale has a range of a fifth of the rate or more.
    const middle = (low + high) / 2;
    const half = Math.max((high - low) / 2, middle * 0.1, 1e-6) * 1.15;
    context.beginPath();
    rates.forEach((rate, index) => {
      const x = ((index + 0.5) / rates.length) * width;
      const y = height - ((rate - (middle - half)) / (2 * half)) * height;
      if (index) context.lineTo(x, y);
      else context.moveTo(x, y);
    });
    context.strokeStyle = themeColor("--plot");
    context.lineWidth = 1.25 * (devicePixelRatio || 1);
    context.stroke();
  }
}

/** Return a number with about three significant digits. */
export function format(value) {
  if (value === null || value === undefined) return "";
  if (Array.isArray(value)) return value.map(format).join(", ");
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(2).replace("e+", "e");
  return size >= 100 ? value.toFixed(0) : value.toPrecision(3);
}
