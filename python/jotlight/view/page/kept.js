// Choices that the browser keeps. It may refuse to keep any.

export function recall(name) {
  try {
    return localStorage.getItem(`jotlight-${name}`);
  } catch {
    return null;
  }
}

export function keep(name, value) {
  try {
    localStorage.setItem(`jotlight-${name}`, value);
  } catch {
    // The choice then lasts as long as the page.
  }
}
