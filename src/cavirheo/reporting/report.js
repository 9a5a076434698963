// The report of very many curves: rows sorted and filtered, a curve's article and picture when they are asked for.
// Nothing is asked of any other place, and without this script the table and all articles are there.
"use strict";
(() => {
  const table = document.querySelector("table.curves"), body = table.tBodies[0];
  const rows = []; // a curve each, with the doubt that stands below it
  for (const row of [...body.rows]) {
    if (row.classList.contains("doubt")) rows[rows.length - 1].below.push(row);
    else {
      const link = row.querySelector("a"), badge = row.querySelector(".badge");
      const article = document.getElementById(link.hash.slice(1));
      rows.push({ row, link, article, below: [], verdict: badge.textContent.trim(), open: null, text: null });
    }
  }
  document.getElementById("articles").hidden = true;
  const make = (name, about = {}, ...inside) => {
    const made = Object.assign(document.createElement(name), about);
    made.append(...inside);
    return made;
  };

  // --- filter
  const counts = new Map();
  for (const one of rows) counts.set(one.verdict, (counts.get(one.verdict) || 0) + 1);
  const words = make("input", { type: "search", id: "words", placeholder: "name, file, message …", autocomplete: "off" });
  const verdict = make("select", { id: "verdict" }, new Option(`all verdicts (${rows.length})`, ""));
  if (counts.has("ok") && counts.size > 1) verdict.add(new Option(`not ok (${rows.length - counts.get("ok")})`, "!ok"));
  for (const [name, count] of counts) verdict.add(new Option(`${name} (${count})`, name));
  const shown = make("output", { id: "shown" });
  document.getElementById("finder").append(
    make("label", {}, "Find ", words), make("label", {}, "Verdict ", verdict), shown);
  const textOf = (one) => one.text ??= [one.row, ...one.below, one.article]
    .map((part) => part.textContent).join(" ").toLowerCase();
  const filter = () => {
    const asked = words.value.toLowerCase().split(/\s+/).filter(Boolean), wanted = verdict.value;
    let count = 0;
    for (const one of rows) {
      const fits = (!wanted || (wanted === "!ok" ? one.verdict !== "ok" : one.verdict === wanted))
        && asked.every((word) => textOf(one).includes(word));
      count += fits;
      for (const row of [one.row, ...one.below, ...(one.open ? [one.open] : [])]) row.hidden = !fits;
    }
    shown.value = `${count} of ${rows.length} curves`;
  };
  let waiting;
  words.addEventListener("input", () => { clearTimeout(waiting); waiting = setTimeout(filter, 150); });
  verdict.addEventListener("change", filter);

  // --- sort
  const heads = [...table.tHead.rows[0].cells];
  const valueOf = (cell) => {
    const text = cell.textContent.trim().replace("−", "-"), number = parseFloat(text.replace(/^[<>≤≥~]\s*/, ""));
    return Number.isNaN(number) ? null : number;
  };
  const order = (column) => {
    const head = heads[column], down = head.getAttribute("aria-sort") === "ascending", way = down ? -1 : 1;
    for (const other of heads) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const words = column < 2; // the others are numbers, and what has none comes last
    const keyed = rows.map((one) => {
      const cell = one.row.cells[column];
      return [words ? cell.textContent.trim() : valueOf(cell), one];
    });
    const compare = new Intl.Collator("en", { numeric: true }).compare;
    keyed.sort(([a], [b]) => words ? way * compare(a, b) : (a === null) - (b === null) || way * (a - b));
    const all = document.createDocumentFragment();
    for (const [, one] of keyed) all.append(one.row, ...one.below, ...(one.open ? [one.open] : []));
    body.append(all);
  };
  heads.forEach((head, column) => {
    const button = make("button", { type: "button", title: "sort" });
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => order(column));
  });

  // --- a curve and its picture
  const close = (one) => {
    one.open.remove();
    one.open = null;
    one.link.setAttribute("aria-expanded", "false");
  };
  const open = (one) => {
    const cell = make("td", { colSpan: heads.length }, one.article);
    one.open = make("tr", { className: "open" }, cell);
    (one.below.at(-1) || one.row).after(one.open);
    one.link.setAttribute("aria-expanded", "true");
    const figure = one.article.querySelector("figure[data-trace]");
    if (figure && !figure.firstChild) draw(figure, JSON.parse(figure.dataset.trace));
  };
  for (const one of rows) one.link.setAttribute("aria-expanded", "false");
  const byId = new Map(rows.map((one) => [one.article.id, one]));
  const asked = () => {
    const one = byId.get(location.hash.slice(1));
    if (!one) return;
    if (!one.open) open(one);
    one.row.scrollIntoView({ block: "start" });
  };
  body.addEventListener("click", (event) => {
    const one = rows.find((one) => one.link === event.target.closest("a"));
    if (!one) return;
    event.preventDefault();
    if (one.open) close(one); else open(one);
  });
  body.addEventListener("keydown", (event) => {
    const here = event.target.closest("tr");
    const one = event.key === "Escape" && rows.find((one) => one.open && (one.row === here || one.open === here));
    if (one) { close(one); one.link.focus(); }
  });
  addEventListener("hashchange", asked);

  // --- the picture: measured, simulated, and what is left between
  const SVG = "http://www.w3.org/2000/svg", LEFT = 62, WIDE = 720, TOP = 24, UPPER = 230, GAP = 26, LOWER = 90;
  const numbers = (text) => new Uint16Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const ticks = (low, high, count) => {
    const rough = (high - low) / count, ten = 10 ** Math.floor(Math.log10(rough));
    const step = ten * [1, 2, 5, 10].find((k) => k * ten >= rough), found = [];
    for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(+(k * step).toPrecision(10));
    return found;
  };
  function draw(figure, about) {
    const part = (name, attributes, text) => {
      const made = document.createElementNS(SVG, name);
      for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
      if (text !== undefined) made.textContent = text;
      svg.append(made);
    };
    const svg = document.createElementNS(SVG, "svg"), answered = about.simulated !== "";
    const bottom = TOP + UPPER, zero = bottom + GAP + LOWER / 2, end = answered ? zero + LOWER / 2 : bottom;
    svg.setAttribute("viewBox", `0 0 ${LEFT + WIDE + 10} ${end + 40}`);
    svg.setAttribute("role", "img");
    svg.setAttribute("aria-label", "measured radius over time" + (answered ? `, ${about.line} and residual` : ""));
    const places = (text, top, tall) => {
      const all = numbers(text), n = all.length / 2;
      return Array.from({ length: n }, (_, k) => [LEFT + all[k] / 65535 * WIDE, top + tall * (1 - all[n + k] / 65535)]);
    };
    const dots = (text, top, tall, look) => places(text, top, tall)
      .forEach(([cx, cy]) => part("circle", { cx: cx.toFixed(1), cy: cy.toFixed(1), r: 2, class: look }));
    const axis = (top, tall, low, high, label, count) => {
      for (const value of ticks(low, high, count)) {
        const y = top + tall * (1 - (value - low) / (high - low));
        part("line", { x1: LEFT, x2: LEFT + WIDE, y1: y, y2: y, class: "grid" });
        part("text", { x: LEFT - 6, y: y + 4, "text-anchor": "end" }, value);
      }
      part("rect", { x: LEFT, y: top, width: WIDE, height: tall, class: "frame" });
      const middle = top + tall / 2;
      part("text", { transform: `translate(14 ${middle}) rotate(-90)`, "text-anchor": "middle" }, label);
    };
    axis(TOP, UPPER, 0, about.y, about.labels[1], 5);
    dots(about.outside, TOP, UPPER, "outside");
    dots(about.measured, TOP, UPPER, "measured");
    if (answered) {
      const line = places(about.simulated, TOP, UPPER).map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
      part("polyline", { points: line, class: "simulated" });
      const band = about.rmse / about.reach * LOWER;
      part("rect", { x: LEFT, y: zero - band / 2, width: WIDE, height: band, class: "band" });
      axis(zero - LOWER / 2, LOWER, -about.reach, about.reach, "residual (%)", 3);
      dots(about.residual, zero - LOWER / 2, LOWER, "residual");
    }
    const [low, high] = about.x;
    for (const value of ticks(low, high, 8)) {
      const x = LEFT + (value - low) / (high - low) * WIDE;
      part("line", { x1: x, x2: x, y1: end, y2: end + 4, class: "tick" });
      part("text", { x, y: end + 17, "text-anchor": "middle" }, value);
    }
    part("text", { x: LEFT + WIDE / 2, y: end + 34, "text-anchor": "middle" }, about.labels[0]);
    part("text", { x: LEFT, y: 14 }, answered
      ? `dots: measured, grey where not compared; line: ${about.line}; below: their difference, band ± RMSE`
      : "dots: measured");
    figure.append(svg);
  }
  filter();
  asked();
})();
