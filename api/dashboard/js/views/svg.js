// Elements of SVG, for small drawings that need no chart.

const SPACE = "http://www.w3.org/2000/svg";

/** svg("circle", { cx: 1, class: "dot" }, child, [children], null). */
export function svg(tag, attributes = {}, ...children) {
  const node = document.createElementNS(SPACE, tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== null && value !== undefined) node.setAttribute(name, value);
  node.append(...children.flat(Infinity).filter((each) => each !== null && each !== undefined));
  return node;
}
