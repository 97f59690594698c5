// recipe: not built yet.

import { empty, replace } from "../dom.js";

export const title = "Recipe";

export async function show(root, params) {
  replace(root, empty("Recipe", `This view is being built: ${JSON.stringify(params)}`));
  return () => {};
}
