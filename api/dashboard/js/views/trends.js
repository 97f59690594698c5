// Trends of a product: is the reject rate still chance, has the score moved, and since when, what people said, drops.

import { get, url } from "../api.js";
import { empty, failed, h, replace, waiting } from "../dom.js";
import { driftPanel } from "./trends/drift.js";
import { peoplePanel } from "./trends/people.js";
import { rejectPanel } from "./trends/rejects.js";
import { stationPanel } from "./trends/station.js";

export const title = ({ product }) => `Trends of ${product}`;

const COUNTS = [200, 500, 1000, 2000, 5000];
const SECONDS = 20; // between two looks, however many parts come: each reads some thousand results

export async function show(root, params, app) {
  const { product } = params;
  const path = `/v1/products/${encodeURIComponent(product)}/trends`;
  const last = h("select", { id: "trends-last" }, COUNTS.map((n) => h("option", { value: String(n) }, n)));
  last.value = COUNTS.map(String).includes(params.last) ? params.last : "2000";
  const body = h("div", { class: "trendsbody" }, waiting("Reading the trends"));
  const station = stationPanel(app);
  let panels = [];
  let asking = null;
  let closed = false;

  async function read() {
    asking?.abort();
    const mine = (asking = new AbortController());
    try {
      const answer = await get(url(path, { last: last.value }), { signal: mine.signal });
      if (closed) return;
      panels.forEach((each) => each.close());
      panels = [];
      if (!answer.parts) {
        replace(body, nothing(product), station.node);
        return;
      }
      panels = [rejectPanel(answer), driftPanel(answer), peoplePanel(answer, product)];
      replace(body, panels.map((each) => each.node), station.node);
    } catch (problem) {
      if (problem.name === "AbortError" || closed) return;
      replace(body, failed(problem, read));
    }
  }

  let timer = null;
  const soon = () => (timer ??= setTimeout(() => ((timer = null), closed || read()), SECONDS * 1000));
  last.addEventListener("change", () => {
    app.note(`#/trends/${encodeURIComponent(product)}?last=${last.value}`);
    read();
  });
  replace(
    root,
    h(
      "div",
      { class: "headline-row" },
      h("h1", {}, product),
      h("label", { for: "trends-last", class: "note" }, "The last ", last, " inspections"),
      h("a", { href: `#/recipe/${encodeURIComponent(product)}` }, "Recipe"),
      h("a", { href: `#/inspections?product_id=${encodeURIComponent(product)}` }, "Inspections"),
    ),
    body,
  );
  await read();
  const ends = [
    app.events.on("reload", read),
    app.events.on("verdict", (event) => event.product_id === product && soon()),
    app.events.on("disposition", soon),
  ];
  return () => {
    closed = true;
    clearTimeout(timer);
    asking?.abort();
    ends.forEach((end) => end());
    panels.forEach((each) => each.close());
    station.close();
  };
}

const nothing = (product) =>
  empty(
    "No part was inspected yet",
    "Trends begin with the first parts that are inspected live; a replay does not count. Some hundred parts make control limits worth looking at.",
    `inspector push PART.mcap --url ${location.origin} --product ${product} --part SERIAL`,
  );
