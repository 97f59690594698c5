// What is left along s of an inspection whose scores of frames are not kept any more: the highest score in each fiftieth.

import { chart } from "./chart.js";
import { fixed, h } from "./dom.js";

/** `deviations` as in its result. `root` has words and a chart; `close()` lets it go. */
export function profile(inspection, deviations) {
  const highest = inspection.profile ?? [];
  const s = highest.map((_, k) => (k + 0.5) / highest.length);
  const room = h("div", { class: "curves" });
  const usual = "Highest score in each fiftieth of the sweep; a gap: no frame was scored there.";
  const readout = h("p", { class: "readout" }, usual);
  const drawn = chart(room, {
    series: [{ label: "highest score", key: "score", colour: "--score", width: 2.5, points: true }],
    x: { label: "s, place on the part" },
    height: 180,
    label: "Highest score in each fiftieth of the sweep, along s, with the limit at 1",
    onCursor: (at) => (readout.textContent = at === null || highest[at] === null ? usual : `s ${fixed(s[at])}: highest score ${fixed(highest[at])}`),
  });
  drawn.set(s, highest);
  drawn.bands(deviations.map((each) => ({ from: each.s_start, to: each.s_end, colour: "--band-ng" })));
  const again = inspection.recording === "kept" ? " Its recording is: a replay scores the frames once more." : "";
  const root = h("div", { class: "column" },
    h("p", { class: "warning", role: "status" },
      `The scores of its frames are not kept any more (the setting `, h("code", {}, "keep_scores_days"), `).${again}`),
    room, readout);
  return { root, close: () => drawn.close() };
}
