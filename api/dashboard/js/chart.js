// Curves along the sweep: uPlot with the limit, bands for deviations, a cursor, and the colours of the theme.

import uPlot from "../vendor/uplot/uPlot.esm.js";
import { atFrame, css, fixed } from "./dom.js";

const FONT = "12px system-ui, sans-serif";

/**
 * A chart in `root`, as wide as it is.
 *
 * series     [{ label, colour: "--score", width, dash: [4, 3], points: true, fill: "--fill", digits }]; colours are names of the
 *            style sheet
 * x          { label, min, max, digits, values: (splits) => [text], time }: usual is s from 0 to 1
 * y          { label, min, max, floor }: usual is from 0 to what is there, and at least `floor` (1.25), so that the limit is seen
 * limit      a horizontal line, usual 1; null for none
 * height     of the whole, px, or a function that tells it
 * onCursor   (index, x) where the pointer is, index into the data as given; (null, null) where it left
 * onPick     (index, x) where it is clicked, or entered by keyboard
 * label      what it shows, for who cannot see it
 *
 * Returns { set(xs, ...ys), bands([{ from, to, colour: "--band-ng", label }]), mark(x), close(), plot }.
 * xs need no order; null in ys is a gap. `set` may be called as often as one likes: it is drawn once a frame.
 */
export function chart(root, options) {
  const { series, x = {}, y = {}, limit = 1, height = 220, onCursor, onPick, label = "Chart" } = options;
  let order = null;
  let bands = [];
  let marked = null;
  let data = [[], ...series.map(() => [])];

  const tall = () => (typeof height === "function" ? height() : height);
  const at = (index) => (index === null || index === undefined ? null : order ? order[index] : index);
  const grid = { stroke: () => css("--grid"), width: 1 };
  const axis = { stroke: () => css("--ink-2"), font: FONT, grid, ticks: grid, labelFont: FONT, labelSize: 18 };
  const plot = new uPlot(
    {
      width: Math.max(root.clientWidth, 80),
      height: tall(),
      legend: { show: false },
      cursor: { y: false, points: { size: 8 }, drag: { x: false, y: false } },
      padding: [10, 14, 0, 0],
      scales: {
        x: { time: Boolean(x.time), range: x.time ? undefined : (u, low, high) => [x.min ?? 0, x.max ?? 1] },
        y: {
          range: (u, low, high) => [
            y.min ?? Math.min(0, low ?? 0),
            y.max ?? Math.max((high ?? 0) * 1.08, y.floor ?? (limit === null ? 0.01 : limit * 1.25)),
          ],
        },
      },
      axes: [
        { ...axis, label: x.label ?? "s", size: 34, ...(x.values ? { values: (u, splits) => x.values(splits) } : {}) },
        { ...axis, label: y.label, size: 48 },
      ],
      series: [
        {},
        ...series.map((each) => ({
          label: each.label,
          stroke: () => css(each.colour),
          width: each.width ?? 1.75,
          dash: each.dash,
          fill: each.fill ? () => css(each.fill) : undefined,
          // A single point is no line.
          points: { show: (u) => Boolean(each.points) || u.data[0].length < 3, size: 6, fill: () => css(each.colour) },
          paths: each.points === "only" ? () => null : undefined,
          spanGaps: false,
        })),
      ],
      hooks: {
        drawClear: [drawBands],
        draw: [drawLimit, drawMark],
        setCursor: [
          (u) => {
            const index = at(u.cursor.idx);
            onCursor?.(index, index === null ? null : u.data[0][u.cursor.idx]);
          },
        ],
      },
    },
    data,
    root,
  );
  plot.root.setAttribute("role", "img");
  plot.root.setAttribute("aria-label", label);

  function across(u, value) {
    return Math.round(u.valToPos(value, "x", true));
  }

  function drawBands(u) {
    const { left, top, width, height: deep } = u.bbox;
    u.ctx.save();
    u.ctx.beginPath();
    u.ctx.rect(left, top, width, deep);
    u.ctx.clip();
    for (const band of bands) {
      u.ctx.fillStyle = css(band.colour ?? "--band-ng");
      const from = across(u, band.from);
      u.ctx.fillRect(from, top, Math.max(across(u, band.to) - from, 2 * devicePixelRatio), deep);
    }
    u.ctx.restore();
  }

  function line(u, colour, dash, width, from, to) {
    u.ctx.save();
    u.ctx.strokeStyle = css(colour);
    u.ctx.lineWidth = width * devicePixelRatio;
    u.ctx.setLineDash(dash.map((each) => each * devicePixelRatio));
    u.ctx.beginPath();
    u.ctx.moveTo(...from);
    u.ctx.lineTo(...to);
    u.ctx.stroke();
    u.ctx.restore();
  }

  function drawLimit(u) {
    if (limit === null) return;
    const down = Math.round(u.valToPos(limit, "y", true));
    const { left, width } = u.bbox;
    line(u, "--limit", [6, 4], 1.5, [left, down], [left + width, down]);
    u.ctx.save();
    u.ctx.fillStyle = css("--limit");
    u.ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    u.ctx.textAlign = "right";
    u.ctx.textBaseline = "bottom";
    u.ctx.fillText(options.limitLabel ?? "limit", left + width - 6 * devicePixelRatio, down - 2 * devicePixelRatio);
    u.ctx.restore();
  }

  function drawMark(u) {
    if (marked === null) return;
    const where = across(u, marked);
    line(u, "--ink", [], 1.5, [where, u.bbox.top], [where, u.bbox.top + u.bbox.height]);
  }

  const show = atFrame(() => plot.setData(data));
  const again = atFrame(() => plot.redraw(false));
  const fit = atFrame(() => plot.setSize({ width: Math.max(root.clientWidth, 80), height: tall() }));
  const watch = new ResizeObserver(fit);
  watch.observe(root);
  document.addEventListener("theme", again);
  plot.over.addEventListener("click", () => {
    const index = at(plot.cursor.idx);
    if (index !== null) onPick?.(index, plot.data[0][plot.cursor.idx]);
  });
  plot.over.addEventListener("mouseleave", () => onCursor?.(null, null));

  return {
    plot,
    set(xs, ...ys) {
      order = rising(xs) ? null : [...xs.keys()].filter((each) => xs[each] !== null).sort((a, b) => xs[a] - xs[b]);
      const put = (values) => (order ? order.map((each) => values[each]) : values);
      data = [put(xs), ...ys.map(put)];
      show();
    },
    bands(those) {
      bands = those;
      again();
    },
    mark(where) {
      marked = where;
      again();
    },
    /** What the data say at an index, as a line of text. */
    say: (index) =>
      series.map((each, number) => `${each.label} ${fixed(data[number + 1][index], each.digits ?? 2)}`).join(", "),
    close() {
      watch.disconnect();
      document.removeEventListener("theme", again);
      for (const each of [show, again, fit]) each.cancel();
      plot.destroy();
    },
  };
}

function rising(xs) {
  for (let index = 0; index < xs.length; index++)
    if (xs[index] === null || (index > 0 && xs[index] < xs[index - 1])) return false;
  return true;
}

/** What the colours of a chart mean: [{ label, colour, dash }]. */
export function legend(series) {
  const list = document.createElement("ul");
  list.className = "legend";
  for (const each of series) {
    const item = document.createElement("li");
    const swatch = document.createElement("span");
    swatch.className = each.dash ? "swatch dashed" : "swatch";
    swatch.style.borderColor = `var(${each.colour})`;
    item.append(swatch, each.label);
    list.append(item);
  }
  return list;
}
