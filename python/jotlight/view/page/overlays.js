// Overlays over the image: flags of jots and pixels, and the uncertainty.

import { themeColor } from "./plots.js";

const FLAG_SIDE = 2; // of a flag that is reduced, in CSS pixels
const scratch = document.createElement("canvas");

/** Return the red, green, and blue of a color of the theme. */
const readColor = (name) => themeColor(name).match(/\d+/g).slice(0, 3).map(Number);

/** Return an overlay for a map of the server. */
export function makeOverlay(kind, header, bytes) {
  if (kind === "uncertainty") return { header, bytes, canvas: shade(header, bytes) };
  const flags = listFlags(bytes, kind === "saturated" ? ["--saturated"] : ["--dead", "--hot"]);
  return { header, bytes, flags, canvas: paintFlags(header, flags) };
}

/** Draw an overlay into a box [x, y, width, height]. Flags that are reduced would vanish in its canvas. */
export function drawOverlay(context, overlay, box) {
  const { width, height } = overlay.header; // in jots, or in pixels
  const isReduced = box[2] < width || box[3] < height;
  if (overlay.flags && isReduced) drawFlags(context, overlay, box);
  else context.drawImage(overlay.canvas, ...box);
}

/** Return the places that are not 0, and their colors as words of an image. */
function listFlags(bytes, names) {
  const colors = names.map(readColor).map(([red, green, blue]) => (0xff000000 | (blue << 16) | (green << 8) | red) >>> 0);
  const number = bytes.reduce((sum, value) => sum + (value > 0 ? 1 : 0), 0);
  const [places, words] = [new Uint32Array(number), new Uint32Array(number)];
  let index = 0;
  bytes.forEach((value, place) => {
    if (value === 0) return;
    places[index] = place;
    words[index++] = colors[value - 1];
  });
  return { places, words };
}

/** Draw each flag as a square that is visible, however small its pixel is. */
function drawFlags(context, { header, flags }, [x, y, width, height]) {
  const { canvas } = context;
  const data = new ImageData(canvas.width, canvas.height);
  const words = new Uint32Array(data.data.buffer);
  const side = Math.max(1, Math.round(FLAG_SIDE * (devicePixelRatio || 1)));
  const [stepX, stepY] = [width / header.width, height / header.height];
  flags.places.forEach((place, index) => {
    const left = Math.round(x + ((place % header.width) + 0.5) * stepX - side / 2);
    const top = Math.round(y + (Math.floor(place / header.width) + 0.5) * stepY - side / 2);
    for (let row = Math.max(0, top); row < Math.min(canvas.height, top + side); row++) {
      for (let column = Math.max(0, left); column < Math.min(canvas.width, left + side); column++) {
        words[row * canvas.width + column] = flags.words[index];
      }
    }
  });
  context.drawImage(fill(scratch, data), 0, 0);
}

function paintFlags({ width, height }, { places, words }) {
  const data = new ImageData(width, height);
  const all = new Uint32Array(data.data.buffer);
  places.forEach((place, index) => (all[place] = words[index]));
  return fill(document.createElement("canvas"), data);
}

/** Return a canvas with uncertainties, which cover the image less where they are small. */
function shade({ width, height }, bytes) {
  const data = new ImageData(width, height);
  const color = readColor("--uncertain");
  for (let i = 0; i < bytes.length; i++) {
    if (bytes[i] === 0) continue;
    data.data.set(color, 4 * i);
    data.data[4 * i + 3] = Math.round((bytes[i] / 255) ** 2 * 220);
  }
  return fill(document.createElement("canvas"), data);
}

function fill(canvas, data) {
  if (canvas.width !== data.width || canvas.height !== data.height) {
    [canvas.width, canvas.height] = [data.width, data.height];
  }
  canvas.getContext("2d").putImageData(data, 0, 0);
  return canvas;
}
