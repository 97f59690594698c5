// line: not built yet.

import { empty, replace } from "../dom.js";

export const title = "Line";

export async function show(root, params) {
  replace(root, empty("Line", `This view is being built: ${JSON.stringify(params)}`));
  return () => {};
}
