// The recipe of a product: what was learnt, what nobody cares about, the policy, and every version there was.

import { get, list } from "../api.js";
import { empty, failed, h, moment, replace } from "../dom.js";
import { learningPanel } from "./recipe/learning.js";
import { masksPanel } from "./recipe/masks.js";
import { policyPanel } from "./recipe/policy.js";
import { versionsPanel } from "./recipe/versions.js";

export const title = ({ product }) => `Recipe of ${product}`;

const TABS = [
  { name: "policy", label: "Policy", panel: policyPanel, needs: "appearance" },
  { name: "learning", label: "Golden sweeps", panel: learningPanel },
  { name: "masks", label: "Masks", panel: masksPanel, needs: "appearance" },
  { name: "versions", label: "Versions", panel: versionsPanel },
];
const ROLE_WORDS = { operator: "an operator", engineer: "an engineer", admin: "an admin" };

export async function show(root, params, app) {
  const recipe = await read(params.product, app);
  const place = h("div", { class: "tabpanel", role: "tabpanel", id: "recipe-panel", tabindex: "-1" });
  const news = h("p", { class: "news", role: "status", hidden: true });
  const head = h("div", { class: "recipehead" });
  const first = recipe.appearances.length ? "policy" : "learning";
  let tab = TABS.some((each) => each.name === params.tab) ? params.tab : first;
  let panel = null;
  let closed = false;

  recipe.go = (name) => {
    tab = name;
    app.note(`#/recipe/${encodeURIComponent(params.product)}?tab=${name}`);
    draw();
  };
  recipe.reload = async (said) => {
    const again = await read(params.product, app);
    if (closed) return;
    Object.assign(recipe, { ...again, chosen: recipe.chosen, go: recipe.go, reload: recipe.reload, tell: recipe.tell });
    if (said) recipe.tell(said);
    draw();
  };
  recipe.tell = (said) => {
    news.textContent = said;
    news.hidden = !said;
  };

  function draw() {
    panel?.close?.();
    panel = null;
    replace(head, heading(recipe), tabs());
    const known = TABS.find((each) => each.name === tab);
    place.setAttribute("aria-labelledby", `tab-${tab}`);
    place.dataset.tab = tab;
    try {
      if (known.needs && !recipe.appearances.length) {
        replace(place, empty("Nothing is learnt yet", "Upload a golden sweep, a recording of one good part, and learn from it.", learnBy(params.product)));
        place.firstChild.append(h("button", { type: "button", class: "main", onclick: () => recipe.go("learning") }, "To the golden sweeps"));
        return;
      }
      panel = known.panel(recipe, app);
      replace(place, panel.node);
    } catch (error) {
      console.error(error);
      replace(place, failed(error, draw));
    }
  }

  function tabs() {
    const buttons = TABS.map((each) =>
      h(
        "button",
        {
          type: "button",
          role: "tab",
          id: `tab-${each.name}`,
          "aria-selected": String(each.name === tab),
          "aria-controls": "recipe-panel",
          tabindex: each.name === tab ? "0" : "-1",
          onclick: () => choose(each.name),
        },
        each.label,
      ),
    );
    const turn = (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      const at = TABS.findIndex((each) => each.name === tab);
      choose(TABS[(at + step + TABS.length) % TABS.length].name);
    };
    return h("div", { class: "tabs", role: "tablist", "aria-label": "Parts of the recipe", onkeydown: turn }, buttons);
  }

  function choose(name) {
    recipe.tell("");
    recipe.go(name);
    document.getElementById(`tab-${name}`)?.focus();
  }

  // Sliders that somebody moves must not jump, nor masks be lost: it is told, and shown when it is asked for.
  function offer(said) {
    recipe.tell(`${said} `);
    news.append(h("button", { type: "button", onclick: () => recipe.reload("") }, "Show it"));
  }

  replace(root, head, news, place);
  draw();
  const ends = [
    app.events.on("reload", async () => {
      const again = await read(params.product, app).catch(() => null);
      if (closed || again === null || mark(again) === mark(recipe)) return;
      offer("The recipe has changed meanwhile.");
    }),
    app.events.on("recipe", (event) => {
      if (event.product_id !== params.product || event.recipe_id === recipe.active?.recipe_id) return;
      offer(`Version ${event.version} is active now.`);
    }),
  ];
  return () => {
    closed = true;
    ends.forEach((end) => end());
    panel?.close?.();
  };
}

/** What changes when something was learnt, saved or activated. */
const mark = ({ active, versions, appearances }) => [active?.recipe_id, versions.length, appearances.length].join();

/** Everything that the panels share of a product. */
async function read(product, app) {
  const path = `/v1/products/${encodeURIComponent(product)}`;
  const [known, versions, appearances] = await Promise.all([
    get(path),
    list(`${path}/recipes`, { most: 200 }),
    list(`${path}/appearances`, { most: 200 }),
  ]).catch(isNew);
  const recipe = {
    product,
    path,
    active: known.active_recipe,
    versions,
    appearances,
    /** The appearance that the next version is to have, where somebody chose one. */
    chosen: null,
    /** Why a role may not do something, or null. */
    forbids: (role) => (app.may(role) ? null : `Only ${ROLE_WORDS[role]} may do this; this token has the role ${app.role}.`),
    /** How an appearance is called on the page. */
    named: (id) => named(appearances, id),
    key: () => `dashboard-${Date.now()}-${Math.random().toString(36).slice(2)}`,
  };
  return recipe;
}

/** A product comes into being with its first sweep: until then it has nothing. */
function isNew(problem) {
  if (problem.status !== 404) throw problem;
  return [{ active_recipe: null }, [], []];
}

function named(appearances, id) {
  const known = appearances.find((each) => each.appearance_id === id);
  const short = id.replace(/^sha256:/, "").slice(0, 8);
  if (!known) return short;
  // What was learnt elsewhere does not say from how many.
  const sweeps = Number(known.facts.sweeps) || known.sweep_ids.length;
  return [short, sweeps ? `${sweeps} sweep${sweeps === 1 ? "" : "s"}` : null, moment(known.created_ns)].filter(Boolean).join(", ");
}

function heading(recipe) {
  const { active, product } = recipe;
  const said = active
    ? [h("strong", {}, `version ${active.version}`), ` is active, saved ${moment(active.created_ns)} by ${active.created_by}`, active.note ? `: “${active.note}”` : ""]
    : ["No version is active: parts cannot be inspected yet."];
  return h(
    "div",
    { class: "headline-row" },
    h("h1", {}, product),
    h("p", { class: "note" }, said),
    h("a", { href: "#/recipe?new=1" }, "Other products"),
    h("a", { href: `#/trends/${encodeURIComponent(product)}` }, "Trends"),
    h("a", { href: `#/inspections?product_id=${encodeURIComponent(product)}` }, "Inspections"),
  );
}

const learnBy = (product) =>
  `curl --data-binary @golden.mcap -H 'Content-Type: application/octet-stream' \\\n  ${location.origin}/v1/products/${product}/sweeps`;
