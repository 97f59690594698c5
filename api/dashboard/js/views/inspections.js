// inspections: not built yet.

import { empty, replace } from "../dom.js";

export const title = "Inspections";

export async function show(root, params) {
  replace(root, empty("Inspections", `This view is being built: ${JSON.stringify(params)}`));
  return () => {};
}
