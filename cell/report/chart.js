// D3 takes over the figures of a page: a pointer reads values off the paths, a drag, a pinch or
// Ctrl and the wheel move and zoom, a name in a legend hides its curves. In a narrow window panels
// stand below one another, each as wide as the window, with the text that they were drawn with.
(() => {
  const AT = 5, NEAR = 16; // from the pointer to a point that is read [pt]: before a field, beside one
  const STEPS = 1000, MOST = 40; // steps of an axis; largest zoom
  const NARROW = 560, TEXT = 1.125; // width of a narrow figure [px]; px a pt: 8 pt are 9 px
  const card = document.createElement("div");
  card.className = "reading";
  card.hidden = true;

  const scale = (axis, from, to) =>
    (axis.scale === "log" ? d3.scaleLog() : d3.scaleLinear()).domain(axis.limits).range([from, to]);
  const digits = (span) => Math.min(d3.precisionFixed(span / STEPS), span < 1 ? 9 : 2);
  const spoken = (axis, value) => {
    if (axis.words.length) return d3.least(axis.words, ([at]) => Math.abs(at - value))[1];
    const fixed = `.${digits(Math.abs(axis.limits[1] - axis.limits[0]))}f`;
    return `${d3.format(axis.scale === "log" ? ".3~g" : fixed)(value)} ${axis.unit}`.trim();
  };
  const pairs = /(-?[\d.]+) (-?[\d.]+)/g;

  const set = (element, name, value) =>
    value ? element.setAttribute(name, value) : element.removeAttribute(name);

  // Points of a curve as pieces without a gap, in units of the drawing.
  const pieces = (group) => {
    const marks = [...group.querySelectorAll("use")];
    if (marks.length) return marks.map((mark) => [[+mark.getAttribute("x"), +mark.getAttribute("y")]]);
    const path = group.querySelector("path")?.getAttribute("d") ?? "";
    return path.split("M").slice(1).map((piece) => [...piece.matchAll(pairs)].map(([, x, y]) => [+x, +y]));
  };

  // Areas come as marks at the drawing's corner: paths in their own place are read, zoomed, moved.
  const inline = (svg) => {
    const { height } = svg.viewBox.baseVal, taken = new Set();
    for (const use of svg.querySelectorAll("[id^=axes-] use")) {
      const [x, y] = [+use.getAttribute("x"), +use.getAttribute("y")];
      const drawn = svg.querySelector(`[id="${use.getAttribute("xlink:href").slice(1)}"]`);
      if (x || Math.abs(y - height) > 0.01 || !drawn) continue;
      const path = drawn.cloneNode();
      path.removeAttribute("id");
      path.setAttribute("d", drawn.getAttribute("d").replace(pairs, (_, a, b) => `${a} ${(+b + y).toFixed(3)}`));
      for (const name of ["style", "clip-path"]) set(path, name, use.getAttribute(name));
      use.replaceWith(path);
      taken.add(drawn);
    }
    const left = new Set([...svg.querySelectorAll("use")].map((use) => use.getAttribute("xlink:href").slice(1)));
    for (const drawn of taken) if (!left.has(drawn.id)) drawn.remove();
  };

  // Boxes of `panels` one below the other in a drawing `wide`, and its height; null where names
  // beside the panels leave too little of it.
  const stacked = (svg, panels, wide, { width, height }) => {
    const tops = d3.groups(d3.sort(panels, ({ box }) => box[1]), ({ box }) => Math.round(box[1]));
    const rows = tops.map(([, row]) => d3.sort(row, ({ box }) => box[0]));
    const bottom = (row) => d3.max(row, ({ box }) => box[3]);
    const left = d3.max(rows.flat(), (p, _, all) => {
      const row = rows.find((r) => r.includes(p)), before = row[row.indexOf(p) - 1];
      return p.box[0] - (before ? before.box[2] : 0);
    });
    const drawn = panels.map(({ id }) => svg.querySelector(`[id="${id}"]`).getBBox());
    const right = Math.min(width, d3.max(drawn, (b) => b.x + b.width)) - d3.max(panels, ({ box }) => box[2]);
    const span = wide - left - right, found = new Map();
    if (span < 0.45 * wide) return null;
    let y = 0;
    rows.forEach((row, i) => {
      const above = row[0].box[1] - (i ? bottom(rows[i - 1]) : 0);
      const below = (i + 1 < rows.length ? rows[i + 1][0].box[1] : height) - bottom(row);
      row.forEach(({ box, equal }, j) => {
        y += j ? below + (i + 1 < rows.length ? 0 : rows[0][0].box[1]) : above;
        const high = (box[3] - box[1]) * (equal ? span / (box[2] - box[0]) : 1);
        found.set(row[j], [left, y, left + span, y + high]);
        y += high;
      });
    });
    return { boxes: found, high: y + height - bottom(rows.at(-1)) };
  };

  // From a box to another one; what lies beyond an edge keeps its distance from it.
  const carry = (from, to, a, b) => (v) =>
    v <= from ? v - from + a : v >= to ? v - to + b : a + ((v - from) * (b - a)) / (to - from);

  const narrow = (svg, panels) => {
    const room = svg.parentElement.clientWidth, wide = room / TEXT, view = svg.viewBox.baseVal;
    const known = svg.querySelectorAll("[id^=axes-]").length === panels.length;
    const place = known && room < NARROW && wide < view.width && stacked(svg, panels, wide, view);
    if (!place) return;
    const all = [...svg.querySelectorAll("clipPath rect")];
    for (const [panel, to] of place.boxes) {
      const from = panel.box, X = carry(from[0], from[2], to[0], to[2]), Y = carry(from[1], from[3], to[1], to[3]);
      const group = svg.querySelector(`[id="${panel.id}"]`), legends = [...group.querySelectorAll("[id^=legend_]")];
      const places = new Map(panel.texts.map(([id, x, y]) => [id, [x, y]]));
      for (const e of group.querySelectorAll("path, use, text, image")) {
        if (e.closest("defs, [id^=legend_]")) continue;
        const [x, y] = [+e.getAttribute("x"), +e.getAttribute("y")];
        if (e.tagName === "path") {
          e.setAttribute("d", (e.getAttribute("d") ?? "").replace(pairs, (_, a, b) => `${X(+a).toFixed(3)} ${Y(+b).toFixed(3)}`));
        } else if (e.tagName === "use") {
          e.setAttribute("x", X(x));
          e.setAttribute("y", Y(y));
        } else if (e.tagName === "text") {
          const [a, b] = places.get(e.parentElement.id) ?? [x, y];
          move(e, X(a) - a, Y(b) - b);
        } else { // stored upside down
          const [w, h] = [+e.getAttribute("width"), +e.getAttribute("height")];
          const high = Y(h - y) - Y(-y);
          for (const [name, value] of Object.entries({ x: X(x), y: -Y(-y), width: X(x + w) - X(x), height: high }))
            e.setAttribute(name, value);
          e.setAttribute("transform", `scale(1 -1) translate(0 ${-high})`);
          e.setAttribute("preserveAspectRatio", "none");
        }
      }
      for (const legend of legends) {
        const { x, y, width, height } = legend.getBBox(), late = (v, [a, b]) => v > (a + b) / 2;
        const across = late(x + width / 2, [from[0], from[2]]) ? to[2] - from[2] : to[0] - from[0];
        const down = late(y + height / 2, [from[1], from[3]]) ? to[3] - from[3] : to[1] - from[1];
        move(legend, Math.max(across, -x), down);
      }
      for (const rect of all.filter((r) => Math.abs(r.getAttribute("x") - from[0]) + Math.abs(r.getAttribute("y") - from[1]) < 0.1)) {
        const [left, top, right, bottom] = to;
        for (const [name, value] of Object.entries({ x: left, y: top, width: right - left, height: bottom - top }))
          rect.setAttribute(name, value);
      }
      panel.box = to;
      panel.cells = panel.cells.map(([l, t, r, b, said]) => [X(l), Y(t), X(r), Y(b), said]);
      panel.texts = panel.texts.map(([id, x, y]) => [id, X(x), Y(y)]);
      thin(group, panel);
    }
    for (const legend of svg.querySelectorAll("[id^=legend_]")) { // above or below all panels
      if (legend.closest("[id^=axes-]")) continue;
      const { x, y, width } = legend.getBBox(), size = Math.min(1, wide / width);
      legend.setAttribute("transform", `translate(0 ${y < view.height / 2 ? y : y + place.high - view.height}) scale(${size}) translate(${-x} ${-y})`);
    }
    svg.setAttribute("viewBox", `0 0 ${wide} ${place.high}`);
    Object.assign(svg.style, { width: "100%", minWidth: 0 });
  };

  const move = (e, x, y) => e.setAttribute("transform", `translate(${x} ${y}) ${e.getAttribute("transform") ?? ""}`);

  // Every other number of an axis goes where they would touch, one under a name in the drawing, and
  // a name that its bar does not hold.
  const thin = (group, panel) => {
    const numbers = [...group.querySelectorAll("[id^=xtick_] text")], at = (e) => e.getBoundingClientRect();
    for (let step = 2; step < 9 && numbers.length > 1; step *= 2) {
      const shown = d3.sort(numbers.filter((e) => !e.style.display), (e) => at(e).x);
      if (d3.pairs(shown).every(([a, b]) => at(a).right + 2 < at(b).x)) break;
      shown.filter((_, i) => i % 2).forEach((e) => { e.style.display = "none"; });
    }
    for (const name of group.querySelectorAll("[id^=item-] text")) {
      const on = at(name), under = (b) => b.x < on.right && b.right > on.x && b.y < on.bottom && b.bottom > on.y;
      for (const e of numbers) if (under(at(e))) e.style.display = "none";
      for (const [l, , r, , said] of panel.cells)
        if (name.textContent === said && name.getBBox().width > r - l) name.style.display = "none";
    }
  };

  class Panel {
    constructor(svg, facts) {
      Object.assign(this, facts, { svg, zoomed: d3.zoomIdentity, dots: [] });
      this.group = svg.querySelector(`[id="${this.id}"]`);
      const [left, top, right, bottom] = this.box;
      this.scales = [scale(this.x, left, right), scale(this.y, bottom, top)];
      for (const curve of this.curves) {
        curve.group = this.group.querySelector(`[id="${curve.id}"]`);
        curve.pieces = curve.read ? pieces(curve.group) : [];
      }
      this.curves = this.curves.filter((curve) => curve.group);
      const read = this.curves.filter((curve) => curve.pieces.flat().length);
      [this.bands, this.readable] = [read.filter(({ band }) => band), read.filter(({ band }) => !band)];
      const ahead = ({ pieces }) => pieces.flat().every(([x], i, points) => !i || x >= points[i - 1][0] - 0.01);
      this.along = !this.equal && !this.x.words.length && !this.y.words.length && this.readable.every(ahead);
      this.movable = [...this.group.querySelectorAll("[id^=item-] :is(path, use)")].filter((e) => !e.closest("defs"))
        .map((e) => ({ e, d: e.getAttribute("d"), x: e.getAttribute("x"), y: e.getAttribute("y") }));
      this.moving = this.texts.map(([id, x, y]) => ({ e: this.group.querySelector(`[id="${id}"]`), x, y }))
        .filter(({ e }) => e);
      this.rule = d3.select(this.group).append("g").attr("class", "rule");
      this.pad = d3.select(this.group).append("rect").attr("class", "pad")
        .attr("x", left).attr("y", top).attr("width", right - left).attr("height", bottom - top);
      this.group.append(...this.group.querySelectorAll("[id^=legend_]"));
      this.pad
        .on("pointermove pointerdown", (event) => this.read(event))
        .on("pointerleave", (event) => event.pointerType === "mouse" && this.rest());
    }

    get mates() { return this.panels.filter((panel) => panel.share === this.share); }

    get zooms() {
      const plain = (axis) => ["linear", "log"].includes(axis.scale) && !axis.words.length;
      return this.readable.length > 0 && plain(this.x) && plain(this.y) && !this.group.querySelector("image");
    }

    zoomable() {
      const [left, top, right, bottom] = this.box, area = [[left, top], [right, bottom]];
      this.zoom = d3.zoom().scaleExtent([1, MOST]).extent(area).translateExtent(area)
        .filter((event) => !event.button && (event.type !== "wheel" || event.ctrlKey || event.metaKey) &&
          (event.type !== "touchstart" || event.touches.length > 1))
        .wheelDelta(({ deltaY, deltaMode }) => // a pinch on a trackpad comes as small steps
          -deltaY * (deltaMode ? 0.05 : 0.002) * (Math.abs(deltaY) < 40 ? 8 : 1))
        .on("zoom", (event) => this.follow(event.transform));
      this.pad.call(this.zoom).classed("zooms", true);
    }

    // All panels that share the axis show the same part of it.
    follow(t) {
      const [left, , right] = this.box, start = ((left - t.x) / t.k - left) / (right - left);
      for (const mate of this.mates) {
        const [from, , to] = mate.box;
        const shift = from - t.k * (from + start * (to - from));
        const its = mate === this ? t : d3.zoomIdentity.translate(shift, t.y).scale(t.k);
        mate.pad.property("__zoom", its);
        mate.show(its);
      }
      this.rest();
      this.whole(t.k > 1);
    }

    show(t) {
      this.zoomed = t;
      const zoomed = t.k > 1, X = (x) => t.applyX(x), Y = this.along ? (y) => y : (y) => t.applyY(y);
      const moved = (_, a, b) => `${X(+a).toFixed(3)} ${Y(+b).toFixed(3)}`;
      for (const { e, d, x, y } of this.movable)
        if (d) e.setAttribute("d", zoomed ? d.replace(pairs, moved) : d);
        else {
          e.setAttribute("x", zoomed ? X(+x) : x);
          e.setAttribute("y", zoomed ? Y(+y) : y);
          set(e, "visibility", !this.holds(X(+x), Y(+y)) && zoomed && "hidden");
        }
      for (const { e, x, y } of this.moving) {
        set(e, "transform", zoomed && `translate(${X(x) - x} ${Y(y) - y})`);
        set(e, "visibility", !this.holds(X(x), Y(y)) && zoomed && "hidden");
      }
      this.axis("x", t.rescaleX(this.scales[0]), zoomed);
      if (!this.along) this.axis("y", t.rescaleY(this.scales[1]), zoomed);
      this.svg.zoomed = t;
      this.svg.dispatchEvent(new Event("zoomed"));
    }

    holds(x, y) {
      const [left, top, right, bottom] = this.box;
      return x >= left - 1 && x <= right + 1 && y >= top - 1 && y <= bottom + 1;
    }

    // Ticks of what is shown take the place of those that were drawn.
    axis(which, shown, zoomed) {
      const drawn = this.group.querySelectorAll(`[id^=${which}tick_]`);
      for (const tick of drawn) set(tick, "display", zoomed && "none");
      const [left, top, right, bottom] = this.box, along = which === "x";
      const has = (what) => [...drawn].some((tick) => tick.querySelector(what));
      const count = along ? 7 : 5, ticks = zoomed && drawn.length ? shown.ticks(count) : [];
      const lines = d3.select(this.group).selectAll(`g.ticks.${which}`).data([0])
        .join((enter) => enter.insert("g", ":nth-child(2)").attr("class", `ticks ${which}`));
      const each = lines.selectAll("g").data(ticks).join("g")
        .attr("transform", (v) => (along ? `translate(${shown(v)} 0)` : `translate(0 ${shown(v)})`));
      if (has("path"))
        each.selectAll("path").data([0]).join("path").attr("d", along ? `M0 ${top}V${bottom}` : `M${left} 0H${right}`);
      if (has("text"))
        each.selectAll("text").data((v) => [v]).join("text").text(shown.tickFormat(count))
          .attr("x", along ? 0 : left - 3.5).attr("y", along ? bottom + 10 : 3);
    }

    whole(shown) {
      const lowest = d3.greatest(this.mates, ({ box }) => box[3]), [, , right, bottom] = lowest.box;
      lowest.back?.remove();
      if (!shown) return;
      lowest.back = d3.select(this.svg).append("g").attr("class", "whole")
        .attr("role", "button").attr("tabindex", 0).attr("transform", `translate(${right - 38} ${bottom + 13})`)
        .on("click keydown", (event) => {
          event.stopPropagation();
          if (event.type === "click" || event.key === "Enter") this.follow(d3.zoomIdentity);
        });
      lowest.back.append("rect").attr("width", 38).attr("height", 13).attr("rx", 3);
      lowest.back.append("text").attr("x", 19).attr("y", 9.4).text("show all");
    }

    read(event) {
      const [px, py] = d3.pointer(event, this.svg), t = this.zoomed;
      const readable = this.mates.some((mate) => mate.readable.length);
      const found = this.along && readable ? this.readAlong(px) : this.readPoint(px, py);
      for (const mate of this.mates) mate.mark(found.share);
      if (!found.rows.length) return this.rest();
      card.replaceChildren(...[found.head, ...found.rows].filter(Boolean).map((row) => {
        const line = document.createElement("p");
        for (const [i, part] of [row].flat().entries()) {
          const word = document.createElement(i === 1 ? "b" : "span");
          word.textContent = part.text ?? part;
          if (part.colour) word.style.setProperty("--key", part.colour);
          line.append(word);
        }
        return line;
      }));
      if (t.k === 1 && this.zoom && event.pointerType === "mouse") {
        const hint = document.createElement("small");
        hint.textContent = "double click or Ctrl + wheel: zoom; drag: move";
        card.append(hint);
      }
      card.hidden = false;
      const { width, height } = card.getBoundingClientRect(), room = document.documentElement.clientWidth;
      const beside = event.clientX + 16 + width < room ? event.clientX + 16 : event.clientX - 16 - width;
      card.style.left = `${Math.max(6, Math.min(beside, room - width - 6))}px`;
      card.style.top = `${Math.max(6, Math.min(event.clientY + 14, innerHeight - height - 6))}px`;
    }

    // What every curve over the shared axis is at one place of it.
    readAlong(px) {
      const rows = [], share = (px - this.box[0]) / (this.box[2] - this.box[0]);
      for (const mate of this.mates) {
        const at = mate.box[0] + share * (mate.box[2] - mate.box[0]), place = mate.zoomed.invertX(at);
        mate.dots = [];
        for (const curve of mate.readable) {
          const [x, y] = (!curve.hidden && pointAt(curve.pieces, place)) || [];
          if (y === undefined) continue;
          mate.dots.push([mate.zoomed.applyX(x), y, colour(curve)]);
          rows.push([{ text: curve.name, colour: colour(curve) }, spoken(mate.y, mate.scales[1].invert(y))]);
        }
        for (const band of mate.bands) {
          const ends = (!band.hidden && endsAt(band.pieces, place)) || [];
          const [low, high] = ends.map((y) => spoken(mate.y, mate.scales[1].invert(y)));
          const bare = low?.slice(0, mate.y.unit ? -mate.y.unit.length : undefined).trim();
          if (low) rows.push([{ text: band.name, colour: colour(band) }, `${bare} to ${high}`]);
        }
        for (const [left, , right, , said] of mate.cells) if (place >= left && place < right) rows.unshift(said);
      }
      const axis = this.mates.map((mate) => mate.x).find(({ name }) => name) ?? this.x;
      return { share, rows, head: [axis.name, spoken(axis, this.scales[0].invert(this.zoomed.invertX(px)))] };
    }

    // The point at the pointer, the field under it, or the point next to it.
    readPoint(px, py) {
      for (const mate of this.mates) mate.dots = [];
      const under = ([left, top, right, bottom]) => px >= left && px < right && py >= top && py <= bottom;
      const cell = this.cells.find(under);
      const near = this.readable.filter((curve) => !curve.hidden).map((curve) => {
        const away = ([x, y]) => Math.hypot(this.zoomed.applyX(x) - px, this.zoomed.applyY(y) - py);
        const point = d3.least(curve.pieces.flat(), away);
        return { curve, point, away: away(point) };
      });
      const best = d3.least(near, ({ away }) => away);
      if (cell && !(best?.away < AT)) return { rows: [cell[4]] };
      if (!(best?.away < NEAR)) return { rows: [] };
      const [x, y] = best.point, tint = colour(best.curve);
      this.dots = [[this.zoomed.applyX(x), this.zoomed.applyY(y), tint]];
      const row = (axis, of, at) => [axis.name, spoken(axis, of.invert(at))];
      const rows = [row(this.x, this.scales[0], x), row(this.y, this.scales[1], y)];
      return { head: [{ text: best.curve.name, colour: tint }], rows };
    }

    mark(share) {
      const [left, top, right, bottom] = this.box;
      this.rule.selectAll("line").data(share === undefined ? [] : [left + share * (right - left)]).join("line")
        .attr("x1", (x) => x).attr("x2", (x) => x).attr("y1", top).attr("y2", bottom);
      this.rule.selectAll("circle").data(this.dots).join("circle")
        .attr("cx", ([x]) => x).attr("cy", ([, y]) => y).attr("r", 2.6).style("fill", ([, , tint]) => tint);
    }

    rest() {
      card.hidden = true;
      for (const mate of this.mates) mate.rule.selectAll("*").remove();
    }
  }

  // The point of the curve at `place`, between those that were drawn; of marks, the one that is next.
  function pointAt(found, place) {
    for (const piece of found) {
      if (piece.length < 2) continue;
      const after = d3.bisector(([x]) => x).left(piece, place);
      if (after === 0 || after === piece.length) continue;
      const [[x0, y0], [x1, y1]] = [piece[after - 1], piece[after]];
      return [place, x1 > x0 ? y0 + ((y1 - y0) * (place - x0)) / (x1 - x0) : y1];
    }
    const marks = found.filter((piece) => piece.length === 1).map(([point]) => point);
    const next = d3.least(marks, ([x]) => Math.abs(x - place));
    return next && Math.abs(next[0] - place) < 3 ? next : null;
  }

  // Where an area between two curves begins and ends at `place`, from below.
  function endsAt(found, place) {
    const crossed = found.flatMap((piece) => d3.pairs([...piece, piece[0]]))
      .filter(([[a], [b]]) => a !== b && (a - place) * (b - place) <= 0)
      .map(([[x0, y0], [x1, y1]]) => y0 + ((y1 - y0) * (place - x0)) / (x1 - x0));
    return crossed.length ? d3.extent(crossed).reverse() : null;
  }

  function colour(curve) {
    const style = getComputedStyle(curve.group.querySelector("use, path"));
    return style.stroke === "none" ? style.fill : style.stroke;
  }

  // A name in a legend hides and shows what it names.
  function legends(svg, panels) {
    for (const name of svg.querySelectorAll("[id^=legend_] text")) {
      const curves = panels.flatMap((panel) => panel.curves).filter((curve) => curve.label === name.textContent);
      if (!curves.length) continue;
      const turn = (event) => {
        if (event.type === "keydown" && event.key !== "Enter") return;
        event.stopPropagation();
        for (const curve of curves) curve.group.style.display = (curve.hidden = !curve.hidden) ? "none" : "";
        name.classList.toggle("off", curves[0].hidden);
      };
      d3.select(name).classed("switch", true).attr("role", "button").attr("tabindex", 0).on("click keydown", turn);
    }
  }

  document.body.append(card);
  addEventListener("scroll", () => { card.hidden = true; }, true);
  addEventListener("pointerdown", ({ target }) => { card.hidden ||= !target.matches(".pad"); });
  for (const svg of document.querySelectorAll("svg[data-chart]")) {
    const facts = JSON.parse(svg.dataset.chart);
    inline(svg);
    narrow(svg, facts);
    const timed = facts.find(({ x }) => x.unit === "s"); // where a film beside it shows its moment
    if (timed) {
      const [left, , right] = timed.box, [first, last] = timed.x.limits, wide = svg.viewBox.baseVal.width;
      Object.assign(svg.dataset, { first, last, left: left / wide, right: right / wide });
    }
    const panels = facts.map((each) => new Panel(svg, each));
    for (const panel of panels) {
      panel.panels = panels;
      if (panel.zooms) panel.zoomable();
    }
    legends(svg, panels);
  }
})();
