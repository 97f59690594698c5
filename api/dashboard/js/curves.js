// The score and its three residuals along s, with the limit, the deviations and what nobody saw.

import { chart } from "./chart.js";
import { h } from "./dom.js";

const SERIES = [
  { label: "score", key: "score", colour: "--score", width: 2.5 },
  { label: "appearance", key: "appearance", colour: "--appearance", width: 1.25, dash: [3, 3] },
  { label: "position", key: "position", colour: "--position", width: 1.25 },
  { label: "timing", key: "timing", colour: "--timing", width: 1.25, dash: [8, 3] },
  { label: "not scored", key: "unscored", colour: "--other", points: "only" },
];

/** `picked(index)` is told the frame that somebody points at with the button down, or clicks. */
export function curves({ sweep, picked, height = 145 }) {
  const room = h("div", { class: "curves" });
  let columns = sweep.columns();
  let pressed = false;
  const pick = (at) => {
    if (at === null || at === undefined) return;
    const index = columns.frame[at] < 0 ? sweep.nearest(columns.s[at]) : columns.frame[at];
    if (index >= 0) picked(index);
  };
  const plot = chart(room, {
    series: SERIES,
    x: { label: "s, place on the part" },
    height,
    label: "Score and its three residuals along s, with the limit at 1",
    onCursor: (at) => pressed && pick(at),
    onPick: pick,
  });
  const press = (event) => (pressed = event.buttons === 1);
  for (const kind of ["pointerdown", "pointermove", "pointerup", "pointerleave"])
    plot.plot.over.addEventListener(kind, press);

  function set() {
    columns = sweep.columns();
    plot.set(columns.s, ...SERIES.map(({ key }) => columns[key]));
  }

  const shown = SERIES.map((series, number) => {
    const box = h("input", { type: "checkbox", checked: true });
    box.addEventListener("change", () => plot.plot.setSeries(number + 1, { show: box.checked }));
    const swatch = h("span", { class: `swatch${series.dash ? " dashed" : ""}${series.points ? " dots" : ""}` });
    swatch.style.borderColor = `var(${series.colour})`;
    return h("label", { class: "choice" }, box, swatch, series.label);
  });
  set();
  return {
    /** What is shown, to be chosen. */
    series: h("div", { class: "row series", role: "group", "aria-label": "Curves shown" }, shown),
    root: room,
    set,
    /** What is out of tolerance, and the stretches that nobody saw. */
    bands(deviations, unseen) {
      plot.bands([
        ...unseen.map(({ start, end }) => ({ from: start, to: end, colour: "--band-unseen" })),
        ...deviations.map((each) => ({ from: each.s_start, to: each.s_end, colour: "--band-ng" })),
      ]);
    },
    mark: (s) => plot.mark(s),
    close: () => plot.close(),
  };
}
