// compare: not built yet.

import { empty, replace } from "../dom.js";

export const title = "Compare";

export async function show(root, params) {
  replace(root, empty("Compare", `This view is being built: ${JSON.stringify(params)}`));
  return () => {};
}
