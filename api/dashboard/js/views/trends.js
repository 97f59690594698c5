// trends: not built yet.

import { empty, replace } from "../dom.js";

export const title = "Trends";

export async function show(root, params) {
  replace(root, empty("Trends", `This view is being built: ${JSON.stringify(params)}`));
  return () => {};
}
