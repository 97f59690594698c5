// What the service has of frames of ended inspections, pictures above all: asked for once, as long as it is remembered.

import { blob, get } from "./api.js";

const KEPT = 150; // pictures as they came, some hundred kilobytes each

export class Shelf {
  #known = new Map();

  /** The picture as a Blob. kind: frame, expected, seen, difference. Throws Problem. */
  picture(inspection, index, kind) {
    return this.#once(`${path(inspection, index)}/pictures/${kind}`, blob);
  }

  /** What was said of the frame, with the `placement` that leads from the expected picture to it. Throws Problem. */
  frame(inspection, index) {
    return this.#once(path(inspection, index), get);
  }

  #once(address, ask) {
    const promise = this.#known.get(address) ?? ask(address);
    promise.catch(() => this.#known.delete(address));
    // Again the newest: what was not wanted for longest is forgotten first.
    this.#known.delete(address);
    this.#known.set(address, promise);
    if (this.#known.size > KEPT) this.#known.delete(this.#known.keys().next().value);
    return promise;
  }
}

const path = (inspection, index) => `/v1/inspections/${inspection}/frames/${index}`;

/** `work(what)` for what was asked for last: while one is in work, only the latest of those that come meanwhile waits. */
export function latest(work) {
  let busy = false;
  let wanted = null;
  return async function ask(what) {
    wanted = { what };
    if (busy) return;
    busy = true;
    try {
      while (wanted) {
        const { what: now } = wanted;
        wanted = null;
        await work(now);
      }
    } finally {
      busy = false;
    }
  };
}
