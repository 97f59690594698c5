// The difference between expected and seen, to be laid over a picture: too dark is striped, too bright is not.

const STRIPE = 6; // px of the picture from one stripe to the next

/** A picture of differences, in which what is blue, too dark, becomes striped. */
export async function striped(blob) {
  return stripes(await pixels(blob));
}

function stripes(image) {
  const { data, width, height } = image;
  const canvas = new OffscreenCanvas(width, height);
  for (let y = 0, at = 0; y < height; y++)
    for (let x = 0; x < width; x++, at += 4)
      if (data[at + 2] > data[at] && (x + y) % STRIPE < STRIPE / 3) data[at + 3] >>= 2;
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

const QUIET = 12; // grey levels that two good pictures may differ by
const FULL = 60;

/** What `other` shows brighter or darker than `one`, both Blobs of one size: striped ink, as of the service. */
export async function between(one, other) {
  const [a, b] = await Promise.all([pixels(one), pixels(other)]);
  const { width, height } = a;
  const image = new ImageData(width, height);
  const ink = image.data;
  for (let at = 0; at < ink.length; at += 4) {
    const by = grey(b.data, at) - grey(a.data, at);
    const cover = Math.min(1, (Math.abs(by) - QUIET) / (FULL - QUIET));
    if (cover <= 0) continue;
    ink.set(by > 0 ? [255, 140, 0, 255 * cover] : [30, 110, 255, 255 * cover], at);
  }
  return stripes(image);
}

const grey = (data, at) => 0.299 * data[at] + 0.587 * data[at + 1] + 0.114 * data[at + 2];

async function pixels(blob) {
  const bitmap = await createImageBitmap(blob);
  const pen = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d", { willReadFrequently: true });
  pen.drawImage(bitmap, 0, 0);
  bitmap.close();
  return pen.getImageData(0, 0, pen.canvas.width, pen.canvas.height);
}
