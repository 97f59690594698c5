// Every version of a recipe, and the trail: who changed what, when, and what was before.

import { get, post, url } from "../../api.js";
import { failed, empty, h, moment, replace, waiting } from "../../dom.js";
import { differences } from "./fields.js";

const PAGE = 200;
const PAGES = 5;

export function versionsPanel(recipe) {
  const trail = h("div", { class: "scroll" }, waiting("Reading the audit trail"));
  let closed = false;
  const read = (pages = PAGES) =>
    entries(recipe.product, pages)
      .then(({ found, more }) => !closed && replace(trail, trailTable(found, recipe), more ? h("button", { type: "button", onclick: () => read(pages + PAGES) }, "Look further back") : null))
      .catch((problem) => !closed && replace(trail, failed(problem, () => read(pages))));
  read();
  const versions = h(
    "section",
    { class: "panel", "aria-labelledby": "versions-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "versions-title" }, "Versions")),
    h("p", { class: "note" }, "A version never changes. An older one can be made active again; inspections that run end as they began."),
    recipe.versions.length
      ? versionTable(recipe)
      : empty("No version yet", "Learn from a golden sweep, then save the first version on the page Policy."),
  );
  const audit = h(
    "section",
    { class: "panel", "aria-labelledby": "trail-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "trail-title" }, "Audit trail")),
    trail,
  );
  return {
    node: h("div", { class: "sides versions" }, versions, audit),
    close: () => (closed = true),
  };
}

function versionTable(recipe) {
  const why = recipe.forbids("engineer");
  const row = (version) => {
    const button = h(
      "button",
      {
        type: "button",
        disabled: Boolean(why),
        title: why ?? "",
        "aria-label": `Activate version ${version.version}`,
        onclick: async () => {
          button.disabled = true;
          try {
            await post(`${recipe.path}/recipes/${version.recipe_id}/activate`);
            await recipe.reload(`Version ${version.version} is active: parts are inspected by it from now on.`);
          } catch (problem) {
            recipe.tell(problem.detail ?? String(problem));
            button.disabled = false;
          }
        },
      },
      "Activate",
    );
    return h(
      "tr",
      { class: version.active ? "active" : null },
      h("td", { class: "number" }, version.version),
      h("td", {}, h("span", { class: "time" }, moment(version.created_ns)), h("p", { class: "note" }, version.created_by)),
      h("td", {}, version.note || "–", h("p", { class: "note" }, recipe.named(version.appearance_id))),
      h("td", {}, version.active ? h("strong", { class: "isactive" }, "● active") : button),
    );
  };
  const head = ["Version", "Saved", "Note, appearance", ""].map((text, i) => h("th", { scope: "col", class: i === 0 ? "number" : null }, text));
  return [
    why ? h("p", { class: "why" }, why) : null,
    h("div", { class: "scroll" }, h("table", { class: "rows" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, recipe.versions.map(row)))),
  ];
}

function trailTable(found, recipe) {
  if (!found.length) return h("p", { class: "note" }, "Nothing of this recipe is in the part of the trail that was read.");
  const row = (entry) => {
    const added = entry.action === "recipe.add";
    const did = added ? `saved version ${entry.after.version}` : `activated version ${entry.after.version}`;
    const over = entry.before ? ` in place of ${entry.before.version}` : "";
    return h(
      "tr",
      {},
      h("td", { class: "time" }, moment(entry.t_ns), h("p", { class: "note" }, entry.actor)),
      h("td", {}, did, entry.after.active ? over : ", not active"),
      h("td", {}, changes(entry, recipe).map((each) => h("p", {}, each))),
    );
  };
  const head = ["When, who", "What", "Before → after"].map((text) => h("th", { scope: "col" }, text));
  return h("table", { class: "rows trail" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, found.map(row)));
}

function changes({ before, after }, recipe) {
  if (!before) return ["the first active version"];
  const said = differences(before.policy, after.policy);
  if (before.appearance_id !== after.appearance_id)
    said.unshift(`Appearance ${recipe.named(before.appearance_id)} → ${recipe.named(after.appearance_id)}`);
  return said.length ? said : ["nothing but the version"];
}

/** What the trail says of a product's recipe, newest first, in so many pages of it at the most. */
async function entries(product, pages) {
  const found = [];
  let after;
  for (let page = 0; page < pages; page++) {
    const read = await get(url("/v1/audit", { limit: PAGE, after }));
    found.push(...read.items.filter((each) => each.action.startsWith("recipe.") && each.after?.product_id === product));
    after = read.next;
    if (after === null) return { found, more: false };
  }
  return { found, more: true };
}
