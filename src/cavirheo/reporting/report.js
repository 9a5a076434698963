// The curves of a report, sorted and filtered: their rows, and what is known of each below the table.
// Nothing is asked of any other place, and without this script all is there.
"use strict";
(() => {
  const table = document.querySelector("table.curves"), body = table.tBodies[0];
  const rows = []; // of each curve its row and its article
  for (const row of body.rows) {
    const article = document.getElementById(row.querySelector("a").hash.slice(1));
    rows.push({ row, article, verdict: row.querySelector(".badge").textContent.trim(), text: null });
  }
  const articles = document.getElementById("articles");
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
  const textOf = (one) => one.text ??= [one.row, one.article]
    .map((part) => part.textContent).join(" ").toLowerCase();
  const filter = () => {
    const asked = words.value.toLowerCase().split(/\s+/).filter(Boolean), wanted = verdict.value;
    let count = 0;
    for (const one of rows) {
      const fits = (!wanted || (wanted === "!ok" ? one.verdict !== "ok" : one.verdict === wanted))
        && asked.every((word) => textOf(one).includes(word));
      count += fits;
      for (const part of [one.row, one.article]) part.hidden = !fits;
    }
    shown.value = `${count} of ${rows.length} curves`;
  };
  let waiting;
  words.addEventListener("input", () => { clearTimeout(waiting); waiting = setTimeout(filter, 150); });
  verdict.addEventListener("change", filter);

  // --- sort
  const heads = [...table.tHead.rows[0].cells];
  const valueOf = (cell) => {
    const text = cell.textContent.trim().replace("−", "-"), number = parseFloat(text.replace(/^(below|above) /, ""));
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
    for (const [, one] of keyed) all.append(one.row);
    body.append(all);
    articles.append(...keyed.map(([, one]) => one.article));
  };
  heads.forEach((head, column) => {
    const button = make("button", { type: "button", title: "sort" });
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => order(column));
  });

  filter();
})();
