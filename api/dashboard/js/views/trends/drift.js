// Whether the score has moved at any place of the sweep, from earlier to later parts, and since when.

import { chart, legend } from "../../chart.js";
import { fixed, h, moment } from "../../dom.js";

const SERIES = [
  { label: "earlier parts", colour: "--ink-2", dash: [5, 3] },
  { label: "later parts", colour: "--score", width: 2 },
];

/** drift: { s, earlier, later, changes: [{ s_start, s_end, since_ns, inspection_id, before, after }] }, or null. */
export function driftPanel({ drift }) {
  const place = h("div", { class: "chart" });
  const cursor = h("p", { class: "note", role: "status" });
  const rest = "Median over the parts of the highest score in each fiftieth of the sweep; the limit is at 1.";
  cursor.textContent = rest;
  const node = h(
    "section",
    { class: "panel", "aria-labelledby": "drift-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "drift-title" }, "Score along the sweep"), legend(SERIES)),
    drift ? [headline(drift.changes), place, cursor, list(drift.changes)] : h("p", { class: "note" }, "Too few parts to compare earlier with later ones."),
  );
  if (!drift) return { node, close: () => {} };
  const { s, earlier, later, changes } = drift;
  const drawn = chart(place, {
    series: SERIES,
    y: { label: "median score" },
    height: 230,
    label: "Median score of earlier and of later parts, along the sweep",
    onCursor: (i) => (cursor.textContent = i === null ? rest : `s ${fixed(s[i])}: earlier ${fixed(earlier[i])}, later ${fixed(later[i])}`),
  });
  drawn.set(s, earlier, later);
  drawn.bands(changes.map((each) => ({ from: each.s_start, to: each.s_end, colour: "--band-select" })));
  return { node, close: () => drawn.close() };
}

function headline(changes) {
  if (!changes.length) return h("p", { class: "headline", dataset: { changes: "0" } }, h("strong", {}, "No drift"), ": nowhere has the score moved for good.");
  const first = changes.reduce((one, other) => (other.since_ns < one.since_ns ? other : one));
  return h(
    "p",
    { class: "headline", dataset: { changes: String(changes.length) } },
    h("strong", {}, `Moved since ${moment(first.since_ns)}`),
    `: at s ${fixed(first.s_start)} to ${fixed(first.s_end)}.`,
  );
}

function list(changes) {
  if (!changes.length) return null;
  const head = ["Where", "Before", "After", "Since"].map((text, i) => h("th", { scope: "col", class: i === 1 || i === 2 ? "number" : null }, text));
  const row = (each) =>
    h(
      "tr",
      {},
      h("td", {}, `s ${fixed(each.s_start)} to ${fixed(each.s_end)}`),
      h("td", { class: "number" }, fixed(each.before)),
      h("td", { class: "number" }, fixed(each.after)),
      h("td", { class: "time" }, each.inspection_id ? h("a", { href: `#/inspection/${each.inspection_id}` }, moment(each.since_ns)) : moment(each.since_ns)),
    );
  return h("div", { class: "scroll" }, h("table", { class: "rows" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, changes.map(row))));
}
