// Two sweeps of a product, matched by their place on the part, not by clock: scores on one chart, pictures side by side.

import { chart, legend } from "../chart.js";
import { atFrame, empty, failed, fixed, h, moment, replace, settled, standing, verdict } from "../dom.js";
import { between } from "../heat.js";
import { boxesOf, pane } from "../panes.js";
import { pick } from "../picker.js";
import { origin, source } from "../record.js";
import { scrubber } from "../scrubber.js";
import { Shelf, latest } from "../shelf.js";
import { Sweep, UNSCORED } from "../sweep.js";

const PAGE = 5000;
const NEAR = 0.02; // of s: what lies farther off shows another place
const SIDES = ["a", "b"];
const SERIES = [
  { label: "A", colour: "--score", width: 2 },
  { label: "B", colour: "--position", width: 2, dash: [6, 3] },
];

export const title = "Compare";

export async function show(root, params, app) {
  let close = await open(root, params, app);
  let gone = false;
  /** One that ran has ended: there is more to see of it. */
  async function ended({ inspection_id: id }) {
    if (id !== params.a && id !== params.b) return;
    close();
    close = () => {};
    const done = await open(root, params, app).catch((problem) => {
      if (!gone) replace(root, failed(problem, () => ended({ inspection_id: id })));
      return () => {};
    });
    if (gone) done();
    else close = done;
  }
  const off = ["verdict", "aborted"].map((kind) => app.events.on(kind, ended));
  return () => {
    gone = true;
    for (const each of off) each();
    close();
  };
}

async function open(root, params, app) {
  if (!params.a) return choose(root, app);
  const sides = {};
  const gone = new AbortController();
  for (const name of SIDES) sides[name] = params[name] ? await read(params[name], app.api, gone.signal) : null;
  if (!sides.b) return half(root, sides.a, app);
  return both(root, sides, params, app, gone);
}

/** Everything of one sweep. */
async function read(id, api, signal) {
  const path = `/v1/inspections/${id}`;
  const inspection = await api.get(path, { signal });
  const result = inspection.state === "processing" ? null : await api.get(`${path}/result?frames=false`, { signal });
  const sweep = new Sweep();
  for (let items = { length: inspection.scores === "removed" ? 0 : PAGE }; items.length === PAGE; ) {
    ({ items } = await api.get(api.url(`${path}/scores`, { after: sweep.length - 1, limit: PAGE }), { signal }));
    sweep.add(items);
  }
  return { inspection, result, sweep };
}

/** No sweep yet: of which product? */
async function choose(root, app) {
  const products = await app.api.list("/v1/products");
  const ask = (product) =>
    pick({ app, product, recipe: null, title: `Compare: the first sweep of ${product}`, chosen: (id) => app.go(`#/compare/${id}`) });
  replace(root, products.length
    ? h("section", { class: "panel column" },
        h("h1", {}, "Compare two sweeps"),
        h("p", { class: "note" }, "Matched by their place on the part. Of which product?"),
        h("div", { class: "row" }, products.map(({ product_id }) =>
          h("button", { type: "button", onclick: () => ask(product_id) }, product_id))))
    : empty("Nothing to compare yet", "There is no product. The first sweep that is uploaded makes one.",
        `curl --data-binary @golden.mcap -H 'Content-Type: application/octet-stream' ${location.origin}/v1/products/plate/sweeps`));
  return () => {};
}

function picked(other, app, name) {
  return () =>
    pick({
      app,
      product: other.inspection.product_id,
      recipe: other.inspection.recipe_id,
      besides: other.inspection.inspection_id,
      title: `Compare: another sweep of ${other.inspection.product_id} as ${name.toUpperCase()}`,
      chosen: (id) => {
        const ids = { [name]: id, [name === "a" ? "b" : "a"]: other.inspection.inspection_id };
        app.go(`#/compare/${ids.a}/${ids.b}`);
      },
    });
}

function card(name, side, change) {
  const { inspection, result } = side;
  return h("section", { class: `panel side ${name}`, "aria-label": `Sweep ${name.toUpperCase()}` },
    h("span", { class: "letter" }, name.toUpperCase()),
    verdict(standing(inspection)),
    h("div", { class: "who" },
      h("a", { class: "row-link", href: `#/inspection/${inspection.inspection_id}` }, inspection.part_id ?? "part without a number"),
      h("p", { class: "note" }, moment(inspection.begun_ns))),
    origin(inspection, result),
    change ? h("button", { type: "button", onclick: change, "aria-label": `Another sweep as ${name.toUpperCase()}` }, "Change") : null);
}

function half(root, side, app) {
  const ask = picked(side, app, "b");
  replace(root,
    h("h1", {}, `Compare sweeps of ${side.inspection.product_id}`),
    h("div", { class: "two" },
      card("a", side, null),
      h("section", { class: "panel side b" },
        h("span", { class: "letter" }, "B"),
        h("p", { class: "note" }, "Another sweep of the same product: an inspection, or a golden sweep."),
        h("button", { type: "button", class: "main", onclick: ask }, "Choose"))));
  ask();
  return () => document.querySelector("dialog.picker")?.close();
}

function both(root, sides, params, app, gone) {
  const { a, b } = sides;
  const [one, other] = [a.inspection, b.inspection];
  const shelf = new Shelf();
  let current = -1;
  const room = h("div", { class: "curves" });
  const readout = h("div", {});
  const plot = chart(room, {
    series: SERIES,
    x: { label: "s, place on the part" },
    height: 180,
    label: "Scores of both sweeps along s, with the limit at 1",
    onCursor: (at) => pressed && go(at),
    onPick: go,
  });
  let pressed = false;
  for (const kind of ["pointerdown", "pointermove", "pointerup", "pointerleave"])
    plot.plot.over.addEventListener(kind, (event) => (pressed = event.buttons === 1));

  const merged = merge(a.sweep.columns(), b.sweep.columns());
  plot.set(merged.s, merged.a, merged.b);
  const found = SIDES.flatMap((name) => sides[name].result?.deviations ?? []);
  plot.bands(found.map((each) => ({ from: each.s_start, to: each.s_end, colour: "--band-ng" })));

  const scrub = scrubber({
    sweep: a.sweep,
    deviations: () => found.map((each) => ({ ...each, peak_index: a.sweep.nearest((each.s_start + each.s_end) / 2) })),
    moved: look,
  });
  const three = { a: pane("a", "A"), b: pane("b", "B"), difference: pane("difference", "B against A", { faded: true }) };
  const row = h("div", { class: "panes" }, Object.values(three).map((each) => each.root));
  const third = views(three.difference);
  const boxes = h("input", { type: "checkbox", onchange: () => look(current) });

  replace(root,
    h("div", { class: "spread" },
      h("h1", {}, `Compare sweeps of ${one.product_id}`),
      h("a", { class: "button", href: `#/compare/${other.inspection_id}/${one.inspection_id}` }, "⇄ Change sides")),
    h("div", { class: "two" }, card("a", a, picked(b, app, "a")), card("b", b, picked(a, app, "b"))),
    SIDES.filter((name) => sides[name].inspection.state === "processing").map((name) =>
      h("p", { class: "warning", role: "status" }, `${name.toUpperCase()} is still running: what is here of it are its first ${sides[name].sweep.length} frames. The rest, and its pictures, come when it has ended.`)),
    SIDES.filter((name) => sides[name].inspection.scores === "removed").map((name) =>
      h("p", { class: "warning", role: "status" }, `The scores of the frames of ${name.toUpperCase()} are not kept any more: there is nothing to match.${sides[name].inspection.recording === "kept" ? " A replay of its recording has them." : ""}`)),
    one.product_id === other.product_id ? null
      : h("p", { class: "warning", role: "alert" }, `These are sweeps of two products, ${one.product_id} and ${other.product_id}.`),
    one.appearance_id === other.appearance_id ? null : unlike(a, b, app),
    h("section", { class: "panel sweep", onkeydown: (event) => !event.target.closest("input, button") && scrub.key(event) },
      h("div", { class: "spread" }, legend(SERIES), scrub.buttons),
      room, scrub.slider, readout, row,
      h("div", { class: "row panes-tools" },
        h("label", { class: "choice" }, boxes, "Boxes"), third.choice,
        h("ul", { class: "legend" },
          h("li", {}, h("span", { class: "key bright" }, "☀"), "B brighter: orange"),
          h("li", {}, h("span", { class: "key dark" }, "☾"), "B darker: blue, striped")))));

  function go(at) {
    if (at !== null && at !== undefined) look(a.sweep.nearest(merged.s[at]));
  }

  const noted = settled(() => {
    if (gone.signal.aborted) return;
    params.s = a.sweep.places[current].toFixed(4);
    app.note(`#/compare/${one.inspection_id}/${other.inspection_id}?s=${params.s}`);
  }, 300);

  const soon = atFrame(() => {
    const s = a.sweep.places[current];
    scrub.set(current);
    plot.mark(s);
    const match = matching(s);
    replace(readout, h("p", { class: "readout" }, h("span", { class: "fact" }, h("span", {}, "s"), h("b", {}, fixed(s, 3))),
      told("A", a.sweep.frames[current]), told("B", match)));
    pictures({ frame: a.sweep.frames[current], match, s });
    noted();
  });

  function look(index) {
    if (index < 0) return;
    current = index;
    soon();
  }

  /** B's frame at the same place, or null. */
  function matching(s) {
    const index = b.sweep.nearest(s, true);
    return index >= 0 && Math.abs(b.sweep.places[index] - s) <= NEAR ? b.sweep.frames[index] : null;
  }

  const pictures = latest(async ({ frame, match, s }) => {
    row.dataset.loading = "yes";
    const [left, right] = await Promise.all([
      pictureOf(three.a, one.inspection_id, frame, `A has no frame at s ${fixed(s, 3)}.`),
      pictureOf(three.b, other.inspection_id, match, `B has no scored frame within ${NEAR} of s ${fixed(s, 3)}.`),
    ]);
    for (const [each, said] of [[three.a, left], [three.b, right]])
      each.picture.boxes(said?.placement && boxes.checked ? boxesOf(said.regions, said.placement) : []);
    if (!left?.placement || !right?.placement) three.difference.say("Both must show this place.");
    else if (one.appearance_id !== other.appearance_id) three.difference.say("They were compared with different pictures of the part.");
    else if (left.reference !== right.reference)
      three.difference.say("They were laid on neighbouring pictures of the golden sweep: their difference would show mostly edges. A step on it may be there.");
    else await third.show(left.blob, right.blob);
    delete row.dataset.loading;
    row.dataset.frame = frame?.index ?? "";
  });

  /** Shows it, and returns it with what was said of the frame; null where there is none. */
  async function pictureOf(at, id, frame, why) {
    if (!frame) {
      at.say(why);
      return null;
    }
    try {
      const isScored = frame.state === "scored";
      const [blob, said] = await Promise.all([
        shelf.picture(id, frame.index, isScored ? "seen" : "frame"),
        isScored ? shelf.frame(id, frame.index) : null,
      ]);
      await at.show(blob);
      at.caption.textContent = `${at.caption.textContent[0]}: frame ${frame.index}${isScored ? "" : `, not scored: ${UNSCORED[frame.state]}`}`;
      return { ...said, blob };
    } catch (problem) {
      if (problem.name !== "Problem") throw problem;
      at.say(problem.detail);
      return null;
    }
  }

  look(a.sweep.nearest(params.s === undefined ? middle(found) : Number(params.s) || 0));
  return () => {
    gone.abort();
    soon.cancel();
    plot.close();
    for (const each of Object.values(three)) each.picture.close();
    document.querySelector("dialog.picker")?.close();
  };
}

/** Where the highest of them is; 0 where there is none. */
function middle(deviations) {
  if (!deviations.length) return 0;
  const highest = deviations.reduce((best, each) => (best.peak_score >= each.peak_score ? best : each));
  return (highest.s_start + highest.s_end) / 2;
}

function told(name, frame) {
  const said = !frame ? "–" : frame.state === "scored" ? fixed(frame.score) : frame.state;
  return h("span", { class: `fact ${frame?.score >= 1 ? "over" : ""}` },
    h("span", {}, `${name}${frame ? `, frame ${frame.index}` : ""}`), h("b", {}, said));
}

/** Learnt differently: s does not mean quite the same in both. */
function unlike(a, b, app) {
  const again = async (event) => {
    event.target.disabled = true;
    event.target.textContent = "Replaying …";
    try {
      const asked = { ...source(b.inspection, b.result), recipe_id: a.inspection.recipe_id };
      const made = await app.api.post("/v1/replays", asked, { key: `compare ${b.inspection.inspection_id} ${asked.recipe_id}` });
      app.go(`#/compare/${a.inspection.inspection_id}/${made.inspection_id}`);
    } catch (problem) {
      event.target.replaceWith(problem.detail ?? String(problem));
    }
  };
  return h("div", { class: "warning row", role: "alert" },
    h("span", {}, "They were inspected by different appearances: the same s is not quite the same place."),
    app.may("engineer") ? h("button", { type: "button", onclick: again }, "Replay B by the recipe of A") : null);
}

/** What the third pane shows: the difference of two pictures, or one half of each. */
function views(at) {
  let mode = "difference";
  let pair = null;
  const split = h("input", { type: "range", min: "0", max: "1", step: "any", value: "0.5", class: "split", hidden: true, "aria-label": "Where A ends and B begins", oninput: () => at.picture.redraw() });
  at.root.append(split);
  const names = { difference: "Difference", halves: "Half and half" };
  const buttons = Object.entries(names).map(([name, text]) =>
    h("button", { type: "button", "aria-pressed": String(name === mode), onclick: () => {
      mode = name;
      buttons.forEach((button, number) => button.setAttribute("aria-pressed", String(Object.keys(names)[number] === mode)));
      if (pair) draw();
    } }, text));

  async function draw() {
    const [left, right] = pair;
    split.hidden = mode !== "halves";
    if (mode === "difference") {
      const ink = await between(left, right);
      at.faded = true;
      at.over = ink;
    } else {
      const bitmap = await createImageBitmap(right);
      at.faded = false;
      at.over = (pen, width, height) => {
        const x = Number(split.value);
        const from = Math.round(x * bitmap.width);
        pen.drawImage(bitmap, from, 0, bitmap.width - from, bitmap.height, x * width, 0, width - x * width, height);
        pen.fillStyle = "#fff";
        pen.fillRect(x * width - 1, 0, 2, height);
      };
    }
    await at.show(left);
  }
  return {
    choice: h("div", { class: "row", role: "group", "aria-label": "Third picture" }, buttons),
    show(left, right) {
      pair = [left, right];
      return draw();
    },
  };
}

/** Both curves over one axis; `undefined` where only the other has a frame, which interrupts no line. */
function merge(a, b) {
  const merged = { s: [], a: [], b: [] };
  for (let i = 0, j = 0; i < a.s.length || j < b.s.length; ) {
    const s = Math.min(a.s[i] ?? Infinity, b.s[j] ?? Infinity);
    merged.s.push(s);
    merged.a.push(a.s[i] === s ? a.score[i++] : undefined);
    merged.b.push(b.s[j] === s ? b.score[j++] : undefined);
  }
  return merged;
}
