// An inspection in words: who, when, by which recipe, what came of it, and where it is out of tolerance.

import { fixed, h, moment, percent } from "./dom.js";

export const POLARITY = {
  bright: { mark: "☀", word: "too bright" },
  dark: { mark: "☾", word: "too dark" },
};

/** A polarity with its mark; "–" where there is none. */
export function polarity(word) {
  const known = POLARITY[word];
  return known ? h("span", { class: `polarity ${word}` }, h("span", { "aria-hidden": "true" }, known.mark), ` ${known.word}`) : "–";
}

/** What is to be asked for where it is to be replayed: its own recording, or that of which it is a replay. */
export function source(inspection, result) {
  const [, kind, id] = /^(inspection|sweep) (.+)$/.exec(result?.replay_of ?? "") ?? [];
  return kind ? { [`${kind}_id`]: id } : { inspection_id: inspection.inspection_id };
}

/** Where it comes from: production, or a replay of something. */
export function origin(inspection, result) {
  if (!inspection.is_simulated) return null;
  const [, kind, id] = /^(inspection|sweep) (.+)$/.exec(result?.replay_of ?? "") ?? [];
  const what = kind === "inspection" ? h("a", { href: `#/inspection/${id}` }, `inspection ${id.slice(0, 8)}`) : kind ? `${kind} ${id.slice(0, 8)}` : null;
  return h("span", { class: "chip" }, "Replay", what ? [" of ", what] : null, ": not from production");
}

/** The frames by state in words: "38 scored, 2 lost, 1 dropped". */
export function tally(counts, dropped) {
  const { scored = 0, ...others } = counts;
  const rest = Object.entries(others).map(([state, n]) => `${n} ${state}`);
  return [`${scored} scored`, ...rest, `${dropped ?? 0} dropped`].join(", ");
}

/** The list of facts. `counts`: frames by state. */
export function facts(inspection, result, counts) {
  const took = inspection.ended_ns ? `, took ${fixed((inspection.ended_ns - inspection.begun_ns) / 1e9, 1)} s` : "";
  const promise = result?.promise;
  const rows = [
    ["Product", h("a", { href: `#/recipe/${encodeURIComponent(inspection.product_id)}` }, inspection.product_id)],
    ["Part", inspection.part_id ?? "–"],
    ["Begun", `${moment(inspection.begun_ns)}${took}`],
    ["Acknowledged", inspection.acknowledged_ns ? moment(inspection.acknowledged_ns) : "no"],
    ["Coverage", percent(inspection.coverage, 1)],
    ["Frames", tally(counts, inspection.frames_dropped)],
    ["Recipe", h("code", {}, inspection.recipe_id ?? "–")],
    ["Appearance", h("code", {}, inspection.appearance_id)],
    promise ? ["Limits", `for ${percent(promise.target, 1)} false rejects, from ${promise.sweeps} golden sweep${promise.sweeps === 1 ? "" : "s"}`] : null,
    inspection.scores === "removed" ? ["Scores of frames", "removed"] : null,
    ["Recording", inspection.recording + (inspection.recording_note ? `: ${inspection.recording_note}` : "")],
    ["Digest", h("code", {}, inspection.digest ?? "–")],
    ["Inspection", h("code", {}, inspection.inspection_id)],
  ];
  return h("dl", { class: "facts" }, rows.filter(Boolean).map(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]));
}

/** The deviations as a table; `picked(index)` is told the frame of the peak; null where there are no frames to look at. */
export function deviationList(deviations, picked, isRunning) {
  if (!deviations.length) return h("p", { class: "note" }, isRunning ? "Nothing over the limit so far." : "No deviation.");
  const place = (each, number) => `${number + 1}: s ${fixed(each.s_start, 3)}–${fixed(each.s_end, 3)}`;
  const row = (each, number) =>
    h("tr", {},
      h("td", {}, picked
        ? h("button", { type: "button", class: "link", onclick: () => picked(each.peak_index) }, place(each, number))
        : place(each, number)),
      h("td", {}, each.kind),
      h("td", {}, polarity(each.polarity)),
      h("td", { class: "number" }, fixed(each.peak_score)),
      h("td", { class: "number" }, each.peak_index));
  return h("table", {},
    h("thead", {}, h("tr", {},
      h("th", {}, "Place"), h("th", {}, "Kind"), h("th", {}, "Against expected"),
      h("th", { class: "number" }, "Peak score"), h("th", { class: "number" }, "Frame"))),
    h("tbody", {}, deviations.map(row)));
}

/** Stretches of which no frame was scored, in words. */
export function unseenList(gaps) {
  if (!gaps.length) return null;
  const why = (states) => Object.entries(states).map(([state, n]) => `${n} ${state}`).join(", ") || "no frame came";
  return h("div", { class: "unseen" },
    h("h3", {}, "Stretches without a scored frame"),
    h("ul", {}, gaps.map((gap) => h("li", {}, `s ${fixed(gap.start, 3)}–${fixed(gap.end, 3)}: ${why(gap.states)}`))));
}

/** What is said of one frame: a line of numbers; time counts from the `first` frame. */
export function frameLine(frame, s, first) {
  if (!frame) return h("p", { class: "readout" }, "No frame yet.");
  const part = (name, value, kind = "") => h("span", { class: `fact ${kind}` }, h("span", {}, name), h("b", {}, value));
  const said = frame.state === "scored"
    ? [
        part("score", fixed(frame.score), frame.score >= 1 ? "over" : ""),
        part("appearance", fixed(frame.residuals.appearance)),
        part("position", fixed(frame.residuals.position)),
        part("timing", fixed(frame.residuals.timing)),
        part("raw", `${fixed(frame.raw_score, 1)} grey levels`),
      ]
    : [part("not scored", frame.state, "over")];
  return h("p", { class: "readout" },
    part(frame.s === null ? "s, about" : "s", fixed(s, 3)), part("frame", frame.index), said, part("after", `${fixed((frame.t_ns - first.t_ns) / 1e9, 2)} s`));
}

/** Runs of frames at or above the limit: what is known of deviations while the sweep goes on. */
export function overLimit(sweep) {
  const runs = [];
  let run = null;
  for (const frame of sweep.frames) {
    if (frame.state !== "scored") continue;
    if (frame.score < 1) {
      run = null;
      continue;
    }
    if (!run) {
      run = { s_start: frame.s, s_end: frame.s, kind: "appearance", polarity: null, peak_score: 0, peak_index: frame.index };
      runs.push(run);
    }
    run.s_start = Math.min(run.s_start, frame.s);
    run.s_end = Math.max(run.s_end, frame.s);
    if (frame.score <= run.peak_score) continue;
    const highest = frame.regions.reduce((best, each) => (best && best.score >= each.score ? best : each), null);
    Object.assign(run, { peak_score: frame.score, peak_index: frame.index, polarity: highest?.polarity ?? null });
  }
  return runs;
}
