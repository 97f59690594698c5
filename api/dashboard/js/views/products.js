// Which product's recipe, or trends: a list to choose from; the only one is gone to at once.

import { empty, h, moment, replace } from "../dom.js";

const WORDS = { recipe: "Recipes", trends: "Trends" };
export const title = ({ of }) => WORDS[of];

export async function show(root, params, app) {
  await draw(root, params, app);
  return app.events.on("reload", () => draw(root, params, app).catch(() => {}));
}

async function draw(root, { of, new: another }, app) {
  const products = await app.api.list("/v1/products");
  if (products.length === 1 && !another) {
    location.replace(`#/${of}/${encodeURIComponent(products[0].product_id)}`);
    return;
  }
  const rows = products.map(({ product_id: id, active_recipe: recipe, created_ns: created }) =>
    h(
      "tr",
      {},
      h("td", {}, h("a", { class: "row-link", href: `#/${of}/${encodeURIComponent(id)}` }, id)),
      h("td", {}, recipe ? `version ${recipe.version}` : "no active version"),
      h("td", { class: "number" }, moment(created)),
    ),
  );
  const head = ["Product", "Recipe", "Since"].map((each) => h("th", { scope: "col", class: each === "Since" ? "number" : null }, each));
  replace(
    root,
    h("h1", {}, WORDS[of]),
    products.length === 0
      ? empty(
          "No product yet",
          "A product comes into being with its first sweep. Record one good part, and upload it:",
          `curl --data-binary @golden-1.mcap -H 'Content-Type: application/octet-stream' \\\n  ${location.origin}/v1/products/plate/sweeps`,
        )
      : h("table", { class: "list" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, rows)),
    of === "recipe" ? newProduct(app) : null,
  );
}

/** A name, and on to the page where its first sweep is uploaded. */
function newProduct(app) {
  const name = h("input", {
    id: "new-product",
    required: true,
    maxlength: "64",
    pattern: "[A-Za-z0-9][A-Za-z0-9._\\-]*",
    title: "Letters, digits, '.', '_', '-'",
    autocomplete: "off",
  });
  const go = (event) => {
    event.preventDefault();
    app.go(`#/recipe/${encodeURIComponent(name.value)}?tab=learning`);
  };
  return h(
    "form",
    { class: "row", onsubmit: go },
    h("label", { for: "new-product" }, "Another product"),
    name,
    h("button", {}, "Upload its first golden sweep"),
  );
}
