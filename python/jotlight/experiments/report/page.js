"use strict";

// Without this script the page shows everything except the sliders and the theme button.

function setUpTheme(button) {
  const isDark = matchMedia("(prefers-color-scheme: dark)").matches;
  // The theme that differs from the current one comes first, so the first click is visible.
  const themes = isDark ? ["auto", "light", "dark"] : ["auto", "dark", "light"];
  let current = 0;
  button.hidden = false;
  button.addEventListener("click", () => {
    current = (current + 1) % themes.length;
    document.documentElement.dataset.theme = themes[current];
    button.textContent = `Theme: ${themes[current]}`;
  });
}

const words = new Intl.Collator("en", { numeric: true });

// Numbers come before words.
function compareCells(one, other) {
  const first = one.dataset.value;
  const second = other.dataset.value;
  if (first !== undefined && second !== undefined) return Math.sign(first - second) || 0;
  if (first !== undefined || second !== undefined) return first !== undefined ? -1 : 1;
  return words.compare(one.textContent, other.textContent);
}

function sortedRows(rows, column, direction) {
  const isMissing = (row) => "missing" in row.cells[column].dataset;
  const sign = direction === "ascending" ? 1 : -1;
  const present = rows.filter((row) => !isMissing(row));
  present.sort((one, other) => sign * compareCells(one.cells[column], other.cells[column]));
  return [...present, ...rows.filter(isMissing)];
}

function setUpTable(table) {
  const body = table.tBodies[0];
  const original = [...body.rows];
  const headings = [...table.tHead.rows[0].cells];
  const after = { none: "ascending", ascending: "descending", descending: "none" };
  headings.forEach((heading, column) => {
    heading.querySelector("button").addEventListener("click", () => {
      const direction = after[heading.getAttribute("aria-sort") ?? "none"];
      for (const each of headings) each.removeAttribute("aria-sort");
      if (direction === "none") {
        body.append(...original);
      } else {
        heading.setAttribute("aria-sort", direction);
        body.append(...sortedRows([...body.rows], column, direction));
      }
    });
  });
}

function setUpScene(scene) {
  const compare = scene.querySelector(".compare");
  if (!compare) return;
  const stage = compare.querySelector(".stage");
  const range = compare.querySelector("input");
  const crops = [...scene.querySelectorAll(".crop")];
  const select = (side) => compare.querySelector(`select.${side}`);

  function show(side) {
    const chosen = Number(select(side).value);
    const image = stage.querySelector(`img.${side}`);
    // The page holds the bytes of each image once, in the enlarged area.
    image.src = crops[chosen].querySelector("img").src;
    image.alt = crops[chosen].querySelector(".title").textContent;
    const subtitle = crops[chosen].querySelector(".subtitle").textContent;
    compare.querySelector(`output.${side}`).textContent = subtitle;
    crops.forEach((crop, index) => {
      if (side === "right") {
        crop.querySelector("button").setAttribute("aria-pressed", String(index === chosen));
      }
    });
  }

  function split(percent) {
    stage.style.setProperty("--split", `${percent}%`);
    range.value = percent;
    range.setAttribute("aria-valuetext", `${range.value} %`);
  }

  function follow(event) {
    const box = stage.getBoundingClientRect();
    const share = (event.clientX - box.left) / box.width;
    split(100 * Math.min(1, Math.max(0, share)));
  }

  compare.hidden = false;
  for (const side of ["left", "right"]) {
    select(side).addEventListener("change", () => show(side));
    const image = stage.querySelector(`img.${side}`);
    image.addEventListener("load", () => {
      // A small image that is much enlarged shows its pixels, as the enlarged area does.
      image.classList.toggle("coarse", stage.clientWidth >= 2 * image.naturalWidth);
    });
    show(side);
  }
  range.addEventListener("input", () => split(Number(range.value)));
  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    event.preventDefault();
    stage.setPointerCapture(event.pointerId);
    follow(event);
  });
  stage.addEventListener("pointermove", (event) => {
    if (stage.hasPointerCapture(event.pointerId)) follow(event);
  });
  crops.forEach((crop, index) => {
    crop.querySelector("button").addEventListener("click", () => {
      select("right").value = index;
      show("right");
      compare.scrollIntoView({ block: "nearest" });
    });
  });
}

setUpTheme(document.querySelector("#theme"));
document.querySelectorAll("table.sortable").forEach(setUpTable);
document.querySelectorAll(".scene").forEach(setUpScene);
