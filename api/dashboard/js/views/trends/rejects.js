// The reject rate as a p-chart: is what changes from batch to batch more than chance?

import { chart, legend } from "../../chart.js";
import { h, moment, percent } from "../../dom.js";
import { control } from "./control.js";

const SERIES = [
  { label: "rejected", colour: "--score", width: 2, points: true },
  { label: "mean", colour: "--ink-2", width: 1.25 },
  { label: "control limits", colour: "--limit", width: 1.5, dash: [6, 4] },
  { label: "", colour: "--limit", width: 1.5, dash: [6, 4] },
];
const FEW = 5;

/** groups: [{ start_ns, end_ns, parts, rejected }], oldest first. Returns {node, close}. */
export function rejectPanel({ groups }) {
  const { mean, points } = control(groups);
  const place = h("div", { class: "chart" });
  const cursor = h("p", { class: "note", role: "status" });
  const odd = groups.map((each, i) => ({ ...each, ...points[i], number: i + 1 })).filter((each) => each.out || each.run);
  const usual = `${percent(mean, 1)} of ${groups.reduce((sum, each) => sum + each.parts, 0)} parts were rejected, in ${groups.length} group${groups.length === 1 ? "" : "s"}.`;
  cursor.textContent = usual;
  const tell = (i) => {
    const [group, point] = [groups[i], points[i]];
    if (!group) return usual;
    return `Group ${i + 1}, ${span(group)}: ${group.rejected} of ${group.parts} rejected, ${percent(point.share, 1)}; by chance ${percent(point.low, 1)} to ${percent(point.high, 1)}.`;
  };
  const node = h(
    "section",
    { class: "panel wide", "aria-labelledby": "rejects-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "rejects-title" }, "Reject rate"), legend(SERIES.slice(0, 3))),
    headline(odd, groups.length),
    place,
    cursor,
    h("details", {}, h("summary", {}, "How to read it"), explanation(mean), table(groups, points)),
  );
  const highest = Math.max(...points.map((each) => Math.max(each.share ?? 0, each.high ?? 0)), 0.02);
  const drawn = chart(place, {
    series: SERIES,
    x: { label: "group, oldest to newest", min: 0.5, max: groups.length + 0.5, values: (splits) => splits.map((each) => (Number.isInteger(each) ? each : "")) },
    y: { label: "rejected, %", min: 0, max: Math.min(100, 108 * highest) },
    limit: null,
    height: 230,
    label: `Share of rejected parts in each of ${groups.length} groups, with mean and control limits`,
    onCursor: (i) => (cursor.textContent = i === null ? usual : tell(i)),
  });
  const hundred = (name) => points.map((each) => (each[name] === null ? null : 100 * each[name]));
  drawn.set(groups.map((_, i) => i + 1), hundred("share"), groups.map(() => 100 * mean), hundred("high"), hundred("low"));
  drawn.bands(odd.map((each) => ({ from: each.number - 0.4, to: each.number + 0.4, colour: "--band-ng" })));
  return { node, close: () => drawn.close() };
}

function headline(odd, groups) {
  if (groups < FEW) return h("p", { class: "headline" }, h("strong", {}, "Too few groups"), ` to tell chance from change: ${groups} so far, ${FEW} are needed.`);
  if (!odd.length) return h("p", { class: "headline", dataset: { odd: "0" } }, h("strong", {}, "Steady"), ": every group is within what chance does.");
  const beyond = odd.filter((each) => each.out);
  const last = odd.at(-1);
  const said = last.out
    ? `group ${last.number} (${span(last)}) had ${percent(last.share, 1)}, where chance gives ${percent(last.low, 1)} to ${percent(last.high, 1)}`
    : `eight groups in a row up to ${last.number} (${span(last)}) lie on one side of the mean`;
  const counted = beyond.length ? `${beyond.length} of ${groups} groups out of control` : "A run";
  return h("p", { class: "headline", dataset: { odd: String(odd.length) } }, h("strong", {}, counted), `: the last, ${said}.`);
}

const explanation = (mean) => [
  h("p", { class: "note" }, `Each point is the share of a group's parts that were rejected. The line in the middle is the mean of all, ${percent(mean, 2)}.`),
  h("p", { class: "note" }, "The dashed limits are mean ± 3 √(mean (1 − mean) / n) for a group of n parts: if nothing but chance were at work, one group in some 370 would lie beyond them. Smaller groups have wider limits."),
  h("p", { class: "note" }, "A group beyond the limits, or eight in a row on one side of the mean, has a cause worth looking for: another batch of parts, a lamp, a fixture, a changed recipe."),
];

function table(groups, points) {
  const head = ["Group", "From", "Parts", "Rejected", "Share", "By chance"].map((text, i) => h("th", { scope: "col", class: i === 1 ? null : "number" }, text));
  const row = (group, i) =>
    h(
      "tr",
      {},
      h("td", { class: "number" }, i + 1),
      h("td", { class: "time" }, moment(group.start_ns)),
      h("td", { class: "number" }, group.parts),
      h("td", { class: "number" }, group.rejected),
      h("td", { class: "number" }, percent(points[i].share, 1), points[i].out ? h("strong", { class: "wrong" }, " out") : null),
      h("td", { class: "number" }, `${percent(points[i].low, 1)} – ${percent(points[i].high, 1)}`),
    );
  return h("div", { class: "scroll tall" }, h("table", { class: "rows" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, groups.map(row))));
}

const span = ({ start_ns: start, end_ns: end }) => `${moment(start)} to ${moment(end)}`;
