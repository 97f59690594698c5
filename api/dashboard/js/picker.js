// A dialog that asks for a sweep of a product: an inspection, or a sweep that is kept, which is replayed for it.

import { empty, failed, fixed, h, moment, replace, standing, verdict, waiting } from "./dom.js";

const PAGE = 50;

/**
 * `chosen(inspectionId)`. `recipe`: what sweeps that are kept are replayed by, so that they lie along the same s; null
 * for the active one. `besides`: the inspection that is there already.
 */
export function pick({ app, product, recipe, besides = null, title, chosen }) {
  const { api } = app;
  const body = h("div", { class: "picker-body" }, waiting());
  const tabs = { inspections: "Inspections", sweeps: "Sweeps that are kept" };
  const buttons = Object.entries(tabs).map(([name, text]) => h("button", { type: "button", onclick: () => open(name) }, text));
  const dialog = h("dialog", { class: "picker", "aria-label": title },
    h("div", { class: "spread" }, h("h2", {}, title), h("button", { type: "button", onclick: () => dialog.close() }, "Close")),
    h("div", { class: "row" }, buttons),
    body);
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();

  async function open(name) {
    buttons.forEach((button, number) => button.setAttribute("aria-pressed", String(Object.keys(tabs)[number] === name)));
    replace(body, waiting());
    try {
      await (name === "sweeps" ? sweeps() : inspections());
    } catch (problem) {
      replace(body, failed(problem, () => open(name)));
    }
  }

  function take(inspection) {
    dialog.close();
    chosen(inspection);
  }

  async function inspections() {
    const rows = h("tbody", {});
    const more = h("button", { type: "button" }, "More");
    let after;
    const page = async () => {
      const { items, next } = await api.get(api.url("/v1/inspections", { product_id: product, limit: PAGE, after }));
      const others = items.filter((each) => each.inspection_id !== besides);
      rows.append(...others.map((each) =>
        h("tr", {},
          h("td", {}, verdict(standing(each), "small")),
          h("td", {}, h("button", { type: "button", class: "link", onclick: () => take(each.inspection_id) }, each.part_id ?? "–")),
          h("td", {}, moment(each.begun_ns)),
          h("td", {}, each.source === "replay" ? "replay" : ""))));
      after = next;
      more.hidden = next === null;
      return others.length;
    };
    more.onclick = () => page().catch((problem) => replace(body, failed(problem, () => open("inspections"))));
    const found = await page();
    replace(body, found
      ? [h("table", {}, h("thead", {}, h("tr", {}, ["Verdict", "Part", "Begun", ""].map((each) => h("th", {}, each)))), rows), more]
      : empty("No inspections", `No ${besides ? "other " : ""}part of ${product} was inspected yet.`, `inspector push part.mcap --url ${location.origin} --product ${product} --part 0001`));
  }

  async function sweeps() {
    const path = `/v1/products/${encodeURIComponent(product)}`;
    const [items, appearances] = await Promise.all([api.list(`${path}/sweeps`), api.list(`${path}/appearances`)]);
    const golden = new Set(appearances.flatMap((each) => each.sweep_ids));
    items.sort((a, b) => golden.has(b.sweep_id) - golden.has(a.sweep_id) || b.created_ns - a.created_ns);
    if (!items.length) {
      replace(body, empty("No sweeps", `The service keeps no sweep of ${product}: upload one, golden ones above all.`,
        `curl --data-binary @golden.mcap -H 'Content-Type: application/octet-stream' ${location.origin}${path}/sweeps`));
      return;
    }
    replace(body,
      h("p", { class: "note" }, "A sweep that is kept is inspected once more for this, as a replay."),
      h("table", {},
        h("thead", {}, h("tr", {}, ["Sweep", "Part", "Kept since"].map((each) => h("th", {}, each)), h("th", { class: "number" }, "Frames"), h("th"))),
        h("tbody", {}, items.map((each) =>
          h("tr", {},
            h("td", {}, h("button", { type: "button", class: "link", disabled: !app.may("engineer"), onclick: () => replay(each.sweep_id) }, each.sweep_id.slice(0, 8))),
            h("td", {}, each.part_id ?? "–"),
            h("td", {}, moment(each.created_ns)),
            h("td", { class: "number" }, each.frames),
            h("td", {}, golden.has(each.sweep_id) ? "golden" : ""))))));
  }

  async function replay(sweep) {
    const asked = { sweep_id: sweep, ...(recipe ? { recipe_id: recipe } : {}) };
    const progress = waiting("Replaying");
    replace(body, progress);
    // The same sweep by the same recipe is replayed once a day, however often it is compared.
    const key = `compare ${sweep} ${recipe}`;
    try {
      const { job_id } = await api.post("/v1/replays", asked, { key, headers: { Prefer: "respond-async" } });
      for (;;) {
        const job = await api.get(`/v1/jobs/${job_id}`);
        if (!dialog.open) return;
        if (job.state === "done") return take(job.inspection_id);
        if (job.state !== "running") throw { title: "The replay failed", detail: job.error };
        progress.textContent = `Replaying … ${fixed(100 * job.progress, 0)} %`;
        await new Promise((done) => setTimeout(done, 300));
      }
    } catch (problem) {
      replace(body, failed(problem, () => replay(sweep)));
    }
  }

  open("inspections");
}
