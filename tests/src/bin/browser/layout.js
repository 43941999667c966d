// What is wrong with the texts on the page, in words: lying on each other, cut off, beside the
// window, or hard to read on their background. An expression.
(() => {
  const faults = [];
  const seen = (element) => {
    const style = getComputedStyle(element);
    return style.visibility !== "hidden" && style.display !== "none" && element.closest(".hoverlayer, .modebar, noscript, script, style, .tip") === null;
  };
  const inside = (box, [left, top, right, bottom]) => [Math.max(box[0], left), Math.max(box[1], top), Math.min(box[2], right), Math.min(box[3], bottom)];
  const sides = (r) => [r.left, r.top, r.right, r.bottom];
  const boxes = [];
  const add = (text, element, list) => {
    // What scrolls may be wider than its place; what is cut off otherwise is a fault.
    const scrolls = element.closest(".scroll, pre");
    const cuts = element.closest("[data-chart], .stage, .gallery button, .card, .bar");
    for (const rect of list) {
      let box = sides(rect);
      if (rect.width < 1 || rect.height < 1) continue;
      if (scrolls && getComputedStyle(scrolls).overflowX !== "visible") box = inside(box, sides(scrolls.getBoundingClientRect()));
      if (box[0] >= box[2] || box[1] >= box[3]) continue;
      const place = cuts ? sides(cuts.getBoundingClientRect()) : [0, -Infinity, document.documentElement.clientWidth, Infinity];
      const kept = inside(box, place);
      if (box.some((x, i) => Math.abs(x - kept[i]) > 1)) faults.push(`cut off: ${text} in ${cuts?.dataset.chart ?? cuts?.className ?? "window"}`);
      boxes.push({ text, element, box: box.map((x, i) => x + (i < 2 ? 1 : -1)) });
    }
  };
  // In the drawings of charts a text is one box, else each line of it.
  for (const element of document.querySelectorAll("[data-chart] text")) {
    if (element.textContent.trim() && seen(element)) add(element.textContent, element, [element.getBoundingClientRect()]);
  }
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode;
    const element = node.parentElement;
    if (!node.data.trim() || element.closest("svg") || !seen(element) || element.closest("details:not([open]) > :not(summary)")) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    add(node.data.trim(), element, range.getClientRects());
  }
  boxes.sort((a, b) => a.box[1] - b.box[1]);
  boxes.forEach((one, i) => {
    for (let k = i + 1; k < boxes.length && boxes[k].box[1] < one.box[3]; k += 1) {
      const other = boxes[k];
      const [left, , right] = inside(one.box, other.box);
      if (left < right && one.element !== other.element) faults.push(`${one.text} lies on ${other.text}`);
    }
  });
  // Contrast as WCAG has it, on the nearest opaque background.
  const parts = (text) => (text.match(/[\d.]+/g) ?? []).map(Number);
  const paint = (element) => (element.closest("svg") ? getComputedStyle(element).fill : getComputedStyle(element).color);
  const over = ([r, g, b, a = 1], under) => [r, g, b].map((x, i) => a * x + (1 - a) * under[i]);
  const ground = (element) => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) {
      const own = getComputedStyle(e).backgroundColor;
      const [r, g, b, a = 1] = own.startsWith("color(srgb") ? parts(own).map((x, i) => (i < 3 && own.includes("srgb") ? 255 * x : x)) : parts(own);
      layers.push([r, g, b, a]);
      if (a === 1) break;
    }
    return layers.reverse().reduce((under, layer) => over(layer, under), [255, 255, 255]);
  };
  const light = (colour) => {
    const [r, g, b] = colour.map((x) => (x / 255 <= 0.04045 ? x / 255 / 12.92 : ((x / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const contrast = (colour, under) => {
    const [a, b] = [light(over(colour, under)), light(under)];
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  };
  for (const { text, element } of boxes) {
    const found = contrast(parts(paint(element)), ground(element));
    if (found < 4.5) faults.push(`contrast ${found.toFixed(1)}: ${text}`);
  }
  return JSON.stringify(faults);
})()
