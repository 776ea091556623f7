(async () => {
  const LEAST_SIZE = 9, LEAST_CONTRAST = 4.5, SQUEEZED = { lines: 5, letters: 8 };
  const found = [];
  const channels = (colour) => {
    const m = colour.match(/rgba?\(([^)]+)\)/);
    if (!m) return null;
    const [r, g, b, a = 1] = m[1].split(/[ ,\/]+/).filter(Boolean).map(Number);
    return { r, g, b, a };
  };
  const light = ({ r, g, b }) => {
    const [x, y, z] = [r, g, b].map((v) => {
      v /= 255;
      return v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * x + 0.7152 * y + 0.0722 * z;
  };
  const over = (top, below) => ({
    r: top.r * top.a + below.r * (1 - top.a), g: top.g * top.a + below.g * (1 - top.a),
    b: top.b * top.a + below.b * (1 - top.a), a: 1,
  });
  const behind = (element) => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) {
      const colour = channels(getComputedStyle(e).backgroundColor);
      if (colour && colour.a > 0) layers.push(colour);
      if (colour && colour.a === 1) break;
    }
    return layers.reverse().reduce((below, top) => over(top, below), { r: 255, g: 255, b: 255, a: 1 });
  };
  const drawnBehind = (element) => {
    element.scrollIntoView({ block: "center" });
    const box = element.getBoundingClientRect();
    const at = [box.left + box.width / 2, box.top + box.height / 2];
    const page = behind(element.closest("svg"));
    for (const other of document.elementsFromPoint(...at)) {
      if (other === element || !(other instanceof SVGGeometryElement)) continue;
      const style = getComputedStyle(other);
      const colour = channels(style.fill);
      if (!colour || colour.a === 0) continue;
      return over({ ...colour, a: colour.a * Number(style.fillOpacity) * opacity(other) }, page);
    }
    return page;
  };
  const opacity = (element) => {
    let share = 1;
    for (let e = element; e; e = e.parentElement) share *= Number(getComputedStyle(e).opacity);
    return share;
  };
  for (const image of document.images)
    if (!image.complete || !image.naturalWidth) found.push(`broken picture ${image.src.slice(0, 60)}`);
  for (const film of document.querySelectorAll("video")) {
    const first = new Image();
    first.src = film.poster;
    if (!(await first.decode().then(() => film.poster, () => false))) found.push(`film that shows nothing ${film.src}`);
  }
  const root = document.documentElement;
  if (root.scrollWidth > window.innerWidth) {
    const wide = [...document.querySelectorAll("body *")].filter(
      (e) => e.getBoundingClientRect().right > window.innerWidth + 1);
    found.push(`overflow: ${root.scrollWidth} px of ${window.innerWidth}: ` +
      wide.slice(0, 3).map((e) => `${e.tagName}.${e.className.baseVal ?? e.className}`).join(", "));
  }
  for (const cell of document.querySelectorAll("td, th")) {
    const range = document.createRange(), said = cell.textContent.trim();
    range.selectNodeContents(cell);
    const lines = new Set([...range.getClientRects()].map((box) => Math.round(box.top))).size;
    if (lines >= SQUEEZED.lines && said.length < SQUEEZED.letters * lines)
      found.push(`squeezed cell, ${lines} lines: "${said.slice(0, 40)}"`);
  }
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const seen = new Set();
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    const text = walker.currentNode.textContent.trim();
    if (!text || !element || seen.has(element) || element.closest("script, style, title, desc, metadata, template"))
      continue;
    seen.add(element);
    const box = element.getBoundingClientRect();
    const style = getComputedStyle(element);
    if (!box.width || style.visibility === "hidden") continue;
    const svg = element instanceof SVGElement;
    const matrix = svg && element.getScreenCTM ? element.getScreenCTM() : null;
    const scale = matrix ? Math.hypot(matrix.a, matrix.b) : 1;
    const size = parseFloat(style.fontSize) * scale;
    const about = `${size.toFixed(1)} px: "${text.slice(0, 40)}"`;
    if (size < LEAST_SIZE - 0.05) found.push(`small text ${about}`);
    const ink = channels(svg ? style.fill : style.color);
    if (!ink) continue;
    const back = svg ? drawnBehind(element) : behind(element);
    const front = over({ ...ink, a: ink.a * opacity(element) }, back);
    const [a, b] = [light(front), light(back)];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < LEAST_CONTRAST) found.push(`faint text, contrast ${contrast.toFixed(2)}: ${about}`);
  }
  return [...new Set(found)];
})()
