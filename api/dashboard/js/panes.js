// Expected, seen and difference of one frame side by side, with the boxes of what is too bright and too dark.

import { h, replace } from "./dom.js";
import { striped } from "./heat.js";
import { picture } from "./picture.js";
import { latest } from "./shelf.js";
import { UNSCORED, onReference } from "./sweep.js";

const NAMES = { expected: "Expected", seen: "Seen", difference: "Difference" };

/** Three panes in a row. `show(frame)` shows a scored frame of the inspection, the latest one asked for. */
export function panes({ inspection, shelf }) {
  const three = Object.fromEntries(
    Object.entries(NAMES).map(([kind, title]) => [kind, pane(kind, title, { faded: kind === "difference" })]),
  );
  const wanted = { boxes: toggle("Boxes", true), heat: toggle("Difference over what was seen", false) };
  const row = h("div", { class: "panes" }, Object.values(three).map((each) => each.root));
  const lacking = h("div", { class: "pane-message", role: "status", hidden: true });
  const root = h("div", { class: "panes-room" },
    row,
    lacking,
    h("div", { class: "row panes-tools" },
      Object.values(wanted).map((each) => each.label),
      h("ul", { class: "legend" },
        h("li", {}, h("span", { class: "key bright" }, "☀"), "too bright: orange, solid box"),
        h("li", {}, h("span", { class: "key dark" }, "☾"), "too dark: blue, striped, dashed box"))));
  let frame = null;
  let heat = null;
  let placed = null;

  function toggle(text, checked) {
    const box = h("input", { type: "checkbox", checked, onchange: () => draw() });
    return { box, label: h("label", { class: "choice" }, box, text) };
  }

  /** What is said in place of the pictures; null where they are there. */
  function lack(title, why, again) {
    row.hidden = title !== null;
    lacking.hidden = title === null;
    if (title) replace(lacking, h("h3", {}, title), h("p", {}, why), h("button", { type: "button", onclick: again }, "Try again"));
  }

  function draw() {
    const boxes = frame && placed && wanted.boxes.box.checked ? boxesOf(frame.regions, placed) : [];
    for (const each of Object.values(three)) each.picture.boxes(boxes);
    three.seen.over = wanted.heat.box.checked ? heat : null;
    three.difference.over = heat;
    for (const each of Object.values(three)) each.picture.redraw();
  }

  const show = latest(async (next) => {
    root.dataset.loading = next.index;
    try {
      lack(null);
      await (next.state === "scored" ? compared(next) : alone(next));
    } catch (problem) {
      if (problem.name !== "Problem") throw problem;
      frame = next;
      lack(`No pictures of frame ${next.index}`, problem.detail, () => show(next));
    } finally {
      delete root.dataset.loading;
      root.dataset.frame = next.index;
    }
  });

  async function compared(next) {
    const ask = (kind) => shelf.picture(inspection, next.index, kind);
    const [expected, seen, difference, said] = await Promise.all([
      ask("expected"), ask("seen"), ask("difference"), shelf.frame(inspection, next.index),
    ]);
    const lies = await striped(difference);
    [frame, heat, placed] = [next, lies, said.placement];
    await Promise.all([three.expected.show(expected), three.seen.show(seen), three.difference.show(seen)]);
    draw();
    const what = `frame ${next.index}, s ${next.s.toFixed(3)}`;
    for (const [kind, each] of Object.entries(three)) each.picture.describe(`${NAMES[kind]}, ${what}`);
  }

  async function alone(next) {
    const recorded = await shelf.picture(inspection, next.index, "frame");
    [frame, heat, placed] = [next, null, null];
    const why = UNSCORED[next.state] ?? next.state;
    const counts = next.state === "waiting" ? "" : " It counts against coverage.";
    three.expected.say(`Frame ${next.index} was not scored (${next.state}): ${why}.${counts}`);
    three.difference.say("Nothing was compared.");
    await three.seen.show(recorded);
    three.seen.picture.describe(`Seen, frame ${next.index}, not scored: ${why}`);
    draw();
  }

  return {
    root,
    show: (next) => void show(next),
    close: () => Object.values(three).forEach((each) => each.picture.close()),
  };
}

/**
 * A pane with a title: a picture, or words in its place. `over` is laid on the picture, by itself where it is a
 * function; `faded` makes the picture pale before.
 */
export function pane(kind, title, { faded = false } = {}) {
  const room = h("div", { class: "pane-picture" });
  const message = h("div", { class: "pane-message", hidden: true });
  const caption = h("figcaption", {}, title);
  const self = { over: null, faded, caption, root: h("figure", { class: `pane ${kind}` }, caption, room, message) };
  self.picture = picture(room, {
    label: title,
    overlay(pen) {
      const { width, height } = pen.canvas;
      if (self.faded) {
        pen.fillStyle = "rgba(20, 24, 28, .72)";
        pen.fillRect(0, 0, width, height);
      }
      if (typeof self.over === "function") self.over(pen, width, height);
      else if (self.over) pen.drawImage(self.over, 0, 0, width, height);
    },
  });
  self.say = (text) => {
    room.hidden = true;
    message.hidden = false;
    message.textContent = text;
  };
  self.show = (blob) => {
    room.hidden = false;
    message.hidden = true;
    return self.picture.show(blob);
  };
  return self;
}

/** The highest of the regions as boxes on the expected picture. */
export function boxesOf(regions, placement) {
  const top = [...regions].sort((a, b) => b.score - a.score).slice(0, 20);
  return top.map((region, rank) => ({
    ...onReference(region, placement),
    label: rank < 3 ? region.score.toFixed(1) : undefined,
  }));
}
