// One lane of the line view: what the camera sees, the score along s, and the verdict to be read from three metres.

import { chart } from "../chart.js";
import { atFrame, fixed, h, percent, replace, verdict } from "../dom.js";
import { blobOf, picture } from "../picture.js";
import { latest } from "../watched.js";

const QUIET_MS = 4000;
const CHART_PX = 150;
const CHART_MOST_PX = 360;

/** What to say of a frame that could not be scored. */
const STATES = {
  waiting: "the part is not in the picture yet",
  ambiguous: "more than one place of the sweep looks like this",
  lost: "no place of the sweep looks like this",
  strange: "the place is known, but the part does not look like itself",
  blind: "no usable picture: lamp out, or lens covered",
};

/** A lane in `root` for a `Live`. Returns { node, take(live), update(), close() }. */
export function lane(root, app) {
  let live = null;
  let asked = 0;
  let closed = false;
  let called = null;

  const name = h("a", { class: "lane-name" });
  const now = h("div", { class: "now", role: "status" });
  const because = h("p", { class: "because" });
  const screen = h("div", { class: "screen" });
  const caption = h("p", { class: "note caption" });
  const facts = h("dl", { class: "lane-facts" });
  const seen = h("div", { class: "seen-bar", role: "img" });
  const curve = h("div", { class: "curve" });
  const node = h(
    "article",
    { class: "lane panel" },
    h("h2", { class: "lane-head" }, name),
    now,
    h("div", { class: "lane-see" }, screen, caption),
    h("div", { class: "lane-say" }, because, facts),
    h("div", { class: "lane-chart" }, curve, seen),
  );
  root.append(node);

  const view = picture(screen, { label: "No picture yet" });
  const plot = chart(curve, {
    label: "Score along the sweep, the limit at 1",
    height: () => Math.min(CHART_MOST_PX, Math.max(CHART_PX, curve.clientHeight)),
    series: [{ label: "Score", colour: "--score", width: 2, points: false, fill: "--fill" }],
    y: { label: "score" },
    x: { label: "s, place along the sweep" },
  });

  const draw = atFrame(() => {
    if (!live || closed) return;
    const { facts: known } = live;
    replace(name, known.product_id, h("span", { class: "part" }, known.part_id ?? "no serial number"));
    name.setAttribute("href", `#/inspection/${encodeURIComponent(live.id)}`);
    const word = live.standing;
    // The same word again would be read out again.
    if (called !== `${live.id} ${word}`) {
      replace(now, verdict(word, `huge ${word.length <= 2 ? "short" : word.length <= 7 ? "middle" : "long"}`));
      called = `${live.id} ${word}`;
    }
    node.dataset.verdict = word;
    node.dataset.inspection = live.id;
    node.classList.toggle("is-running", live.running);
    because.textContent = reason(live);
    tellFacts();
    tellSeen();
    const shown = [...live.s.keys()].filter((index) => Number.isFinite(live.s[index]));
    plot.set(
      shown.map((index) => live.s[index]),
      shown.map((index) => live.score[index]),
    );
    plot.bands(live.findings.map((each) => ({ from: each.s_start, to: live.endOf(each), colour: "--band-ng" })));
    plot.mark(live.running ? (live.latest?.s ?? null) : null);
  });

  function tellFacts() {
    const pace = live.pace;
    const rows = [
      ["seen", percent(live.coverage)],
      ["highest score", live.peak.s === null ? "–" : `${fixed(live.peak.score)} at s ${fixed(live.peak.s)}`],
      ["frames", `${live.frames}${live.dropped ? "" : ", none dropped"}`],
    ];
    if (live.dropped) rows.push(["dropped", String(live.dropped), "bad"]);
    if (live.running) rows.push(["pace", pace ? paceText(pace) : "–"]);
    replace(
      facts,
      rows.map(([what, value, kind]) => h("div", { class: kind }, h("dt", {}, what), h("dd", {}, value))),
    );
  }

  function tellSeen() {
    const stops = [];
    const size = live.seen.length;
    for (let from = 0, to; from < size; from = to) {
      for (to = from + 1; to < size && live.seen[to] === live.seen[from]; ) to++;
      const colour = live.seen[from] ? "var(--accent)" : "var(--line)";
      stops.push(`${colour} ${(100 * from) / size}% ${(100 * to) / size}%`);
    }
    seen.style.backgroundImage = `linear-gradient(to right, ${stops.join(", ")})`;
    seen.setAttribute("aria-label", `${percent(live.coverage)} of the sweep seen`);
    seen.title = "Seen so far, along the sweep";
  }

  /** The latest picture of what runs. */
  async function see(data) {
    if (!live.running || document.hidden) return;
    const mine = ++asked;
    try {
      await view.show(blobOf(data));
    } catch {
      caption.textContent = `Frame ${data.scored.index}: browsers do not show ${data.type}`;
      return;
    }
    if (mine === asked && !closed && live.running) tellFrame(data.scored);
  }

  /** The picture that came last before anybody looked: the next may be long in coming. */
  async function catchUp() {
    const mine = ++asked;
    const last = await latest(live.id).catch(() => null);
    if (!last || mine !== asked || closed) return;
    await view.show(last.blob);
    if (mine === asked && !closed && live.running) tellFrame(last.scored);
  }

  /** The frame that tells most: the peak of what was found, or of the score. */
  async function showWhy() {
    const mine = ++asked;
    const worst = live.findings.find((each) => each.regions.length > 0);
    const index = worst?.peak_index ?? live.peak.index ?? live.latest?.index;
    if (!Number.isInteger(index) || live.facts.recording === "none" || live.facts.recording === "removed") return;
    try {
      const body = await app.api.blob(`/v1/inspections/${live.id}/frames/${index}/pictures/frame`);
      if (mine !== asked || closed) return;
      await view.show(body);
      tellFrame({ index, s: live.s[index], regions: worst?.regions ?? [] });
    } catch {
      // The recording is not there: the last picture stays.
    }
  }

  function tellFrame({ index, s, regions, state }) {
    // The best of them, so that boxes do not hide what they point at.
    const boxes = [...regions].sort((one, other) => other.score - one.score).slice(0, 6);
    view.boxes(boxes.map((each, rank) => ({ ...each, label: rank === 0 ? fixed(each.score) : null })));
    const where = Number.isFinite(s) ? `, s ${fixed(s)}` : state ? `: ${STATES[state] ?? state}` : "";
    const found = boxes.map(({ polarity, x, y, width, height }) => `too ${polarity} at x ${x} to ${x + width}, y ${y} to ${y + height}`);
    const said = `Frame ${index}${where}`;
    caption.textContent = said;
    view.describe(`${said}; ${found.join("; ") || "nothing out of tolerance"}`);
  }

  return {
    node,
    see,
    get live() {
      return live;
    },
    /** Another inspection, in the place of the one before. */
    take(other) {
      const same = live?.facts.product_id === other.facts.product_id;
      live = other;
      view.boxes([]);
      if (!same) view.clear();
      caption.textContent = live.running ? "No picture yet" : "No picture";
      view.describe(caption.textContent);
      draw();
      asked++;
      if (!live.running) showWhy();
      else if (live.facts.frames_scored > 0) catchUp();
    },
    /** More is known of it. */
    update: draw,
    /** It has ended. */
    ended() {
      draw();
      showWhy();
    },
    close() {
      closed = true;
      draw.cancel();
      view.close();
      plot.close();
      node.remove();
    },
  };
}

function paceText({ frames, sweep }) {
  return `${fixed(frames, frames < 10 ? 1 : 0)} frames/s${sweep === null ? "" : ` · ${fixed(100 * sweep, 1)} %/s`}`;
}

/** Why it is so, in one line. */
function reason(live) {
  const [worst, ...others] = live.findings;
  const found = worst
    ? `${said(worst)} at s ${fixed(worst.s_start)} to ${fixed(live.endOf(worst))}${others.length ? `, and ${others.length} more` : ""}`
    : "";
  if (live.running) {
    const quiet = performance.now() - live.heardAt;
    if (live.interrupted) return "the service that inspected it is gone; another goes on when the next frame comes";
    if (live.foreign) return live.foreign;
    if (live.early) return `NG is certain already: ${found}`;
    if (quiet > QUIET_MS) return `no frame for ${Math.round(quiet / 1000)} s`;
    if (live.state && live.state !== "scored") return STATES[live.state] ?? live.state;
    return found || (live.peak.index === null || !live.whole ? "" : "within tolerance so far");
  }
  if (live.phase === "aborted" || live.phase === "failed") return live.facts.reason ?? "";
  if (live.facts.verdict === "INVALID" && live.facts.reasons?.length) return live.facts.reasons[0];
  return found || (live.facts.reasons?.[0] ?? "");
}

function said({ kind, polarity }) {
  if (kind === "position") return "lies off, or another look,";
  if (kind === "timing") return "wrong pace";
  return polarity === "dark" ? "too dark" : polarity === "bright" ? "too bright" : "looks wrong";
}
