// What was learnt: what it rests on, what it promises, what was left out, and where the sweep was too fast.

import { get } from "../../api.js";
import { chart, legend } from "../../chart.js";
import { empty, failed, fixed, h, moment, percent, replace, waiting } from "../../dom.js";

const SPEED = [
  { label: "picture moves", colour: "--score" },
  { label: "looks change", colour: "--other", dash: [5, 3] },
];

export function learntPanel(recipe, app) {
  if (!recipe.appearances.length) {
    const node = h("section", { class: "panel" }, empty("Nothing is learnt yet", "Tick the sweeps of good parts and learn from them. One is enough to begin; three or more tell which of them is unlike the others."));
    return { node, close: () => {} };
  }
  const choose = h(
    "select",
    { id: "learnt-which", "aria-label": "Appearance" },
    recipe.appearances.map((each) => {
      const active = each.appearance_id === recipe.active?.appearance_id ? " (active)" : "";
      return h("option", { value: each.appearance_id }, recipe.named(each.appearance_id) + active);
    }),
  );
  choose.value = recipe.chosen ?? recipe.active?.appearance_id ?? recipe.appearances[0].appearance_id;
  const facts = h("div", {});
  const speed = h("div", { class: "speed" });
  let drawn = null;
  let turn = 0;

  async function show() {
    const mine = ++turn;
    const appearance = recipe.appearances.find((each) => each.appearance_id === choose.value);
    replace(facts, learntFacts(appearance, recipe));
    drawn?.close();
    drawn = null;
    replace(speed, waiting("Looking how fast the sweep was"));
    try {
      const sampling = await get(`${recipe.path}/appearances/${appearance.appearance_id}/sampling`);
      if (mine === turn) drawn = samplingPart(speed, sampling);
    } catch (problem) {
      if (mine === turn) replace(speed, failed(problem, show));
    }
  }

  choose.addEventListener("change", show);
  show();
  const use = h(
    "button",
    {
      type: "button",
      onclick: () => {
        recipe.chosen = choose.value;
        recipe.go("policy");
      },
    },
    "Judge by it …",
  );
  const mask = h(
    "button",
    {
      type: "button",
      onclick: () => {
        recipe.chosen = choose.value;
        recipe.go("masks");
      },
    },
    "Draw masks …",
  );
  const node = h(
    "section",
    { class: "panel", "aria-labelledby": "learnt-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "learnt-title" }, "What was learnt"), choose),
    facts,
    h("div", { class: "buttons" }, use, mask),
    speed,
  );
  return {
    node,
    close() {
      turn++;
      drawn?.close();
    },
  };
}

function learntFacts(appearance, recipe) {
  const { facts } = appearance;
  const rows = [
    ["Learnt", moment(appearance.created_ns)],
    facts.places && ["From", [sweepsOf(appearance), `${facts.places} places`, `${facts.width}×${facts.height} px`].filter(Boolean).join(", ")],
    masked(facts) && ["Masks", masked(facts)],
    facts.promised && ["Promise", facts.promised],
    facts.added_to ? ["Added to", recipe.named(facts.added_to)] : null,
  ].filter(Boolean);
  const cautions = [...leftOut(facts), ...appearance.said];
  return [
    h("dl", { class: "facts" }, rows.map(([name, said]) => [h("dt", {}, name), h("dd", {}, said)])),
    [...new Set(cautions)].map((each) => h("p", { class: "caution" }, each)),
  ];
}

function sweepsOf({ facts, sweep_ids }) {
  const sweeps = Number(facts.sweeps) || sweep_ids.length;
  return sweeps ? `${sweeps} sweep${sweeps === 1 ? "" : "s"}` : null;
}

/** What it does not look at, in words; null where it looks at everything. */
function masked({ ignored, excused_regions: regions }) {
  const part = Number(regions) ? `${regions} region${Number(regions) === 1 ? "" : "s"} of the part excused` : null;
  return [Number(ignored) ? `${percent(ignored, 1)} of the picture ignored` : null, part].filter(Boolean).join(", ") || null;
}

/** A sentence for each golden sweep that was left out; the service says it in `said`, older ones only in facts. */
function leftOut(facts) {
  if (!facts.left_out) return [];
  const [which, reached, common] = ["left_out", "left_out_reached", "left_out_usual"].map((name) => String(facts[name] ?? "").split(", "));
  return which.map(
    (sweep, i) =>
      `Sweep ${Number(sweep) + 1} was left out: it reaches ${fixed(Number(reached[i]), 1)} times the assumed tolerance, where the others usually reach ${fixed(Number(common[i]), 1)}. Is that part defective?`,
  );
}

/** How fast picture and curve go along s, as times what is usual on this sweep, and where to slow down. */
function samplingPart(root, sampling) {
  const { s, pixels_per_frame: pixels, curve_per_frame: curve, frames_per_spot: shown, moves, advice } = sampling;
  const usual = middle(pixels);
  const series = moves ? SPEED : SPEED.slice(1);
  const place = h("div", { class: "chart" });
  const rest = moves
    ? `Usual is ${fixed(usual, 1)} px per frame; a spot is seen in ${fixed(Math.min(...shown.filter(Number.isFinite)), 0)} frames or more.`
    : "The picture does not move along this sweep: how its looks change is told.";
  const told = (i) =>
    moves && shown[i] !== null
      ? `s ${fixed(s[i], 3)}: ${fixed(pixels[i], 1)} px per frame, a spot is seen in ${fixed(shown[i], 0)} frames`
      : `s ${fixed(s[i], 3)}: looks change ${fixed(curve[i], 1)} times as fast as usual`;
  const cursor = h("p", { class: "note", role: "status" }, rest);
  const list = advice.length
    ? h("ul", { class: "advice" }, advice.map((each) => h("li", { class: "caution" }, h("strong", {}, span(each)), " ", each.said)))
    : h("p", { class: "note" }, "Nowhere does the sweep need to go slower.");
  replace(root, h("h3", {}, "How fast the sweep was"), legend(series), place, cursor, list);
  const drawn = chart(place, {
    series,
    y: { label: "times usual" },
    limit: null,
    height: 170,
    label: "How fast picture and looks change from frame to frame, along the sweep",
    onCursor: (i) => (cursor.textContent = i === null ? rest : told(i)),
  });
  drawn.set(s, ...(moves ? [pixels.map((each) => (usual ? each / usual : null))] : []), curve);
  drawn.bands(advice.map((each) => ({ from: each.s_start, to: each.s_end, colour: "--band-select" })));
  return drawn;
}

const span = (each) => `s ${fixed(each.s_start)} to ${fixed(each.s_end)}:`;

function middle(values) {
  const known = values.filter((each) => each !== null).sort((a, b) => a - b);
  return known.length ? known[known.length >> 1] : NaN;
}
