// The fields of a policy: what each means, what is usual and allowed, and how it is shown and moved.

/** As `models.verdict.Policy` has them. `low`, `high`: allowed; `from`, `to`: what the slider covers, where less. */
export const FIELDS = [
  {
    name: "false_rejects",
    label: "False-reject target",
    said: "Share of the good sweeps that may be NG: it sets the limits.",
    usual: 0.02,
    low: 0.0001,
    high: 0.5,
    percent: true,
    logarithmic: true,
  },
  {
    name: "sensitivity",
    label: "Sensitivity",
    said: "Above 1 finds weaker defects, below 1 forgives more.",
    usual: 1,
    low: 0.01,
    high: 100,
    from: 0.1,
    to: 10,
    logarithmic: true,
  },
  {
    name: "review_margin",
    label: "Review margin",
    said: "A highest score this close below the limit asks a person to look.",
    usual: 0.05,
    low: 0,
    high: 1,
    percent: true,
  },
  {
    name: "hysteresis",
    label: "Hysteresis",
    said: "A deviation goes on while its score stays above this share of the limit.",
    usual: 0.7,
    low: 0,
    high: 1,
    percent: true,
  },
  {
    name: "coverage",
    label: "Coverage",
    said: "Share of the sweep that must have been scored; less is INCOMPLETE.",
    usual: 0.95,
    low: 0,
    high: 1,
    percent: true,
  },
  {
    name: "invalid_share",
    label: "Invalid share",
    said: "More frames than this without a known place, or blind: INVALID.",
    usual: 0.5,
    low: 0,
    high: 1,
    percent: true,
  },
];

export const STEPS = 1000;

/** The policy where nobody said otherwise. */
export const usual = () => Object.fromEntries(FIELDS.map((field) => [field.name, field.usual]));

export const same = (one, other) => FIELDS.every(({ name }) => one[name] === other[name]);

const ends = (field) => [field.from ?? field.low, field.to ?? field.high];
const short = (value) => Number(value.toPrecision(3));

/** Where the slider stands, from 0 to STEPS; a value beyond its ends is at the end. */
export function toSlider(field, value) {
  const [from, to] = ends(field);
  const share = field.logarithmic ? Math.log(value / from) / Math.log(to / from) : (value - from) / (to - from);
  return Math.round(STEPS * Math.min(1, Math.max(0, share)));
}

/** The value of a slider, to three digits. */
export function fromSlider(field, position) {
  const [from, to] = ends(field);
  const share = position / STEPS;
  return short(field.logarithmic ? from * (to / from) ** share : from + (to - from) * share);
}

export const unit = (field) => (field.percent ? "%" : "×");
export const toShown = (field, value) => Number((field.percent ? 100 * value : value).toPrecision(6));
export const fromShown = (field, shown) => Number((field.percent ? shown / 100 : shown).toPrecision(6));
export const told = (field, value) => `${toShown(field, value)} ${unit(field)}`;

/** What is wrong with a value, or null. */
export function wrong(field, value) {
  if (Number.isFinite(value) && value >= field.low && value <= field.high) return null;
  return `allowed are ${told(field, field.low)} to ${told(field, field.high)}`;
}

/** What differs between two policies: "Sensitivity 1 × → 1.5 ×". */
export function differences(before, after) {
  return FIELDS.filter(({ name }) => before?.[name] !== after[name]).map(
    (field) => `${field.label} ${before ? `${told(field, before[field.name])} → ` : ""}${told(field, after[field.name])}`,
  );
}
