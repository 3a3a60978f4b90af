// The state that the address of the page states after the #, which anybody may have written.

const MAX_PROBLEMS = 3;
const MAX_LETTERS = 30;

const whole = (least, step) => (text) =>
  /^\d{1,15}$/.test(text) && Number(text) >= least && Number(text) % step === 0 ? Number(text) : undefined;
const oneOf = (names) => (text) => (names.includes(text) ? text : undefined);
const oneFlag = (text) => (text === "0" ? false : undefined);
const flag = (text) => (text === "1" ? true : text === "0" ? false : undefined);

function intensity(text) {
  const value = Number(text);
  return value > 1e-30 && value < 1e30 ? value : undefined;
}

function someOf(names) {
  return (text) => {
    const found = [...new Set(text.split(",").filter(Boolean))];
    return found.every((name) => names.includes(name)) ? found : undefined;
  };
}

/** Return, for each name, what its value must be, and a function that reads it from a text. */
function readers(capture, overlays) {
  const { cycle, align_reason: reason } = capture;
  const usable = capture.methods.filter((method) => !method.reason).map((method) => method.name);
  const found = {
    start: [cycle === 1 ? "a whole number" : `a multiple of the ${cycle} exposures`, whole(0, cycle)],
    window: [cycle === 1 ? "a whole number from 1" : `a multiple of the ${cycle} exposures`, whole(cycle, cycle)],
    method: ["a method that serves this capture", oneOf(usable)],
    compare: ["a method that serves this capture", oneOf(usable.slice(1))],
    align: reason ? [`0, because windows cannot be aligned: ${reason}`, oneFlag] : ["0 or 1", flag],
    curve: [capture.curves.join(", "), oneOf(capture.curves)],
    white: ["a number from 1e-30 to 1e30", intensity],
    overlays: [`some of ${overlays.join(",")}`, someOf(overlays)],
  };
  if (capture.live) found.follow = ["0 or 1", flag];
  return new Map(Object.entries(found));
}

const shorten = (text) => (text.length > MAX_LETTERS ? `${text.slice(0, MAX_LETTERS)}…` : text);

/** Return the valid values of an address, and a text about all others, which is empty if there are none. */
export function readAddress(text, capture, overlays) {
  const known = readers(capture, overlays);
  const stated = {};
  const problems = [];
  for (const [name, value] of new URLSearchParams(text)) {
    const [expected, read] = known.get(name) ?? [];
    const result = read?.(value);
    if (result !== undefined) stated[name] = result;
    else problems.push(`${shorten(`${name}=${value}`)} (${expected ? `expected ${expected}` : "unknown"})`);
  }
  if (!problems.length) return { stated, problem: "" };
  const others = problems.length - MAX_PROBLEMS;
  const listed = problems.slice(0, MAX_PROBLEMS).join("; ") + (others > 0 ? `; and ${others} more` : "");
  return { stated, problem: `Parts of the address are ignored: ${listed}` };
}
