// A don't-care mask as the service reads it: a PNG of the pictures' size, white where nothing is said, in base64.

/**
 * `masks`: rectangles of kind `ignore` or `window`; outside of all windows nothing is said, where there are any.
 * `before`: a canvas of that size, opaque where nothing is said already; or null.
 */
export async function maskPng(masks, width, height, before = null) {
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const pen = canvas.getContext("2d");
  const windows = masks.filter((each) => each.kind === "window");
  const fill = (colour, those) => {
    pen.fillStyle = colour;
    for (const { x, y, width: across, height: down } of those) pen.fillRect(x, y, across, down);
  };
  fill(windows.length ? "#fff" : "#000", [{ x: 0, y: 0, width, height }]);
  fill("#000", windows);
  fill("#fff", masks.filter((each) => each.kind === "ignore"));
  if (before) pen.drawImage(before, 0, 0);
  const blob = await new Promise((done) => canvas.toBlob(done, "image/png"));
  const bytes = new Uint8Array(await blob.arrayBuffer());
  let text = "";
  for (const byte of bytes) text += String.fromCharCode(byte);
  return btoa(text);
}
