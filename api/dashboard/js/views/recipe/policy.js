// The policy with sliders: every move judges the last parts again, and a good one is saved as a new version.

import { post } from "../../api.js";
import { empty, failed, h, replace, settled, waiting } from "../../dom.js";
import { FIELDS, STEPS, differences, fromShown, fromSlider, same, toShown, toSlider, unit, usual, wrong } from "./fields.js";
import { rejudgedPanel } from "./rejudged.js";

const SETTLE_MS = 200;
const FIRST = 2; // fields that are always shown: what sets the limits
const COUNTS = [20, 50, 100, 200, 500, 1000];

let openBefore = false;

/** The panel of a product that has an appearance. `recipe` is the view's state; returns {node, close}. */
export function policyPanel(recipe) {
  const active = recipe.active?.policy ?? usual();
  const draft = { ...active };
  const why = recipe.forbids("engineer");
  const said = h("div", { class: "rejudged", "aria-live": "polite", "aria-busy": "false" });
  const last = h("select", { id: "rejudge-last", disabled: Boolean(why) }, COUNTS.map((n) => h("option", { value: String(n) }, n)));
  last.value = "100";
  const rows = FIELDS.map((field) => fieldRow(field, draft, active, Boolean(why), moved));
  const save = savePart(recipe, draft, why);
  let asking = null;

  const ask = settled(async () => {
    asking?.abort();
    const mine = (asking = new AbortController());
    said.setAttribute("aria-busy", "true");
    try {
      const body = { policy: draft, last: Number(last.value) };
      const path = `/v1/products/${encodeURIComponent(recipe.product)}/rejudge`;
      const answer = await post(path, body, { signal: mine.signal });
      replace(said, rejudgedPanel(answer, same(draft, active), recipe.active));
    } catch (problem) {
      if (problem.name === "AbortError") return;
      replace(said, failed(problem, ask));
    }
    if (asking === mine) said.setAttribute("aria-busy", "false");
  }, SETTLE_MS);

  function moved() {
    const bad = rows.some((row) => !row.valid());
    save.changed(bad);
    if (!bad && !why) ask();
  }

  function set(policy) {
    Object.assign(draft, policy);
    rows.forEach((row) => row.show());
    moved();
  }

  last.addEventListener("change", moved);
  replace(
    said,
    why
      ? empty("Judging again", `Here it would say how many verdicts of the last parts change. ${why}`)
      : waiting("Judging the last parts again"),
  );
  const reset = (text, policy) =>
    h("button", { type: "button", disabled: Boolean(why), title: why ?? "", onclick: () => set(policy) }, text);
  const sliders = h(
    "section",
    { class: "panel sliders", "aria-labelledby": "sliders-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "sliders-title" }, "Policy"), reset("As active", active), reset("As usual", usual())),
    why ? h("p", { class: "why" }, why) : null,
    rows.slice(0, FIRST).map((row) => row.node),
    h("details", { open: openBefore, ontoggle: (event) => (openBefore = event.currentTarget.open) }, h("summary", {}, "Review margin, hysteresis, coverage, invalid share"), rows.slice(FIRST).map((row) => row.node)),
    save.node,
  );
  const outcome = h(
    "section",
    { class: "panel", "aria-labelledby": "rejudge-title" },
    h(
      "div",
      { class: "panelhead" },
      h("h2", { id: "rejudge-title" }, "What it would have said"),
      h("label", { for: "rejudge-last" }, "of the last ", last, " parts"),
    ),
    said,
  );
  moved();
  return { node: h("div", { class: "sides policy" }, sliders, outcome), close: () => asking?.abort() };
}

/** Label, slider, number, and what it was; all three show the same value. */
function fieldRow(field, draft, active, disabled, moved) {
  const id = `policy-${field.name}`;
  const slider = h("input", {
    type: "range",
    id,
    min: "0",
    max: String(STEPS),
    step: "1",
    disabled,
    "aria-describedby": `${id}-said`,
  });
  const number = h("input", { type: "number", step: "any", disabled, "aria-label": `${field.label} in ${field.percent ? "percent" : "times"}` });
  const error = h("p", { class: "wrong", role: "alert", hidden: true });
  const was = h("span", { class: "was" });
  const node = h(
    "div",
    { class: "field" },
    h("label", { for: id }, field.label),
    slider,
    h("span", { class: "amount" }, number, unit(field)),
    h("p", { class: "note below" }, h("span", { id: `${id}-said` }, field.said), was),
    error,
  );

  function tell() {
    const problem = wrong(field, draft[field.name]);
    error.hidden = !problem;
    error.textContent = problem ?? "";
    number.setAttribute("aria-invalid", String(Boolean(problem)));
    slider.setAttribute("aria-valuetext", `${number.value} ${unit(field)}`);
    const changed = draft[field.name] !== active[field.name];
    node.classList.toggle("changed", changed);
    was.textContent = changed ? `was ${toShown(field, active[field.name])} ${unit(field)}` : "";
  }

  slider.addEventListener("input", () => {
    draft[field.name] = fromSlider(field, Number(slider.value));
    number.value = toShown(field, draft[field.name]);
    tell();
    moved();
  });
  number.addEventListener("input", () => {
    draft[field.name] = number.value === "" ? NaN : fromShown(field, Number(number.value));
    if (!wrong(field, draft[field.name])) slider.value = toSlider(field, draft[field.name]);
    tell();
    moved();
  });
  const show = () => {
    slider.value = toSlider(field, draft[field.name]);
    number.value = toShown(field, draft[field.name]);
    tell();
  };
  show();
  return { node, show, valid: () => !wrong(field, draft[field.name]) };
}

/** A new version with a note. What was learnt may be exchanged by it, too. */
function savePart(recipe, draft, why) {
  const note = h("input", { id: "recipe-note", maxlength: "500", disabled: Boolean(why), placeholder: "Why, for who reads it later" });
  const appearance = h(
    "select",
    { id: "recipe-appearance", disabled: Boolean(why) },
    recipe.appearances.map((each) =>
      h("option", { value: each.appearance_id }, `${recipe.named(each.appearance_id)}${each.appearance_id === recipe.active?.appearance_id ? " (active)" : ""}`),
    ),
  );
  appearance.value = recipe.chosen ?? recipe.active?.appearance_id ?? recipe.appearances[0].appearance_id;
  const what = h("p", { class: "note", role: "status" });
  const next = Math.max(0, ...recipe.versions.map((each) => each.version)) + 1;
  const button = (text, main, activate) =>
    h("button", { type: "button", class: main ? "main" : null, onclick: (event) => save(event.currentTarget, activate) }, text);
  const buttons = [button(`Save version ${next} and inspect by it`, true, true), button("Save only", false, false)];
  const node = h(
    "form",
    { class: "save", onsubmit: (event) => event.preventDefault() },
    h("label", { for: "recipe-appearance" }, "Appearance"),
    appearance,
    h("label", { for: "recipe-note" }, "Note"),
    note,
    what,
    h("div", { class: "buttons" }, buttons),
  );
  let bad = false;

  function changed(isBad = bad) {
    bad = isBad;
    const other = appearance.value !== recipe.active?.appearance_id;
    const differs = bad ? [] : differences(recipe.active?.policy, draft);
    if (other && recipe.active) differs.unshift(`Appearance ${recipe.named(recipe.active.appearance_id)} → ${recipe.named(appearance.value)}`);
    const nothing = recipe.active && !differs.length;
    const refusal = why ?? (bad ? "A value above is not allowed." : nothing ? "Nothing differs from the active version." : null);
    buttons.forEach((each) => {
      each.disabled = Boolean(refusal);
      each.title = refusal ?? "";
    });
    what.textContent = refusal ?? (recipe.active ? `Changes: ${differs.join("; ")}.` : "The first version.");
  }

  async function save(pressed, activate) {
    pressed.disabled = true;
    try {
      const body = { appearance_id: appearance.value, policy: draft, activate, note: note.value };
      const made = await post(`/v1/products/${encodeURIComponent(recipe.product)}/recipes`, body, { key: recipe.key() });
      recipe.chosen = null;
      await recipe.reload(`Version ${made.version} is saved${activate ? ": parts are inspected by it from now on" : ""}.`);
    } catch (problem) {
      what.textContent = problem.detail ?? String(problem);
      what.classList.add("wrong");
      pressed.disabled = false;
    }
  }

  appearance.addEventListener("change", () => changed());
  return { node, changed };
}
