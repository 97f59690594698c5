// Control limits of a p-chart: how far a share may stray from its mean by chance.

const SIGMAS = 3;
const RUN = 8;

/**
 * groups: [{ parts, rejected }]. Returns { mean, points: [{ share, low, high, out, run }] }.
 *
 * The limits of a group of n parts are mean ± 3 √(mean (1 − mean) / n), within 0 and 1: smaller groups have wider ones.
 * out: beyond its limits, which chance does once in some 370 groups. run: the eighth or later of groups in a row on one
 * side of the mean, which chance does once in some 128.
 */
export function control(groups) {
  const parts = groups.reduce((sum, each) => sum + each.parts, 0);
  const rejected = groups.reduce((sum, each) => sum + each.rejected, 0);
  const mean = parts ? rejected / parts : NaN;
  let side = 0;
  let length = 0;
  const points = groups.map((each) => {
    if (!each.parts) return { share: null, low: null, high: null, out: false, run: false };
    const share = each.rejected / each.parts;
    const reach = SIGMAS * Math.sqrt((mean * (1 - mean)) / each.parts);
    const [low, high] = [Math.max(0, mean - reach), Math.min(1, mean + reach)];
    const now = Math.sign(share - mean);
    length = now !== 0 && now === side ? length + 1 : 1;
    side = now;
    return { share, low, high, out: share > high || share < low, run: now !== 0 && length >= RUN };
  });
  return { mean, points };
}
