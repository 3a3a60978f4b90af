// Saving and sharing: files, the command line, the code, and links.

import { toast, warn } from "./messages.js";

const NO_ANSWER = "Not copied: the server does not answer.";
const get = (id) => document.getElementById(id);
async function copy(text, what) {
  try {
    await navigator.clipboard.writeText(text);
    toast(`Copied: ${what}`);
  } catch {
    // Without HTTPS, browsers refuse the clipboard on addresses other than this machine.
    const focused = document.activeElement;
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    const isCopied = document.execCommand("copy");
    area.remove();
    focused.focus({ preventScroll: true });
    if (isCopied) toast(`Copied: ${what}`);
    else warn(text);
  }
}

export function addSharing(store, connection, capture) {
  const pending = [];
  for (const ending of ["png", "tif", "exr"]) {
    get(`save-${ending}`).addEventListener("click", () => save(store, ending));
  }
  const ask = (kind) => {
    if (!connection.isOpen) {
      warn(NO_ANSWER);
      return;
    }
    pending.push(kind);
    connection.send({ type: "recipe", state: shown(store.state) });
  };
  get("copy-command").addEventListener("click", () => ask("command"));
  get("copy-python").addEventListener("click", () => ask("python"));
  get("copy-link").addEventListener("click", () => {
    if (!capture()) {
      warn(NO_ANSWER); // which has not said its token yet
      return;
    }
    const token = encodeURIComponent(capture().token);
    copy(`${location.origin}/?token=${token}#${store.text()}`, "a link to this state");
  });
  connection.onReopen = () => pending.splice(0);
  return (recipe) => {
    const kind = pending.shift();
    if (kind === undefined) return;
    if (recipe.problem) warn(`Not copied: ${recipe.problem}`);
    else if (recipe[kind] === null) warn(capture().live ? "A live capture cannot be opened again." : "Bits in memory have no command. The Python code makes this image.");
    else copy(recipe[kind], kind === "command" ? "the command line" : "the Python code");
  };
}

async function save(store, ending) {
  toast("Saving");
  const state = encodeURIComponent(JSON.stringify(shown(store.state)));
  const answer = await fetch(`save?format=${ending}&state=${state}`).catch(() => null);
  if (!answer) {
    warn("Not saved: the server does not answer.");
    return;
  }
  if (!answer.ok) {
    warn(`Not saved: ${await answer.text()}`);
    return;
  }
  const name = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition") ?? "");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await answer.blob());
  link.download = name ? name[1] : `view.${ending}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  toast(`Saved: ${link.download}`);
}

/** Return the state of the image that is shown, whatever arrives meanwhile. */
function shown(state) {
  return { ...state, follow: false };
}
