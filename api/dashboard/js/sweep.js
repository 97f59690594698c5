// One inspection along s: what was said of its frames, the oldest first, each at its place on the part.

const WIDE = 3; // of the usual steps between frames: a wider one is a stretch of which no frame was scored
const LEAST = 0.02; // of s: what is narrower is not told

export const UNSCORED = {
  waiting: "the part has not come into the picture yet",
  ambiguous: "more than one place of the sweep looks like this",
  lost: "no place of the sweep looks like this",
  strange: "the place is known, but the part does not look like this there",
  blind: "no usable picture: lamp out, lens covered, or saturated",
};

export class Sweep {
  constructor(frames = []) {
    this.frames = [];
    this.add(frames);
  }

  /** Frames that follow those that are there; what is known already is left out. Tells whether any was new. */
  add(frames) {
    const fresh = frames.filter((frame) => frame.index >= this.frames.length);
    for (const frame of fresh) this.frames.push(frame);
    if (fresh.length) this.placed = this.sorted = null;
    return fresh.length > 0;
  }

  get length() {
    return this.frames.length;
  }

  /** The place of every frame, by index; of one without a known place, that between its neighbours. */
  get places() {
    this.placed ??= places(this.frames);
    return this.placed;
  }

  /** Indices in the order of their places: a sweep may stand still or go back. */
  get order() {
    this.sorted ??= this.frames.map((_, i) => i).sort((a, b) => this.places[a] - this.places[b] || a - b);
    return this.sorted;
  }

  /** The frame that lies nearest to s; a scored one goes before another as near. -1 where there are none. */
  nearest(s, scoredOnly = false) {
    const { order, places: at } = this;
    let low = 0;
    let high = order.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (at[order[middle]] < s) low = middle + 1;
      else high = middle;
    }
    let best = -1;
    const better = (i) =>
      best < 0 || off(i) < off(best) || (off(i) === off(best) && this.isScored(i) && !this.isScored(best));
    const off = (i) => Math.abs(at[i] - s);
    const look = (k, step) => {
      while (k >= 0 && k < order.length && scoredOnly && !this.isScored(order[k])) k += step;
      if (k >= 0 && k < order.length && better(order[k])) best = order[k];
    };
    look(low, 1);
    look(low - 1, -1);
    return best;
  }

  isScored(index) {
    return this.frames[index]?.state === "scored";
  }

  /** Curves for a chart: x ascending; null where a frame was not scored and where no frame was. */
  columns() {
    const columns = { frame: [], s: [], score: [], appearance: [], position: [], timing: [], unscored: [] };
    const put = (frame, s, said) => {
      columns.frame.push(frame);
      columns.s.push(s);
      columns.score.push(said ? said.score : null);
      for (const name of ["appearance", "position", "timing"]) columns[name].push(said ? said.residuals[name] : null);
      columns.unscored.push(said || frame < 0 ? null : 0);
    };
    const breaks = this.unseen().filter((gap) => gap.start > 0 && gap.end < 1).map((gap) => (gap.start + gap.end) / 2);
    let next = 0;
    for (const index of this.order) {
      while (next < breaks.length && breaks[next] < this.places[index]) put(-1, breaks[next++], null);
      put(index, this.places[index], this.isScored(index) ? this.frames[index] : null);
    }
    return columns;
  }

  /** Stretches without a scored frame: { start, end, states: { lost: 3 } } of the frames that came there. */
  unseen(reached = 1) {
    const scored = this.order.filter((i) => this.isScored(i));
    const at = [0, ...scored.map((i) => this.places[i]), reached];
    const steps = at.slice(1).map((s, i) => s - at[i]).sort((a, b) => a - b);
    const wide = Math.max(LEAST, WIDE * (steps[steps.length >> 1] ?? 0));
    const gaps = [];
    for (let i = 1; i < at.length; i++) {
      if (at[i] - at[i - 1] <= wide && scored.length) continue;
      gaps.push({ start: at[i - 1], end: at[i], states: this.statesBetween(at[i - 1], at[i]) });
    }
    return gaps;
  }

  statesBetween(start, end) {
    const states = {};
    this.frames.forEach((frame, i) => {
      if (frame.state !== "scored" && this.places[i] >= start && this.places[i] <= end)
        states[frame.state] = (states[frame.state] ?? 0) + 1;
    });
    return states;
  }

  /** How many frames are in each state. */
  counts() {
    const counts = {};
    for (const frame of this.frames) counts[frame.state] = (counts[frame.state] ?? 0) + 1;
    return counts;
  }
}

function places(frames) {
  const at = new Float64Array(frames.length);
  let last = -1;
  for (let i = 0; i <= frames.length; i++) {
    const known = i < frames.length && frames[i].s !== null;
    if (!known && i < frames.length) continue;
    const from = last < 0 ? (known ? frames[i].s : 0) : frames[last].s;
    const to = known ? frames[i].s : from;
    for (let k = last + 1; k < i; k++) at[k] = from + ((to - from) * (k - last)) / (i - last);
    if (known) at[i] = frames[i].s;
    last = i;
  }
  return at;
}

/**
 * Where a region of the frame lies on the expected picture: the box around it. `placement` leads from there to the
 * frame, middles of pixels to middles of pixels.
 */
export function onReference(region, placement) {
  const [a, b, c, d, e, f] = placement;
  const by = a * e - b * d;
  const corners = [0, 1, 2, 3].map((k) => {
    const x = region.x + (k & 1) * region.width - 0.5 - c;
    const y = region.y + (k >> 1) * region.height - 0.5 - f;
    return [(e * x - b * y) / by, (a * y - d * x) / by];
  });
  const [us, vs] = [corners.map((p) => p[0]), corners.map((p) => p[1])];
  const [x, y] = [Math.min(...us), Math.min(...vs)];
  return { ...region, x: x + 0.5, y: y + 0.5, width: Math.max(...us) - x, height: Math.max(...vs) - y };
}
