// The theme: that of the system, light, or dark.

import { keep, recall } from "./kept.js";

const THEMES = ["auto", "light", "dark"];

/** Connect the button of the theme. `onChange` is called whenever the colors change. */
export function addTheme(button, onChange) {
  const { dataset } = document.documentElement;
  const set = (theme) => {
    if (theme === "auto") delete dataset.theme;
    else dataset.theme = theme;
    button.setAttribute("aria-label", `Theme: ${theme === "auto" ? "automatic" : theme}`);
    keep("theme", theme);
    onChange();
  };
  for (const query of ["(prefers-color-scheme: dark)", "(forced-colors: active)"]) {
    matchMedia(query).addEventListener("change", onChange);
  }
  button.addEventListener("click", () => set(THEMES[(THEMES.indexOf(dataset.theme ?? "auto") + 1) % THEMES.length]));
  const kept = recall("theme");
  set(THEMES.includes(kept) ? kept : "auto");
}
