// Small tools that every view builds on: elements, numbers as text, verdicts, states that are not the usual one.

/** An element: h("p", { class: "note", onclick: fn, hidden: true }, "text", node, [nodes], null). No HTML is parsed. */
export function h(tag, props = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(props ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "style") Object.assign(node.style, value);
    else if (name === "dataset") Object.assign(node.dataset, value);
    else if (name in node && typeof value !== "string") node[name] = value;
    else if (name === "value") node.value = value;
    else node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...flat(children));
  return node;
}

export function replace(node, ...children) {
  node.replaceChildren(...flat(children));
  return node;
}

const flat = (children) =>
  children.flat(Infinity).filter((each) => each !== null && each !== undefined && each !== false);

/** Numbers with as many digits, "–" where there is none. */
export const fixed = (value, digits = 2) => (Number.isFinite(value) ? value.toFixed(digits) : "–");
export const percent = (share, digits = 0) => (Number.isFinite(share) ? `${(100 * share).toFixed(digits)} %` : "–");
export const count = (value) => (Number.isFinite(value) ? value.toLocaleString("en").replaceAll(",", "\u202f") : "–");

const two = (value) => String(value).padStart(2, "0");

/** Of nanoseconds since the epoch, here: 14:03:59. */
export function clock(ns) {
  const at = new Date(ns / 1e6);
  return `${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}`;
}

/** 2026-11-22 14:03:59; the day is left out where it is today. */
export function moment(ns) {
  if (!ns) return "–";
  const at = new Date(ns / 1e6);
  const day = `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())}`;
  return at.toDateString() === new Date().toDateString() ? clock(ns) : `${day} ${clock(ns)}`;
}

export const VERDICTS = {
  OK: { mark: "✓", kind: "ok", said: "good" },
  NG: { mark: "✕", kind: "ng", said: "not good" },
  REVIEW: { mark: "?", kind: "review", said: "near the limit: a person should look" },
  INCOMPLETE: { mark: "◐", kind: "incomplete", said: "not all of the part was seen" },
  INVALID: { mark: "!", kind: "invalid", said: "wrong part, or no usable picture" },
};

/** How an inspection stands, for `verdict`: its verdict; or its state, where it runs, was aborted, or failed. */
export const standing = ({ verdict: word, state = "processing" }) => (state === "completed" && word ? word : state);

/** A verdict, or a state: colour, word and shape. `size`: small, usual, huge. */
export function verdict(word, size = "usual") {
  const known = VERDICTS[word] ?? STATES[word] ?? { mark: "·", kind: "none", said: word };
  const mark = h("span", { class: "mark", "aria-hidden": "true" }, known.mark);
  return h("span", { class: `verdict ${known.kind} ${size}`, title: known.said }, mark, known.word ?? word);
}

const STATES = {
  processing: { mark: "▸", kind: "running", word: "running", said: "frames are coming" },
  aborted: { mark: "■", kind: "none", said: "ended without a verdict" },
  failed: { mark: "■", kind: "none", said: "could not be scored to its end" },
};

/** Nothing is there yet: what to do next, with the command that does it. */
export function empty(title, text, command) {
  return h(
    "section",
    { class: "empty" },
    h("h2", {}, title),
    h("p", {}, text),
    command ? h("pre", {}, h("code", {}, command)) : null,
  );
}

/** Something went wrong: what, and a button that tries again. */
export function failed(problem, again) {
  return h(
    "section",
    { class: "failed", role: "alert" },
    h("h2", {}, problem.title ?? "Something went wrong"),
    h("p", {}, problem.detail ?? String(problem.message ?? problem)),
    again ? h("button", { type: "button", class: "main", onclick: again }, "Try again") : null,
  );
}

export const waiting = (text = "Loading") => h("p", { class: "waiting", role: "status" }, `${text} …`);

/** fn at the next frame of the screen, once however often it is asked for. `.cancel()` ends it. */
export function atFrame(fn) {
  let asked = 0;
  const soon = () => {
    asked ||= requestAnimationFrame(() => {
      asked = 0;
      fn();
    });
  };
  soon.cancel = () => {
    cancelAnimationFrame(asked);
    asked = 0;
  };
  return soon;
}

/** fn, `ms` after the last time it was asked for. */
export function settled(fn, ms) {
  let timer;
  return (...args) => {
    clearTimeout(timer);
    timer = setTimeout(() => fn(...args), ms);
  };
}

/** A colour, or any value, of the style sheet by its name: css("--ok"). */
export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
