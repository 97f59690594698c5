// inspection: not built yet.

import { empty, replace } from "../dom.js";

export const title = "Inspection";

export async function show(root, params) {
  replace(root, empty("Inspection", `This view is being built: ${JSON.stringify(params)}`));
  return () => {};
}
