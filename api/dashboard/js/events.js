// What happens in the service, as it happens: server-sent events by fetch, since EventSource cannot show a token.

import { ask } from "./api.js";

const QUIET_MS = 45_000; // the service says something every 15 s
const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 4_000;
const HIDDEN_MS = 60_000;

/** Why a connection is ended that only asks for something else. */
const TURN = "turn";

const listeners = new Map();
let lastId = null;
let stop = null;
let wait = FIRST_WAIT_MS;
let watched = null;

export const events = {
  /** connecting, live, reconnecting */
  state: "connecting",
  /** The problem because of which it is not live, or null. */
  problem: null,
  /** The data of the last `station` event. */
  station: {},
  /** fn(data, kind) for each event of that kind; `reload`: read every list again; `state`: `events.state` changed;
   * `*`: all. Returns what ends it. */
  on(kind, fn) {
    if (!listeners.has(kind)) listeners.set(kind, new Set());
    listeners.get(kind).add(fn);
    return () => listeners.get(kind).delete(fn);
  },
  start() {
    document.addEventListener("visibilitychange", watchHidden);
    follow();
  },
  /** `picture` events of `every` running inspection, of the one with that id, or of none (null). */
  watch(pictures) {
    if (pictures === watched) return;
    watched = pictures;
    stop?.abort(TURN);
  },
  /** At once, not after the wait. */
  retry() {
    wait = FIRST_WAIT_MS;
    stop?.abort();
  },
};

function tell(kind, data) {
  for (const name of [kind, "*"])
    for (const fn of [...(listeners.get(name) ?? [])]) {
      try {
        fn(data, kind);
      } catch (error) {
        console.error(error);
      }
    }
}

function become(state, problem = null) {
  if (state === events.state && problem?.detail === events.problem?.detail) return;
  Object.assign(events, { state, problem });
  tell("state", state);
}

let first = true;

async function follow() {
  for (;;) {
    if (hidden) await hidden;
    stop = new AbortController();
    try {
      await listen(stop.signal);
      become("reconnecting");
    } catch (error) {
      // It goes on at once, where it broke off.
      if (stop.signal.reason === TURN) continue;
      become("reconnecting", error.name === "AbortError" ? null : error);
    }
    if (hidden) continue;
    await pause(wait);
    wait = Math.min(wait * 2, LONGEST_WAIT_MS);
  }
}

function pause(ms) {
  stop = new AbortController();
  const { signal } = stop;
  return new Promise((done) => {
    signal.addEventListener("abort", done, { once: true });
    setTimeout(done, ms);
  });
}

async function listen(signal) {
  const from = lastId;
  const asked = watched === null ? "/v1/events" : `/v1/events?pictures=${encodeURIComponent(watched)}`;
  const response = await ask(asked, { signal, headers: from === null ? {} : { "Last-Event-ID": from } });
  wait = FIRST_WAIT_MS;
  become("live");
  // Without an id to go on from, what happened meanwhile is not told again.
  if (!first && from === null) tell("reload", {});
  first = false;
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const quiet = setTimeout(() => reader.cancel().catch(() => {}), QUIET_MS);
    const { done, value } = await reader.read().finally(() => clearTimeout(quiet));
    if (done) return;
    const blocks = (text + value).split("\n\n");
    text = blocks.pop();
    blocks.forEach(take);
  }
}

function take(block) {
  let kind = "message";
  const data = [];
  for (const line of block.split("\n")) {
    const colon = line.indexOf(":");
    const name = line.slice(0, colon);
    const value = line.slice(colon + 1).replace(/^ /, "");
    if (name === "event") kind = value;
    else if (name === "data") data.push(value);
    else if (name === "id") lastId = value;
  }
  if (data.length === 0) return;
  const facts = JSON.parse(data.join("\n"));
  if (kind === "station") events.station = { ...events.station, ...facts };
  tell(kind, facts);
  if (kind === "missed") tell("reload", facts);
}

// A tab that nobody sees lets go: a browser has six connections to a host, and the service 64 listeners in all.
let hidden = null;
let hiding = null;

function watchHidden() {
  clearTimeout(hiding);
  if (document.visibilityState === "hidden") {
    hiding = setTimeout(() => {
      hidden = new Promise((shown) => (release = shown));
      stop?.abort();
    }, HIDDEN_MS);
  } else if (hidden) {
    hidden = null;
    release();
  }
}
let release = () => {};
