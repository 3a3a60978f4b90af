// The values under the pointer, the legend, and the notes of the overlays.

import { capitalize, element, framesText, write } from "./controls.js";
import { format } from "./plots.js";
import { OVERLAYS } from "./store.js";

const get = (id) => document.getElementById(id);

/** Show the values of a pixel in all units, or nothing. Return them as a text. */
export function showReadout(values) {
  if (!values) {
    get("readout").replaceChildren();
    return "";
  }
  const rows = [
    ["row, column", `${values.row}, ${values.column}`],
    [values.counted, `${[values.counts].flat().join(", ")} of ${[values.trials].flat().map(trim).join(", ")}`],
  ];
  if (values.intensity !== undefined) {
    const errors = values.error?.map((error) => (error === null ? "unknown" : format(error))).join(", ");
    rows.push(["intensity", `${format(values.intensity)}${errors ? ` ± ${errors}` : ""}`]);
    const perSecond = values["photons-per-second"];
    if (values.photons === undefined) rows.push(["photons per frame", "differ from frame to frame"]);
    else {
      rows.push(["photons per frame", format(values.photons)]);
      rows.push(["photons per second", perSecond === undefined ? "exposure time unknown" : format(perSecond)]);
    }
  }
  get("readout").replaceChildren(
    ...rows.map(([name, value]) => {
      const row = document.createElement("div");
      row.append(element("dt", name), element("dd", value));
      return row;
    }),
  );
  return rows.map((row) => row.join(" ")).join("; ");
}

const trim = (value) => (Number.isInteger(value) ? value : format(value));

/** Return the numbers of dead and of hot jots, which may not have been searched. */
function jotNumbers({ bytes, header }) {
  const counts = [0, 0, 0];
  for (const value of bytes) counts[value] += 1;
  return `${counts[1]}, ${header.searched ? counts[2] : "not searched"}`;
}

/** Return which image is shown, or which difference, as a text. */
export function describeImage({ title, tone, low, high, start, window }) {
  const frames = framesText({ start, window });
  if (tone.curve !== "difference") return `${title}, ${frames}, values ${format(low)} to ${format(high)}`;
  return `${title} minus ${tone.other}, ${frames}, root mean square ${format(tone.rms)}`;
}

/** Show the meaning of the colors of a difference. */
export function showLegend(stage, header) {
  const legend = get("legend");
  const { tone } = header;
  legend.hidden = tone.curve !== "difference";
  if (legend.hidden) return;
  const ramp = document.createElement("div");
  ramp.className = "ramp difference";
  const ends = document.createElement("div");
  ends.className = "ends";
  ends.append(...[0, 2, 4].map((place) => element("span", format(tone.axis[place]))));
  legend.replaceChildren(
    element("div", `${header.title} − ${tone.other}`),
    ramp,
    ends,
    element("div", `root mean square ${format(tone.rms)}`),
  );
}

/** Return what an overlay found, in a few characters. */
function overlayNote(kind, { bytes, header }) {
  if (header.unknown) return "unknown";
  if (kind === "jots") return jotNumbers({ bytes, header });
  if (kind === "uncertainty") return `0 – ${format(header.largest)}${header.is_exceeded ? " or more" : ""}`;
  return String(bytes.reduce((sum, value) => sum + (value > 0 ? 1 : 0), 0));
}

/** Show what the overlays found, beside their switches, and how. */
export function showOverlayNotes(stage, state) {
  for (const kind of OVERLAYS) {
    const overlay = state.overlays.includes(kind) ? stage.overlays.get(kind) : undefined;
    write(`${kind}-note`, overlay ? overlayNote(kind, overlay) : "");
    write(`${kind}-reason`, capitalize(overlay?.header.note ?? ""));
  }
}
