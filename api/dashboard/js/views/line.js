// The line: every running inspection, every product's last verdict, and the last fifty as a strip.

import { clock, empty, h, replace, settled, standing, VERDICTS, verdict } from "../dom.js";
import { Live } from "../live.js";
import { lane } from "./lane.js";

export const title = "Line";
const STRIP = 50;
const MOST_LANES = 16;

export async function show(root, params, app) {
  const { api, events } = app;
  const away = h("div", { class: "away", role: "status", hidden: true });
  const lanes = h("div", { class: "lanes" });
  const idle = h("div", { class: "idle" });
  const tiles = h("ol", { class: "tiles" });
  const tally = h("p", { class: "note tally" });
  const strip = h(
    "section",
    { class: "panel strip", "aria-label": `The last ${STRIP} verdicts` },
    h("div", { class: "spread" }, h("h2", {}, `Last ${STRIP} verdicts`), tally),
    tiles,
  );
  const page = [away, lanes, idle, strip];

  /** By inspection, the newest last. */
  const lives = new Map();
  /** What is shown, in its order. */
  let shown = [];
  let last = [];
  let products = [];
  let knownAt = Date.now();
  /** While lists are read: what has begun and what has ended since they were asked for. They may not know. */
  const readings = new Set();

  async function read() {
    const since = { begun: new Set(), ended: new Set() };
    readings.add(since);
    const [all, list, processing] = await Promise.all([
      api.list("/v1/products", { most: 200 }),
      api.list("/v1/inspections", { source: "live", most: STRIP + MOST_LANES }),
      api.list("/v1/inspections", { state: "processing", source: "live", most: 200 }),
    ]).finally(() => readings.delete(since));
    products = all;
    const ended = list.filter((each) => each.state !== "processing");
    const known = new Set(ended.map((each) => each.inspection_id));
    const unknown = last.filter(({ inspection_id: id }) => since.ended.has(id) && !known.has(id));
    last = [...unknown, ...ended].slice(0, STRIP);
    const running = processing.filter((each) => !since.ended.has(each.inspection_id));
    const wanted = new Map(running.map((each) => [each.inspection_id, each]));
    for (const product of all) {
      const latest = last.find((each) => each.product_id === product.product_id);
      if (latest && !running.some((each) => each.product_id === product.product_id)) wanted.set(latest.inspection_id, latest);
    }
    for (const id of [...lives.keys()]) if (!wanted.has(id) && !since.begun.has(id) && !since.ended.has(id)) lives.delete(id);
    for (const [id, facts] of wanted) {
      if (lives.has(id)) lives.get(id).know(facts);
      else lives.set(id, new Live(facts));
    }
    knownAt = Date.now();
    arrange();
    tellStrip();
    await Promise.all([...lives.values()].slice(0, MOST_LANES).map(catchUp));
  }

  /** What was said of it before this page listened. */
  async function catchUp(live) {
    try {
      for (let after = -1; live.facts.scores !== "removed"; ) {
        const { items, next } = await api.get(api.url(`/v1/inspections/${live.id}/scores`, { after, limit: 5000 }));
        live.addRecords(items);
        if (items.length < 5000) break;
        after = next;
      }
      if (live.running) {
        live.ask();
        live.recall((await api.get(`/v1/inspections/${live.id}`)).so_far);
      } else if (live.facts.state === "completed") {
        const { deviations, reasons } = await api.get(`/v1/inspections/${live.id}/result?frames=false`);
        live.know({ deviations, reasons });
      }
    } catch (error) {
      if (!(error instanceof api.Problem)) throw error;
    }
    const at = shown.find((each) => each.live === live);
    if (live.running) at?.update();
    else at?.ended();
  }

  /** A lane for each that runs, and for each product the last one that ran. A lane keeps its place. */
  function arrange() {
    const newest = [...lives.values()].reverse();
    const running = newest.filter((each) => each.running);
    const busy = new Set(running.map((each) => each.facts.product_id));
    const rest = newest.filter((each, index) => {
      const { product_id: product } = each.facts;
      return !each.running && !busy.has(product) && newest.findIndex((one) => !one.running && one.facts.product_id === product) === index;
    });
    const wanted = [...running, ...rest].slice(0, MOST_LANES);
    for (const id of [...lives.keys()]) if (!wanted.includes(lives.get(id)) && !lives.get(id).running) lives.delete(id);
    const kept = shown.filter((each) => wanted.includes(each.live));
    const free = shown.filter((each) => !kept.includes(each));
    const fresh = wanted.filter((each) => !kept.some((one) => one.live === each));
    for (const live of fresh) {
      // In the lane of the part before, if that has gone.
      const place = free.findIndex((each) => each.live.facts.product_id === live.facts.product_id);
      const [at] = place >= 0 ? free.splice(place, 1) : [lane(lanes, app)];
      if (place < 0) shown.push(at);
      at.take(live);
    }
    for (const each of free) {
      each.close();
      shown = shown.filter((one) => one !== each);
    }
    lanes.dataset.count = String(shown.length);
    tellIdle();
  }

  function tellIdle() {
    const seen = new Set([...lives.values()].map((each) => each.facts.product_id));
    const others = products.filter((each) => !seen.has(each.product_id));
    lanes.hidden = shown.length === 0;
    if (products.length === 0) {
      replace(
        idle,
        empty(
          "Nothing learnt yet",
          "Show this station one good part: record a golden sweep, upload it, learn, and make a recipe. Or watch a simulated line first:",
          "inspector demo --serve",
        ),
      );
    } else if (shown.length === 0) {
      const ready = others.find((each) => each.active_recipe) ?? others[0];
      const product = ready.product_id;
      replace(
        idle,
        ready.active_recipe
          ? empty(
              "Ready for the first part",
              `${product} is learnt. Let the line begin an inspection, or send a recording as a line would:`,
              `inspector push part-0001.mcap --url ${location.origin} --product ${product} --part 0001`,
            )
          : empty(
              "No recipe yet",
              `${product} has sweeps, and nothing is learnt from them. Learn in its recipe, or with:`,
              `curl -H 'Content-Type: application/json' -d '{"sweep_ids": ["…"]}' \\\n  ${location.origin}/v1/products/${product}/appearances`,
            ),
        h("p", {}, h("a", { class: "button", href: `#/recipe/${encodeURIComponent(product)}` }, `Recipe of ${product}`)),
      );
    } else {
      replace(
        idle,
        others.length
          ? h(
              "p",
              { class: "note row" },
              "Not inspected lately:",
              others
                .slice(0, 20)
                .map(({ product_id: id }) => h("a", { class: "button", href: `#/recipe/${encodeURIComponent(id)}` }, id)),
            )
          : null,
      );
    }
    strip.hidden = last.length === 0;
  }

  function tellStrip() {
    strip.hidden = last.length === 0;
    const counts = new Map();
    for (const each of last) counts.set(standing(each), (counts.get(standing(each)) ?? 0) + 1);
    const order = [...Object.keys(VERDICTS), "aborted", "failed"].filter((each) => counts.has(each));
    replace(tally, order.map((each) => `${counts.get(each)} ${each}`).join(" · "));
    const before = [...tiles.children].indexOf(document.activeElement?.closest?.("li"));
    replace(
      tiles,
      last.map((each, index) => {
        const word = standing(each);
        const said = `${each.product_id} ${each.part_id ?? ""}: ${word}, ${clock(each.ended_ns ?? each.begun_ns)}`;
        const badge = verdict(word, "tile");
        badge.lastChild.textContent = "";
        badge.title = "";
        const href = `#/inspection/${encodeURIComponent(each.inspection_id)}`;
        // One stop of the Tab key for all of them; arrows go from one to the next.
        return h("li", {}, h("a", { href, title: said, "aria-label": said, tabindex: index === 0 ? "0" : "-1" }, badge));
      }),
    );
    if (before >= 0) stand(Math.min(before, last.length - 1));
  }

  function stand(index) {
    for (const [number, item] of [...tiles.children].entries()) item.firstChild.tabIndex = number === index ? 0 : -1;
    tiles.children[index]?.firstChild.focus();
  }

  tiles.addEventListener("keydown", (event) => {
    const at = [...tiles.children].indexOf(event.target.closest("li"));
    const to = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: last.length - 1 }[event.key];
    if (to === undefined || to < 0 || to >= last.length) return;
    event.preventDefault();
    stand(to);
  });

  function ended(facts) {
    for (const since of readings) since.ended.add(facts.inspection_id);
    const live = lives.get(facts.inspection_id);
    last = [{ ended_ns: Date.now() * 1e6, ...live?.facts, ...facts }, ...last].slice(0, STRIP);
    tellStrip();
    if (facts.state === "completed") app.sound.play(facts.verdict);
    if (!live) return;
    live.know(facts);
    shown.find((each) => each.live === live)?.ended();
    arrange();
    // The result has what no event tells.
    catchUp(live);
  }

  const reload = settled(() => read().then(tellAway, tellAway), 100);

  function tellAway() {
    const gone = events.state === "reconnecting";
    root.classList.toggle("stale", gone);
    away.hidden = !gone;
    if (!gone) return;
    const why = events.problem?.detail ?? "the connection broke";
    replace(
      away,
      h("strong", {}, "Reconnecting."),
      h("span", {}, `What is shown was true at ${clock(knownAt * 1e6)}: ${why}`),
      h("button", { type: "button", onclick: () => events.retry() }, "Try now"),
    );
  }

  const of = (fn) => (data) => {
    knownAt = Date.now();
    const live = lives.get(data.inspection_id);
    if (!live) return;
    fn(live, data);
    shown.find((each) => each.live === live)?.update();
  };
  const offs = [
    events.on("begun", (facts) => {
      for (const since of readings) since.begun.add(facts.inspection_id);
      const live = new Live(facts);
      live.whole = true;
      lives.set(facts.inspection_id, live);
      if (!products.some((each) => each.product_id === facts.product_id)) reload();
      arrange();
    }),
    events.on(
      "scores",
      of((live, { frames, dropped, lost }) => {
        live.add(frames);
        live.dropped = Math.max(lost ?? 0, dropped ?? 0, live.dropped);
      }),
    ),
    ...["deviation_opened", "deviation_closed", "early_ng", "early_invalid", "recognised", "part_found"].map((kind) =>
      events.on(
        kind,
        of((live, said) => live.tell({ ...said, kind })),
      ),
    ),
    events.on("picture", (data) => shown.find((each) => each.live.id === data.inspection_id)?.see(data)),
    events.on("interrupted", of((live) => (live.interrupted = true))),
    events.on("verdict", ended),
    events.on("aborted", ended),
    events.on("reload", () => {
      // Something was missed.
      for (const live of lives.values()) live.whole = false;
      reload();
    }),
    events.on("job", settled(reload, 1000)),
    events.on("state", tellAway),
  ];
  // How long nothing came is told, too, where nothing comes.
  const ticking = setInterval(() => shown.forEach((each) => each.live.running && each.update()), 1000);

  events.watch("every");
  const close = () => {
    events.watch(null);
    clearInterval(ticking);
    offs.forEach((off) => off());
    shown.forEach((each) => each.close());
  };
  try {
    await read();
  } catch (error) {
    close();
    throw error;
  }
  replace(root, h("h1", { class: "for-readers" }, "Line"), ...page);
  tellAway();
  return close;
}
