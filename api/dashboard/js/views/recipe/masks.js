// What nobody cares about, drawn on the reference picture: fixed in the picture, a window, or of the part.

import { ask, blob, post, url } from "../../api.js";
import { failed, fixed, h, replace, settled } from "../../dom.js";
import { picture } from "../../picture.js";
import { maskPng } from "./mask_png.js";
import { followJob } from "./job.js";

const LOOK_MS = 80;
const KINDS = {
  ignore: { short: "in the picture", label: "Don't care, fixed in the picture", said: "Reflections, the fixture, a time stamp: nothing there is looked at, wherever the part is." },
  window: { short: "window", label: "Window, fixed in the picture", said: "Only what lies in a window is looked at; all else is as if it were masked." },
  excuse: { short: "on the part", label: "Don't care, on the part", said: "Labels, serial numbers: drawn here, excused wherever the sweep sees this place of the part." },
};

export function masksPanel(recipe, app) {
  const why = recipe.forbids("engineer");
  const chosen = recipe.chosen ?? recipe.active?.appearance_id ?? recipe.appearances[0].appearance_id;
  const appearance = recipe.appearances.find((each) => each.appearance_id === chosen);
  const base = `${recipe.path}/appearances/${chosen}`;
  let drawn = [];
  let kind = "ignore";
  let at = null;
  let asking = null;
  let before = null;
  const excusedBefore = JSON.parse(appearance.facts.excused ?? "[]");
  const hasMasks = Number(appearance.facts.ignored) > 0 || Number(appearance.facts.excused_regions) > 0;

  const where = h("p", { class: "note", role: "status" });
  const trouble = h("div", {});
  const place = h("div", { class: "reference" });
  const shown = picture(place, {
    label: "Reference picture. Arrows move a cross, with Shift by 10; Enter sets the first and the second corner of a rectangle.",
    onDraw: why ? null : add,
    overlay(pen) {
      if (!before || (keep && !keep.checked)) return;
      for (const [each, colour] of [[before.fixed, "rgba(255, 255, 255, .7)"], [before.part, "rgba(255, 205, 80, .85)"]])
        pen.drawImage(inked(each, colour), 0, 0, pen.canvas.width, pen.canvas.height);
    },
  });
  const keep = hasMasks ? h("input", { type: "checkbox", checked: true, disabled: Boolean(why), onchange: () => draw() }) : null;
  const slider = h("input", { type: "range", id: "mask-s", min: "0", max: "1", step: "0.002", value: "0.5" });
  const number = h("output", { for: "mask-s", class: "number" });
  const radios = Object.entries(KINDS).map(([name, { label, said }]) => {
    const radio = h("input", { type: "radio", name: "mask-kind", value: name, checked: name === kind, disabled: Boolean(why), onchange: () => (kind = name) });
    return h("label", { class: "choice" }, radio, h("span", {}, h("strong", {}, label), h("span", { class: "note" }, said)));
  });
  const table = h("div", { class: "scroll" });
  const trap = h("p", { class: "wrong", role: "status" });
  const learn = h("button", { type: "button", class: "main", onclick: begin }, "Learn with these");
  const jobs = h("div", { class: "jobs", "aria-live": "polite" });
  const ends = [];

  const look = settled(async () => {
    asking?.abort();
    const mine = (asking = new AbortController());
    try {
      const response = await ask(url(`${base}/reference`, { s: slider.value }), { signal: mine.signal });
      const shows = hasMasks ? await levels(await blob(url(`${base}/ignored`, { s: slider.value }), { signal: mine.signal })) : null;
      const told = Number(response.headers.get("Reference-S") ?? NaN);
      at = Number.isFinite(told) ? told : Number(slider.value);
      where.textContent = `Nearest reference picture: s ${fixed(at, 3)}`;
      const expected = await response.blob();
      before = shows;
      await shown.show(expected);
      replace(trouble);
      draw();
    } catch (problem) {
      if (problem.name !== "AbortError") replace(trouble, failed(problem, look));
    }
  }, LOOK_MS);

  function tellS() {
    number.textContent = `s ${fixed(Number(slider.value), 3)}`;
    slider.setAttribute("aria-valuetext", number.textContent);
  }

  function add(rect) {
    drawn = [...drawn, { kind, ...(kind === "excuse" ? { s: at } : {}), ...rect }];
    draw();
  }

  function remove(mask) {
    drawn = drawn.filter((each) => each !== mask);
    draw();
  }

  function goTo(s) {
    slider.value = s;
    tellS();
    look();
  }

  /** Masks of the part are shown at the place only where they were drawn: where they go from there the service knows. */
  function draw() {
    const here = drawn.filter((each) => each.kind === "ignore" || (each.kind === "excuse" && Math.abs(each.s - at) < 1e-6));
    shown.rects([...here, ...outside(drawn.filter((each) => each.kind === "window"), shown.size())]);
    replace(table, drawn.length ? maskTable() : h("p", { class: "note" }, "Nothing is drawn yet. Drag over the picture, or use the keyboard: Enter, arrows, Enter."));
    const away = keep !== null && !keep.checked;
    const again = (away || drawn.some((each) => each.kind !== "excuse")) && !appearance.sweep_ids.length;
    shown.redraw();
    learn.textContent = away && !drawn.length ? "Learn without masks" : "Learn with these";
    const nothing = drawn.length || away ? (again ? "The sweeps that it was learnt from are not here: only regions of the part can be excused." : null) : "Draw something first.";
    trap.textContent = again ? nothing : "";
    learn.disabled = Boolean(why ?? nothing);
    learn.title = why ?? nothing ?? "";
  }

  function maskTable() {
    const row = (mask, i) =>
      h(
        "tr",
        {},
        h("td", {}, KINDS[mask.kind].short, mask.kind === "excuse" ? h("button", { type: "button", class: "link", onclick: () => goTo(mask.s) }, `at s ${fixed(mask.s, 3)}`) : null),
        ["x", "y", "width", "height"].map((name) => h("td", { class: "number" }, corner(mask, name, i))),
        h("td", {}, h("button", { type: "button", class: "icon", "aria-label": `Remove rectangle ${i + 1}`, title: "Remove", onclick: () => remove(mask) }, "✕")),
      );
    const head = ["What", "x", "y", "width", "height", ""].map((text, i) => h("th", { scope: "col", class: i > 0 && i < 5 ? "number" : null }, text));
    return h("table", { class: "rows masks" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, drawn.map(row)));
  }

  function corner(mask, name, i) {
    const { width, height } = shown.size();
    const most = { x: width - 1, y: height - 1, width, height }[name];
    const input = h("input", { type: "number", min: name === "x" || name === "y" ? "0" : "1", max: String(most), step: "1", "aria-label": `${name} of rectangle ${i + 1}` });
    input.value = mask[name];
    input.addEventListener("change", () => {
      if (input.checkValidity() && input.value !== "") mask[name] = Number(input.value);
      draw();
    });
    return input;
  }

  async function begin() {
    learn.disabled = true;
    replace(jobs);
    try {
      const fixedOnes = drawn.filter((each) => each.kind !== "excuse");
      const kept = keep?.checked;
      let excuse = drawn.filter((each) => each.kind === "excuse").map(({ s, x, y, width, height }) => ({ s, x, y, width, height }));
      let learnt = chosen;
      if (fixedOnes.length || (keep && !kept)) {
        const { width, height } = shown.size();
        const asked = { sweep_ids: appearance.sweep_ids };
        if (fixedOnes.length || (kept && Number(appearance.facts.ignored) > 0))
          asked.ignore = await maskPng(fixedOnes, width, height, kept ? before.fixed : null);
        learnt = await learnBy("Learning with what is fixed in the picture", asked);
        // What is learnt anew has to be excused anew.
        if (kept) excuse = [...excusedBefore, ...excuse];
      }
      if (excuse.length) learnt = await learnBy("Excusing regions of the part", { of: learnt, excuse });
      recipe.chosen = learnt;
      await recipe.reload("");
      recipe.tell(`Appearance ${recipe.named(learnt)} is learnt with the masks. Save a version with it, and parts are inspected by it.`);
      recipe.go("policy");
    } catch (problem) {
      // A job that failed has said so in its row.
      if (problem.detail) replace(jobs, failed(problem));
      draw();
    }
  }

  async function learnBy(text, body) {
    const { job_id } = await post(`${recipe.path}/appearances`, body, { key: recipe.key() });
    return new Promise((done, refuse) => {
      const row = followJob(app, job_id, text, (job) => (job.appearance_id ? done(job.appearance_id) : refuse(new Error(job.error))));
      ends.push(row.close);
      jobs.append(row.node);
    });
  }

  slider.addEventListener("input", () => {
    tellS();
    look();
  });
  tellS();
  draw();
  look();
  const left = h(
    "section",
    { class: "panel", "aria-labelledby": "masks-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "masks-title" }, "Reference picture"), h("span", { class: "note" }, recipe.named(chosen))),
    h("div", { class: "srow" }, h("label", { for: "mask-s" }, "Along the sweep"), slider, number),
    where,
    trouble,
    place,
  );
  const right = h(
    "section",
    { class: "panel", "aria-labelledby": "kinds-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "kinds-title" }, "Draw")),
    why ? h("p", { class: "why" }, why) : null,
    h("fieldset", { class: "choices" }, h("legend", {}, "A rectangle is"), radios),
    keep ? h("label", { class: "choice kept" }, keep, h("span", {}, h("strong", {}, "Keep what is masked already"), h("span", { class: "note" }, "Striped in the picture: white is fixed in it, yellow lies on the part. Without this tick, only what is drawn now holds."))) : null,
    table,
    h("p", { class: "note" }, "Masks go into a new appearance, learnt once more from the same sweeps. Draw generously: compression carries what is under a mask to its neighbours."),
    trap,
    h("div", { class: "buttons" }, learn),
    jobs,
  );
  return {
    node: h("div", { class: "sides masks" }, left, right),
    close() {
      asking?.abort();
      ends.forEach((end) => end());
      shown.close();
    },
  };
}

/** The mask that the service tells, as two canvases, opaque where it is white, and where it is grey. */
async function levels(png) {
  const bitmap = await createImageBitmap(png);
  const { width, height } = bitmap;
  const pen = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  pen.drawImage(bitmap, 0, 0);
  bitmap.close();
  const { data } = pen.getImageData(0, 0, width, height);
  const of = (from, to) => {
    const canvas = new OffscreenCanvas(width, height);
    const image = new ImageData(width, height);
    for (let at = 0; at < data.length; at += 4) if (data[at] >= from && data[at] < to) image.data.fill(255, at, at + 4);
    canvas.getContext("2d").putImageData(image, 0, 0);
    return canvas;
  };
  return { fixed: of(200, 256), part: of(64, 200) };
}

const STRIPE = 6; // px of the picture from one stripe to the next

/** The same in stripes of a colour. */
function inked(canvas, colour) {
  const { width, height } = canvas;
  const made = new OffscreenCanvas(width, height);
  const pen = made.getContext("2d");
  pen.drawImage(canvas, 0, 0);
  pen.globalCompositeOperation = "source-in";
  pen.strokeStyle = colour;
  pen.lineWidth = STRIPE / 3;
  pen.beginPath();
  for (let x = -height; x < width; x += STRIPE) {
    pen.moveTo(x, 0);
    pen.lineTo(x + height, height);
  }
  pen.stroke();
  return made;
}

/** What lies outside of all windows, as rectangles: bands between the windows' edges, to be drawn over. */
function outside(windows, size) {
  if (!windows.length || !size) return [];
  const rows = edges(windows.flatMap((each) => [each.y, each.y + each.height]), size.height);
  const found = [];
  for (let r = 0; r + 1 < rows.length; r++) {
    const [top, bottom] = [rows[r], rows[r + 1]];
    const within = windows.filter((each) => each.y <= top && each.y + each.height >= bottom);
    let x = 0;
    for (const each of within.toSorted((a, b) => a.x - b.x)) {
      if (each.x > x) found.push({ x, y: top, width: each.x - x, height: bottom - top });
      x = Math.max(x, each.x + each.width);
    }
    if (x < size.width) found.push({ x, y: top, width: size.width - x, height: bottom - top });
  }
  return found;
}

const edges = (values, end) => [...new Set([0, ...values.map((each) => Math.min(each, end)), end])].sort((a, b) => a - b);
