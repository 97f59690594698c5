// How the station keeps up: frames that were lost, and how long one takes from its last byte to its score.

import { get } from "../../api.js";
import { count, failed, fixed, h, replace, waiting } from "../../dom.js";

const LOOK_MS = 5000;

/** Of the station as a whole, since it was started. Returns {node, close}. */
export function stationPanel(app) {
  const body = h("div", {}, waiting("Asking the station"));
  const node = h(
    "section",
    { class: "panel", "aria-labelledby": "station-title" },
    h("h2", { id: "station-title" }, "Drops and latency"),
    body,
  );
  let closed = false;

  async function look() {
    try {
      const station = await get("/v1/station");
      if (!closed) replace(body, told(station));
    } catch (problem) {
      if (!closed) replace(body, failed(problem, look));
    }
  }

  look();
  const timer = setInterval(() => document.visibilityState === "visible" && look(), LOOK_MS);
  const end = app.events.on("station", look);
  return {
    node,
    close() {
      closed = true;
      clearInterval(timer);
      end();
    },
  };
}

function told({ frames, latency, running, capacity, nodes = [] }) {
  const all = frames.scored + frames.dropped + frames.refused;
  const ms = (seconds) => (seconds === null ? "–" : `${fixed(1000 * seconds, 1)} ms`);
  const share = (many) => (all ? `${fixed((100 * many) / all, many ? 3 : 0)} %` : "–");
  const rows = [
    ["Frames scored", count(frames.scored), ""],
    ["Frames dropped", count(frames.dropped), share(frames.dropped)],
    ["Frames refused", count(frames.refused), share(frames.refused)],
    ["Half have their score within", ms(latency.p50), ""],
    ["99 of 100 within", ms(latency.p99), ""],
    ["Inspections now", `${running} of ${capacity}`, ""],
    ...nodes.slice(1).map(({ name, node_id, running }) => [`At ${name}, ${node_id.slice(0, 4)}`, running ?? "–", "other service"]),
  ];
  const row = ([name, number, more]) =>
    h("tr", {}, h("th", { scope: "row" }, name), h("td", { class: "number" }, number), h("td", { class: "number note" }, more));
  return [
    h("table", { class: "rows station" }, h("tbody", {}, rows.map(row))),
    h("p", { class: "note" }, "Of the whole station since it was started; from the last byte of a frame to its score. Dropped: there was no room, and the line was told. /metrics has them by product, for Prometheus."),
  ];
}
