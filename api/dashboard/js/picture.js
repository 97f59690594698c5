// A picture with boxes, and rectangles drawn on it by mouse, finger or keyboard.

import { atFrame, css } from "./dom.js";

const BRIGHT = { colour: "#ff9320", dash: [], mark: sun };
const DARK = { colour: "#3d8bff", dash: [7, 4], mark: moon };
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** The picture of an event `picture`. */
export function blobOf({ type, picture }) {
  return new Blob([Uint8Array.from(atob(picture), (each) => each.charCodeAt(0))], { type });
}

/**
 * A canvas in `root` that shows a picture as large as fits.
 *
 * label     what it shows, for who cannot see it
 * onDraw    ({ x, y, width, height }) in pixels of the picture: drawing is on. By mouse or finger; by keyboard: arrows move a
 *           cross (with Shift by 10), Enter sets the first and the second corner, Escape gives up
 *
 * Returns { show(blob | ImageBitmap | ImageData | null), boxes([{ x, y, width, height, polarity, label, selected, colour }]),
 * rects([…]) (what was drawn before), clear(), size(), close(), canvas }. All in pixels of the picture.
 * polarity `bright`: solid orange with a sun; `dark`: dashed blue with a moon.
 */
export function picture(root, { label = "Picture", onDraw = null, overlay = null } = {}) {
  const canvas = document.createElement("canvas");
  canvas.className = "picture";
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", label);
  if (onDraw) {
    canvas.tabIndex = 0;
    canvas.classList.add("drawing");
  }
  root.append(canvas);
  let shown = null;
  let boxes = [];
  let rects = [];
  let from = null;
  let cross = null;
  let closed = false;
  let latest = 0;

  const draw = atFrame(() => {
    const width = shown?.width ?? 4;
    const height = shown?.height ?? 3;
    canvas.style.aspectRatio = `${width} / ${height}`;
    const across = canvas.clientWidth * devicePixelRatio;
    const scale = shown ? Math.max(1, across / width) : 1;
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    const pen = canvas.getContext("2d");
    // From there on the pixels themselves are of interest.
    pen.imageSmoothingEnabled = scale < 4;
    if (shown) pen.drawImage(shown, 0, 0, canvas.width, canvas.height);
    const unit = canvas.width / Math.max(canvas.clientWidth, 1);
    overlay?.(pen, scale);
    for (const rect of rects) hatch(pen, rect, scale, unit);
    // What is written beside one is not hidden by the others.
    for (const box of boxes.toSorted((one, other) => !!one.label - !!other.label)) outline(pen, box, scale, unit);
    const now = current();
    if (now) hatch(pen, now, scale, unit);
    if (cross && document.activeElement === canvas) target(pen, cross, scale, unit);
  });

  const current = () => (from && cross ? between(from, cross) : null);

  function place(event) {
    const bounds = canvas.getBoundingClientRect();
    return inside({
      x: ((event.clientX - bounds.left) / bounds.width) * shown.width,
      y: ((event.clientY - bounds.top) / bounds.height) * shown.height,
    });
  }

  function inside({ x, y }) {
    return { x: Math.min(Math.max(x, 0), shown.width), y: Math.min(Math.max(y, 0), shown.height) };
  }

  function finish() {
    const rect = current();
    from = null;
    draw();
    if (rect && rect.width >= 2 && rect.height >= 2) onDraw(rect);
  }

  if (onDraw) {
    canvas.addEventListener("pointerdown", (event) => {
      if (!shown || event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      from = cross = place(event);
      draw();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!shown || !from) return;
      cross = place(event);
      draw();
    });
    canvas.addEventListener("pointerup", () => from && finish());
    canvas.addEventListener("pointercancel", () => {
      from = null;
      draw();
    });
    canvas.addEventListener("focus", draw);
    canvas.addEventListener("blur", draw);
    canvas.addEventListener("keydown", (event) => {
      if (!shown) return;
      cross ??= { x: shown.width / 2, y: shown.height / 2 };
      const step = KEYS[event.key];
      if (step) {
        const far = event.shiftKey ? 10 : 1;
        cross = inside({ x: cross.x + far * step[0], y: cross.y + far * step[1] });
      } else if (event.key === "Enter") {
        if (from) finish();
        else from = { ...cross };
      } else if (event.key === "Escape" && from) {
        from = null;
      } else return;
      event.preventDefault();
      draw();
    });
  }

  const watch = new ResizeObserver(draw);
  watch.observe(canvas);
  draw();

  return {
    canvas,
    /** Resolves when it is shown; a picture that came after it goes before it. */
    async show(source) {
      const number = ++latest;
      const made = source instanceof Blob || source instanceof ImageData ? await createImageBitmap(source) : source;
      if (closed || number !== latest) return made?.close?.();
      if (shown !== made) shown?.close?.();
      shown = made;
      draw();
    },
    boxes(those) {
      boxes = those;
      draw();
    },
    rects(those) {
      rects = those;
      draw();
    },
    clear() {
      boxes = [];
      rects = [];
      latest++;
      shown?.close?.();
      shown = null;
      draw();
    },
    size: () => (shown ? { width: shown.width, height: shown.height } : null),
    describe: (text) => canvas.setAttribute("aria-label", text),
    redraw: draw,
    close() {
      closed = true;
      watch.disconnect();
      draw.cancel();
      shown?.close?.();
      canvas.remove();
    },
  };
}

function between(one, other) {
  const x = Math.round(Math.min(one.x, other.x));
  const y = Math.round(Math.min(one.y, other.y));
  return { x, y, width: Math.round(Math.max(one.x, other.x)) - x, height: Math.round(Math.max(one.y, other.y)) - y };
}

function outline(pen, box, scale, unit) {
  const kind = box.polarity === "dark" ? DARK : BRIGHT;
  // A box of few pixels still has to be seen from afar.
  const pad = 3 * unit;
  const [x, y] = [box.x * scale - pad, box.y * scale - pad];
  const [width, height] = [box.width * scale + 2 * pad, box.height * scale + 2 * pad];
  const wide = (box.selected ? 4 : 2.5) * unit;
  pen.save();
  pen.lineJoin = "round";
  pen.strokeStyle = "rgba(0, 0, 0, .75)";
  pen.lineWidth = wide + 2.5 * unit;
  pen.strokeRect(x, y, width, height);
  pen.strokeStyle = box.colour ?? kind.colour;
  pen.lineWidth = wide;
  pen.setLineDash(kind.dash.map((each) => each * unit));
  pen.strokeRect(x, y, width, height);
  pen.setLineDash([]);
  const size = 9 * unit;
  const above = y - 2.6 * size < 0 ? y + height + 1.4 * size : y - 1.4 * size;
  const left = Math.min(Math.max(x + size, 1.3 * size), pen.canvas.width - 1.3 * size);
  pen.fillStyle = "rgba(0, 0, 0, .8)";
  pen.beginPath();
  pen.arc(left, above, 1.25 * size, 0, 7);
  pen.fill();
  kind.mark(pen, left, above, size, box.colour ?? kind.colour);
  if (box.label) {
    pen.font = `600 ${13 * unit}px system-ui, sans-serif`;
    pen.lineWidth = 3.5 * unit;
    pen.textBaseline = "middle";
    const wanted = pen.measureText(box.label).width;
    const right = left + 1.6 * size + wanted < pen.canvas.width;
    pen.textAlign = right ? "left" : "right";
    const where = left + (right ? 1.6 : -1.6) * size;
    pen.strokeStyle = "rgba(0, 0, 0, .85)";
    pen.strokeText(box.label, where, above);
    pen.fillStyle = "#fff";
    pen.fillText(box.label, where, above);
  }
  pen.restore();
}

function sun(pen, x, y, size, colour) {
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = size / 5;
  pen.beginPath();
  pen.arc(x, y, 0.42 * size, 0, 7);
  pen.fill();
  for (let ray = 0; ray < 8; ray++) {
    const [across, down] = [Math.cos((ray * Math.PI) / 4), Math.sin((ray * Math.PI) / 4)];
    pen.beginPath();
    pen.moveTo(x + 0.6 * size * across, y + 0.6 * size * down);
    pen.lineTo(x + 0.95 * size * across, y + 0.95 * size * down);
    pen.stroke();
  }
}

function moon(pen, x, y, size, colour) {
  pen.fillStyle = colour;
  pen.beginPath();
  pen.arc(x, y, 0.8 * size, 0.25 * Math.PI, 1.75 * Math.PI);
  pen.quadraticCurveTo(x - 0.35 * size, y, x + 0.57 * size, y + 0.57 * size);
  pen.fill();
}

function hatch(pen, { x, y, width, height }, scale, unit) {
  pen.save();
  pen.beginPath();
  pen.rect(x * scale, y * scale, width * scale, height * scale);
  pen.fillStyle = "rgba(20, 20, 30, .35)";
  pen.fill();
  pen.save();
  pen.clip();
  pen.strokeStyle = "rgba(255, 255, 255, .65)";
  pen.lineWidth = unit;
  pen.beginPath();
  for (let across = (x - height) * scale; across < (x + width) * scale; across += 8 * unit) {
    pen.moveTo(across, (y + height) * scale);
    pen.lineTo(across + height * scale, y * scale);
  }
  pen.stroke();
  pen.restore();
  pen.strokeStyle = css("--focus");
  pen.lineWidth = 2 * unit;
  pen.strokeRect(x * scale, y * scale, width * scale, height * scale);
  pen.restore();
}

function target(pen, { x, y }, scale, unit) {
  pen.save();
  for (const [colour, width] of [["#000", 4], ["#fff", 1.5]]) {
    pen.strokeStyle = colour;
    pen.lineWidth = width * unit;
    pen.beginPath();
    pen.moveTo(x * scale - 12 * unit, y * scale);
    pen.lineTo(x * scale + 12 * unit, y * scale);
    pen.moveTo(x * scale, y * scale - 12 * unit);
    pen.lineTo(x * scale, y * scale + 12 * unit);
    pen.stroke();
  }
  pen.restore();
}
