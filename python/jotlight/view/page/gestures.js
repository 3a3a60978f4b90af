// Mouse, wheel, and fingers on the image.

export function addGestures(stage) {
  const { canvas } = stage;
  const fingers = new Map();
  const ratio = () => devicePixelRatio || 1;
  const position = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, position(event));
    if (event.pointerType !== "mouse") stage.point(stage.locate(...position(event)));
  });

  canvas.addEventListener("pointermove", (event) => {
    const place = position(event);
    const before = fingers.get(event.pointerId);
    if (!before) {
      stage.point(stage.locate(...place));
      return;
    }
    const spread = () => {
      const [one, other] = [...fingers.values()];
      return Math.hypot(one[0] - other[0], one[1] - other[1]);
    };
    if (fingers.size === 2) {
      const old = spread();
      fingers.set(event.pointerId, place);
      const [one, other] = [...fingers.values()];
      const middle = [((one[0] + other[0]) / 2) * ratio(), ((one[1] + other[1]) / 2) * ratio()];
      if (old > 0) stage.zoom(spread() / old, middle);
    } else {
      canvas.classList.add("dragging");
    }
    stage.pan(((place[0] - before[0]) * ratio()) / fingers.size, ((place[1] - before[1]) * ratio()) / fingers.size);
    fingers.set(event.pointerId, place);
  });

  const end = (event) => {
    fingers.delete(event.pointerId);
    canvas.classList.remove("dragging");
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("pointerleave", (event) => {
    if (event.pointerType === "mouse" && !fingers.size) stage.point(null);
  });
  canvas.addEventListener("dblclick", () => stage.fit());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const step = event.deltaMode === 1 ? event.deltaY * 16 : event.deltaY;
      const place = position(event).map((value) => value * ratio());
      stage.zoom(Math.exp(-Math.max(-200, Math.min(200, step)) / 400), place);
    },
    { passive: false },
  );
  canvas.addEventListener("blur", () => stage.draw());
}
