// What another policy would have said of the last parts: how many verdicts change, which, and how near each part came.

import { VERDICTS, empty, fixed, h, moment, verdict } from "../../dom.js";
import { svg } from "../svg.js";

const ORDER = Object.keys(VERDICTS);
const LOWEST = 0.2;
const HIGHEST = 5;
const SHOWN = 100;

/** `answer` as `rejudge` gives it; `asActive`: the policy that is judged is the active one. */
export function rejudgedPanel(answer, asActive, active) {
  const gone = answer.gone ? goneNote(answer.gone) : null;
  if (!answer.inspections.length && gone) return gone;
  if (!answer.inspections.length)
    return empty(
      "No part was inspected yet",
      "As soon as parts of this product were inspected, every move of a slider says here how many of their verdicts would change.",
      `inspector push PART.mcap --url ${location.origin} --product ${active?.product_id ?? "PRODUCT"} --part SERIAL`,
    );
  const changed = answer.inspections.filter((each) => each.before !== each.now);
  return [headline(answer, asActive, active), gone, counts(answer), strip(answer.inspections), list(changed, answer.inspections)];
}

function goneNote(n) {
  return h("p", { class: "warning", role: "status" },
    `${n} of the last parts ${n === 1 ? "is" : "are"} left out: the scores of their frames are not kept any more.`);
}

function headline(answer, asActive, active) {
  const n = answer.changed;
  const verdicts = n < 2 ? `${n || "No"} verdict` : `${n} verdicts`;
  const of = `of ${answer.inspections.length}`;
  const rest = asActive
    ? `${of} would change by the active ${active ? `version ${active.version}` : "policy"}${n ? ": those were given by another" : ""}.`
    : `${of} would change.`;
  return h("p", { class: "headline", dataset: { changed: String(n) } }, h("strong", {}, verdicts), ` ${rest}`);
}

function counts({ counts: { before, now } }) {
  const words = ORDER.filter((word) => before[word] || now[word]);
  const cell = (of, word) => h("td", { class: "number" }, of[word] ?? 0);
  const step = (word) => (now[word] ?? 0) - (before[word] ?? 0);
  return h(
    "table",
    { class: "counts" },
    h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Parts"), words.map((word) => h("th", { scope: "col" }, verdict(word, "small"))))),
    h(
      "tbody",
      {},
      h("tr", {}, h("th", { scope: "row" }, "as given"), words.map((word) => cell(before, word))),
      h("tr", {}, h("th", { scope: "row" }, "by this policy"), words.map((word) => cell(now, word))),
      h(
        "tr",
        { class: "step" },
        h("th", { scope: "row" }, "change"),
        words.map((word) => h("td", { class: "number" }, step(word) > 0 ? `+${step(word)}` : step(word) < 0 ? `−${-step(word)}` : "·")),
      ),
    ),
  );
}

/** Each part's highest score against the limit, oldest to newest; a ring where the verdict changes. */
function strip(inspections) {
  const [width, height, left, right, top, bottom] = [560, 150, 30, 6, 8, 16];
  const parts = inspections.toReversed();
  const x = (i) => left + ((i + 0.5) / parts.length) * (width - left - right);
  const y = (score) => {
    const share = Math.log(Math.min(HIGHEST, Math.max(LOWEST, score)) / LOWEST) / Math.log(HIGHEST / LOWEST);
    return height - bottom - share * (height - top - bottom);
  };
  const scale = [0.2, 0.5, 1, 2, 5].map((score) => [
    svg("line", { x1: left, x2: width - right, y1: y(score), y2: y(score), class: score === 1 ? "limit" : "grid" }),
    svg("text", { x: left - 4, y: y(score) + 3.5, class: "tick end" }, String(score)),
  ]);
  const marks = parts.map((each, i) => {
    const known = VERDICTS[each.now] ?? { mark: "·", kind: "none" };
    const changed = each.before !== each.now;
    const said = `${each.part_id ?? each.inspection_id}: ${fixed(each.highest_score)}, ${changed ? `${each.before} → ` : ""}${each.now}`;
    const dot = each.now === "OK" ? svg("circle", { cx: x(i), cy: y(each.highest_score), r: 2.6, class: "dot ok" }) : svg("text", { x: x(i), y: y(each.highest_score) + 4, class: `glyph ${known.kind}` }, known.mark);
    const ring = changed ? svg("circle", { cx: x(i), cy: y(each.highest_score), r: 7, class: "ring" }) : null;
    return svg("g", {}, svg("title", {}, said), ring, dot);
  });
  const words = [
    svg("text", { x: left, y: height - 3, class: "tick" }, "oldest"),
    svg("text", { x: width - right, y: height - 3, class: "tick end" }, "newest"),
    svg("text", { x: left + 4, y: y(1) - 4, class: "tick" }, "limit"),
  ];
  const label = `Highest score of each of ${parts.length} parts against the limit at 1; rings mark verdicts that change.`;
  return h(
    "figure",
    { class: "strip" },
    svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label }, scale, marks, words),
    h("figcaption", {}, "Highest score of each part. A ring: its verdict changes."),
  );
}

function list(changed, all) {
  if (!changed.length) return h("p", { class: "note" }, `The verdicts on all ${all.length} parts stay as they were given.`);
  const row = (each) =>
    h(
      "tr",
      {},
      h("td", {}, h("a", { href: `#/inspection/${each.inspection_id}` }, each.part_id ?? each.inspection_id.slice(0, 8))),
      h("td", { class: "turn" }, verdict(each.before, "small"), h("span", { "aria-label": "becomes" }, "→"), verdict(each.now, "small")),
      h("td", { class: "number" }, fixed(each.highest_score)),
      h("td", { class: "time" }, moment(each.ended_ns)),
    );
  const head = ["Part", "Verdict", "Highest score", "Inspected"].map((text, i) => h("th", { scope: "col", class: i === 2 ? "number" : null }, text));
  const more = changed.length > SHOWN ? h("p", { class: "note" }, `and ${changed.length - SHOWN} more`) : null;
  return h(
    "div",
    { class: "changes" },
    h("table", { class: "rows" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, changed.slice(0, SHOWN).map(row))),
    more,
    h("p", { class: "note" }, "Each part is judged by what it was inspected with, from its stored scores. Where limits fall, regions are missing that had not reached them then."),
  );
}
