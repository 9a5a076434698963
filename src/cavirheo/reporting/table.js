// The table of shots of the report and of the app: a click on the head of a column sorts the rows, and so does Enter.
"use strict";
{
  const sortRows = (head) => {
    const body = head.closest("table").tBodies[0], column = head.cellIndex;
    const way = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
    const valueOf = (row) => {
      const text = row.cells[column].textContent.trim();
      const number = parseFloat(text.replace("−", "-").replace(/^(below|above) /, ""));
      return column === 0 || column === row.cells.length - 1 ? text : Number.isNaN(number) ? null : number;
    };
    const compare = new Intl.Collator("en", { numeric: true }).compare;
    const rows = [...body.rows].filter((row) => !row.matches(".doubt"));
    const sorted = rows.map((row) => [valueOf(row), row, row.nextElementSibling]).sort(([a], [b]) =>
      typeof a === "string" ? way * compare(a, b) : (a === null) - (b === null) || way * (a - b));
    for (const [, row, next] of sorted) body.append(row, ...(next?.matches(".doubt") ? [next] : []));
  };
  const headOf = (event) => event.target.closest("table.curves thead th");
  document.addEventListener("click", (event) => { const head = headOf(event); if (head) sortRows(head); });
  document.addEventListener("keydown", (event) => {
    if (["Enter", " "].includes(event.key) && headOf(event)) sortRows(headOf(event));
  });
  for (const head of document.querySelectorAll("table.curves thead th")) head.tabIndex = 0;
}
