// All inspections, newest first: found by product, verdict, source and part, read page by page as one scrolls.

import { empty, failed, h, moment, percent, replace, settled, standing, verdict } from "../dom.js";
import { table } from "../table.js";

const PAGE = 200;
const ROW = 44; // px, as in the style sheet
const OFTEN_MS = 1000;
const TYPED_MS = 250;
const FILTERS = ["product_id", "verdict", "state", "source", "part"];
const OUTCOMES = ["OK", "NG", "REVIEW", "INCOMPLETE", "INVALID"];
const STATES = { processing: "running", aborted: "aborted", failed: "failed" };
const SOURCES = { "": "Production and replays", live: "Production", replay: "Replays" };

export const title = "Inspections";

/** What was shown last and how far one had scrolled, for who comes back from one of them. */
let left = null;

export async function show(root, params, app) {
  const { api, events } = app;
  const asked = Object.fromEntries(FILTERS.map((name) => [name, params[name] ?? ""]));
  const gone = new AbortController();
  let [items, next, turn] = [[], null, 0];
  let reading = false;
  let broken = null;

  const numbers = table({
    label: "Inspections, newest first",
    columns: columns((i) => items[i]),
    count: () => items.length,
    row: ROW,
    chosen: (i) => app.go(`#/inspection/${items[i].inspection_id}`),
    moved: (i) => numbers.choose(i),
    near: () => more(),
  });
  numbers.root.classList.add("inspection-list");
  const known = h("p", { class: "note known" });
  const place = h("div", { class: "listing" });
  const filters = filterForm(await api.list("/v1/products", { most: 200 }), asked, changed);

  function address() {
    return api.url("#/inspections", asked);
  }

  function changed() {
    app.note(address());
    left = null;
    again();
  }

  const page = (after, limit = PAGE) =>
    api.get(api.url("/v1/inspections", { ...asked, limit, after }), { signal: gone.signal });

  /** From the newest on, for what is asked now. */
  async function again() {
    const mine = ++turn;
    try {
      const first = await page();
      if (mine !== turn) return;
      [items, next, broken] = [first.items, first.next, null];
      numbers.root.scrollTop = 0;
      draw();
    } catch (problem) {
      if (problem.name !== "AbortError" && mine === turn) replace(place, failed(problem, again));
    }
  }

  /** The older ones that follow. */
  async function more() {
    if (reading || broken || next === null) return;
    const mine = turn;
    reading = true;
    try {
      const older = await page(next);
      if (mine === turn) [items, next] = [[...items, ...older.items], older.next];
    } catch (problem) {
      if (problem.name !== "AbortError") broken = problem;
    }
    reading = false;
    draw();
  }

  /** What is new, or another than it was, among the newest; what is in sight stays where it is. */
  async function fresh() {
    const mine = turn;
    const first = await page().catch(() => null);
    if (first === null || mine !== turn || gone.signal.aborted) return;
    const oldest = first.items.at(-1)?.number ?? Infinity;
    const rest = first.next === null ? [] : items.filter((each) => each.number < oldest);
    if (!rest.length) next = first.next;
    const before = items[Math.floor(numbers.root.scrollTop / ROW)];
    items = [...first.items, ...rest];
    draw();
    const moved = items.findIndex((each) => each.number <= before?.number) - Math.floor(numbers.root.scrollTop / ROW);
    if (numbers.root.scrollTop > 0 && moved) numbers.root.scrollTop += moved * ROW;
  }

  let waits = null;
  /** However much happens, once a second. */
  function soon() {
    waits ??= setTimeout(() => {
      waits = null;
      fresh();
    }, OFTEN_MS);
  }

  function draw() {
    const some = FILTERS.some((name) => asked[name]);
    replace(known,
      next === null ? `${items.length} in all` : `The newest ${items.length}; older ones come as you scroll`,
      broken ? [`. ${broken.detail ?? broken} `, h("button", { type: "button", onclick: () => ((broken = null), more()) }, "Try again")] : null);
    known.hidden = !items.length;
    if (items.length) {
      if (numbers.root.parentNode !== place) replace(place, numbers.root);
      numbers.refresh();
    } else if (some) {
      const none = empty("None is like that", "No inspection has all of what is asked for above.");
      none.append(h("button", { type: "button", class: "main", onclick: () => app.go("#/inspections") }, "Show all"));
      replace(place, none);
    } else {
      replace(place, empty("Nothing was inspected yet", "Let the line begin an inspection, or send a recording as a line would:",
        `inspector push part-0001.mcap --url ${location.origin} --product plate --part 0001`));
    }
  }

  replace(root, h("div", { class: "spread" }, h("h1", {}, "Inspections"), known), filters, place);
  if (left?.address === address()) {
    ({ items, next } = left);
    draw();
    numbers.choose(left.current);
    numbers.root.scrollTop = left.top;
    fresh();
  } else {
    await again();
  }
  const off = [
    ...["begun", "verdict", "aborted"].map((kind) => events.on(kind, soon)),
    // That may be an old one, which no first page tells.
    events.on("disposition", ({ inspection_id: id, disposition }) => {
      items = items.map((each) => (each.inspection_id === id ? { ...each, disposition } : each));
      numbers.refresh();
    }),
    events.on("reload", fresh),
  ];
  return () => {
    gone.abort();
    clearTimeout(waits);
    for (const each of off) each();
    left = items.length ? { address: address(), items, next, top: numbers.root.scrollTop, current: numbers.current() } : null;
  };
}

function columns(at) {
  const text = (title, of, number = false) => ({ title, number, text: (i) => of(at(i)) });
  return [
    text("Verdict", (each) => verdict(standing(each), "small")),
    text("Part", (each) =>
      h("a", { class: "row-link", tabindex: "-1", href: `#/inspection/${each.inspection_id}` }, each.part_id ?? "–")),
    text("Product", (each) => each.product_id),
    text("Begun", (each) => moment(each.begun_ns), true),
    text("Coverage", (each) => percent(each.coverage ?? NaN, 1), true),
    text("Frames", (each) => each.frames_scored ?? "–", true),
    text("Person", (each) => person(each.disposition)),
    text("", (each) => [each.source === "replay" ? "replay" : null, each.reason].filter(Boolean).join(": ")),
  ];
}

function person(said) {
  if (!said) return "–";
  return said.decision === "confirm" ? "✓ confirmed" : `✎ says ${said.verdict}`;
}

/** What is asked for; `changed()` after `asked` has become another. */
function filterForm(products, asked, changed) {
  const select = (id, label, options, value, take) => {
    const node = h("select", { id }, Object.entries(options).map(([name, said]) => h("option", { value: name }, said)));
    // An address may ask for what the list does not have.
    if (value && !(value in options)) node.append(h("option", { value }, value));
    node.value = value;
    node.addEventListener("change", () => {
      take(node.value);
      changed();
    });
    return h("div", { class: "filter" }, h("label", { for: id }, label), node);
  };
  const names = products.map((each) => [each.product_id, each.product_id]);
  const stood = { "": "Any", ...Object.fromEntries(OUTCOMES.map((word) => [word, word])), ...STATES };
  const part = h("input", { id: "filter-part", type: "search", maxlength: "128", placeholder: "begins with", value: asked.part });
  const typed = settled(() => {
    if (asked.part === part.value.trim() || !part.isConnected) return;
    asked.part = part.value.trim();
    changed();
  }, TYPED_MS);
  part.addEventListener("input", typed);
  return h("form", { class: "filters", "aria-label": "Which", onsubmit: (event) => event.preventDefault() },
    select("filter-product", "Product", { "": "All", ...Object.fromEntries(names) }, asked.product_id, (to) => (asked.product_id = to)),
    select("filter-verdict", "Verdict", stood, asked.verdict || asked.state, (to) => {
      asked.state = to in STATES ? to : "";
      asked.verdict = to in STATES ? "" : to;
    }),
    select("filter-source", "From", SOURCES, asked.source, (to) => (asked.source = to)),
    h("div", { class: "filter" }, h("label", { for: "filter-part" }, "Part"), part));
}
