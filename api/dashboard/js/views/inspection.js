// One inspection: how it stands and why, the curves along s, and what was expected and seen at every place.

import { curves } from "../curves.js";
import { disposition } from "../disposition.js";
import { atFrame, fixed, h, moment, replace, settled, standing, verdict } from "../dom.js";
import { panes } from "../panes.js";
import { profile } from "../profile.js";
import { deviationList, facts, frameLine, origin, overLimit, tally, unseenList } from "../record.js";
import { scrubber } from "../scrubber.js";
import { Shelf } from "../shelf.js";
import { Sweep } from "../sweep.js";
import { table } from "../table.js";
import { watched } from "../watched.js";

const PAGE = 5000; // frames asked for at once
const OFTEN_MS = 500;

export const title = (params) => `Inspection ${params.id.slice(0, 8)}`;

export async function show(root, params, app) {
  const { api, events } = app;
  const path = `/v1/inspections/${params.id}`;
  const gone = new AbortController();
  const options = { signal: gone.signal };
  let inspection = await api.get(path, options);
  let result = null;
  let current = -1;
  let follows = params.frame === undefined;
  const sweep = new Sweep();
  const shelf = new Shelf();
  const running = () => inspection.state === "processing";
  /** Its frames' scores are not kept any more, and were not read before. */
  const bare = () => inspection.scores === "removed" && !sweep.length;

  const parts = ["head", "reasons", "readout", "pictures", "found", "said", "facts"];
  const at = Object.fromEntries(parts.map((name) => [name, h("div", { class: `at-${name}` })]));
  const chart = curves({ sweep, picked: (index) => choose(index) });
  const scrub = scrubber({ sweep, deviations, moved: (index) => choose(index) });
  const numbers = table({
    label: "Every frame",
    columns: COLUMNS(sweep),
    count: () => sweep.length,
    chosen: (index) => choose(index),
    empty: "No frame was scored yet.",
  });
  const raw = h("details", { class: "panel raw", ontoggle: () => numbers.choose(current) },
    h("summary", {}, "Raw numbers of every frame"), numbers.root);
  let pictures = null;
  let left = null;
  const along = h("section", { class: "panel sweep", "aria-label": "Along the sweep", onkeydown: keys },
    h("div", { class: "spread" }, chart.series, scrub.buttons), chart.root, scrub.slider, at.readout, at.pictures);

  replace(root,
    h("section", { class: "panel inspection-head" }, at.head, at.reasons),
    along,
    h("div", { class: "columns" },
      h("div", { class: "column" }, h("section", { class: "panel" }, h("h2", {}, "Deviations"), at.found), at.said),
      h("section", { class: "panel" }, h("h2", {}, "Facts"), at.facts)),
    raw);

  function deviations() {
    return result?.deviations ?? overLimit(sweep);
  }

  /** A frame is shown because somebody asked for it. */
  function choose(index) {
    follows = false;
    look(index);
    noted();
  }

  const noted = settled(() => !gone.signal.aborted && app.note(`#/inspection/${params.id}?frame=${current}`), 300);

  function look(index) {
    current = Math.min(index, sweep.length - 1);
    look.soon();
  }
  look.soon = atFrame(() => {
    const frame = sweep.frames[current];
    scrub.set(current);
    replace(at.readout, frameLine(frame, sweep.places[current], sweep.frames[0]));
    chart.mark(frame ? sweep.places[current] : null);
    if (frame) pictures?.show(frame);
    if (raw.open) numbers.choose(current);
  });

  const draw = atFrame(() => {
    chart.set();
    const reached = running() ? Math.max(0, ...sweep.places) : 1;
    const unseen = bare() || result?.coverage >= 0.9995 ? [] : sweep.unseen(reached);
    chart.bands(deviations(), unseen);
    replace(at.head, head(unseen));
    replace(at.found, deviationList(deviations(), bare() ? null : choose, running()), unseenList(unseen));
    replace(at.facts, facts(inspection, result, bare() ? { scored: inspection.frames_scored } : sweep.counts()));
    if (raw.open) numbers.refresh();
    if (follows) look(running() ? sweep.length - 1 : worst());
    else look(current);
  });

  /** Where to look first: the highest peak. */
  function worst() {
    const highest = (list, by) => list.reduce((best, each) => (best && by(best) >= by(each) ? best : each), null);
    const deviation = highest(deviations(), (each) => each.peak_score);
    return deviation?.peak_index ?? highest(sweep.frames, (each) => each.score)?.index ?? -1;
  }

  function head() {
    const said = inspection.disposition;
    return [
      h("div", { class: "row" },
        verdict(standing(inspection), "large"),
        h("div", { class: "who" },
          h("h1", {}, `${inspection.product_id} · ${inspection.part_id ?? "part without a number"}`),
          h("p", { class: "note" }, moment(inspection.begun_ns), " · ",
            running() ? tally(sweep.counts(), inspection.frames_dropped) : `coverage ${fixed(100 * (inspection.coverage ?? 0), 1)} %`)),
        origin(inspection, result),
        result?.is_partial ? h("span", { class: "chip" }, "Partial: it was broken off") : null,
        said ? h("span", { class: "chip" }, `A person: ${said.decision === "confirm" ? "confirmed" : `overruled, ${said.verdict}`}`) : null),
      h("div", { class: "row end actions" }, running() ? following() : actions()),
    ];
  }

  function following() {
    return h("button", { type: "button", "aria-pressed": String(follows), onclick: () => {
      follows = !follows;
      draw();
    } }, "Follow the camera");
  }

  function actions() {
    const button = (text, act, props = {}) => h("button", { type: "button", onclick: (event) => attempt(event.target, act), ...props }, text);
    const name = `${inspection.product_id}-${inspection.part_id ?? "part"}-${inspection.inspection_id.slice(0, 8)}`;
    const kept = inspection.recording === "kept";
    return [
      inspection.acknowledged_ns
        ? h("span", { class: "chip" }, `✓ Acknowledged ${moment(inspection.acknowledged_ns)}`)
        : app.may("operator") && button("Acknowledge", async () => become(await api.post(`${path}/acknowledge`))),
      button("Recording", () => api.download(`${path}/recording`, `${name}.mcap`), {
        disabled: !kept, title: kept ? "Exactly the frames that were scored, as MCAP" : inspection.recording_note ?? `Recording: ${inspection.recording}` }),
      button("Result", () => api.download(`${path}/result`, `${name}.json`), {
        title: inspection.scores === "removed" ? "As JSON; the scores of its frames are not kept any more" : "As JSON, with the scores of every frame" }),
      kept && app.may("engineer") && button("Replay", replay, { title: "Inspect the recording once more, by the same recipe" }),
      h("a", { class: "button", href: `#/compare/${inspection.inspection_id}` }, "Compare with …"),
    ];
  }

  async function replay() {
    const made = await api.post("/v1/replays", { inspection_id: inspection.inspection_id });
    app.go(`#/inspection/${made.inspection_id}`);
  }

  async function attempt(button, act) {
    button.disabled = true;
    replace(problem);
    try {
      await act();
    } catch (error) {
      if (error.name !== "AbortError") replace(problem, error.detail ?? error.message);
    } finally {
      button.disabled = false;
    }
  }
  const problem = h("p", { class: "problem", role: "alert" });
  root.firstChild.append(problem);

  let told = null;

  function become(now) {
    inspection = now;
    draw();
    // What somebody is writing, or has opened, stays where nothing else was said.
    const mark = JSON.stringify([running(), inspection.verdict, inspection.disposition]);
    if (mark === told) return;
    told = mark;
    replace(at.said, running() ? null : disposition({ api, inspection, allowed: app.may("operator"), told: become }));
  }

  /** The frames that are not here yet. */
  async function read() {
    for (;;) {
      const page = await api.get(api.url(`${path}/scores`, { after: sweep.length - 1, limit: PAGE }), options);
      if (sweep.add(page.items)) draw();
      if (page.items.length < PAGE) return;
    }
  }

  /** Everything, anew. */
  async function load() {
    const now = await api.get(path, options);
    const ended = now.state !== "processing";
    if (ended) result = await api.get(`${path}/result?frames=false`, options);
    inspection = now;
    if (bare()) {
      left ??= profile(inspection, deviations());
      replace(along, left.root);
      raw.hidden = true;
    } else await read();
    if (!bare() && (!pictures || pictures.live === ended)) {
      pictures?.close();
      pictures = ended ? panes({ inspection: params.id, shelf }) : watched({ inspection: params.id, events });
      replace(at.pictures, pictures.root);
    }
    replace(at.reasons, h("ul", { class: "reasons" }, (result?.reasons ?? []).map((each) => h("li", {}, each))));
    become(now);
  }

  const tell = (error) => error.name !== "AbortError" && replace(problem, error.detail ?? String(error));
  let asked = null;
  /** While it runs. */
  function soon() {
    asked ??= setTimeout(async () => {
      try {
        await read();
      } catch (error) {
        tell(error);
      }
      asked = null;
    }, OFTEN_MS);
  }
  const mine = (fn) => (data) => data.inspection_id === params.id && fn(data);
  const again = () => load().catch(tell);
  const off = [
    events.on("scores", mine((data) => {
      inspection = { ...inspection, frames_dropped: data.lost };
      soon();
    })),
    events.on("verdict", mine(again)),
    events.on("aborted", mine(again)),
    events.on("disposition", mine(again)),
    events.on("reload", again),
  ];

  function keys(event) {
    if (!event.target.closest("input, textarea, select, summary")) scrub.key(event);
  }

  const close = () => {
    gone.abort();
    clearTimeout(asked);
    for (const each of off) each();
    draw.cancel();
    look.soon.cancel();
    chart.close();
    pictures?.close();
    left?.close();
  };
  try {
    await load();
  } catch (error) {
    close();
    throw error;
  }
  if (!follows) look(Number(params.frame) || 0);
  return close;
}

const COLUMNS = (sweep) => {
  const of = (name, text) => ({ title: name, number: true, text: (i) => text(sweep.frames[i]) });
  const residual = (name) => of(name, (frame) => (frame.state === "scored" ? fixed(frame.residuals[name], 3) : "–"));
  return [
    of("frame", (frame) => String(frame.index)),
    of("s", (frame) => fixed(frame.s ?? NaN, 4)),
    { title: "state", text: (i) => sweep.frames[i].state },
    of("score", (frame) => (frame.state === "scored" ? fixed(frame.score, 3) : "–")),
    of("raw", (frame) => (frame.state === "scored" ? fixed(frame.raw_score, 2) : "–")),
    residual("appearance"),
    residual("position"),
    residual("timing"),
    of("regions", (frame) => String(frame.regions.length)),
    of("t, s", (frame) => fixed((frame.t_ns - sweep.frames[0].t_ns) / 1e9, 3)),
  ];
};
