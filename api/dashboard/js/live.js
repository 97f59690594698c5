// One inspection as its events tell it, frame by frame; no drawing here.

import { standing } from "./dom.js";

const PLACES = 100;
/** Frames further apart than this share of the sweep leave a gap in what was seen. */
const REACH = 0.05;
const PACE_MS = 3000;

export class Live {
  /** facts: an inspection of the list, or the event `begun`. */
  constructor(facts) {
    this.facts = {};
    this.s = [];
    this.score = [];
    this.state = null;
    this.latest = null;
    this.peak = { score: -1, s: null, index: null };
    this.deviations = new Map();
    this.dropped = 0;
    /** Whether all that was found is known: heard from the beginning on, or asked for. */
    this.whole = false;
    this.heard = null;
    this.early = null;
    this.foreign = null;
    /** Whether the service that had it is gone, and no frame has come since. */
    this.interrupted = false;
    this.exact = null;
    this.heardAt = performance.now();
    this.seen = new Uint8Array(PLACES);
    this.before = null;
    this.paced = [];
    this.know(facts);
  }

  get id() {
    return this.facts.inspection_id;
  }

  /** `processing`, `completed`, `aborted`, `failed`. */
  get phase() {
    return this.facts.state ?? "processing";
  }

  get running() {
    return this.phase === "processing";
  }

  /** The verdict; NG where it is certain already, INVALID as long as another part lies there; or the state that it is in. */
  get standing() {
    if (this.running && this.foreign) return "INVALID";
    return this.early && this.running ? "NG" : standing(this.facts);
  }

  get frames() {
    return Math.max(this.score.length, this.facts.frames_scored ?? 0);
  }

  /** What is known from the list, from `begun`, or from the end. */
  know(facts) {
    this.facts = { ...this.facts, ...facts };
    this.dropped = facts.frames_dropped ?? this.dropped;
    if (Number.isFinite(facts.coverage)) this.exact = facts.coverage;
    for (const each of facts.deviations ?? []) this.deviate(each);
  }

  /** Frames as [index, s, score, state], in any order, told twice or not. */
  add(frames, at = performance.now()) {
    let fresh = 0;
    for (const [index, s, score, state] of frames) {
      if (this.score[index] !== undefined) continue;
      fresh++;
      const scored = state === "scored";
      this.s[index] = scored ? s : null;
      this.score[index] = score;
      if (this.latest === null || index >= this.latest.index) {
        this.latest = { index, s, score, state };
        this.state = state;
      }
      if (!scored) continue;
      this.see(s);
      if (score > this.peak.score) this.peak = { score, s, index };
    }
    if (fresh === 0) return;
    this.heardAt = at;
    this.interrupted = false;
    this.paced.push({ at, count: this.score.length, s: this.latest.s });
    while (this.paced.length > 2 && at - this.paced[0].at > PACE_MS) this.paced.shift();
  }

  /** Frames of `/scores`. */
  addRecords(items) {
    this.add(items.map(({ index, s, score, state }) => [index, s, score, state]));
    this.paced = [];
  }

  /** What was found, as an event tells it. */
  tell(message) {
    this.heard?.push(message);
    this.note(message);
  }

  /** What was found before this page listened is being asked for: what is told meanwhile is newer. */
  ask() {
    this.heard = [];
  }

  /** The answer; null where the service that was asked does not know. */
  recall(soFar) {
    const heard = this.heard ?? [];
    this.heard = null;
    if (soFar === null) return;
    [...soFar, ...heard].forEach((each) => this.note(each));
    this.whole = true;
  }

  note({ kind, ...said }) {
    if (kind === "deviation_opened") this.deviate(said.deviation, true);
    else if (kind === "deviation_closed") this.deviate(said.deviation);
    else if (kind === "early_ng") this.early = said;
    else if (kind === "early_invalid") this.foreign = said.reason;
    else if (kind === "recognised") this.foreign &&= said.sentence;
    else if (kind === "part_found") this.foreign = null;
  }

  see(s) {
    const near = this.before !== null && Math.abs(s - this.before) < REACH;
    const [low, high] = near ? [Math.min(s, this.before), Math.max(s, this.before)] : [s, s];
    const place = (value) => Math.min(PLACES - 1, Math.max(0, Math.floor(value * PLACES)));
    this.seen.fill(1, place(low), place(high) + 1);
    this.before = s;
  }

  /** `open`: it goes on with the frames that come. */
  deviate(deviation, open = false) {
    const key = `${deviation.kind} ${deviation.index_start}`;
    this.deviations.set(key, { ...this.deviations.get(key), ...deviation, open });
  }

  /** Where a deviation ends, as far as is known: one that is open reaches to where the sweep is. */
  endOf({ open, s_end: end }) {
    return open && this.running && this.latest?.s > end ? this.latest.s : end;
  }

  /** Share of the sweep that was seen: by the service where it said, else as far as the scores tell. */
  get coverage() {
    if (this.exact !== null && !this.running) return this.exact;
    return this.seen.reduce((sum, each) => sum + each, 0) / PLACES;
  }

  /** { frames: per second, sweep: share of it per second }, over the last seconds; null where there is none. */
  get pace() {
    const [first, last] = [this.paced[0], this.paced.at(-1)];
    const seconds = first && last ? (last.at - first.at) / 1000 : 0;
    if (!this.running || seconds < 0.4) return null;
    const sweep = first.s === null || last.s === null ? null : (last.s - first.s) / seconds;
    return { frames: (last.count - first.count) / seconds, sweep };
  }

  /** Deviations as a list, the highest first. */
  get findings() {
    return [...this.deviations.values()].sort((one, other) => other.peak_score - one.peak_score);
  }
}
